//! The long format: one record per run, simulator, category or difficulty, and metric.

use reactsim_evaluation::Estimate;

use super::{Run, TableStyle};

/// An estimate with its keys.
pub(super) struct Record<'a> {
    pub(super) run: &'a str,
    /// What drives the AV, such as `planner:idm`.
    pub(super) av: &'a str,
    pub(super) simulator: &'a str,
    pub(super) oracle: bool,
    /// `mean`, or `difference` to log replay.
    pub(super) kind: &'static str,
    /// Category of deviation; `None` for all categories.
    pub(super) category: Option<&'a str>,
    /// Difficulty of the deviation; `None` for all difficulties.
    pub(super) difficulty: Option<&'a str>,
    pub(super) metric: &'a str,
    pub(super) estimate: Estimate,
}

/// Returns all estimates of runs, or those of the chosen columns.
pub(super) fn records<'a>(runs: &'a [Run<'a>], style: TableStyle<'_>) -> Vec<Record<'a>> {
    let mut out = Vec::new();
    for run in runs {
        for (simulator, _, summary) in run.summary.order() {
            let all = [
                ("mean", None, None, &summary.metrics),
                ("difference", None, None, &summary.paired_to_log_replay),
            ];
            let categories = summary.by_category.iter();
            let categories = categories.map(|(name, s)| ("mean", Some(name.as_str()), None, &s.metrics));
            let difficulties = summary.by_difficulty.iter();
            let difficulties = difficulties.map(|(name, s)| ("mean", None, Some(name.as_str()), &s.metrics));
            for (kind, category, difficulty, metrics) in all.into_iter().chain(categories).chain(difficulties)
            {
                let chosen = metrics.iter().filter(|(metric, _)| style.has(metric));
                out.extend(chosen.map(|(metric, estimate)| Record {
                    run: run.name,
                    av: &run.summary.provenance.run.settings.av,
                    simulator,
                    oracle: summary.oracle,
                    kind,
                    category,
                    difficulty,
                    metric,
                    estimate: *estimate,
                }));
            }
        }
    }
    out
}
