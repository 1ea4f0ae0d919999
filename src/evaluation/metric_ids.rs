//! Ids of the metrics of a run.

use crate::metrics::METRICS;

/// Returns the ids of all metrics, in the order of their list.
pub(super) fn metric_ids() -> Vec<&'static str> {
    METRICS.iter().map(|m| m.spec().id).collect()
}
