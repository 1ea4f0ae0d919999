//! Paired differences of planners under every simulator, and how they depend on it.

use std::collections::BTreeMap;

use rayon::prelude::*;
use reactsim_metrics::MetricSpec;

use super::planners::{two, values};
use super::{PlannerRanks, Study};
use crate::av::PlannedAv;
use crate::error::EvaluationError;
use crate::statistics::comparison::{Comparison, PairedDifference};
use crate::statistics::tally::Tally;

/// Two planners of a study, compared scenario by scenario.
#[derive(Clone, Debug, PartialEq)]
pub struct PlannerPair {
    /// Names of the planners. A difference is the second minus the first.
    pub planners: [String; 2],
    /// Difference of the score of the ranks under each simulator, in the order of the ranks; `None` without a
    /// scenario that has the score with both planners.
    pub differences: Vec<Option<PairedDifference>>,
    /// How the difference depends on the simulator; `None` with one simulator, or without a scenario that has
    /// the score with both planners under two of them.
    pub dependence: Option<Dependence>,
}

/// The largest change of a difference between two simulators.
#[derive(Clone, Debug, PartialEq)]
pub struct Dependence {
    /// Ids of the simulators.
    pub simulators: [String; 2],
    /// Difference of the planners under the second simulator minus that under the first, on the scenarios of
    /// both.
    pub change: PairedDifference,
    /// p-value of the change, times the number of pairs of simulators from which it was chosen (Bonferroni
    /// correction); at most 1.
    pub p: f64,
}

/// A planner and the results of its run.
type Planned<'a> = (&'a str, &'a Tally);

/// Ids of scenarios with the differences under two simulators.
type Paired<'a> = Vec<(&'a str, f64, f64)>;

impl PlannerPair {
    /// Compares every two planners of a study with these results by member; the pairs with an external
    /// planner, which is the user's own, come first. `seed` selects the random streams of resamplings and
    /// permutations.
    ///
    /// # Errors
    /// [`EvaluationError`] for a simulator that is not in every run, and scenarios that differ between runs.
    pub(super) fn of_study(
        study: &Study,
        tallies: &[Tally],
        ranks: &PlannerRanks,
        seed: u64,
    ) -> Result<Vec<Self>, EvaluationError> {
        let members = study.members.iter().zip(tallies);
        let planned: Vec<Planned<'_>> =
            members.filter_map(|(member, tally)| Some((member.planner.as_deref()?, tally))).collect();
        let mut pairs: Vec<[usize; 2]> = two(planned.len()).collect();
        pairs.sort_by_key(|pair| !pair.iter().any(|&i| PlannedAv::is_external(planned[i].0)));
        let one = |[first, second]: [usize; 2]| Self::of(planned[first], planned[second], ranks, seed);
        pairs.into_par_iter().map(one).collect()
    }

    fn of(
        first: Planned<'_>,
        second: Planned<'_>,
        ranks: &PlannerRanks,
        seed: u64,
    ) -> Result<Self, EvaluationError> {
        let score = ranks.score.as_str();
        let mut differences = Vec::new();
        for simulator in &ranks.simulators {
            let id = simulator.id.as_str();
            let is_score = |spec: &MetricSpec| spec.id == score;
            let found = Comparison::of_metrics((first.1, id), (second.1, id), seed, is_score, None);
            differences.push(match found {
                Err(EvaluationError::NothingInCommon { .. }) => None,
                other => other?.metrics.remove(score),
            });
        }
        let ids: Vec<&str> = ranks.simulators.iter().map(|simulator| simulator.id.as_str()).collect();
        Ok(Self {
            planners: [first.0.to_owned(), second.0.to_owned()],
            differences,
            dependence: Dependence::of([first.1, second.1], &ids, score, seed),
        })
    }
}

impl Dependence {
    /// Finds the largest change of the difference of two planners with these results between two simulators.
    fn of(planners: [&Tally; 2], simulators: &[&str], score: &str, seed: u64) -> Option<Self> {
        let spec = reactsim_metrics::metric(score)?.spec();
        let of_simulators: Vec<BTreeMap<&str, f64>> =
            simulators.iter().map(|id| differences(planners, id, score)).collect();
        let pairs: Vec<[usize; 2]> = two(simulators.len()).collect();
        let mut largest: Option<(f64, [usize; 2], Paired<'_>)> = None;
        for &[s, t] in &pairs {
            let others = &of_simulators[t];
            let both: Paired<'_> =
                of_simulators[s].iter().filter_map(|(id, a)| Some((*id, *a, *others.get(id)?))).collect();
            let sum: f64 = both.iter().map(|(_, a, b)| b - a).sum();
            let size = (sum / both.len().max(1) as f64).abs();
            if !both.is_empty() && largest.as_ref().is_none_or(|(known, ..)| size > *known) {
                largest = Some((size, [s, t], both));
            }
        }
        let (_, chosen, both) = largest?;
        let change = PairedDifference::of(spec, &both, seed)?;
        let p = (change.p * pairs.len() as f64).min(1.0);
        Some(Self { simulators: chosen.map(|simulator| simulators[simulator].to_owned()), change, p })
    }
}

/// Returns the difference of two planners under a simulator, by scenario.
fn differences<'a>(planners: [&'a Tally; 2], simulator: &str, score: &str) -> BTreeMap<&'a str, f64> {
    let of = |tally: &'a Tally| {
        let at = tally.simulators.iter().position(|id| id == simulator);
        at.map(|at| values(tally, at, score)).unwrap_or_default()
    };
    let [first, second] = planners.map(of);
    first.into_iter().filter_map(|(id, value)| Some((id, second.get(id)? - value))).collect()
}

