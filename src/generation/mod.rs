//! Generated scenarios: parametric maps, microscopic traffic, a driver of which is the AV. They are what the program ships, since
//! recordings may not be passed on, and what small networks are trained on.

mod draw;
mod in_order;
mod layout;
pub mod maps;
pub mod realism;
mod scenario;
mod settings;
pub mod traffic;

pub use draw::Draw;
pub use in_order::{Ending, in_order};
pub use layout::{Entry, Footway, Layout, ParkingSpot, Priority, RightOfWay, SignalPlan};
pub use settings::{GenerationSettings, Preset};

use crate::scene::{Scenario, SceneError};

/// Version of the generator: raised whenever the same settings and numbers give other scenarios, or other deviated AVs, than before.
pub const VERSION: u32 = 2;

/// Why no scenario could be generated.
#[derive(Debug, thiserror::Error)]
pub enum GenerationError {
    /// A map type that does not exist.
    #[error("there is no map type `{name}`; there are: {known}")]
    UnknownMap {
        /// What was asked for.
        name: String,
        /// What there is.
        known: String,
    },
    /// A density that makes no sense.
    #[error("density {0}: expected a number above 0 and up to 3")]
    Density(f64),
    /// However often traffic was drawn: no driver could be the AV, or there was an accident.
    #[error(
        "{id}: in {attempts} attempts no driver could be the AV in traffic without accidents; allow more map types or another density"
    )]
    Fruitless {
        /// The scenario.
        id: String,
        /// How often it was tried.
        attempts: u32,
    },
    /// What was generated is no scenario: a bug.
    #[error(transparent)]
    Scene(#[from] SceneError),
}

/// Makes scenarios by number.
#[derive(Clone, Debug)]
pub struct Generator {
    settings: GenerationSettings,
}

impl Generator {
    /// Checks the settings.
    ///
    /// # Errors
    /// [`GenerationError`] names a map type that does not exist, and a density that is no positive number up to 3.
    pub fn new(settings: GenerationSettings) -> Result<Self, GenerationError> {
        let known = || maps::MAP_TYPES.iter().map(|m| m.id).collect::<Vec<_>>().join(", ");
        for name in &settings.maps {
            if !maps::MAP_TYPES.iter().any(|m| m.id == name) {
                return Err(GenerationError::UnknownMap { name: name.clone(), known: known() });
            }
        }
        match settings.density {
            Some(density) if !(density > 0.0 && density <= 3.0) => Err(GenerationError::Density(density)),
            _ => Ok(Self { settings }),
        }
    }

    /// The scenario of this number. It depends on settings and number only, so any number of threads may share a generator.
    ///
    /// # Errors
    /// [`GenerationError::Fruitless`] when no traffic on the allowed maps has a driver who can be the AV;
    /// [`GenerationError::Scene`] would be a bug.
    pub fn scenario(&self, number: u64) -> Result<Scenario, GenerationError> {
        scenario::generate(&self.settings, number)
    }
}
