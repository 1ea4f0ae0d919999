//! How the evaluation of planners depends on the simulator of the traffic: the order of planners, and
//! collisions that depend on whether agents react.

use std::cmp::Ordering;
use std::collections::BTreeMap;
use std::path::Path;

use reactsim_formats::rollouts::RolloutRecord;
use reactsim_rollout::{Purpose, stream};
use reactsim_scene::Frame;
use serde::{Deserialize, Serialize};

use super::{Member, read_study};
use crate::error::EvaluationError;
use crate::folder::finished_run::FinishedRun;
use crate::folder::{read_json, write_json};
use crate::statistics::tally::{Entry, Tally};
use crate::statistics::{MIN_FOR_INTERVAL, RESAMPLES, below, interval};

/// Name of the file with the ranks of the planners of a study.
pub const PLANNER_RANKS: &str = "planners.json";

/// Scores by which planners are ranked, in the order of preference.
const SCORES: [&str; 2] = ["av-score", "av-score-partial"];
/// Metric of collisions that are the fault of the AV: 1 without one.
const COLLISIONS: &str = "av-at-fault-collisions";
/// Metric of unnecessary reactions to a fixed AV, metres.
const OVER_REACTION: &str = "over-reaction";

/// Largest distance in metres between the positions of an agent with two different AVs up to which it did not
/// react to either.
const UNMOVED: f64 = 0.5;
/// Over-reaction in metres from which agents of a scenario count as frozen: a car length.
const FROZEN: f64 = 5.0;

/// Planners × simulators.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlannerRanks {
    /// The score: `av-score`, or `av-score-partial` if more scenarios have this one in every run.
    pub score: String,
    /// Number of scenarios that have the score for every planner and simulator. Only these are used.
    pub scenarios: usize,
    /// Planners, as in `--av planner:ID`.
    pub planners: Vec<String>,
    /// Simulators with the scores and ranks of the planners.
    pub simulators: Vec<SimulatorRanks>,
    /// Kendall's tau between each two simulators.
    pub agreement: Vec<Agreement>,
    /// The two planners whose difference depends most on the simulator; `None` with one planner or simulator.
    pub change: Option<OrderChange>,
}

/// Planners under one simulator.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SimulatorRanks {
    /// Id of the simulator.
    pub id: String,
    /// Mean score of each planner.
    pub scores: Vec<f64>,
    /// Rank of each planner, 1 is best; equal scores share the mean of their ranks.
    pub ranks: Vec<f64>,
    /// Number of scenarios, over all planners but the log, in which the AV causes a collision.
    pub at_fault: usize,
    /// Those of them in which no hit agent reacted: with the logged AV it was at the same place, within 0.5
    /// m, up to the contact. `None` if rollouts were not kept.
    pub ignored: Option<usize>,
    /// Number of scenarios, over all planners but the log, in which the AV causes a collision under another
    /// simulator and none under this one, and agents of this one are frozen: their over-reaction to the fixed
    /// AV is at least 5 m. `None` if the scenarios have no certified AVs.
    pub frozen: Option<usize>,
}

/// Agreement of two simulators about the order of planners.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Agreement {
    /// Id of a simulator.
    pub first: String,
    /// Id of another simulator.
    pub second: String,
    /// Kendall's tau-b of the mean scores; `None` if one of them ranks all planners equally.
    pub tau: Option<f64>,
    /// 2.5 % percentile over resampled scenarios; `None` with fewer than 5 scenarios.
    pub low: Option<f64>,
    /// 97.5 % percentile.
    pub high: Option<f64>,
}

/// Two planners whose difference depends on the simulator.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OrderChange {
    /// The planners.
    pub planners: [String; 2],
    /// The simulators.
    pub simulators: [String; 2],
    /// Mean score of the first planner minus that of the second, under each of the simulators.
    pub differences: [f64; 2],
    /// Whether the simulators order the planners differently.
    pub is_reversed: bool,
    /// Id of the scenario in which the difference changes most.
    pub scenario: String,
}

