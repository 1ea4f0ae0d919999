//! Scores of rollouts that any program recorded, scenario by scenario.

use std::collections::BTreeMap;
use std::sync::OnceLock;

use reactsim_formats::rollouts::RolloutRecord;
use reactsim_metrics::{Event, Metrics, Options};
use reactsim_rollout::{Entered, Entering, Rollout};
use reactsim_scene::{Frame, Scenario};

use crate::deviation::labels::DeviationLabels;
use crate::deviation::pose::Pose;
use crate::folder::rollouts::{entered_in, recorded_tracks};
use crate::judge::judge;
use crate::motion::kind::RolloutCheck;
use crate::motion::rollout_checks;
use crate::motion::rollout_checks::Findings;
use crate::row::{RecordPosition, Row};

/// Recorded rollouts, which are scored scenario by scenario in the order in which scenarios are read.
#[derive(Debug)]
pub(crate) struct RecordedRollouts {
    records: BTreeMap<String, Vec<RolloutRecord>>,
    simulators: Vec<String>,
    /// Number of rollouts that every scenario must have with every simulator: the largest there is.
    rollouts: usize,
    findings: Findings,
    options: Options,
    /// The point of vehicles whose poses are recorded.
    pose: Pose,
    /// Whether agents entered and left.
    entering: Entering,
}

/// The scores of the rollouts of one scenario and one simulator.
pub(crate) struct ScoredPair {
    /// Index of the simulator.
    pub(crate) simulator: usize,
    pub(crate) rollouts: Vec<Rollout>,
    pub(crate) rows: Vec<Row>,
    /// Events of each rollout.
    pub(crate) events: Vec<Vec<Event>>,
}

impl RecordedRollouts {
    /// Takes recorded rollouts. Simulators are in the order of their first rollout.
    pub(crate) fn new(
        rollouts: Vec<RolloutRecord>,
        options: Options,
        pose: Pose,
        entering: Entering,
    ) -> Self {
        let mut simulators: Vec<String> = Vec::new();
        let mut records: BTreeMap<String, Vec<RolloutRecord>> = BTreeMap::new();
        let mut counts: BTreeMap<(String, String), usize> = BTreeMap::new();
        for record in rollouts {
            if !simulators.contains(&record.simulator) {
                simulators.push(record.simulator.clone());
            }
            *counts.entry((record.scenario_id.clone(), record.simulator.clone())).or_default() += 1;
            records.entry(record.scenario_id.clone()).or_default().push(record);
        }
        let rollouts = counts.into_values().max().unwrap_or_default();
        Self { records, simulators, rollouts, findings: Findings::default(), options, pose, entering }
    }

    /// Scores all rollouts of a scenario. Returns the scores per simulator, and the failures with the name of
    /// the simulator. A scenario without rollouts is skipped. `digest` returns the digest of the scenario.
    pub(crate) fn score(
        &mut self,
        place: RecordPosition,
        scenario: &Scenario,
        digest: impl Fn() -> String,
    ) -> Vec<Result<ScoredPair, (String, String)>> {
        let mut groups: BTreeMap<String, Vec<RolloutRecord>> = BTreeMap::new();
        for record in self.records.remove(&scenario.id).unwrap_or_default() {
            groups.entry(record.simulator.clone()).or_default().push(record);
        }
        let mut scored = Vec::new();
        let (pose, enters) = (self.pose, self.entering == Entering::Log);
        for (simulator, name) in self.simulators.iter().enumerate() {
            let Some(mut records) = groups.remove(name) else {
                self.findings.add(RolloutCheck::Coverage, || {
                    format!("scenario `{}` has no rollout of `{name}`", scenario.id)
                });
                continue;
            };
            records.sort_by_key(|r| r.rollout);
            let pair = rollouts_of(scenario, &records, enters).and_then(|mut rollouts| {
                if rollouts.len() != self.rollouts {
                    let (n, all) = (rollouts.len(), self.rollouts);
                    return Err(format!(
                        "{n} rollouts, where others have {all}; give the same number for all"
                    ));
                }
                for (index, rollout) in rollouts.iter_mut().enumerate() {
                    to_centres(pose, scenario, rollout)?;
                    let place = format!("scenario `{}`, `{name}`, rollout {index}", scenario.id);
                    let failed = rollout_checks::check(scenario, &place, rollout, &mut self.findings);
                    rollout.outcomes.extend(failed.into_iter().map(|check| (check.outcome(), 1)));
                }
                let (rows, events) =
                    score_rollouts(place, scenario, digest(), name, &rollouts, self.options, false);
                Ok(ScoredPair { simulator, rollouts, rows, events })
            });
            scored.push(pair.map_err(|error| (name.clone(), error)));
        }
        scored
    }

