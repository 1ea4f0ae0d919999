//! The quotas of a benchmark: numbers of scenarios by category and by difficulty, with a minimum and a
//! maximum for each group of scenarios.

use std::collections::BTreeMap;

use reactsim_scene::{Deviation, Difficulty};

use super::{Chooser, ScenarioRecord};

/// Numbers of scenarios by category in the paper's benchmark (ReactSim-Bench, "Data Analysis").
pub const PROPORTIONS: [(Deviation, u64); 3] =
    [(Deviation::Longitudinal, 937), (Deviation::Directional, 799), (Deviation::Lateral, 900)];

/// Shares of the difficulties in a benchmark: equal, except that hard scenarios come first when rounding
/// up.
pub const DIFFICULTIES: [(Difficulty, u64); 3] =
    [(Difficulty::Hard, 1), (Difficulty::Medium, 1), (Difficulty::Easy, 1)];

/// Largest size of a group, as a multiple of its share if all groups were of equal size.
const MAX_GROUP_FACTOR: u64 = 2;

/// Requirements of the remaining places of a benchmark. They can be relaxed, because there may be no
/// scenario of one category, one difficulty and one group.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Strictness {
    /// Only categories and difficulties that are not full.
    CategoryAndDifficulty,
    /// Only categories that are not full.
    Category,
    /// Any category and difficulty.
    Any,
    /// Also groups that occur already, while others do not occur yet.
    AnyGroup,
}

/// Decides for one scenario after the other which candidate is taken, until the benchmark is full. A
/// decision depends on the previous ones and on nothing else.
#[derive(Clone, Debug)]
pub struct Quota {
    /// Number of open places by category.
    open: BTreeMap<Deviation, u64>,
    /// Number of open places by difficulty.
    open_difficulties: BTreeMap<Difficulty, u64>,
    /// Number of open places.
    left: u64,
    strictness: Strictness,
    /// Whether every group must occur.
    needs_all_groups: bool,
    /// Number of taken scenarios by group; contains all required groups from the beginning.
    groups: BTreeMap<String, u64>,
    /// Largest number of scenarios of one group.
    max_per_group: u64,
    chooser: Chooser,
}

impl Quota {
    /// Creates the quotas of a benchmark of `wanted` scenarios, in the paper's proportions, in which
    /// each of the groups occurs if there are at most `wanted` of them.
    pub fn new(wanted: u64, groups: &[String]) -> Self {
        let open = in_proportion(wanted, &PROPORTIONS);
        let open_difficulties = in_proportion(wanted, &DIFFICULTIES);
        let chooser = Chooser::with_shares(shares(&open), shares(&open_difficulties));
        let groups: BTreeMap<String, u64> = groups.iter().map(|g| (g.clone(), 0)).collect();
        let max_per_group = (MAX_GROUP_FACTOR * wanted).div_ceil(groups.len().max(1) as u64);
        Self {
            open,
            open_difficulties,
            left: wanted,
            strictness: Strictness::CategoryAndDifficulty,
            needs_all_groups: wanted >= groups.len() as u64,
            groups,
            max_per_group,
            chooser,
        }
    }

    /// Returns the number of open places.
    pub fn left(&self) -> u64 {
        self.left
    }

    /// Returns whether no more scenarios of a group are taken: there are enough of it, or the remaining
    /// places are reserved for groups that do not occur yet. Once true, it stays true until the
    /// requirements are relaxed.
    pub fn refuses(&self, group: &str) -> bool {
        let taken = self.groups.get(group).copied().unwrap_or(0);
        let missing = self.groups.iter().filter(|(name, n)| **n == 0 && *name != group).count() as u64;
        taken >= self.max_per_group || self.needs_all_groups && self.left() <= missing
    }

    /// Marks the candidate that is taken, if any: the choice of the [`Chooser`] among survivors whose
    /// category and difficulty are not full. Returns whether one was taken.
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
                Strictness::Any | Strictness::AnyGroup => true,
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

    /// Relaxes the requirements of the remaining places. Returns the new requirements, `None` if nothing
    /// is left to relax.
    pub fn relax(&mut self) -> Option<Strictness> {
        self.strictness = match self.strictness {
            Strictness::CategoryAndDifficulty => Strictness::Category,
            Strictness::Category => Strictness::Any,
            Strictness::Any if self.needs_all_groups => Strictness::AnyGroup,
            Strictness::Any | Strictness::AnyGroup => return None,
        };
        self.needs_all_groups &= self.strictness != Strictness::AnyGroup;
        Some(self.strictness)
    }

    /// Describes the open quotas in words; empty if there are none.
    pub fn missing(&self) -> String {
        let categories = self.open.iter().filter(|(_, n)| **n > 0).map(|(c, n)| format!("{n} {}", c.name()));
        let left = self.open_difficulties.iter().filter(|(_, n)| **n > 0);
        let difficulties = left.map(|(d, n)| format!("{n} {}", d.name()));
        let groups = self.groups.iter().filter(|(_, n)| **n == 0).map(|(g, _)| format!("any of `{g}`"));
        categories.chain(difficulties).chain(groups).collect::<Vec<_>>().join(", ")
    }
}

/// Returns the share of each kind.
fn shares<K: Ord + Copy>(wanted: &BTreeMap<K, u64>) -> BTreeMap<K, f64> {
    let total = wanted.values().sum::<u64>().max(1) as f64;
    wanted.iter().map(|(k, n)| (*k, *n as f64 / total)).collect()
}

/// Splits a whole into parts in these proportions, rounded so that the parts add up to it. The largest
/// remainders are rounded up; of equal ones, the first.
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
