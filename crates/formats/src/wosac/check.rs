//! Validation of a submission: every scenario by the rules of the challenge, and no scenario twice or
//! missing.

use std::collections::BTreeMap;
use std::path::PathBuf;

use reactsim_scene::wosac::{WosacLog, check_rollouts};

use super::submission::SubmittedRollouts;
use crate::error::{Cause, FormatError};

/// The scenarios of a submission that were checked so far. Only their ids and places are kept.
#[derive(Default)]
pub struct SubmissionCheck {
    places: BTreeMap<String, (PathBuf, u64)>,
}

impl SubmissionCheck {
    /// Checks rollouts against the log of their scenario, and that the scenario is submitted once.
    ///
    /// # Errors
    /// The first violation, with file, record, scenario, rollout and object.
    pub fn check(&mut self, submitted: &SubmittedRollouts, log: &WosacLog) -> Result<(), FormatError> {
        self.check_id(submitted)?;
        check_rollouts(&submitted.rollouts, log)
            .map_err(|error| FormatError::scene(&submitted.file, submitted.record, error))
    }

    /// Checks only that the scenario is submitted once; for scenarios whose log is not at hand.
    ///
    /// # Errors
    /// The scenario was submitted before; the error names the place.
    pub fn check_id(&mut self, submitted: &SubmittedRollouts) -> Result<(), FormatError> {
        let (id, place) = (&submitted.rollouts.scenario_id, (submitted.file.clone(), submitted.record));
        if let Some((file, record)) = self.places.get(id) {
            let expected = format!("each scenario once, but {} has it as record {record}", file.display());
            let cause = Cause::value("scenario_id", "submitted twice", expected);
            let scenario = Some(id.clone());
            return Err(FormatError::record(&submitted.file, submitted.record, scenario, cause));
        }
        self.places.insert(id.clone(), place);
        Ok(())
    }

    /// Returns the number of scenarios.
    pub fn scenarios(&self) -> usize {
        self.places.len()
    }

    /// Returns those of the expected scenarios that were not submitted, in their order.
    pub fn missing<'a>(&self, expected: impl IntoIterator<Item = &'a str>) -> Vec<&'a str> {
        expected.into_iter().filter(|id| !self.places.contains_key(*id)).collect()
    }
}
