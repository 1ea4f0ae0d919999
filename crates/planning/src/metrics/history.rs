//! The input of the metrics: one driven scenario.

use crate::{EgoShape, EgoState, PlanningError, PlanningMap, TrackedObject};

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

impl History<'_> {
    /// Checks numbers of samples and that all numbers are finite.
    ///
    /// # Errors
    /// [`PlanningError`] for the first fault.
    pub fn check(&self) -> Result<(), PlanningError> {
        let (ego, objects) = (self.ego.len(), self.objects.len());
        if ego < MIN_SAMPLES {
            let text =
                format!("the history has {ego} samples of ego; the metrics need at least {MIN_SAMPLES}");
            return Err(PlanningError(text));
        }
        if objects != ego {
            return Err(PlanningError(format!(
                "the history has {ego} samples of ego, but {objects} of objects; give one list per sample"
            )));
        }
        for (who, states) in [("ego", self.ego), ("the expert", self.expert.unwrap_or_default())] {
            if let Some(sample) = states.iter().position(|state| !state.is_finite()) {
                return Err(PlanningError(format!("sample {sample}: the state of {who} is not finite")));
            }
        }
        for (sample, objects) in self.objects.iter().enumerate() {
            if let Some(bad) = objects.iter().find(|object| !object.is_finite()) {
                return Err(PlanningError(format!(
                    "sample {sample}: box or velocity of object `{}` is not finite; leave it out or estimate it",
                    bad.id
                )));
            }
        }
        Ok(())
    }
}
