//! What a benchmark must hold: so many scenarios of each category and of each difficulty, and some of every group of scenarios, but not too many of any.

use std::collections::BTreeMap;

use super::{Chooser, ScenarioRecord};
use crate::scene::{Deviation, Difficulty};

/// How many scenarios of each category the benchmark of the paper has (ReactSim-Bench, "Data Analysis").
pub const PROPORTIONS: [(Deviation, u64); 3] =
    [(Deviation::Longitudinal, 937), (Deviation::Directional, 799), (Deviation::Lateral, 900)];

/// Shares of the difficulties in a benchmark: as many easy as medium ones, and no fewer hard ones, rounded up.
pub const DIFFICULTIES: [(Difficulty, u64); 3] =
    [(Difficulty::Hard, 1), (Difficulty::Medium, 1), (Difficulty::Easy, 1)];

/// A group has at most so many times the share that it had if all had the same.
const MOST_OF_ONE: u64 = 2;

/// What the last places of a benchmark must be, where the wanted ones are not found: a scenario of one category, one difficulty and one
/// group may not exist.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Strictness {
    /// Of the categories and of the difficulties that are not full.
    CategoryAndDifficulty,
    /// Of the categories that are not full.
    Category,
    /// Of any category and difficulty.
    Any,
}

/// Decides scenario by scenario which candidate is taken, until the benchmark is full. The decision depends on those before it and on
/// nothing else.
#[derive(Clone, Debug)]
pub struct Quota {
    /// How many are still to be taken, by category.
    open: BTreeMap<Deviation, u64>,
    /// How many are still to be taken, by difficulty.
    open_difficulties: BTreeMap<Difficulty, u64>,
    /// How many are still to be taken.
    left: u64,
    strictness: Strictness,
    /// How many were taken, by group; those that must be there from the beginning.
    groups: BTreeMap<String, u64>,
    /// Most of one group.
    most: u64,
    chooser: Chooser,
}

impl Quota {
    /// A benchmark of so many scenarios, in the paper's proportions, in which each of the groups is there.
    pub fn new(wanted: u64, groups: &[String]) -> Self {
        let open = in_proportion(wanted, &PROPORTIONS);
        let open_difficulties = in_proportion(wanted, &DIFFICULTIES);
        let chooser = Chooser::with_shares(shares(&open), shares(&open_difficulties));
        let groups: BTreeMap<String, u64> = groups.iter().map(|g| (g.clone(), 0)).collect();
        let most = (MOST_OF_ONE * wanted).div_ceil(groups.len().max(1) as u64);
        Self {
            open,
            open_difficulties,
            left: wanted,
            strictness: Strictness::CategoryAndDifficulty,
            groups,
            most,
            chooser,
        }
    }

    /// How many are still to be taken.
    pub fn left(&self) -> u64 {
        self.left
    }

    /// Whether nothing of a group will be taken any more: there are enough of it, or the places that are left are for groups that are not
    /// there yet. Once true it stays true.
    pub fn refuses(&self, group: &str) -> bool {
        let taken = self.groups.get(group).copied().unwrap_or(0);
        let missing = self.groups.iter().filter(|(name, n)| **n == 0 && *name != group).count() as u64;
        taken >= self.most || self.left() <= missing
    }

    /// Marks the candidate that is taken, where one is: of the survivors whose category and difficulty are not full the one that the
    /// [`Chooser`] takes.
    pub fn take(&mut self, group: &str, record: &mut ScenarioRecord) -> bool {
        if self.refuses(group) {
            return false;
        }
        let (open, difficulties, strictness) = (&self.open, &self.open_difficulties, self.strictness);
        let is_wanted = |c: &super::CandidateRecord| {
            let Some(difficulty) = c.difficulty() else { return false };
            let category = open.get(&c.taxonomy.category).is_some_and(|n| *n > 0);
            match strictness {
                Strictness::CategoryAndDifficulty => {
                    category && difficulties.get(&difficulty).is_some_and(|n| *n > 0)
                }
                Strictness::Category => category,
                Strictness::Any => true,
            }
        };
        let Some(chosen) = self.chooser.choose_among(record, is_wanted) else { return false };
        self.left -= 1;
        self.open.entry(chosen.taxonomy.category).and_modify(|n| *n = n.saturating_sub(1));
        if let Some(difficulty) = chosen.difficulty() {
            self.open_difficulties.entry(difficulty).and_modify(|n| *n = n.saturating_sub(1));
        }
        *self.groups.entry(group.to_owned()).or_default() += 1;
        true
    }

    /// Asks less of the places that are left; what is asked of them from now on, `None` where nothing was left to be given up.
    pub fn relax(&mut self) -> Option<Strictness> {
        self.strictness = match self.strictness {
            Strictness::CategoryAndDifficulty => Strictness::Category,
            Strictness::Category => Strictness::Any,
            Strictness::Any => return None,
        };
        Some(self.strictness)
    }

    /// What is not full, in words; empty where nothing is lacking.
    pub fn lacking(&self) -> String {
        let categories = self.open.iter().filter(|(_, n)| **n > 0).map(|(c, n)| format!("{n} {}", c.name()));
        let left = self.open_difficulties.iter().filter(|(_, n)| **n > 0);
        let difficulties = left.map(|(d, n)| format!("{n} {}", d.name()));
        let groups = self.groups.iter().filter(|(_, n)| **n == 0).map(|(g, _)| format!("any of `{g}`"));
        categories.chain(difficulties).chain(groups).collect::<Vec<_>>().join(", ")
    }
}

/// The share of each of the kinds that are wanted.
fn shares<K: Ord + Copy>(wanted: &BTreeMap<K, u64>) -> BTreeMap<K, f64> {
    let total = wanted.values().sum::<u64>().max(1) as f64;
    wanted.iter().map(|(k, n)| (*k, *n as f64 / total)).collect()
}

/// Parts of a whole in these proportions, rounded so that the parts sum up to it: the largest remainders are rounded up, of equal ones
/// the first.
pub fn in_proportion<K: Ord + Copy>(wanted: u64, proportions: &[(K, u64)]) -> BTreeMap<K, u64> {
    let total: u64 = proportions.iter().map(|(_, n)| n).sum();
    let share = |n: u64| u128::from(wanted) * u128::from(n);
    let mut parts: Vec<(K, u64, u128)> = proportions
        .iter()
        .map(|&(k, n)| (k, (share(n) / u128::from(total)) as u64, share(n) % u128::from(total)))
        .collect();
    parts.sort_by_key(|&(_, _, rest)| std::cmp::Reverse(rest));
    let mut left = wanted - parts.iter().map(|p| p.1).sum::<u64>();
    for (_, n, _) in &mut parts {
        let more = left.min(1);
        (*n, left) = (*n + more, left - more);
    }
    parts.into_iter().map(|(k, n, _)| (k, n)).collect()
}