    /// Returns the number of rollouts of every scenario and simulator.
    pub(crate) fn rollouts(&self) -> usize {
        self.rollouts
    }

    /// Returns the rollouts that fail checks.
    pub(crate) fn findings(&self) -> &Findings {
        &self.findings
    }

    /// Returns the ids of the scenarios whose rollouts are not yet scored.
    pub(crate) fn left(&self) -> impl Iterator<Item = &str> {
        self.records.keys().map(String::as_str)
    }

    /// Returns the names of the simulators.
    pub(crate) fn simulators(&self) -> &[String] {
        &self.simulators
    }
}

/// Converts the recorded steps of a rollout to poses of box centres.
fn to_centres(pose: Pose, scenario: &Scenario, rollout: &mut Rollout) -> Result<(), String> {
    let history = scenario.length().history;
    let entered = rollout.entered.iter().map(|entered| &scenario.unselected[entered.logged].agent);
    for (agent, track) in scenario.start.agents.iter().chain(entered).zip(&mut rollout.tracks) {
        pose.to_centre(agent, None, track[history..].iter_mut().flatten())?;
    }
    Ok(())
}

/// Returns the recorded rollouts of one scenario and one simulator, given in their order, with the tracks of
/// all agents of the scenario. `enters`: whether agents that appear later in the log could enter.
///
/// # Errors
/// A text that names the rollout that is missing, repeated or not of this scenario, or an agent that cannot
/// have entered.
pub(crate) fn rollouts_of(
    scenario: &Scenario,
    records: &[RolloutRecord],
    enters: bool,
) -> Result<Vec<Rollout>, String> {
    let rollouts = (0..).zip(records).map(|(index, record)| {
        if record.rollout < index {
            return Err(format!("rollout {} occurs twice", record.rollout));
        }
        if record.rollout > index {
            return Err(format!("rollout {index} is missing (there is {}); count from 0", record.rollout));
        }
        let entered = entered_in(scenario, record);
        if let Some(later) = entered.first().filter(|_| !enters) {
            let id = &scenario.unselected[*later].agent.id;
            return Err(format!(
                "rollout {index}: agent `{id}` appears after the current frame: leave it out (rollouts of a run \
                 in which agents enter are scored in its folder)"
            ));
        }
        let scene = (!entered.is_empty()).then(|| scenario.with_entered(&entered));
        let tracks = recorded_tracks(scene.as_ref().unwrap_or(scenario), record);
        let tracks = tracks.map_err(|e| format!("rollout {index}: {e}"))?;
        let first = |(logged, track): (usize, &Vec<Frame>)| {
            let frame = (scenario.length().history..track.len()).find(|f| track[*f].is_some());
            Entered { logged, frame: frame.unwrap_or(track.len()), waited: 0 }
        };
        let later = entered.into_iter().zip(&tracks[scenario.start.agents.len()..]);
        let entering = if enters { Entering::Log } else { Entering::Off };
        Ok(Rollout { entering, entered: later.map(first).collect(), tracks, outcomes: BTreeMap::new() })
    });
    rollouts.collect()
}

/// Returns the rows of the recorded rollouts of one scenario and one simulator, in the order of the rollouts,
/// and the events of each. Reactions are judged if the AV is the one that the certificate is about. `digest`:
/// digest of the scenario. `judges_av`: whether the AV is judged, too.
pub(crate) fn score_rollouts(
    place: RecordPosition,
    scenario: &Scenario,
    digest: String,
    simulator: &str,
    rollouts: &[Rollout],
    options: Options,
    judges_av: bool,
) -> (Vec<Row>, Vec<Vec<Event>>) {
    let is_deviated = |rollout: &Rollout| rollout_checks::other_av(scenario, &rollout.tracks).is_none();
    let deviation = scenario.deviation.as_ref().filter(|_| rollouts.iter().all(is_deviated));
    let deviation = deviation.map(DeviationLabels::of).unwrap_or_default();
    let template = Row::about(place, scenario, digest, simulator).with_deviation(&deviation);
    let (how, map) = ((&Metrics::default(), options), OnceLock::new());
    let judged = judge(scenario, deviation.certificate.as_ref(), rollouts, how, judges_av.then_some(&map));
    judged.rows(template, rollouts)
}
