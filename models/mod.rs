//! The baselines: one folder each, with the simulator, its card and its entry in [`MODELS`].

mod card;
mod error;
pub mod constant_velocity;
pub mod ctg;
pub mod diffusion;
pub mod diffusion_planner;
pub mod idm;
mod joint_plan;
pub mod learning;
pub mod log_replay;
pub mod nn;
pub mod ntp;
mod parameters;
pub mod perception;
pub mod pufferdrive;
pub mod qp_regression;
pub mod qp;
mod ranges;
mod setup;
pub mod stop;
pub mod vbd;
pub mod weights;

pub use card::{Card, CardError};
pub use error::ModelError;
pub use parameters::Parameters;
pub use ranges::{Allowed, ParameterRange, Ranges};
pub use setup::Setup;
pub use weights::WeightsFile;

use reactsim::models::learning::TrainingTask;
use reactsim::rollout::Controller;

/// A baseline, as listed by `--models` and in tables.
#[derive(Clone, Copy, Debug)]
pub struct Baseline {
    /// Stable id, such as `idm`.
    pub id: &'static str,
    /// Text of its card (TOML): description, parameters and their sources.
    pub card: &'static str,
    /// Text of the units and ranges of these parameters (TOML); empty if there are none.
    pub ranges: &'static str,
    /// Whether the simulator sees the log's future (†).
    pub oracle: bool,
    /// Whether a trajectory stage can follow it. False where the motion is the log's or already
    /// comes from the stage.
    pub takes_stage: bool,
    /// Whether it runs if no simulators are named. The others are run by their ids, or by `all`.
    pub by_default: bool,
    /// Whether the simulator needs weights.
    pub needs_weights: bool,
    /// Builds the simulator.
    pub make: fn(Setup) -> Result<Controller, ModelError>,
}

impl Baseline {
    /// Returns the default setup: the parameters of the card and the weights that ship with the
    /// program.
    ///
    /// # Errors
    /// [`ModelError`], for example if the card or its ranges cannot be read. Missing weights are not an error
    /// here.
    pub fn setup(&self) -> Result<Setup, ModelError> {
        let weights = if self.needs_weights { weights::shipped(self.id)? } else { None };
        Setup::new(self.id, self.card, self.ranges, weights)
    }

    /// Returns whether it can be built without weights from elsewhere.
    pub fn is_complete(&self) -> bool {
        !self.needs_weights || matches!(weights::shipped(self.id), Ok(Some(_)))
    }

    /// Builds the simulator with the parameters of the card and the weights that ship with the
    /// program.
    ///
    /// # Errors
    /// [`ModelError`], for example if the weights do not ship.
    pub fn simulator(&self) -> Result<Controller, ModelError> {
        (self.make)(self.setup()?)
    }
}

/// All baselines, in the order in which tables list them.
pub const MODELS: &[Baseline] = &[
    log_replay::ENTRY,
    constant_velocity::ENTRY,
    stop::ENTRY,
    idm::ENTRY,
    ntp::entries::REACTIVE,
    ntp::entries::REACTIVE_RAW,
    ntp::guarded::GUARDED,
    ntp::entries::SMART,
    ntp::entries::SMART_PROJECTED,
    ntp::entries::SMART_SMALL,
    ntp::entries::TRAJTOK_SMALL,
    ntp::entries::CATK_SMALL,
    ntp::entries::SMART_REACTIVE,
    ntp::entries::TOKEN_REPLAY,
    pufferdrive::ENTRY,
    qp_regression::entries::QP_REGRESSION,
    qp_regression::entries::REGRESSION,
    qp_regression::entries::MTR,
    vbd::entries::VBD,
    vbd::entries::VBD_INPAINTING,
    ctg::entries::CTG_CLONING,
    ctg::entries::CTG_DIFFUSION,
    ctg::entries::CTG_GUIDED,
];

/// Returns the baseline with this id.
pub fn find(id: &str) -> Option<&'static Baseline> {
    MODELS.iter().find(|m| m.id == id)
}

/// All training tasks.
pub const TASKS: &[TrainingTask] = &[
    ntp::learn::TASK,
    ntp::smart::learn::TASK,
    ntp::smart::learn::catk::TASK,
    ntp::smart::learn::grpo::TASK,
    qp_regression::learn::TASK,
    vbd::learn::TASK,
    ctg::learn::TASK,
    diffusion_planner::learn::TASK,
];

/// Returns the training task with this id or earlier name.
pub fn find_task(id: &str) -> Option<&'static TrainingTask> {
    TASKS.iter().find(|task| task.id == id || task.also.contains(&id))
}
