//! Entries of the list of baselines.

use reactsim_rollout::Controller;
use serde::de::DeserializeOwned;

use super::{ModelError, Setup, weights};

/// Builds a simulator.
pub type Make = fn(Setup) -> Result<Controller, ModelError>;

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
    pub make: Make,
}

impl Baseline {
    /// Creates the entry of a simulator without weights, which runs by default.
    pub const fn of_rules(id: &'static str, card: &'static str, ranges: &'static str, make: Make) -> Self {
        let (oracle, takes_stage, by_default, needs_weights) = (false, true, true, false);
        Self { id, card, ranges, oracle, takes_stage, by_default, needs_weights, make }
    }

    /// Creates the entry of a network, which is run by its id.
    pub const fn of_network(id: &'static str, card: &'static str, ranges: &'static str, make: Make) -> Self {
        Self { by_default: false, needs_weights: true, ..Self::of_rules(id, card, ranges, make) }
    }

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

    /// Returns the parameters of the card.
    ///
    /// # Errors
    /// [`ModelError`] if the card or its ranges cannot be read; a test rules it out.
    pub fn parameters<T: DeserializeOwned>(&self) -> Result<T, ModelError> {
        Setup::new(self.id, self.card, self.ranges, None)?.parameters()
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
