//! Generated scenarios: parametric maps with microscopic traffic, in which one of the drivers is the AV.
//! They ship with the program, because recordings may not be redistributed, and small networks are trained
//! on them.
// Tests may call the mathematical functions of the platform: their comparisons have tolerances.
#![cfg_attr(test, allow(clippy::disallowed_methods))]

mod draw;
mod heights;
mod in_order;
mod layout;
pub mod maps;
mod scenario;
mod sensor;
mod settings;
pub mod traffic;

pub use draw::Draw;
pub use in_order::{Ending, in_order};
pub use layout::{Entry, Footway, Layout, ParkingSpot, Priority, RightOfWay, SignalPlan};
pub use settings::{GenerationSettings, Preset};

use reactsim_scene::{Length, Scenario, SceneError};

/// Version of the generator, raised whenever the same settings and numbers produce other scenarios, or
/// other deviated AVs, than before.
pub const VERSION: u32 = 2;

/// Reason why no scenario could be generated.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct GenerationError(pub String);

impl From<SceneError> for GenerationError {
    fn from(error: SceneError) -> Self {
        Self(error.to_string())
    }
}

/// Generator of scenarios by number.
#[derive(Clone, Debug)]
pub struct Generator {
    settings: GenerationSettings,
}

impl Generator {
    /// Checks the settings and creates a generator.
    ///
    /// # Errors
    /// [`GenerationError`] if a map type does not exist, the density is not a positive number up to 3, or no
    /// scenario may have this length.
    pub fn new(settings: GenerationSettings) -> Result<Self, GenerationError> {
        let known = || maps::all().map(|m| m.id).collect::<Vec<_>>().join(", ");
        let refused = |text: String| Err(GenerationError(text));
        for name in &settings.maps {
            if maps::find(name).is_none() {
                return refused(format!("no map type `{name}`; available: {}", known()));
            }
        }
        if !settings.length.is_valid() {
            let Length { history, future } = settings.length;
            return refused(format!(
                "{history} frames of history and {future} after them: expected 2 to {}, and 1 to {}",
                Length::MAX_HISTORY,
                Length::MAX_FUTURE
            ));
        }
        match settings.density {
            Some(density) if !(density > 0.0 && density <= 3.0) => {
                refused(format!("density {density}: expected a number above 0 and at most 3"))
            }
            _ => Ok(Self { settings }),
        }
    }

    /// Generates the scenario with this number. It depends only on the settings and the number, so any
    /// number of threads may share a generator.
    ///
    /// # Errors
    /// [`GenerationError`] if no traffic on the allowed maps has a driver who can be the AV; parts that are
    /// not a valid scenario would be a bug.
    pub fn scenario(&self, number: u64) -> Result<Scenario, GenerationError> {
        scenario::generate(&self.settings, number)
    }
}
