//! The layout of all files: the one under which the AVs continue their logs best.

use std::collections::BTreeMap;

use reactsim_scene::AgentState;

use super::layout::{Fit, Layout};
use super::track::Heading;

/// Share of the files that a layout must fit.
const NEARLY_ALL: f64 = 0.9;
/// Cost of a file that does not fit, metres.
pub(super) const MISFIT: f64 = 2.0;
/// Ratio of costs up to which two layouts fit equally, and a cost per file that counts as none, metres.
const EQUAL: (f64, f64) = (1.15, 0.15);
/// Most layouts that are compared in detail.
const MAX_RIVALS: usize = 12;
/// Largest distance between equal trajectories, metres.
const SAME_TRACK: f64 = 0.1;

/// Layouts with their totals, the best first.
pub(super) type Ranked = Vec<(Layout, Total)>;

/// How well a layout fits the files.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Total {
    /// Number of files that it fits.
    pub(super) files: usize,
    /// Number of them whose trajectory is the log.
    pub(super) logs: usize,
    /// Entries and columns.
    pub(super) shape: [usize; 2],
    cost: f64,
}

/// Layouts of the files so far.
#[derive(Debug, Default)]
pub struct LayoutTally {
    files: usize,
    totals: BTreeMap<Layout, Total>,
}

impl LayoutTally {
    /// Adds the layouts that fit a file.
    pub(super) fn add(&mut self, fitting: Vec<(Layout, Fit)>) {
        self.files += 1;
        for (layout, fit) in fitting {
            let none = Total { files: 0, logs: 0, shape: fit.shape, cost: 0.0 };
            let total = self.totals.entry(layout).or_insert(none);
            total.files += 1;
            total.logs += usize::from(fit.is_log);
            total.cost += fit.cost;
        }
    }

    /// Returns the layouts that fit nearly all files and, among them, no worse than any other, best first.
    ///
    /// # Errors
    /// If there is none: the best ones.
    pub(super) fn best(&self) -> Result<Ranked, Ranked> {
        let n = self.files as f64;
        let cost = |total: &Total| total.cost + MISFIT * (self.files - total.files) as f64;
        let is_log = |total: &Total| total.logs as f64 >= NEARLY_ALL * total.files as f64;
        let mut ranked: Ranked =
            self.totals.iter().filter(|(_, t)| !is_log(t)).map(|(l, t)| (l.clone(), *t)).collect();
        if ranked.is_empty() {
            ranked = self.totals.iter().map(|(layout, total)| (layout.clone(), *total)).collect();
        }
        ranked.sort_by(|(_, a), (_, b)| cost(a).total_cmp(&cost(b)));
        let fits = |total: &Total| total.files as f64 >= NEARLY_ALL * n && !is_log(total);
        let Some((best, least)) = ranked.first().filter(|(_, total)| fits(total)).cloned() else {
            ranked.truncate(MAX_RIVALS);
            return Err(ranked);
        };
        let most = EQUAL.0 * cost(&least) + EQUAL.1 * n;
        // Another trajectory of the same AV is a rival however well it fits.
        let is_other =
            |layout: &Layout| Layout { key: best.key.clone(), slot: best.slot, ..layout.clone() } == best;
        ranked.retain(|(layout, total)| fits(total) && (cost(total) <= most || is_other(layout)));
        ranked.truncate(MAX_RIVALS);
        Ok(ranked)
    }
}

/// Headings of the files so far under a layout.
#[derive(Debug, Default)]
pub(super) struct HeadingTally {
    files: usize,
    totals: BTreeMap<Heading, (usize, f64)>,
}

impl HeadingTally {
    /// Adds the headings that fit a file.
    pub(super) fn add(&mut self, fitting: &[(Heading, f64)]) {
        self.files += 1;
        for (heading, cost) in fitting {
            let total = self.totals.entry(*heading).or_default();
            *total = (total.0 + 1, total.1 + cost);
        }
    }

    /// Returns the heading that fits nearly all files best, or else the direction of motion.
    pub(super) fn best(&self) -> Heading {
        let least = NEARLY_ALL * self.files as f64;
        let fitting = self.totals.iter().filter(|(_, (files, _))| *files as f64 >= least);
        let cost = |(files, cost): &(usize, f64)| cost + (self.files - files) as f64;
        let best = fitting.min_by(|(_, a), (_, b)| cost(a).total_cmp(&cost(b)));
        best.map_or(Heading::Motion, |(heading, _)| *heading)
    }
}

/// Returns whether two layouts give the same trajectories for nearly all files.
pub(super) fn are_same<'a>(
    pairs: impl Iterator<Item = (Option<&'a [AgentState]>, Option<&'a [AgentState]>)>,
) -> bool {
    let (mut different, mut all) = (0, 0_usize);
    for (a, b) in pairs {
        let far = a.zip(b).is_some_and(|(a, b)| {
            a.iter().zip(b).any(|(a, b)| (a.position() - b.position()).norm() > SAME_TRACK)
        });
        (different, all) = (different + usize::from(far || a.is_some() != b.is_some()), all + 1);
    }
    50 * different < all.max(1)
}
