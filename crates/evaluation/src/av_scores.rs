//! The metrics of the AV in one rollout.

use std::collections::BTreeMap;

use reactsim_metrics::{AvScores, Event};
use reactsim_planning::from_scene::{SceneHistory, SceneHistoryError};
use reactsim_planning::metrics::{
    ClosedLoopScore, FirstContact, HistoryError, Label, MetricValue, PlannerMetric, PlannerScores,
};
use reactsim_rollout::Rollout;
use reactsim_scene::Scenario;

/// The scores of the AV, and what they lack.
pub(super) struct JudgedAv {
    pub(super) scores: AvScores,
    /// Substituted inputs, and undefined metrics with their reasons, each counted once.
    pub(super) outcomes: BTreeMap<String, u64>,
}

/// Reason why the AV of a rollout cannot be judged.
#[derive(Debug, thiserror::Error)]
pub(super) enum AvScoresError {
    #[error("{0}")]
    Scene(#[from] SceneHistoryError),
    #[error("the AV cannot be judged: {0}")]
    History(#[from] HistoryError),
}

/// Judges the AV of a rollout by nuPlan's closed-loop metrics. Its motion is its track, so that all AVs are
/// judged alike, and rollouts that are kept can be judged again.
///
/// # Errors
/// [`AvScoresError`] if the map cannot be used or the AV is absent at a step.
pub(super) fn judge_av(scenario: &Scenario, rollout: &Rollout) -> Result<JudgedAv, AvScoresError> {
    let judged = SceneHistory::of_rollout(scenario, &rollout.tracks)?.judge()?;
    let mut values: Vec<(&'static str, f64)> = Vec::new();
    let mut outcomes: BTreeMap<String, u64> =
        judged.labels.iter().map(|label| (format!("av {}", Label::name(*label)), 1)).collect();
    for (metric, value) in judged.values() {
        match value {
            MetricValue::Defined(value) => values.push((metric.id(), value)),
            MetricValue::Undefined(reason) => {
                outcomes.insert(format!("{} undefined: {}", metric.id(), reason.id()), 1);
            }
        }
    }
    values.push(match &judged.score {
        ClosedLoopScore::Complete(score) => ("av-score", *score),
        ClosedLoopScore::Partial { score, .. } => ("av-score-partial", *score),
    });
    let events = contacts(scenario, &judged);
    Ok(JudgedAv { scores: AvScores { values, events }, outcomes })
}

/// Returns the first contact of the AV with each object; a contact counts if it is the fault of the AV.
fn contacts(scenario: &Scenario, judged: &PlannerScores) -> Vec<Event> {
    let event = |contact: &FirstContact| Event {
        metric: PlannerMetric::Collisions.id(),
        // Steps are 1 to 80; a contact at the current frame was there before.
        step: contact.step.max(1),
        last_step: contact.step.max(1),
        agent: scenario.start.agents[0].id.clone(),
        partner: Some(contact.object.to_string()),
        reason: Some(contact.class.id()),
        counted: contact.at_fault == Some(true),
        values: vec![("delta_v", contact.delta_v)],
    };
    judged.collisions.contacts.iter().map(event).collect()
}
