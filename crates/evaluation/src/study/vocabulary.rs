//! Members of a study of vocabularies: the log, and the log by the tokens of each vocabulary.

use std::collections::BTreeMap;

use reactsim_baseline::WeightsFile;

use super::Member;
use crate::{EvaluationError, PlannedSimulator};

/// Id of the simulator that replays the log.
const LOG: &str = "log-replay";
/// Id of the simulator that replays the log by tokens.
const TOKENS: &str = "token-replay";

/// A vocabulary under a name.
#[derive(Clone, Debug)]
pub struct NamedVocabulary {
    /// Name in tables and folders, such as `k-disks`.
    pub name: String,
    /// File of the vocabulary, or of a network that contains it.
    pub file: WeightsFile,
}

/// Returns the members with their simulators.
pub(super) fn members(
    vocabularies: Vec<NamedVocabulary>,
) -> Result<Vec<(Member, Vec<PlannedSimulator>)>, EvaluationError> {
    let mut members = vec![member("log", "as recorded", PlannedSimulator::by_ids(&[LOG.to_owned()])?)];
    for NamedVocabulary { name, file } in vocabularies {
        let simulator = PlannedSimulator::with_weights(&format!("{TOKENS}@{name}"), file)?;
        members.push(member(&name, &name, vec![simulator]));
    }
    Ok(members)
}

fn member(name: &str, label: &str, simulators: Vec<PlannedSimulator>) -> (Member, Vec<PlannedSimulator>) {
    let originals: BTreeMap<_, _> = simulators.iter().map(|s| (s.id.clone(), LOG.to_owned())).collect();
    let member = Member {
        folder: name.to_owned(),
        label: label.to_owned(),
        variant: Some(name.to_owned()),
        originals,
        ..Member::default()
    };
    (member, simulators)
}
