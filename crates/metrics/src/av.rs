//! Closed-loop metrics of the AV, as nuPlan defines them. `reactsim_planning` computes them; here they are
//! metrics like all others, for rows, summaries and tables.

use super::{Case, Event, Metric, MetricSpec, Scope, Score, Unit};

/// The values of the AV in one rollout, by the id of the metric; undefined ones are absent.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AvScores {
    /// Values with the ids of the metrics with [`Scope::Av`].
    pub values: Vec<(&'static str, f64)>,
    /// Events of these metrics.
    pub events: Vec<Event>,
}

/// A metric of the AV: an index into [`SPECS`].
pub(super) struct OfAv(pub(super) usize);

/// Source of nuPlan's definitions.
const SOURCE: &str = "nuPlan devkit 1.2.2, closed-loop metrics; docs/metrics.md";

const fn spec(id: &'static str, title: &'static str, source: &'static str) -> MetricSpec {
    MetricSpec { id, title, unit: Unit::Plain, scope: Scope::Av, lower_is_better: false, source }
}

/// The metrics: the score, the score without undefined metrics, the four multipliers and the four weighted
/// ones.
static SPECS: [MetricSpec; 10] = [
    spec("av-score", "AV score", SOURCE),
    spec(
        "av-score-partial",
        "AV score, partial",
        "reactsim, docs/metrics.md: nuPlan's score without the metrics that the scenario leaves undefined",
    ),
    spec("av-at-fault-collisions", "AV no collision", SOURCE),
    spec("av-drivable-area", "AV on road", SOURCE),
    spec("av-driving-direction", "AV direction", SOURCE),
    spec("av-making-progress", "AV moves", SOURCE),
    spec("av-expert-progress", "AV progress", SOURCE),
    spec("av-time-to-collision", "AV TTC", SOURCE),
    spec("av-speed-limit", "AV speed limit", SOURCE),
    spec("av-comfort", "AV comfort", SOURCE),
];

impl Metric for OfAv {
    fn spec(&self) -> &'static MetricSpec {
        &SPECS[self.0]
    }

    fn score(&self, case: &Case<'_>, events: &mut Vec<Event>) -> Option<Score> {
        let (scores, id) = (case.av_scores?, self.spec().id);
        events.extend(scores.events.iter().filter(|event| event.metric == id).cloned());
        scores.values.iter().find(|(metric, _)| *metric == id).map(|(_, value)| Score::Value(*value))
    }
}
