//! What a benchmark must hold: so many scenarios of each category, and of every group of scenarios some, but of none too many.

use std::collections::BTreeMap;

use super::{Chooser, ScenarioRecord};
use crate::scene::Deviation;

/// How many scenarios of each category the benchmark of the paper has (ReactSim-Bench, "Data Analysis").
pub const PROPORTIONS: [(Deviation, u64); 3] =
    [(Deviation::Longitudinal, 937), (Deviation::Lateral, 799), (Deviation::Directional, 900)];

/// A group has at most so many times the share that it had if all had the same.
const MOST_OF_ONE: u64 = 2;

/// Decides scenario by scenario which candidate is taken, until the benchmark is full. The decision depends on those before it and on
/// nothing else.
#[derive(Clone, Debug)]
pub struct Quota {
    /// How many are still to be taken, by category.
    open: BTreeMap<Deviation, u64>,
    /// How many were taken, by group; those that must be there from the beginning.
    groups: BTreeMap<String, u64>,
    /// Most of one group.
    most: u64,
    chooser: Chooser,
}

impl Quota {
    /// A benchmark of so many scenarios, in the paper's proportions, in which each of the groups is there.
    pub fn new(wanted: u64, groups: &[String]) -> Self {
        let open = in_proportion(wanted);
        let shares = open.iter().map(|(c, n)| (*c, *n as f64 / wanted.max(1) as f64)).collect();
        let groups: BTreeMap<String, u64> = groups.iter().map(|g| (g.clone(), 0)).collect();
        let most = (MOST_OF_ONE * wanted).div_ceil(groups.len().max(1) as u64);
        Self { open, groups, most, chooser: Chooser::with_shares(shares) }
    }

    /// How many are still to be taken.
    pub fn left(&self) -> u64 {
        self.open.values().sum()
    }

    /// Whether nothing of a group will be taken any more: there are enough of it, or the places that are left are for groups that are not
    /// there yet. Once true it stays true.
    pub fn refuses(&self, group: &str) -> bool {
        let taken = self.groups.get(group).copied().unwrap_or(0);
        let missing = self.groups.iter().filter(|(name, n)| **n == 0 && *name != group).count() as u64;
        taken >= self.most || self.left() <= missing
    }

    /// Marks the candidate that is taken, where one is: of the survivors with a certificate whose category is not full the one that the
    /// [`Chooser`] takes.
    pub fn take(&mut self, group: &str, record: &mut ScenarioRecord) -> bool {
        if self.refuses(group) {
            return false;
        }
        let open = &self.open;
        let is_wanted = |c: &super::CandidateRecord| {
            c.certificate.is_some() && open.get(&c.taxonomy.category).is_some_and(|n| *n > 0)
        };
        let Some(category) = self.chooser.choose_among(record, is_wanted) else { return false };
        self.open.entry(category).and_modify(|n| *n -= 1);
        *self.groups.entry(group.to_owned()).or_default() += 1;
        true
    }

    /// What is not full, in words; empty where nothing is lacking.
    pub fn lacking(&self) -> String {
        let categories = self.open.iter().filter(|(_, n)| **n > 0).map(|(c, n)| format!("{n} {}", c.name()));
        let groups = self.groups.iter().filter(|(_, n)| **n == 0).map(|(g, _)| format!("any of `{g}`"));
        categories.chain(groups).collect::<Vec<_>>().join(", ")
    }
}

/// The paper's proportions of a whole, rounded so that the parts sum up to it: the largest remainders are rounded up.
pub fn in_proportion(wanted: u64) -> BTreeMap<Deviation, u64> {
    let total: u64 = PROPORTIONS.iter().map(|(_, n)| n).sum();
    let share = |n: u64| u128::from(wanted) * u128::from(n);
    let mut parts: Vec<(Deviation, u64, u128)> = PROPORTIONS
        .iter()
        .map(|&(c, n)| (c, (share(n) / u128::from(total)) as u64, share(n) % u128::from(total)))
        .collect();
    parts.sort_by_key(|&(_, _, rest)| std::cmp::Reverse(rest));
    let mut left = wanted - parts.iter().map(|p| p.1).sum::<u64>();
    for (_, n, _) in &mut parts {
        let more = left.min(1);
        (*n, left) = (*n + more, left - more);
    }
    parts.into_iter().map(|(c, n, _)| (c, n)).collect()
}
