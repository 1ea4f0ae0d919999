//! Scoring of the rollouts of one scenario and one simulator, and their rows.

pub(crate) mod av_scores;

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::sync::{Arc, OnceLock};

use reactsim_metrics::{Case, DeviationStats, Event, MetricSpec, Metrics, Options, Scope, Score, metric};
use reactsim_planning::PlanningMap;
use reactsim_rollout::{Entering, Rollout};
use reactsim_scene::{Certificate, Scenario};

use crate::judge::av_scores::{JudgedAv, judge_av};
use crate::row::Row;

/// The scores of the rollouts of one scenario and one simulator.
pub(super) struct PairScores {
    /// Scores of each rollout.
    pub(super) rollouts: Vec<RolloutResult>,
    /// Metrics over all rollouts.
    pub(super) over_all: BTreeMap<String, Option<Score>>,
    /// The first value of a metric of the calling program that is not finite, in words.
    pub(super) not_finite: Option<String>,
}

/// The scores of one rollout.
pub(super) struct RolloutResult {
    pub(super) metrics: BTreeMap<String, Option<Score>>,
    pub(super) events: Vec<Event>,
    pub(super) deviation: BTreeMap<String, f64>,
    pub(super) direction_tracking: &'static str,
    /// Substituted inputs and undefined metrics of the AV, as outcomes.
    pub(super) av: BTreeMap<String, u64>,
}

impl PairScores {
    /// Returns one row per rollout and a last one over all rollouts, and the events of each rollout. `template`
    /// is the row of the scenario and the simulator without values.
    pub(super) fn rows(self, template: Row, rollouts: &[Rollout]) -> (Vec<Row>, Vec<Vec<Event>>) {
        let (mut rows, mut events) = (Vec::with_capacity(rollouts.len() + 1), Vec::new());
        for ((index, rollout), result) in (0..).zip(rollouts).zip(self.rollouts) {
            rows.push(Row {
                rollout: Some(index),
                direction_tracking: Some(result.direction_tracking.to_owned()),
                metrics: result.metrics,
                deviation: result.deviation,
                outcomes: rollout
                    .outcomes
                    .iter()
                    .map(|(name, n)| ((*name).to_owned(), *n))
                    .chain(result.av)
                    .collect(),
                ..template.clone()
            });
            events.push(result.events);
        }
        rows.push(Row { metrics: self.over_all, ..template });
        (rows, events)
    }
}

/// Scores the rollouts of one scenario and one simulator. `certificate`: responses that avoid the AV of the
/// rollouts, if known. `av_map`: planning map on which the AV is judged, too, made at first use; `None` if
/// the AV is not judged.
pub(super) fn judge(
    scenario: &Scenario,
    certificate: Option<&Certificate>,
    rollouts: &[Rollout],
    (metrics, options): (&Metrics, Options),
    av_map: Option<&OnceLock<Arc<PlanningMap>>>,
) -> PairScores {
    let scenes: Vec<Cow<'_, Scenario>> =
        rollouts.iter().map(|rollout| rolled_out(scenario, rollout)).collect();
    let scenes: Vec<&Scenario> = scenes.iter().map(AsRef::as_ref).collect();
    let parts = || rollouts.iter().zip(&scenes);
    let judged: Vec<_> =
        parts().map(|(rollout, scene)| av_map.map(|map| judge_av(scene, rollout, map))).collect();
    let is_own = |scope| scope == Scope::Rollout || av_map.is_some() && scope == Scope::Av;
    let (mut last_case, mut not_finite) = (None, None);
    let results = parts().zip(&judged).map(|((rollout, scene), judged)| {
        let (av_scores, said) = match judged {
            Some(Ok(JudgedAv { scores, outcomes })) => (Some(scores), outcomes.clone()),
            Some(Err(error)) => (None, [(format!("av not judged: {error}"), 1)].into()),
            None => (None, BTreeMap::new()),
        };
        let case = Case::of_rollout(scene, &rollout.tracks, options).with_certificate(certificate);
        let case = case.with_leaving(rollout.entering == Entering::Log);
        let case = last_case.insert(case.with_av_scores(av_scores));
        let scores = metrics.score_case(case);
        let own = scores.values.into_iter().filter(|(spec, _)| is_own(spec.scope));
        RolloutResult {
            metrics: own.map(|value| finite(value, &mut not_finite)).collect(),
            deviation: scores.deviation.map(|d| deviation(&d)).unwrap_or_default(),
            direction_tracking: scores.dir_tracking.name(),
            events: scores.events,
            av: said,
        }
    });
    let results = results.collect();
    // Other agents enter in each rollout. Metrics over all rollouts judge the agents of the beginning only.
    let agents = scenario.start.agents.len();
    let tracks: Vec<_> = rollouts.iter().map(|r| &r.tracks[..agents]).collect();
    if let Some(last) = rollouts.last().filter(|rollout| !rollout.entered.is_empty()) {
        last_case = Some(Case::of_rollout(scenario, &last.tracks[..agents], options).with_leaving(true));
    }
    let all = last_case.map(|case| metrics.score_rollouts(case, &tracks).values).unwrap_or_default();
    let over_all = all.into_iter().map(|value| finite(value, &mut not_finite)).collect();
    PairScores { rollouts: results, over_all, not_finite }
}

