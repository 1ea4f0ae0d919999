//! Checks of rollouts from other programs, whose numbers would otherwise look better than they are.

use std::collections::BTreeMap;

use reactsim_rollout::{Entering, Rollout};
use reactsim_scene::{Frame, OBSERVED_DISTANCE, Scenario};

use crate::error::EvaluationError;
use crate::motion::CheckedScene;
use crate::motion::kind::RolloutCheck;

/// Largest distance of a recorded AV from the prescribed trajectory, metres: more than rounding to `f32`.
const AV_TOLERANCE: f64 = 0.05;

/// Rollouts that fail checks: how many, and the first of them.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Findings(BTreeMap<RolloutCheck, (usize, String)>);

impl Findings {
    /// Adds a finding; the text of the first one is kept.
    pub fn add(&mut self, check: RolloutCheck, text: impl FnOnce() -> String) {
        self.0.entry(check).or_insert_with(|| (0, text())).0 += 1;
    }

    /// Returns check, number of rollouts (of scenarios for coverage) and first example.
    pub fn iter(&self) -> impl Iterator<Item = (RolloutCheck, usize, &str)> {
        self.0.iter().map(|(check, (count, text))| (*check, *count, text.as_str()))
    }

    /// Checks that all findings are allowed.
    ///
    /// # Errors
    /// [`EvaluationError`] has a line for each that is not, with what allows it.
    pub(crate) fn check(&self, allowed: &[RolloutCheck]) -> Result<(), EvaluationError> {
        let lines =
            self.iter().filter(|(check, _, _)| !allowed.contains(check)).map(|(check, count, text)| {
                let what = if check == RolloutCheck::Coverage { "scenario" } else { "rollout" };
                let plural = if count == 1 { "" } else { "s" };
                format!("\n  {count} {what}{plural}, the first: {text} (`allow` {})", check.allowance())
            });
        let lines: String = lines.collect();
        match lines.is_empty() {
            true => Ok(()),
            false => Err(EvaluationError::Refused(format!(
                "the rollouts do not show what the scenarios ask for:{lines}"
            ))),
        }
    }
}

/// Checks a rollout. Returns the checks that fail.
pub(crate) fn check(
    scenario: &Scenario,
    place: &str,
    rollout: &Rollout,
    findings: &mut Findings,
) -> Vec<RolloutCheck> {
    let mut failed = Vec::new();
    let mut add = |check, text: String| {
        findings.add(check, || format!("{place}: {text}"));
        failed.push(check);
    };
    if let Some(text) = other_av(scenario, &rollout.tracks) {
        add(RolloutCheck::Av, text);
    }
    for finding in CheckedScene::of_rollout(scenario, rollout, scenario.deviation.is_some()).findings() {
        add(finding.check, finding.text);
    }
    if let Some(text) = missing(scenario, rollout) {
        add(RolloutCheck::Presence, text);
    }
    failed
}

/// Returns how the AV differs from the deviated AV of the scenario, if it does.
pub(crate) fn other_av(scenario: &Scenario, tracks: &[Vec<Frame>]) -> Option<String> {
    let prescribed = &scenario.deviation.as_ref()?.track;
    let recorded = &tracks.first()?[scenario.length().history..];
    for (k, (wanted, found)) in prescribed.iter().zip(recorded).enumerate() {
        let step = k + 1;
        match found {
            None => return Some(format!("the AV is absent at step {step}")),
            Some(found) => {
                let distance = (found.position() - wanted.position()).norm();
                // NaN is not within the tolerance either.
                let is_same = distance <= AV_TOLERANCE;
                if !is_same {
                    return Some(format!(
                        "the AV is {distance:.2} m from the prescribed trajectory at step {step}"
                    ));
                }
            }
        }
    }
    None
}

fn missing(scenario: &Scenario, rollout: &Rollout) -> Option<String> {
    let (mut agents, mut first, history) = (0, None, scenario.length().history);
    for (slot, (track, logged)) in rollout.tracks.iter().zip(&scenario.log_future.tracks).enumerate() {
        let gone = track[history..].iter().zip(logged).position(|(own, log)| own.is_none() && log.is_some());
        // An agent may leave outside of the observed area, for good.
        let has_left = |k: usize| {
            let (last, av) = (track[history + k - 1], rollout.tracks[0][history + k - 1]);
            let distance = last.zip(av).map(|(last, av)| (last.position() - av.position()).norm());
            track[history + k..].iter().all(Option::is_none)
                && distance.is_some_and(|distance| distance >= OBSERVED_DISTANCE)
        };
        if let Some(k) = gone.filter(|k| rollout.entering == Entering::Off || !has_left(*k)) {
            agents += 1;
            let id = &scenario.start.agents[slot].id;
            first.get_or_insert_with(|| {
                format!("agent `{id}` is absent at step {}, but not in the log", k + 1)
            });
        }
    }
    let first = first?;
    Some(if agents > 1 { format!("{first}; {agents} agents are") } else { first })
}
