//! The errors of the realism metrics.

use reactsim_scene::SceneError;

use super::feature::Feature;

/// The reason why rollouts cannot be scored. Messages begin with the scenario.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum WosacError {
    /// The log has no future.
    #[error(
        "scenario `{scenario}`: the log ends at the current frame (test split), expected 91 frames; \
         score scenarios of the training or validation split"
    )]
    NoFuture {
        /// Id of the scenario.
        scenario: String,
    },
    /// An evaluated object was not observed at the current frame.
    #[error(
        "scenario `{scenario}`: object {object} of tracks_to_predict or the AV is invalid at frame 10, \
         expected a simulated object"
    )]
    EvaluatedAbsent {
        /// Id of the scenario.
        scenario: String,
        /// Id of the object.
        object: i32,
    },
    /// The map has no road edge with at least two points.
    #[error(
        "scenario `{scenario}`: the map has no road edge, expected at least one: without it the distance \
         to the road edge is undefined, and the official code fails too"
    )]
    NoRoadEdge {
        /// Id of the scenario.
        scenario: String,
    },
    /// No logged sample of a feature is valid.
    #[error(
        "scenario `{scenario}`: no logged step of {} can be judged, expected a valid AV that is a vehicle",
        feature.name()
    )]
    NothingToJudge {
        /// Id of the scenario.
        scenario: String,
        /// The feature.
        feature: Feature,
    },
    /// The log or the rollouts have an invalid value.
    #[error(transparent)]
    Invalid(#[from] SceneError),
}