/// Scores of the scenarios that all runs have in common.
struct Common<'a> {
    score: &'static str,
    /// Ids of the scenarios.
    scenarios: Vec<&'a str>,
    /// By simulator, planner and scenario.
    values: Vec<Vec<Vec<f64>>>,
}

impl PlannerRanks {
    /// Ranks the planners of a finished study of kind `planners`.
    ///
    /// # Errors
    /// [`EvaluationError`] if a run of the study cannot be read, or no scenario has a score in every run.
    pub fn of_study(folder: &Path) -> Result<Self, EvaluationError> {
        let study = read_study(folder)?;
        let mut members: Vec<(&Member, FinishedRun)> = Vec::new();
        for member in &study.members {
            members.push((member, FinishedRun::open(&folder.join(&member.folder))?));
        }
        let seed = members.first().map_or(0, |(_, run)| run.summary().provenance.run.settings.seed);
        Self::of(&members, seed)
    }

    /// Writes the ranks into the folder of a study.
    ///
    /// # Errors
    /// [`EvaluationError`] if the file cannot be written.
    pub fn write(&self, study: &Path) -> Result<(), EvaluationError> {
        write_json(&study.join(PLANNER_RANKS), self)
    }

    /// Reads the ranks in the folder of a study; `None` if there are none.
    ///
    /// # Errors
    /// [`EvaluationError`] if the file cannot be read or is damaged.
    pub fn read(study: &Path) -> Result<Option<Self>, EvaluationError> {
        read_json(&study.join(PLANNER_RANKS))
    }

    /// Ranks the planners of these runs. One of them may have fixed AVs and no planner.
    fn of(members: &[(&Member, FinishedRun)], seed: u64) -> Result<Self, EvaluationError> {
        let planned: Vec<(&str, &FinishedRun)> =
            members.iter().filter_map(|(m, run)| Some((m.planner.as_deref()?, run))).collect();
        let fixed = members.iter().find(|(member, _)| member.planner.is_none()).map(|(_, run)| run);
        let nothing = || EvaluationError::NothingInCommon { lengths: String::new() };
        let (_, first) = planned.first().ok_or_else(nothing)?;
        let ids = &first.tally().simulators;
        let found = SCORES.map(|score| Common::of(score, &planned, ids));
        // On ties the complete score.
        let common = found.into_iter().rev().max_by_key(|common| common.scenarios.len());
        let common = common.filter(|common| !common.scenarios.is_empty()).ok_or_else(nothing)?;
        let means = common.means(&(0..common.scenarios.len()).collect::<Vec<_>>());
        let hits: Vec<Vec<BTreeMap<&str, bool>>> = planned
            .iter()
            .map(|(_, run)| (0..ids.len()).map(|simulator| collisions(run, simulator)).collect())
            .collect();
        let is_log = |planner: usize| planned[planner].0 == "log";
        let log = (0..planned.len()).find(|&planner| is_log(planner)).map(|planner| planned[planner].1);
        let mut simulators = Vec::new();
        for (s, id) in ids.iter().enumerate() {
            let mut ranked = SimulatorRanks {
                id: id.clone(),
                scores: means[s].clone(),
                ranks: ranks(&means[s]),
                at_fault: 0,
                ignored: log.filter(|log| log.keeps_rollouts()).map(|_| 0),
                frozen: None,
            };
            let over_reaction = fixed.map(|run| values(run.tally(), s, OVER_REACTION));
            if over_reaction.as_ref().is_some_and(|found| !found.is_empty()) {
                ranked.frozen = Some(0);
            }
            for planner in (0..planned.len()).filter(|&planner| !is_log(planner)) {
                for (scenario, is_hit) in &hits[planner][s] {
                    if *is_hit {
                        ranked.at_fault += 1;
                        if let (Some(count), Some(log)) = (&mut ranked.ignored, log)
                            && is_ignored(planned[planner].1, log, s, scenario)?
                        {
                            *count += 1;
                        }
                        continue;
                    }
                    let hits_elsewhere =
                        || hits[planner].iter().any(|hits| hits.get(scenario) == Some(&true));
                    let is_frozen = |found: &BTreeMap<&str, f64>| {
                        found.get(scenario).is_some_and(|metres| *metres >= FROZEN)
                    };
                    if let (Some(count), Some(found)) = (&mut ranked.frozen, &over_reaction)
                        && is_frozen(found)
                        && hits_elsewhere()
                    {
                        *count += 1;
                    }
                }
            }
            simulators.push(ranked);
        }
        let planners: Vec<String> = planned.iter().map(|(planner, _)| (*planner).to_owned()).collect();
        Ok(Self {
            score: common.score.to_owned(),
            scenarios: common.scenarios.len(),
            simulators,
            agreement: common.agreement(ids, &means, seed),
            change: common.change(&planners, ids, &means),
            planners,
        })
    }
}