#[cfg(test)]
mod tests {
    use reactsim_metrics::Score;

    use super::*;
    use crate::row::Row;
    use crate::study::{Member, SimulatorRanks, StudyKind};

    const SIMULATORS: [&str; 2] = ["log-replay", "idm"];

    /// A run of one planner, from its scores by simulator and scenario.
    fn tally(scores: [&[f64]; 2]) -> Tally {
        let metrics = vec![reactsim_metrics::metric("av-score").unwrap().spec()];
        let simulators = SIMULATORS.map(str::to_owned).to_vec();
        let mut tally = Tally { metrics, simulators, rollouts: 1, entries: BTreeMap::new() };
        for (simulator, scores) in SIMULATORS.iter().zip(scores) {
            for (record, score) in scores.iter().enumerate() {
                tally.add(&[Row {
                    record,
                    scenario: format!("s{record}"),
                    digest: record.to_string(),
                    simulator: (*simulator).to_owned(),
                    rollout: Some(0),
                    metrics: [("av-score".to_owned(), Some(Score::Value(*score)))].into(),
                    ..Row::default()
                }]);
            }
        }
        tally
    }

    fn pairs(tallies: &[Tally]) -> Vec<PlannerPair> {
        let member = |planner: &str| Member {
            folder: planner.to_owned(),
            planner: Some(planner.to_owned()),
            ..Member::default()
        };
        let study = Study::new(StudyKind::Planners, vec![member("log"), member("mine")]);
        let simulator = |id: &str| SimulatorRanks {
            id: id.to_owned(),
            scores: Vec::new(),
            ranks: Vec::new(),
            at_fault: 0,
            ignored: None,
            frozen: None,
        };
        let ranks = PlannerRanks {
            score: "av-score".to_owned(),
            scenarios: 10,
            planners: vec!["log".to_owned(), "mine".to_owned()],
            simulators: SIMULATORS.map(simulator).to_vec(),
            agreement: Vec::new(),
            change: None,
        };
        PlannerPair::of_study(&study, tallies, &ranks, 0).unwrap()
    }

    #[test]
    fn differences_and_their_dependence_are_those_of_the_values() {
        // The second planner is better by 0.5 among logged agents, and worse by 0.25 among those that react.
        let log = tally([&[0.5; 10], &[0.75; 10]]);
        let mine = tally([&[1.0; 10], &[0.5; 10]]);
        let found = pairs(&[log, mine]);
        let [pair] = found.as_slice() else { panic!("{found:?}") };
        assert_eq!(pair.planners, ["log", "mine"]);
        let means: Vec<f64> =
            pair.differences.iter().map(|found| found.as_ref().unwrap().difference.mean.unwrap()).collect();
        assert_eq!(means, [0.5, -0.25]);
        // Ten of one sign: two of 1024 assignments are as far from 0.
        assert_eq!(pair.differences[0].as_ref().unwrap().p, 2.0 / 1024.0);
        let dependence = pair.dependence.as_ref().unwrap();
        assert_eq!(dependence.simulators, SIMULATORS);
        assert_eq!(dependence.change.difference.mean, Some(-0.75));
        assert_eq!(dependence.p, 2.0 / 1024.0, "one pair of simulators");
    }

    #[test]
    fn scenarios_with_one_planner_are_left_out() {
        let found = pairs(&[tally([&[0.5; 3], &[]]), tally([&[0.5, 1.0], &[0.5; 3]])]);
        let [under_log, under_idm] = found[0].differences.as_slice() else { panic!("{found:?}") };
        let under_log = under_log.as_ref().unwrap();
        assert_eq!((under_log.difference.scenarios, under_log.difference.mean), (2, Some(0.25)));
        assert_eq!((under_idm, &found[0].dependence), (&None, &None));
    }
}
