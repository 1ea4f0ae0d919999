//! The rollout protocol: what each participant observes, and when (ReactSim-Bench, Algorithms 1 and 2).
//! Depends on scenes, but on no particular simulator.
// Tests may call the mathematical functions of the platform: their comparisons have tolerances.
#![cfg_attr(test, allow(clippy::disallowed_methods))]

mod av;
mod engine;
mod entering;
mod episode;
mod mix;
mod observation;
mod running;
mod settings;
mod stream;
mod track_heights;
mod view;

pub use av::{
    Av, AvError, AvPolicy, DeviatedAv, LogAv, LoggedDrive, MAX_STEP_DISPLACEMENT, ParseScriptError, Script,
    ScriptedAv, SimulatedAv,
};
pub use engine::{
    ENTERED, ENTERED_LATE, KEPT_OUT, LEFT, Lockstep, OVER_LIMIT, PAST_ROAD_END, PLANNED_ALONE, Request,
    Rollout, RolloutBeginning, RolloutError, roll_out, roll_out_while,
};
pub use entering::{Entered, Entering, MAX_PRESENT};
pub use episode::{
    Beginning, Continuation, Controller, Episode, Identity, JointPlan, Memory, NOT_FINITE, Oracle, PlanError,
    Planning, Simulator, SingleEpisode,
};
pub use mix::{Mix, MixMember};
pub use observation::Observation;
pub use settings::{ParseReplanError, Protocol, Replan, Settings};
pub use stream::{Purpose, Stream, stream};
