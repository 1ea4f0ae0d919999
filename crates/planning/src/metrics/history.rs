//! The input of the metrics: one driven scenario.

use reactsim_geometry::{OrientedBox, Vec2};

use crate::{EgoShape, EgoState, PlanningMap, STEP, TrackedObject};

/// Minimum number of samples: the yaw acceleration is the second derivative of a cubic polynomial.
pub const MIN_SAMPLES: usize = 4;

/// The rule for metrics whose inputs are missing in a scenario.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum MissingInputs {
    /// Undefined, with the reason.
    #[default]
    Undefined,
    /// As in nuPlan's devkit, which gives 1 for unknown speed limits and for an expert without lanes.
    AsDevkit,
}

/// One driven scenario. Samples are 0.1 s apart; sample 0 is the state at the current frame.
#[derive(Clone, Copy, Debug)]
pub struct History<'a> {
    /// The map.
    pub map: &'a PlanningMap,
    /// Box and axles of ego, also used for the expert.
    pub shape: EgoShape,
    /// State of ego per sample; at least 4.
    pub ego: &'a [EgoState],
    /// State of the expert, the AV of the log, per sample; its number of samples may differ. `None` if the
    /// log has gaps.
    pub expert: Option<&'a [EgoState]>,
    /// Objects present, per sample of ego.
    pub objects: &'a [Vec<TrackedObject>],
    /// Rule for missing inputs.
    pub missing: MissingInputs,
}

/// Reason why a history cannot be judged.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum HistoryError {
    /// Too few samples.
    #[error("the history has {0} samples of ego; the metrics need at least 4")]
    TooShort(usize),
    /// Objects are not given per sample.
    #[error("the history has {ego} samples of ego, but {objects} of objects; give one list per sample")]
    Objects {
        /// Samples of ego.
        ego: usize,
        /// Samples of objects.
        objects: usize,
    },
    /// A number of ego or the expert is NaN or infinite.
    #[error("sample {sample}: the state of {who} is not finite")]
    NotFinite {
        /// `ego` or `the expert`.
        who: &'static str,
        /// Index of the sample.
        sample: usize,
    },
    /// A number of an object is NaN or infinite.
    #[error(
        "sample {sample}: box or velocity of object `{object}` is not finite; leave it out or estimate it"
    )]
    Object {
        /// Index of the sample.
        sample: usize,
        /// Id of the object.
        object: String,
    },
}

impl History<'_> {
    /// Checks numbers of samples and that all numbers are finite.
    ///
    /// # Errors
    /// [`HistoryError`] for the first fault.
    pub fn check(&self) -> Result<(), HistoryError> {
        if self.ego.len() < MIN_SAMPLES {
            return Err(HistoryError::TooShort(self.ego.len()));
        }
        if self.objects.len() != self.ego.len() {
            return Err(HistoryError::Objects { ego: self.ego.len(), objects: self.objects.len() });
        }
        for (who, states) in [("ego", self.ego), ("the expert", self.expert.unwrap_or_default())] {
            if let Some(sample) = states.iter().position(|state| !state.is_finite()) {
                return Err(HistoryError::NotFinite { who, sample });
            }
        }
        for (sample, objects) in self.objects.iter().enumerate() {
            if let Some(bad) = objects.iter().find(|object| !object.is_finite()) {
                return Err(HistoryError::Object { sample, object: bad.id.to_string() });
            }
        }
        Ok(())
    }

    /// Returns the box of ego at a sample.
    pub(super) fn footprint(&self, sample: usize) -> OrientedBox {
        self.ego[sample].footprint(&self.shape)
    }

    /// Returns the centre of the box of ego per sample, metres.
    pub(super) fn centers(&self) -> Vec<Vec2> {
        self.ego.iter().map(|state| state.center(&self.shape)).collect()
    }

    /// Returns the time from the first to the last sample, seconds.
    pub(super) fn duration(&self) -> f64 {
        (self.ego.len() - 1) as f64 * STEP
    }
}
