//! The long form: one line per run, simulator, category and metric.

use super::Run;
use crate::evaluation::Estimate;

/// One number.
pub(super) struct Record<'a> {
    pub(super) run: &'a str,
    pub(super) simulator: &'a str,
    pub(super) oracle: bool,
    /// `mean`, or `difference` to log replay.
    pub(super) kind: &'static str,
    /// Category of deviation; `None` for all scenarios.
    pub(super) category: Option<&'a str>,
    pub(super) metric: &'a str,
    pub(super) estimate: Estimate,
}

/// All numbers of runs.
pub(super) fn records<'a>(runs: &'a [Run<'a>]) -> Vec<Record<'a>> {
    let mut out = Vec::new();
    for run in runs {
        for (simulator, _, summary) in run.summary.order() {
            let parts = summary.by_category.iter().map(|(c, s)| ("mean", Some(c.as_str()), &s.metrics));
            let all = [("mean", None, &summary.metrics), ("difference", None, &summary.paired_to_log_replay)];
            for (kind, category, metrics) in all.into_iter().chain(parts) {
                out.extend(metrics.iter().map(|(metric, estimate)| Record {
                    run: run.name,
                    simulator,
                    oracle: summary.oracle,
                    kind,
                    category,
                    metric,
                    estimate: *estimate,
                }));
            }
        }
    }
    out
}
