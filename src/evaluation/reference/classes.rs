//! How closely a run must agree with a reference.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::evaluation::{Estimate, SimulatorRecord, SimulatorSummary};

/// Default bound, as a share of the half-width of a metric's interval.
const BOUND_SHARE: f64 = 0.5;
/// Smallest default bound, in the units of a metric's values: an interval without width says nothing about rounding.
const SMALLEST_BOUND: f64 = 1e-3;

/// How closely the results of a simulator must agree with those of a reference.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "class", rename_all = "lowercase")]
pub enum SimulatorClass {
    /// No network: bit for bit on every machine.
    Exact,
    /// A network: bit for bit on the backend and the class of processor of the reference; elsewhere within bounds.
    Tolerance {
        /// Largest absolute mean of the paired differences, by metric, in the units of its values.
        bounds: BTreeMap<String, f64>,
    },
}

impl SimulatorClass {
    /// The class of a simulator with its default bounds: half of the half-width of each metric's 95 % interval, at least 0.001.
    pub fn of(simulator: &SimulatorRecord, summary: &SimulatorSummary) -> Self {
        if !simulator.is_network() {
            return Self::Exact;
        }
        let bounds = summary.metrics.iter().filter_map(|(metric, estimate)| {
            let half = (estimate.high? - estimate.low?) / 2.0;
            Some((metric.clone(), (BOUND_SHARE * half).max(SMALLEST_BOUND)))
        });
        Self::Tolerance { bounds: bounds.collect() }
    }

    /// Name in tables and files.
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Exact => "exact",
            Self::Tolerance { .. } => "tolerance",
        }
    }

    /// What is wrong with the bounds of a simulator with these metrics: one that is no bound, or a metric without one.
    pub(super) fn wrong_bound(&self, metrics: &BTreeMap<String, Estimate>) -> Option<String> {
        let Self::Tolerance { bounds } = self else { return None };
        let wrong = bounds.iter().find(|(_, bound)| !(bound.is_finite() && **bound >= 0.0));
        if let Some((metric, bound)) = wrong {
            return Some(format!("the bound of `{metric}` is {bound}: write a number from 0 up"));
        }
        let mut judged = metrics.iter().filter(|(_, estimate)| estimate.mean.is_some());
        let (metric, _) = judged.find(|(metric, _)| !bounds.contains_key(*metric))?;
        Some(format!("`{metric}` has no bound"))
    }
}