impl<'a> Common<'a> {
    /// Collects the scenarios in which every run and simulator has this score.
    fn of(score: &'static str, planned: &[(&str, &'a FinishedRun)], ids: &[String]) -> Self {
        let of_pair: Vec<Vec<BTreeMap<&str, f64>>> = (0..ids.len())
            .map(|s| planned.iter().map(|(_, run)| values(run.tally(), s, score)).collect())
            .collect();
        let is_common = |scenario: &&str| of_pair.iter().flatten().all(|found| found.contains_key(scenario));
        let first = of_pair.first().and_then(|planners| planners.first());
        let scenarios: Vec<&str> = first.into_iter().flat_map(|found| found.keys().copied()).collect();
        let scenarios: Vec<&str> = scenarios.into_iter().filter(is_common).collect();
        let chosen = |found: &BTreeMap<&str, f64>| scenarios.iter().map(|scenario| found[scenario]).collect();
        let values = of_pair.iter().map(|planners| planners.iter().map(chosen).collect()).collect();
        Self { score, scenarios, values }
    }

    /// Returns the mean score of each planner under each simulator over these scenarios, which may repeat.
    fn means(&self, chosen: &[usize]) -> Vec<Vec<f64>> {
        let mean = |values: &Vec<f64>| chosen.iter().map(|&i| values[i]).sum::<f64>() / chosen.len() as f64;
        self.values.iter().map(|planners| planners.iter().map(mean).collect()).collect()
    }

    /// Returns the agreement of each pair of simulators. `means`: mean scores over all scenarios.
    fn agreement(&self, ids: &[String], means: &[Vec<f64>], seed: u64) -> Vec<Agreement> {
        let pairs: Vec<[usize; 2]> = two(ids.len()).collect();
        let n = self.scenarios.len();
        let mut resampled: Vec<Vec<f64>> = vec![Vec::new(); pairs.len()];
        if n >= MIN_FOR_INTERVAL {
            let mut random = stream(seed, "kendall", 0, Purpose::Bootstrap);
            for _ in 0..RESAMPLES {
                let chosen: Vec<usize> = (0..n).map(|_| below(&mut random, n)).collect();
                let means = self.means(&chosen);
                for ([i, j], taus) in pairs.iter().zip(&mut resampled) {
                    taus.extend(kendall(&means[*i], &means[*j]));
                }
            }
        }
        let of_pair = |(&[i, j], taus): (&[usize; 2], Vec<f64>)| {
            let (low, high) = interval(taus).unzip();
            Agreement {
                first: ids[i].clone(),
                second: ids[j].clone(),
                tau: kendall(&means[i], &means[j]),
                low,
                high,
            }
        };
        pairs.iter().zip(resampled).map(of_pair).collect()
    }

    /// Returns the planners and simulators with the largest change of a difference; reversals come first.
    fn change(&self, planners: &[String], ids: &[String], means: &[Vec<f64>]) -> Option<OrderChange> {
        let all = two(planners.len()).flat_map(|planners| two(ids.len()).map(move |pair| (planners, pair)));
        let found = all.map(|([p, q], [s, t])| {
            let differences = [means[s][p] - means[s][q], means[t][p] - means[t][q]];
            let is_reversed = differences[0] * differences[1] < 0.0;
            (is_reversed, (differences[0] - differences[1]).abs(), [p, q], [s, t], differences)
        });
        let largest = found.max_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
        let (is_reversed, _, [p, q], [s, t], differences) = largest?;
        let towards = (differences[0] - differences[1]).signum();
        let change = |i: usize| {
            let [first, second] = [s, t].map(|s| self.values[s][p][i] - self.values[s][q][i]);
            towards * (first - second)
        };
        let scenario = (0..self.scenarios.len()).max_by(|&i, &j| change(i).total_cmp(&change(j)))?;
        Some(OrderChange {
            planners: [p, q].map(|planner| planners[planner].clone()),
            simulators: [s, t].map(|simulator| ids[simulator].clone()),
            differences,
            is_reversed,
            scenario: self.scenarios[scenario].to_owned(),
        })
    }
}

