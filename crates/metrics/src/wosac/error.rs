//! The errors of the realism metrics.

use reactsim_scene::SceneError;

/// The reason why rollouts cannot be scored. Messages begin with the scenario.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct WosacError(pub String);

impl From<SceneError> for WosacError {
    fn from(error: SceneError) -> Self {
        Self(error.to_string())
    }
}
