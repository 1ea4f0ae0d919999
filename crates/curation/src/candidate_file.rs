//! Candidates of other planners, from a file.

use std::cell::OnceCell;
use std::collections::BTreeMap;
use std::path::Path;

use reactsim_formats::{
    Cause, FormatError,
    deviations::{self, DeviationRecord},
};
use reactsim_rollout::Stream;
use reactsim_scene::{Scenario, limits};

use super::{CandidateSource, NoProposal, Proposal};

/// Largest number of candidates per scenario.
pub const MAX_CANDIDATES: u32 = 1000;

/// Candidates from a file of trajectories, any number per scenario.
///
/// The file is one of deviations, as `docs/files.md` describes it, of any program. If it is the output
/// of a curation, all of its candidates are judged anew.
#[derive(Debug)]
pub struct CandidateFile {
    /// Name without its folder.
    name: String,
    candidates: BTreeMap<String, Vec<DeviationRecord>>,
}

impl CandidateFile {
    /// Reads a file, Parquet or JSON, into memory: about 40 bytes per state.
    ///
    /// # Errors
    /// [`FormatError`] names scenario and step; also if a scenario has more than [`MAX_CANDIDATES`].
    pub fn read(path: &Path) -> Result<Self, FormatError> {
        let candidates = deviations::read_all(path)?;
        for (scenario, all) in &candidates {
            if all.len() > MAX_CANDIDATES as usize {
                let (field, found) = (format!("scenario `{scenario}`"), format!("{} candidates", all.len()));
                let cause = Cause::value(field, found, format!("at most {MAX_CANDIDATES}"));
                return Err(FormatError::file(path, cause));
            }
        }
        let name = path.file_name().map_or_else(|| path.to_string_lossy(), |n| n.to_string_lossy());
        Ok(Self { name: name.into_owned(), candidates })
    }

    /// Returns the ids of the scenarios that have candidates.
    pub fn scenarios(&self) -> impl Iterator<Item = &str> {
        self.candidates.keys().map(String::as_str)
    }

    fn of(&self, scenario: &Scenario) -> &[DeviationRecord] {
        self.candidates.get(&scenario.id).map_or(&[], Vec::as_slice)
    }
}

impl CandidateSource for CandidateFile {
    fn id(&self) -> &'static str {
        "file"
    }

    /// Refuses candidates of another version of the scenario, and states that cannot be meant.
    fn check(&self, scenario: &Scenario) -> Result<(), Cause> {
        let center = scenario.start.now(0).position();
        let digest = OnceCell::new();
        for (number, record) in self.of(scenario).iter().enumerate() {
            let field = |what: &str| format!("candidate {number} of {}: {what}", self.name);
            let own = || digest.get_or_init(|| scenario.digest());
            if let Some(other) = record.scenario_digest.as_ref().filter(|other| *other != own()) {
                let digest = own();
                let expected =
                    format!("{digest}; the candidate was made for another version of the scenario");
                return Err(Cause::value(field("scenario_digest"), other, expected));
            }
            let (found, steps) = (record.track.len(), scenario.length().future);
            if found != steps {
                let expected = format!("{steps}, as many as the scenario has");
                return Err(Cause::value(field("the number of steps"), found, expected));
            }
            let track = record.track_in(scenario.origin);
            let beyond = track.iter().zip(1..).find_map(|(s, step)| Some((step, limits::beyond(s, center)?)));
            if let Some((step, (name, value, expected))) = beyond {
                return Err(Cause::value(field(&format!("{name} at step {step}")), value, expected));
            }
        }
        Ok(())
    }

    fn propose(&self, scenario: &Scenario, streams: &mut [Stream]) -> Vec<Result<Proposal, NoProposal>> {
        let records = self.of(scenario);
        if records.is_empty() {
            return vec![Err(NoProposal("the file has no candidate for the scenario".to_owned()))];
        }
        let proposal = |record: &DeviationRecord| Proposal {
            intent: record.category,
            maneuver: record.maneuver.clone(),
            future: record.track_in(scenario.origin),
        };
        records.iter().take(streams.len()).map(|record| Ok(proposal(record))).collect()
    }
}