/// Returns the pairs of numbers below `n`.
pub(super) fn two(n: usize) -> impl Iterator<Item = [usize; 2]> {
    (0..n).flat_map(move |i| (i + 1..n).map(move |j| [i, j]))
}

/// Returns the values of a metric by scenario, averaged over rollouts.
pub(super) fn values<'a>(tally: &'a Tally, simulator: usize, metric: &str) -> BTreeMap<&'a str, f64> {
    let Some(at) = tally.metric(metric) else { return BTreeMap::new() };
    let value =
        |entry: &'a Entry| Some((entry.scenario.as_str(), entry.cells.get(simulator)?.as_ref()?.values[at]?));
    tally.entries.values().filter_map(value).collect()
}

/// Returns whether the AV causes a collision, by scenario.
fn collisions(run: &FinishedRun, simulator: usize) -> BTreeMap<&str, bool> {
    let found = values(run.tally(), simulator, COLLISIONS);
    found.into_iter().map(|(scenario, value)| (scenario, value < 1.0)).collect()
}

/// Returns whether every agent with which the AV of `run` causes a collision in a scenario was, up to the
/// contact, where it is with the AV of `log`. Agents that are not in both are not known to be.
fn is_ignored(
    run: &FinishedRun,
    log: &FinishedRun,
    simulator: usize,
    scenario: &str,
) -> Result<bool, EvaluationError> {
    let place = run.tally().entries.iter().find(|(_, entry)| entry.scenario == scenario);
    let Some((place, _)) = place else { return Ok(false) };
    let mut contacts = run.events(*place, simulator)?;
    contacts.retain(|event| event.metric == COLLISIONS && event.counted);
    for contact in &contacts {
        let Some(partner) = &contact.partner else { return Ok(false) };
        let with_planner = run.recorded(scenario, simulator, contact.rollout)?;
        let with_log = log.recorded(scenario, simulator, contact.rollout)?;
        let (Some(a), Some(b)) = (with_planner, with_log) else { return Ok(false) };
        let track = |of: &RolloutRecord| {
            let slot = of.agent_ids.iter().position(|id| id == partner)?;
            Some(of.tracks[slot][..contact.step.min(of.tracks[slot].len())].to_vec())
        };
        // Static objects are no agents, and do not react in any simulator.
        let (Some(a), Some(b)) = (track(&a), track(&b)) else { return Ok(false) };
        if !is_unmoved(&a, &b) {
            return Ok(false);
        }
    }
    Ok(!contacts.is_empty())
}

/// Returns whether an agent has the same positions in two rollouts, and both at some frame.
fn is_unmoved(a: &[Frame], b: &[Frame]) -> bool {
    let mut both = a.iter().zip(b).filter_map(|(a, b)| a.zip(*b)).peekable();
    both.peek().is_some() && both.all(|(a, b)| (a.position() - b.position()).norm() <= UNMOVED)
}

/// Returns ranks, 1 for the largest score; equal scores share the mean of their ranks.
fn ranks(scores: &[f64]) -> Vec<f64> {
    let rank = |score: &f64| {
        let above = scores.iter().filter(|other| *other > score).count();
        let equal = scores.iter().filter(|other| *other == score).count();
        above as f64 + (equal as f64 + 1.0) / 2.0
    };
    scores.iter().map(rank).collect()
}

