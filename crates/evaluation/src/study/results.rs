//! The results of a study.

use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::{LogErrors, PlannerPair, PlannerRanks, Study, StudyKind, read_study};
use crate::error::EvaluationError;
use crate::folder::{read_summary, read_tally};
use crate::realism::RealismSummary;
use crate::statistics::comparison::Comparison;
use crate::statistics::tally::Tally;
use crate::summary::Summary;

/// The numbers of a study.
#[derive(Clone, Debug)]
pub struct StudyResults {
    /// The study.
    pub study: Study,
    /// Result of each member, in order.
    pub summaries: Vec<Summary>,
    /// Effects of the changes in a study of kind `guards`, by member and simulator; empty in other studies.
    pub differences: Vec<Difference>,
    /// Realism metrics of the Sim Agents challenge in a study of kind `realism` whose rollouts were kept, by
    /// simulator; empty in other studies.
    pub realism: Vec<RealismSummary>,
    /// Order of the planners in a study of kind `planners` ([`PlannerRanks::write`]); `None` in other
    /// studies.
    pub planners: Option<PlannerRanks>,
    /// Every two planners of a study of kind `planners` with ranks; empty in other studies.
    pub planner_pairs: Vec<PlannerPair>,
    /// Displacements from the log in a study of kind `errors` ([`LogErrors::write`]); `None` in other studies.
    pub errors: Option<LogErrors>,
}

/// A changed simulator, compared with the unchanged one (in the first member).
#[derive(Clone, Debug)]
pub struct Difference {
    /// Index of the member.
    pub member: usize,
    /// Id of the changed simulator.
    pub simulator: String,
    /// Id of the unchanged simulator.
    pub original: String,
    /// Comparison of the unchanged (first) with the changed simulator (second). `None` if there is no
    /// scenario for which both have a result.
    pub comparison: Option<Comparison>,
}

impl StudyResults {
    /// Reads the results in the folder of a study.
    ///
    /// # Errors
    /// [`EvaluationError`] if there is no study, it is not finished, or its files are damaged.
    pub fn read(folder: &Path) -> Result<Self, EvaluationError> {
        let study = read_study(folder)?;
        let members = || study.members.iter().map(|m| folder.join(&m.folder));
        let summaries: Vec<Summary> = members().map(|path| read_summary(&path)).collect::<Result<_, _>>()?;
        let planners = PlannerRanks::read(folder)?;
        let (mut differences, mut planner_pairs) = (Vec::new(), Vec::new());
        if study.kind == StudyKind::Guards {
            differences = compare(&study, &summaries, &tallies(&summaries, members())?)?;
        } else if let Some(ranks) = &planners {
            let seed = summaries.first().map_or(0, |first| first.provenance.run.settings.seed);
            planner_pairs = PlannerPair::of_study(&study, &tallies(&summaries, members())?, ranks, seed)?;
        }
        let errors = LogErrors::read(folder)?;
        let realism = RealismSummary::read_all(folder)?;
        Ok(Self { study, summaries, differences, realism, planners, planner_pairs, errors })
    }
}

/// Reads the results by scenario of members with these summaries.
fn tallies(
    summaries: &[Summary],
    members: impl Iterator<Item = PathBuf>,
) -> Result<Vec<Tally>, EvaluationError> {
    let read = |(summary, path): (&Summary, PathBuf)| {
        let tally = read_tally(&path)?;
        if summary.is_of(&tally) { Ok(tally) } else { Err(EvaluationError::unfinished(&path)) }
    };
    summaries.iter().zip(members).map(read).collect()
}

/// Compares every simulator of every member but the first with its original in the first member.
fn compare(
    study: &Study,
    summaries: &[Summary],
    tallies: &[Tally],
) -> Result<Vec<Difference>, EvaluationError> {
    let Some((as_is, tally)) = summaries.first().zip(tallies.first()) else { return Ok(Vec::new()) };
    let seed = as_is.provenance.run.settings.seed;
    let mut pairs = Vec::new();
    for (i, member) in study.members.iter().enumerate().skip(1) {
        for id in &tallies[i].simulators {
            pairs.push((i, id, member.originals.get(id).unwrap_or(id)));
        }
    }
    let one = |(member, id, original): (usize, &String, &String)| {
        let comparison = match Comparison::of((tally, original), (&tallies[member], id), seed) {
            Err(EvaluationError::NothingInCommon { .. }) => None,
            other => Some(other?),
        };
        Ok(Difference { member, simulator: id.clone(), original: original.clone(), comparison })
    };
    pairs.into_par_iter().map(one).collect()
}
