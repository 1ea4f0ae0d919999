//! From rollouts to rows: what the metrics say about one scenario and one simulator.

use std::collections::BTreeMap;

use super::row::{Row, Value};
use crate::metrics::{self, Case, DeviationStats, Event, METRICS, Options, Score};
use crate::rollout::Rollout;
use crate::scene::{Certificate, Scenario};

/// Metrics that judge all rollouts of a scenario together.
const TOGETHER: [&str; 2] = ["min-ade", "kinematic-likelihood"];

/// Ids of all metrics, in the order of their list.
pub(super) fn metric_ids() -> Vec<&'static str> {
    METRICS.iter().map(|m| m.spec().id).collect()
}

/// What the rollouts of one scenario and one simulator are worth.
pub(super) struct Judged {
    /// Per rollout.
    pub(super) each: Vec<JudgedRollout>,
    /// Metrics over all rollouts.
    pub(super) together: BTreeMap<String, Option<Value>>,
}

/// What one rollout is worth.
pub(super) struct JudgedRollout {
    pub(super) metrics: BTreeMap<String, Option<Value>>,
    pub(super) events: Vec<Event>,
    pub(super) deviation: BTreeMap<String, f64>,
    pub(super) direction_tracking: &'static str,
}

impl Judged {
    /// A row per rollout, each with its events, and at the end one for all of them; `about` says what they are rows of.
    /// `indices` are those of the rollouts.
    pub(super) fn rows(
        self,
        about: Row,
        indices: impl IntoIterator<Item = u32>,
        rollouts: &[Rollout],
    ) -> Vec<(Row, Vec<Event>)> {
        let mut rows = Vec::with_capacity(rollouts.len() + 1);
        for ((index, rollout), one) in indices.into_iter().zip(rollouts).zip(self.each) {
            let row = Row {
                rollout: Some(index),
                direction_tracking: Some(one.direction_tracking.to_owned()),
                metrics: one.metrics,
                deviation: one.deviation,
                outcomes: rollout.outcomes.iter().map(|(name, n)| ((*name).to_owned(), *n)).collect(),
                ..about.clone()
            };
            rows.push((row, one.events));
        }
        rows.push((Row { metrics: self.together, ..about }, Vec::new()));
        rows
    }
}

/// Judges the rollouts of one scenario and one simulator. `certificate`: how the AV of the rollouts can be avoided, where known.
pub(super) fn judge(
    scenario: &Scenario,
    certificate: Option<&Certificate>,
    rollouts: &[Rollout],
    options: Options,
) -> Judged {
    let tracks: Vec<_> = rollouts.iter().map(|r| r.tracks.as_slice()).collect();
    let all = metrics::score_rollouts(scenario, &tracks, options);
    let over_all = [
        all.displacement.map(|d| d.min_ade),
        all.likelihood.as_ref().and_then(metrics::KinematicLikelihood::kinematic),
    ];
    let together = TOGETHER.iter().zip(over_all).map(|(id, value)| {
        let value = value.and_then(|v| finite(Score::Value(v)));
        ((*id).to_owned(), value)
    });
    let each = rollouts.iter().map(|rollout| {
        let case = Case::of_rollout(scenario, rollout.tracks.clone(), options);
        let scores = metrics::score_case(&case.with_certificate(certificate));
        let own = scores.values.iter().filter(|(spec, _)| !TOGETHER.contains(&spec.id));
        JudgedRollout {
            metrics: own.map(|(spec, score)| (spec.id.to_owned(), score.and_then(finite))).collect(),
            deviation: scores.deviation.map(|d| deviation(&d)).unwrap_or_default(),
            direction_tracking: scores.dir_tracking.name(),
            events: scores.events,
        }
    });
    Judged { each: each.collect(), together: together.collect() }
}

/// A score as files hold it. A number that is none judges nothing: files have no form for it.
fn finite(score: Score) -> Option<Value> {
    score.value().is_none_or(f64::is_finite).then(|| Value::from(score))
}

/// The statistics that are defined, by name.
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
