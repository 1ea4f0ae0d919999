//! The scenarios of a submission with their logs.

use reactsim_formats::{
    FormatError,
    wosac::{SubmissionCheck, SubmissionReader, SubmittedRollouts},
};

use super::logs::LogFiles;
use super::scores::{RealismFailure, ScoredPair};

/// Iterator over the scenarios of a submission: validated, each with its log. Violations of the rules of the
/// challenge are failures.
pub struct SubmittedPairs {
    submission: SubmissionReader,
    logs: LogFiles,
    check: SubmissionCheck,
    any_rollouts: bool,
    ended: bool,
}

impl SubmittedPairs {
    /// Reads this submission, with the logs of these files. With `any_rollouts` the number of rollouts need
    /// not be that of the challenge.
    pub fn new(submission: SubmissionReader, logs: LogFiles, any_rollouts: bool) -> Self {
        Self { submission, logs, check: SubmissionCheck::default(), any_rollouts, ended: false }
    }

    /// Passes over scenarios, of which only the ids are noted; returns their number, which is smaller at the
    /// end of the submission.
    pub fn pass_over(&mut self, scenarios: usize) -> usize {
        let mut passed = 0;
        while passed < scenarios && !self.ended {
            match self.submission.next() {
                None => self.ended = true,
                Some(submitted) => {
                    passed += 1;
                    if let Ok(submitted) = submitted {
                        // A repeated id is the failure of the unit that scores the scenario.
                        self.check.check_id(&submitted).ok();
                    }
                }
            }
        }
        passed
    }

    /// Returns the name of the method, if the submission has one; known after the first scenario.
    pub fn method(&self) -> Option<&str> {
        self.submission.metadata()?.unique_method_name.as_deref()
    }

    /// Returns whether the submission is an archive that is not compressed with gzip.
    pub fn is_plain_archive(&self) -> bool {
        self.submission.is_plain_archive()
    }

    /// Returns what the metadata lack, if the server would refuse them.
    pub fn metadata_fault(&self) -> Option<String> {
        let fault = self.submission.metadata()?.check().err()?;
        Some(fault.to_string())
    }

    /// Returns the ids of the scenarios with a log that were not submitted so far, and the errors of logs
    /// that could not be read.
    pub fn missing(&mut self) -> (Vec<String>, Vec<FormatError>) {
        let ids = self.logs.ids();
        let missing = self.check.missing(ids.iter().map(String::as_str));
        let missing = missing.into_iter().map(str::to_owned).collect();
        (missing, self.logs.take_errors())
    }

    fn pair(&mut self, submitted: SubmittedRollouts) -> Result<ScoredPair, RealismFailure> {
        let id = submitted.rollouts.scenario_id.clone();
        let place = format!("{}: record {}", submitted.file.display(), submitted.record);
        let refuse = |error: String| RealismFailure { scenario_id: Some(id.clone()), error };
        let log = self.logs.get(&id).map_err(|error| refuse(error.to_string()))?;
        let Some(log) = log else {
            self.check.check_id(&submitted).map_err(|error| refuse(error.to_string()))?;
            let text = format!("{place}: no scenario file has the scenario `{id}`: give it");
            return Err(refuse(text));
        };
        // All other rules are also those of the metrics.
        let checked = match self.any_rollouts {
            true => self.check.check_id(&submitted),
            false => self.check.check(&submitted, &log),
        };
        checked.map_err(|error| refuse(error.to_string()))?;
        Ok(ScoredPair { place, log, rollouts: submitted.rollouts })
    }
}

impl Iterator for SubmittedPairs {
    type Item = Result<ScoredPair, RealismFailure>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.ended {
            return None;
        }
        let Some(submitted) = self.submission.next() else {
            self.ended = true;
            return None;
        };
        Some(match submitted {
            Ok(submitted) => self.pair(submitted),
            Err(error) => Err(RealismFailure { scenario_id: None, error: error.to_string() }),
        })
    }
}
