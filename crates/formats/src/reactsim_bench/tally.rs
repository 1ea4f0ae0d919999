//! The layout of all files: the one under which the AVs continue their logs best.

use std::collections::{BTreeMap, BTreeSet};

use reactsim_scene::AgentState;

use super::layout::{Fit, Layout, Slot};
use super::track::Heading;

/// Share of the files that a layout must fit.
const NEARLY_ALL: f64 = 0.9;
/// Cost of a file that does not fit, metres.
pub(super) const MISFIT: f64 = 2.0;
/// Ratio of costs up to which two layouts fit equally, and a cost per file that counts as none, metres.
const EQUAL: (f64, f64) = (1.15, 0.15);
/// Largest distance between equal trajectories, metres.
const SAME_TRACK: f64 = 0.1;

/// Layouts with their totals, the best first.
pub(super) type Ranked = Vec<(Layout, Total)>;

/// How well a reading of the files fits them.
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

/// Readings of the files so far.
#[derive(Debug)]
pub struct Tally<K> {
    files: usize,
    totals: BTreeMap<K, Total>,
}

impl<K> Default for Tally<K> {
    fn default() -> Self {
        Self { files: 0, totals: BTreeMap::new() }
    }
}

impl<K: Ord> Tally<K> {
    /// Adds those that fit a file.
    pub(super) fn add(&mut self, fitting: Vec<(K, Fit)>) {
        self.files += 1;
        for (key, fit) in fitting {
            let none = Total { files: 0, logs: 0, shape: fit.shape, cost: 0.0 };
            let total = self.totals.entry(key).or_insert(none);
            total.files += 1;
            total.logs += usize::from(fit.is_log);
            total.cost += fit.cost;
        }
    }

    fn cost(&self, total: &Total) -> f64 {
        total.cost + MISFIT * (self.files - total.files) as f64
    }

    fn fits(&self, total: &Total) -> bool {
        total.files as f64 >= NEARLY_ALL * self.files as f64
    }
}

impl Tally<Layout> {
    /// Returns the layouts that fit nearly all files and, among them, no worse than any other, best first.
    ///
    /// # Errors
    /// If there is none: the best ones.
    pub(super) fn best(&self) -> Result<Ranked, Ranked> {
        let (cost, fits) = (|total: &Total| self.cost(total), |total: &Total| self.fits(total));
        let is_log = |total: &Total| fits(total) && total.logs as f64 >= NEARLY_ALL * total.files as f64;
        // Whatever else the logged drive could be read as, it is the log.
        let logs = self.totals.iter().filter(|(_, total)| is_log(total));
        let logs: BTreeSet<(&str, Slot)> =
            logs.map(|(layout, _)| (layout.key.as_str(), layout.slot)).collect();
        let mut all: Ranked = self.totals.iter().map(|(layout, total)| (layout.clone(), *total)).collect();
        all.sort_by(|(_, a), (_, b)| cost(a).total_cmp(&cost(b)));
        let (logged, mut ranked): (Ranked, Ranked) =
            all.into_iter().partition(|(layout, _)| logs.contains(&(layout.key.as_str(), layout.slot)));
        let Some((best, least)) = ranked.first().filter(|(_, total)| fits(total)).cloned() else {
            ranked.extend(logged);
            return Err(ranked);
        };
        let most = EQUAL.0 * cost(&least) + EQUAL.1 * self.files as f64;
        // Another trajectory of the same AV is a rival however well it fits.
        let is_other =
            |layout: &Layout| Layout { key: best.key.clone(), slot: best.slot, ..layout.clone() } == best;
        ranked.retain(|(layout, total)| fits(total) && (cost(total) <= most || is_other(layout)));
        Ok(ranked)
    }
}

impl Tally<Heading> {
    /// Returns the heading that fits nearly all files best, or else the direction of motion.
    pub(super) fn best(&self) -> Heading {
        let fitting = self.totals.iter().filter(|(_, total)| self.fits(total));
        let best = fitting.min_by(|(_, a), (_, b)| self.cost(a).total_cmp(&self.cost(b)));
        best.map_or(Heading::Motion, |(heading, _)| *heading)
    }
}

/// Returns whether a file has the same trajectory under two layouts.
pub(super) fn is_same(a: Option<&[AgentState]>, b: Option<&[AgentState]>) -> bool {
    let is_near = |(a, b): (&AgentState, &AgentState)| (a.position() - b.position()).norm() <= SAME_TRACK;
    a.zip(b).map_or(a.is_none() && b.is_none(), |(a, b)| a.iter().zip(b).all(is_near))
}
