//! The metrics of the benchmark: scores of finished rollouts. This module knows maps, tracks and numbers, not
//! simulators.
// Tests may call the mathematical functions of the platform: their comparisons have tolerances.
#![cfg_attr(test, allow(clippy::disallowed_methods))]

mod ade;
mod agent_agent;
mod av;
mod boxes;
mod cache;
mod case;
mod collision;
mod deviation;
mod direction;
mod event;
mod judgement;
mod kinematics;
mod likelihood;
mod light;
mod log_clinging;
mod metrics;
mod motion;
mod object;
mod offroad;
mod options;
mod over_reaction;
mod progress;
mod red_light;
mod responders;
mod score;
mod scores;
mod spec;
mod ttc;
mod undisturbed;
pub mod wosac;

pub use ade::Displacement;
pub use agent_agent::{Overlaps, pair_counts};
pub use av::AvScores;
pub use case::Case;
pub use collision::{BEHIND_DEGREES, Contact, Fault, STOPPED_SPEED};
pub use deviation::DeviationStats;
pub use direction::{WrongWay, WrongWayInterval};
pub use event::{EVENT_UNITS, Event};
pub use judgement::Judgement;
pub use kinematics::{InfeasibleMotion, ViolationInterval, Violations};
pub use light::ObservedLight;
pub use likelihood::KinematicLikelihood;
pub use metrics::{MetricError, Metrics, check_own};
pub use motion::Motion;
pub use object::{LoggedTrack, Object};
pub use offroad::OffRoadSteps;
pub use options::{
    CurvatureYaw, DirCandidate, DirConnector, DirTracking, FaultOrder, OptionDescription, OptionError,
    Options, VelocitySource,
};
pub use score::Score;
pub use scores::{AgentScores, METRICS, REMOVED_METRICS, RolloutScores, Scores, metric, score_case};
use spec::OfBenchmark;
pub use spec::{Metric, MetricSpec, Scope, Unit};
pub use ttc::{Approach, is_front, placement};