/// Returns the scenario as it was in a rollout, with the agents that entered.
fn rolled_out<'s>(scenario: &'s Scenario, rollout: &Rollout) -> Cow<'s, Scenario> {
    if rollout.entering == Entering::Off {
        return Cow::Borrowed(scenario);
    }
    let entered: Vec<usize> = rollout.entered.iter().map(|agent| agent.logged).collect();
    Cow::Owned(scenario.with_entered(&entered))
}

/// Converts a score for files, which cannot represent numbers that are not finite: `None` for metrics of the
/// benchmark; `not_finite` gets the first such value of another metric.
fn finite(
    (spec, score): (&MetricSpec, Option<Score>),
    not_finite: &mut Option<String>,
) -> (String, Option<Score>) {
    let number = score.and_then(Score::value);
    if let Some(value) = number.filter(|value| !value.is_finite() && metric(spec.id).is_none()) {
        not_finite.get_or_insert_with(|| format!("metric `{}` is {value}, expected a finite value", spec.id));
    }
    (spec.id.to_owned(), score.filter(|_| number.is_none_or(f64::is_finite)))
}

/// Returns the statistics that are defined, by name.
fn deviation(stats: &DeviationStats) -> BTreeMap<String, f64> {
    let all = [
        ("ade", stats.ade),
        ("endpoint_lateral", stats.endpoint_lateral),
        ("endpoint_longitudinal", stats.endpoint_longitudinal),
        ("mean_speed_difference", stats.mean_speed_difference),
    ];
    let defined =
        all.into_iter().filter_map(|(name, v)| Some((name.to_owned(), v.filter(|v| v.is_finite())?)));
    defined.collect()
}

#[cfg(test)]
mod tests {
    use reactsim_geometry::Vec2;
    use reactsim_rollout::Entered;
    use reactsim_scene::{
        Agent, AgentKind, AgentState, CURRENT, DT, FRAMES, Frame, LoggedAgent, ScenarioParts,
    };

    use super::*;

    fn straight(y: f64, speed: f64) -> Vec<Frame> {
        let x = |f: usize| speed * DT * (f as f64 - CURRENT as f64);
        (0..FRAMES).map(|f| Some(AgentState { x: x(f), y, heading: 0.0, vx: speed, vy: 0.0 })).collect()
    }

    /// `car` leaves 1 s after the current frame, 1 m beside its log, and `late` enters there, 3 m beside its
    /// own.
    #[test]
    fn agents_that_come_and_go_are_judged_while_they_are_there() {
        let now = CURRENT + 10;
        let agent = |id: &str, track: Vec<Frame>| LoggedAgent {
            agent: Agent { id: id.into(), kind: AgentKind::Vehicle, length: 4.0, width: 2.0 },
            track,
            heights: Vec::new(),
        };
        let from_now = |mut track: Vec<Frame>| {
            track[..now].fill(None);
            track
        };
        let parts = ScenarioParts {
            id: "made".into(),
            origin: Some(Vec2::zeros()),
            agents: vec![
                agent("av", straight(0.0, 0.0)),
                agent("car", straight(70.0, 10.0)),
                agent("late", from_now(straight(40.0, 10.0))),
            ],
            ..ScenarioParts::default()
        };
        let scenario = Scenario::assemble(parts).unwrap();
        let mut car = straight(71.0, 10.0);
        car[CURRENT] = straight(70.0, 10.0)[CURRENT];
        car[now + 1..].fill(None);
        let judged = |entering: Entering| {
            let mut rollout = Rollout {
                tracks: vec![straight(0.0, 0.0), car.clone()],
                entering,
                entered: Vec::new(),
                outcomes: BTreeMap::new(),
            };
            if entering == Entering::Log {
                rollout.entered.push(Entered { logged: 0, frame: now, waited: 0 });
                rollout.tracks.push(from_now(straight(43.0, 10.0)));
            }
            let metrics = (&Metrics::default(), Options::default());
            let found = judge(&scenario, None, &[rollout], metrics, None);
            let of = |values: &BTreeMap<String, Option<Score>>, id: &str| values[id].and_then(Score::value);
            let own = &found.rollouts[0].metrics;
            (of(own, "ade"), of(&found.over_all, "min-ade"), of(own, "progress").unwrap())
        };
        let (ade, min_ade, progress) = judged(Entering::Log);
        assert_eq!((ade, min_ade), (Some(2.0), Some(1.0)));
        assert!(progress >= 1.0, "{progress}");
        // Without agents that leave, it has vanished.
        let (ade, min_ade, progress) = judged(Entering::Off);
        assert_eq!((ade, min_ade), (Some(1.0), Some(1.0)));
        assert!(progress < 0.2, "{progress}");
    }
}
