//! The metrics of the AV in one rollout.

use std::collections::BTreeMap;
use std::sync::{Arc, OnceLock};

use reactsim_metrics::{AvScores, Event};
use reactsim_planning::from_scene::{RouteEnd, SceneHistory, planning_map};
use reactsim_planning::metrics::{
    ClosedLoopScore, FirstContact, Label, MetricValue, PlannerMetric, PlannerScores, UndefinedReason,
};
use reactsim_planning::{PlanningError, PlanningMap};
use reactsim_rollout::Rollout;
use reactsim_scene::Scenario;

/// Outcome of a rollout at whose end the AV brakes or stands because its route ends; the place follows.
pub const ROUTE_ENDS: &str = "route-ends";

/// The scores of the AV, and what they lack.
pub(crate) struct JudgedAv {
    pub(crate) scores: AvScores,
    /// Substituted inputs, and undefined metrics with their reasons, each counted once.
    pub(crate) outcomes: BTreeMap<String, u64>,
}

/// Judges the AV in a rollout of a scenario by nuPlan's closed-loop metrics. The motion of the AV is its
/// track, so that all AVs are judged alike, and rollouts that are kept can be judged again. `map`: planning
/// map of the scenario, which is made if it is missing.
///
/// # Errors
/// [`PlanningError`] if the map cannot be used or the AV is absent at a step.
pub(crate) fn judge_av(
    scenario: &Scenario,
    rollout: &Rollout,
    map: &OnceLock<Arc<PlanningMap>>,
) -> Result<JudgedAv, PlanningError> {
    let known = || match map.get() {
        Some(known) => Ok(Arc::clone(known)),
        None => {
            let made = Arc::new(planning_map(scenario)?);
            Ok(Arc::clone(map.get_or_init(|| made)))
        }
    };
    let history = SceneHistory::on_map(scenario, &rollout.tracks, known)?;
    let judged =
        history.judge().map_err(|error| PlanningError(format!("the AV cannot be judged: {error}")))?;
    let mut values: Vec<(&'static str, f64)> = Vec::new();
    let mut outcomes: BTreeMap<String, u64> =
        judged.labels.iter().map(|label| (format!("av {}", Label::name(*label)), 1)).collect();
    let mut add = |id: &'static str, value: Result<f64, UndefinedReason>| match value {
        Ok(value) => values.push((id, value)),
        Err(reason) => _ = outcomes.insert(format!("{id} undefined: {}", reason.id()), 1),
    };
    for (metric, value) in judged.values() {
        add(
            metric.id(),
            match value {
                MetricValue::Defined(value) => Ok(value),
                MetricValue::Undefined(reason) => Err(reason),
            },
        );
    }
    match &judged.score {
        ClosedLoopScore::Complete(score) => add("av-score", Ok(*score)),
        ClosedLoopScore::Partial { score, .. } => add("av-score-partial", Ok(*score)),
    }
    let events = events(scenario, &judged);
    if let Some(end) = history.route_end(scenario) {
        let RouteEnd { lane, position, .. } = end;
        let place = format!("{ROUTE_ENDS}: lane `{lane}` at ({:.1}, {:.1})", position.x, position.y);
        outcomes.insert(place, 1);
    }
    Ok(JudgedAv { scores: AvScores { values, events }, outcomes })
}

/// Returns the occurrences behind the metrics, each with its steps: the first contact with each object, and
/// stretches off the drivable area, against the driving direction, with a short time to collision, above the
/// speed limit, and beyond a bound of comfort. The two metrics of progress are of the whole rollout and have
/// none.
fn events(scenario: &Scenario, judged: &PlannerScores) -> Vec<Event> {
    let agent = &scenario.start.agents[0].id;
    let stretch = |metric: PlannerMetric, [first, last]: [usize; 2], value: (&'static str, f64)| Event {
        metric: metric.id(),
        // Steps count from 1; what is so at the current frame was so before.
        step: first.max(1),
        last_step: last.max(1),
        agent: agent.clone(),
        partner: None,
        reason: None,
        counted: true,
        values: vec![value],
    };
    let contact = |contact: &FirstContact| Event {
        partner: Some(contact.object.to_string()),
        reason: Some(contact.class.id()),
        counted: contact.at_fault == Some(true),
        ..stretch(PlannerMetric::Collisions, [contact.step; 2], ("delta_v", contact.delta_v))
    };
    let mut events: Vec<Event> = judged.collisions.contacts.iter().map(contact).collect();

    let mut corners: BTreeMap<usize, f64> = BTreeMap::new();
    for corner in &judged.drivable_area.off_road {
        *corners.entry(corner.step).or_default() += 1.0;
    }
    for steps in stretches(corners.keys().copied()) {
        let most = corners.range(steps[0]..=steps[1]).map(|(_, corners)| *corners).fold(0.0, f64::max);
        events.push(stretch(PlannerMetric::DrivableArea, steps, ("corners", most)));
    }

    let direction = &judged.driving_direction;
    if direction.value.value().is_some_and(|value| value < 1.0) {
        let value = ("against", -direction.lowest);
        events.push(stretch(PlannerMetric::DrivingDirection, direction.lowest_horizon(), value));
    }

    let short = &judged.time_to_collision.short;
    for same in short.chunk_by(|a, b| a.object == b.object && b.step == a.step + 1) {
        let steps = [same[0].step, same[same.len() - 1].step];
        let least = same.iter().map(|short| short.ttc).fold(f64::INFINITY, f64::min);
        let partner = Some(same[0].object.to_string());
        events.push(Event { partner, ..stretch(PlannerMetric::TimeToCollision, steps, ("ttc", least)) });
    }

    let excess = &judged.speed_limit.overspeed;
    for steps in stretches((0..excess.len()).filter(|&step| excess[step] > 0.0)) {
        let most = excess[steps[0]..=steps[1]].iter().copied().fold(0.0, f64::max);
        events.push(stretch(PlannerMetric::SpeedLimit, steps, ("excess", most)));
    }

    for (quantity, found) in judged.comfort.quantities() {
        let [lower, upper] = found.bounds;
        let is_beyond = |step: &usize| found.values[*step] <= lower || found.values[*step] >= upper;
        for steps in stretches((0..found.values.len()).filter(is_beyond)) {
            let values = &found.values[steps[0]..=steps[1]];
            let extreme = values.iter().copied().fold(0.0, |a: f64, b| if b.abs() > a.abs() { b } else { a });
            let reason = Some(quantity);
            events.push(Event { reason, ..stretch(PlannerMetric::Comfort, steps, ("extreme", extreme)) });
        }
    }
    events
}

/// Returns the first and last of each uninterrupted sequence of increasing steps.
fn stretches(steps: impl Iterator<Item = usize>) -> Vec<[usize; 2]> {
    let mut found: Vec<[usize; 2]> = Vec::new();
    for step in steps {
        match found.last_mut() {
            Some([_, last]) if *last + 1 == step => *last = step,
            _ => found.push([step, step]),
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stretches_end_at_gaps() {
        assert_eq!(stretches([3, 4, 5, 9, 11, 12].into_iter()), [[3, 5], [9, 9], [11, 12]]);
        assert!(stretches(std::iter::empty()).is_empty());
    }
}
