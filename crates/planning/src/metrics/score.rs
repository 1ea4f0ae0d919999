//! The closed-loop score of a scenario (nuPlan devkit 1.2.2; the same weights for reactive and non-reactive
//! traffic).

use super::{MetricValue, PlannerMetric, UndefinedReason};

/// The role of a metric in the score.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MetricRole {
    /// The score is multiplied by the value.
    Multiplier,
    /// The value is part of the weighted mean, with this weight.
    Weighted(f64),
}

impl PlannerMetric {
    /// Returns the role in the score.
    pub const fn role(self) -> MetricRole {
        match self {
            Self::Collisions | Self::DrivableArea | Self::DrivingDirection | Self::MakingProgress => {
                MetricRole::Multiplier
            }
            Self::Progress | Self::TimeToCollision => MetricRole::Weighted(5.0),
            Self::SpeedLimit => MetricRole::Weighted(4.0),
            Self::Comfort => MetricRole::Weighted(2.0),
        }
    }
}

/// The closed-loop score of one scenario, 0 to 1.
#[derive(Clone, Debug, PartialEq)]
pub enum ClosedLoopScore {
    /// All eight metrics are defined: `cls`.
    Complete(f64),
    /// Some metrics are undefined and left out, the weights of the others are scaled up: `cls-partial`. It is
    /// not comparable with `cls`.
    Partial {
        /// The score of the defined metrics.
        score: f64,
        /// The metrics left out, with reasons.
        undefined: Vec<(PlannerMetric, UndefinedReason)>,
    },
}

impl ClosedLoopScore {
    /// Combines the values of the metrics: the product of the multipliers times the weighted mean.
    pub fn of(values: &[(PlannerMetric, MetricValue)]) -> Self {
        let score = combined(values.iter().map(|(metric, value)| (*value, metric.role())));
        let reason = |&(metric, value): &(PlannerMetric, MetricValue)| match value {
            MetricValue::Undefined(reason) => Some((metric, reason)),
            MetricValue::Defined(_) => None,
        };
        let undefined: Vec<_> = values.iter().filter_map(reason).collect();
        if undefined.is_empty() { Self::Complete(score) } else { Self::Partial { score, undefined } }
    }

    /// Returns the id of the column: `cls` or `cls-partial`.
    pub const fn id(&self) -> &'static str {
        match self {
            Self::Complete(_) => "cls",
            Self::Partial { .. } => "cls-partial",
        }
    }

    /// Returns the score if all metrics are defined.
    pub const fn cls(&self) -> Option<f64> {
        match self {
            Self::Complete(score) => Some(*score),
            Self::Partial { .. } => None,
        }
    }

    /// Returns the score of the defined metrics, which may be incomplete.
    pub const fn value(&self) -> f64 {
        match self {
            Self::Complete(score) | Self::Partial { score, .. } => *score,
        }
    }
}

/// Returns the product of the multipliers times the weighted mean of the defined values; 0 if none is
/// defined.
fn combined(values: impl IntoIterator<Item = (MetricValue, MetricRole)>) -> f64 {
    let (mut product, mut sum, mut weights) = (None, 0.0, 0.0);
    for (value, role) in values {
        match (value, role) {
            (MetricValue::Undefined(_), _) => {}
            (MetricValue::Defined(value), MetricRole::Multiplier) => {
                product = Some(product.unwrap_or(1.0) * value);
            }
            (MetricValue::Defined(value), MetricRole::Weighted(weight)) => {
                sum += weight * value;
                weights += weight;
            }
        }
    }
    if weights > 0.0 { product.unwrap_or(1.0) * (sum / weights) } else { product.unwrap_or(0.0) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn values(change: &[(PlannerMetric, MetricValue)]) -> Vec<(PlannerMetric, MetricValue)> {
        let changed = |metric| change.iter().find(|(m, _)| *m == metric).map(|(_, value)| *value);
        let value = |metric| changed(metric).unwrap_or(MetricValue::Defined(1.0));
        PlannerMetric::ALL.map(|metric| (metric, value(metric))).to_vec()
    }

    #[test]
    fn undefined_metrics_make_the_score_partial() {
        let undefined = MetricValue::Undefined(UndefinedReason::UnknownSpeedLimits);
        let comfort = (PlannerMetric::Comfort, MetricValue::Defined(0.0));
        let score = ClosedLoopScore::of(&values(&[(PlannerMetric::SpeedLimit, undefined), comfort]));
        assert_eq!((score.id(), score.cls()), ("cls-partial", None));
        assert!((score.value() - 10.0 / 12.0).abs() < 1e-12);
    }

    #[test]
    fn a_scenario_without_metrics_scores_zero() {
        let undefined = MetricValue::Undefined(UndefinedReason::NoLanes);
        let all = PlannerMetric::ALL.map(|metric| (metric, undefined));
        assert_eq!(ClosedLoopScore::of(&all).value(), 0.0);
    }
}
