//! The data types of scenarios: agents, tracks, maps and lights; and the motion of vehicles ([`dynamics`]).
//! This module depends on geometry only.

mod agent;
mod all_agents;
mod assemble;
mod certificate;
mod contradictions;
mod digest;
pub mod dynamics;
mod error;
mod headings;
pub mod levels;
pub mod limits;
mod lights;
mod map;
mod map_index;
mod named;
mod notes;
mod parts;
mod scenario;
mod shared_map;
mod time;
mod undrivable_links;
mod velocities;
pub mod wosac;

pub use agent::{Agent, AgentKind, AgentState, Frame, LoggedAgent};
pub use certificate::{
    Certificate, Difficulty, EASY_DECELERATION, EASY_TIME_TO_REACT, Effort, HARD_DECELERATION,
    HARD_TIME_TO_REACT, Response,
};
pub use contradictions::VelocityContradiction;
pub use error::{SceneError, brief};
pub use levels::MapHeights;
pub use lights::{LightState, TrafficLight};
pub use map::{
    Crosswalk, LANE_HALF_WIDTH, Lane, LaneArea, LaneClass, LaneKind, LaneNeighbor, RoadEdge, RoadEdgeKind,
    RoadLine, RoadMap, StopKind, StopLine, Surface,
};
pub use map_index::{LaneHit, MapIndex, Road};
pub use notes::{EARLIER_FRAME, LATER_FRAME, Note, Notes, note_text, unknown_type};
pub use parts::{
    DeviationParts, LaneParts, LightParts, MapParts, NeighborParts, ScenarioParts, StopLineParts,
};
pub use scenario::{DeviatedTrack, Deviation, LogFuture, MAX_AGENTS, OBSERVED_DISTANCE, Scenario, Start};
pub use shared_map::SharedMap;
pub use time::{CURRENT, DT, FRAMES, FUTURE, HISTORY, Length};
pub use velocities::estimate_av_velocities;
