//! The baselines. Each is a folder: its simulator, its card, its line in [`MODELS`].

mod card;
pub mod constant_velocity;
pub mod idm;
pub(crate) mod learning;
pub mod log_replay;
pub mod nn;
pub mod ntp;
pub mod pufferdrive;
pub mod qp_regression;
pub mod qp;
mod setup;
pub mod stop;
pub mod weights;

pub use card::{Card, CardError};
pub use setup::{ModelError, Setup};
pub use weights::WeightsFile;

use reactsim::rollout::Controller;

/// A baseline: what `--models` and the tables name.
#[derive(Clone, Copy, Debug)]
pub struct Baseline {
    /// Stable id, such as `idm`.
    pub id: &'static str,
    /// The text of its card (TOML): what it is, its parameters and their sources.
    pub card: &'static str,
    /// Whether it is shown the log's future (†).
    pub oracle: bool,
    /// Whether a stage can be put behind it: not where its motion is the log's, or comes out of the stage already.
    pub takes_stage: bool,
    /// Whether it needs weights.
    pub needs_weights: bool,
    /// Makes its simulator.
    pub make: fn(Setup) -> Result<Controller, ModelError>,
}

impl Baseline {
    /// What it is made from where nothing else is asked for: the parameters of its card and the weights that ship with the program.
    ///
    /// # Errors
    /// [`ModelError`], as for a card that can not be read. That there are no weights is no error yet.
    pub fn setup(&self) -> Result<Setup, ModelError> {
        let weights = if self.needs_weights { weights::shipped(self.id)? } else { None };
        Ok(Setup::new(self.id, self.card, weights)?)
    }

    /// Whether it can be made without weights from elsewhere.
    pub fn is_complete(&self) -> bool {
        !self.needs_weights || matches!(weights::shipped(self.id), Ok(Some(_)))
    }

    /// Makes its simulator with the parameters of its card and the weights that ship with the program.
    ///
    /// # Errors
    /// [`ModelError`], as for weights that do not ship.
    pub fn simulator(&self) -> Result<Controller, ModelError> {
        (self.make)(self.setup()?)
    }
}

/// All baselines, in the order of the tables.
pub const MODELS: &[Baseline] = &[
    log_replay::ENTRY,
    constant_velocity::ENTRY,
    stop::ENTRY,
    idm::ENTRY,
    ntp::entries::REACTIVE,
    ntp::entries::REACTIVE_RAW,
    ntp::entries::SMART,
    ntp::entries::SMART_PROJECTED,
    pufferdrive::ENTRY,
    qp_regression::entries::QP_REGRESSION,
    qp_regression::entries::REGRESSION,
];

/// The baseline with this id.
pub fn find(id: &str) -> Option<&'static Baseline> {
    MODELS.iter().find(|m| m.id == id)
}
