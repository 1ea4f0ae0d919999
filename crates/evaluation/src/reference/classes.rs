//! The required agreement of a run with a reference.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::simulators::record::SimulatorRecord;
use crate::statistics::Estimate;
use crate::summary::SimulatorSummary;

/// Default bound, as a fraction of the half-width of a metric's interval.
const BOUND_SHARE: f64 = 0.5;
/// Minimum default bound, in the unit of the metric: an interval of width zero does not allow for rounding.
const MIN_BOUND: f64 = 1e-3;

/// The required agreement of the results of a simulator with those of a reference.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "class", rename_all = "lowercase")]
pub enum SimulatorClass {
    /// No network: bit-identical on every machine.
    Exact,
    /// A network: bit-identical with the backend and the class of processor of the reference; otherwise
    /// within bounds.
    Tolerance {
        /// Maximum absolute mean of the paired differences, by metric, in the unit of the metric.
        bounds: BTreeMap<String, f64>,
    },
}

impl SimulatorClass {
    /// Returns the class of a simulator with its default bounds: half of the half-width of each metric's 95 %
    /// interval, at least 0.001. Metrics without an interval, of fewer than five scenarios, have none.
    pub fn of(simulator: &SimulatorRecord, summary: &SimulatorSummary) -> Self {
        if !simulator.is_network() {
            return Self::Exact;
        }
        let bounds = summary.metrics.iter().filter_map(|(metric, estimate)| {
            let half = (estimate.high? - estimate.low?) / 2.0;
            Some((metric.clone(), (BOUND_SHARE * half).max(MIN_BOUND)))
        });
        Self::Tolerance { bounds: bounds.collect() }
    }

    /// Returns the name used in tables and files.
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Exact => "exact",
            Self::Tolerance { .. } => "tolerance",
        }
    }

    /// Returns what is wrong with the bounds of a simulator with these metrics, if anything: an invalid
    /// bound, or a metric with an interval but without a bound.
    pub(super) fn wrong_bound(&self, metrics: &BTreeMap<String, Estimate>) -> Option<String> {
        let Self::Tolerance { bounds } = self else { return None };
        let wrong = bounds.iter().find(|(_, bound)| !(bound.is_finite() && **bound >= 0.0));
        if let Some((metric, bound)) = wrong {
            return Some(format!("the bound of `{metric}` is {bound}, expected a number of at least 0"));
        }
        let mut defined = metrics.iter().filter(|(_, estimate)| estimate.high.is_some());
        let (metric, _) = defined.find(|(metric, _)| !bounds.contains_key(*metric))?;
        Some(format!("`{metric}` has no bound"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn metrics_with_an_interval_need_a_bound() {
        let estimate = |low, high| Estimate { mean: Some(0.1), low, high, scenarios: 4 };
        let metric = |estimate| BTreeMap::from([("ade".to_owned(), estimate)]);
        let class = SimulatorClass::Tolerance { bounds: BTreeMap::new() };
        assert_eq!(class.wrong_bound(&metric(estimate(None, None))), None);
        let wrong = class.wrong_bound(&metric(estimate(Some(0.0), Some(0.2))));
        assert_eq!(wrong.as_deref(), Some("`ade` has no bound"));
    }
}