/// Returns Kendall's tau-b of two lists of scores; `None` if all scores of one of them are equal (Kendall,
/// "The treatment of ties in ranking problems", Biometrika 33, 1945).
fn kendall(a: &[f64], b: &[f64]) -> Option<f64> {
    let (mut order, mut in_a, mut in_b) = (0.0, 0_u32, 0_u32);
    for i in 0..a.len() {
        for j in i + 1..a.len() {
            let sign = |values: &[f64]| match values[i].total_cmp(&values[j]) {
                _ if values[i] == values[j] => 0.0,
                Ordering::Less => -1.0,
                _ => 1.0,
            };
            let (x, y) = (sign(a), sign(b));
            order += x * y;
            in_a += u32::from(x != 0.0);
            in_b += u32::from(y != 0.0);
        }
    }
    (in_a > 0 && in_b > 0).then(|| order / (f64::from(in_a) * f64::from(in_b)).sqrt())
}

#[cfg(test)]
mod tests {
    use reactsim_scene::AgentState;

    use super::*;

    #[test]
    fn tau_counts_pairs_in_the_same_order() {
        assert_eq!(kendall(&[3.0, 2.0, 1.0], &[0.9, 0.5, 0.1]), Some(1.0));
        assert_eq!(kendall(&[3.0, 2.0, 1.0], &[0.1, 0.5, 0.9]), Some(-1.0));
        let one_of_three = kendall(&[3.0, 2.0, 1.0], &[0.5, 0.9, 0.1]).unwrap();
        assert!((one_of_three - 1.0 / 3.0).abs() < 1e-12);
        // Two of three pairs are ordered in the second list: 2 / sqrt(3 · 2).
        let tied = kendall(&[3.0, 2.0, 1.0], &[0.5, 0.5, 0.1]).unwrap();
        assert!((tied - 2.0 / 6.0_f64.sqrt()).abs() < 1e-12);
        assert_eq!(kendall(&[1.0, 1.0], &[1.0, 2.0]), None);
    }

    #[test]
    fn agents_without_a_common_frame_have_not_been_seen_to_ignore_anything() {
        let at = |x: f64| Some(AgentState { x, y: 0.0, heading: 0.0, vx: 0.0, vy: 0.0 });
        assert!(is_unmoved(&[at(0.0), at(1.0), None], &[at(0.4), at(1.4), at(2.0)]));
        assert!(!is_unmoved(&[at(0.0), at(1.0)], &[at(0.0), at(1.6)]));
        // It entered one rollout later, after the contact in the other.
        assert!(!is_unmoved(&[None, at(1.0)], &[None, None]));
        assert!(!is_unmoved(&[at(0.0), None], &[None, at(1.0)]));
    }

    #[test]
    fn equal_scores_share_their_ranks() {
        assert_eq!(ranks(&[0.5, 0.9, 0.5, 0.1]), [2.5, 1.0, 2.5, 4.0]);
    }

    #[test]
    fn the_change_of_order_has_its_scenario() {
        // Under the first simulator the first planner is better, under the second the other one; scenario b
        // is the reason.
        let values = vec![vec![vec![1.0, 1.0], vec![0.8, 0.6]], vec![vec![1.0, 0.0], vec![0.8, 0.6]]];
        let common = Common { score: "av-score", scenarios: vec!["a", "b"], values };
        let means = common.means(&[0, 1]);
        let ids = ["one".to_owned(), "two".to_owned()];
        let agreement = common.agreement(&ids, &means, 0);
        assert_eq!((agreement.len(), agreement[0].tau, agreement[0].low), (1, Some(-1.0), None));
        let change = common.change(&["x".to_owned(), "y".to_owned()], &ids, &means).unwrap();
        assert!(change.is_reversed && change.scenario == "b", "{change:?}");
        assert!((change.differences[0] - 0.3).abs() < 1e-12 && (change.differences[1] + 0.2).abs() < 1e-12);
    }
}
