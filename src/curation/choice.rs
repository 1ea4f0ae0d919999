//! Step 4, the automatic choice: one candidate per scenario, by a score, with categories, difficulties and paces kept in balance.

use std::collections::BTreeMap;

use super::filters::comfort;
use super::{CandidateRecord, ScenarioRecord};
use crate::scene::{Certificate, Deviation, Difficulty, EASY_TIME_TO_REACT};

/// Weight of a vehicle that collides by its own fault under log replay.
const AT_FAULT: f64 = 2.0;
/// Weight of any contact.
const CONTACT: f64 = 0.5;
/// Weight of a short time to react: none counts 1, what makes a conflict easy counts 0. So hard ones are not just past the threshold.
const URGENCY: f64 = 1.5;
/// Weight of a conflict that leaves time to see how it goes on: 1 up to that step, 0 at the last.
const TIME: (f64, f64) = (1.0, 50.0);
/// Weight of a comfortable AV: as for its share of nuPlan's comfort bounds, 2 bounds give 0.
const COMFORT: f64 = 0.5;
/// Weight of a deviation of that many metres on average, or more.
const DISTANCE: (f64, f64) = (0.5, 8.0);
/// Weight of a second vehicle that collides by its own fault: several agents are pressed at once.
const SEVERAL: f64 = 0.5;
/// Weight of the share that a category, or a difficulty, is short of.
const BALANCE: f64 = 60.0;
/// Weight of the share that AVs faster than their log, or slower ones, are short of.
const PACE_BALANCE: f64 = 40.0;
/// How much the share of the same maneuver among those chosen before weighs against a candidate: a set of stops would be a poor one.
const VARIETY: f64 = 4.0;

/// How good a survivor is: pressure that the log cannot answer, early enough to see how it goes on, by an AV that drives as one would, well
/// away from the log, that leaves agents little time to react. 0 to 6.5. How hard they must brake does not count here: difficulties are
/// balanced over the set.
pub fn score(record: &CandidateRecord) -> f64 {
    let pressure = &record.pressure;
    let time_to_react = record.certificate.as_ref().and_then(Certificate::time_to_react);
    let step = record.taxonomy.conflict_step.map_or(80.0, f64::from);
    let comfort = record.figures.iter().find(|f| f.filter == comfort::ID).and_then(|f| f.value);
    AT_FAULT * f64::from(pressure.at_fault.min(1))
        + SEVERAL * f64::from(u8::from(pressure.at_fault > 1))
        + CONTACT * f64::from(pressure.overlaps.min(1))
        + URGENCY * time_to_react.map_or(0.0, |t| (1.0 - t / EASY_TIME_TO_REACT).clamp(0.0, 1.0))
        + TIME.0 * ((80.0 - step) / (80.0 - TIME.1)).clamp(0.0, 1.0)
        + COMFORT * comfort.map_or(0.0, |share| (1.0 - share / 2.0).clamp(0.0, 1.0))
        + DISTANCE.0 * (record.offsets.ade / DISTANCE.1).min(1.0)
}

/// How many of each kind were chosen, against the shares that they should have.
#[derive(Clone, Debug)]
struct Shares<K> {
    wanted: BTreeMap<K, f64>,
    chosen: BTreeMap<K, u64>,
}

impl<K: Ord + Copy> Shares<K> {
    /// Every kind should have the same share.
    fn equal(kinds: impl ExactSizeIterator<Item = K>) -> Self {
        let share = 1.0 / kinds.len() as f64;
        Self { wanted: kinds.map(|k| (k, share)).collect(), chosen: BTreeMap::new() }
    }

    /// The share that a kind is short of; negative where it has more.
    fn shortfall(&self, kind: K) -> f64 {
        let total: u64 = self.chosen.values().sum();
        let count = self.chosen.get(&kind).copied().unwrap_or(0);
        let wanted = self.wanted.get(&kind).copied().unwrap_or(0.0);
        if total == 0 { 0.0 } else { wanted - count as f64 / total as f64 }
    }

    fn count(&mut self, kind: K) {
        *self.chosen.entry(kind).or_default() += 1;
    }
}

/// Whether an AV is faster than its log, or slower.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Pace {
    Faster,
    Slower,
}

/// Chooses scenario by scenario, in the order of the input: the choice of one depends on those before it, and on nothing else.
#[derive(Clone, Debug)]
pub struct Chooser {
    categories: Shares<Deviation>,
    difficulties: Shares<Difficulty>,
    paces: Shares<Pace>,
    maneuvers: BTreeMap<String, u64>,
}

impl Default for Chooser {
    fn default() -> Self {
        Self::new()
    }
}

impl Chooser {
    /// Nothing chosen yet; all categories, difficulties and paces should have the same share.
    pub fn new() -> Self {
        Self {
            categories: Shares::equal(Deviation::ALL.into_iter()),
            difficulties: Shares::equal(Difficulty::ALL.into_iter()),
            paces: Shares::equal([Pace::Faster, Pace::Slower].into_iter()),
            maneuvers: BTreeMap::new(),
        }
    }

    /// As [`Chooser::new`], but each category and each difficulty should have the share that is named.
    pub fn with_shares(
        categories: BTreeMap<Deviation, f64>,
        difficulties: BTreeMap<Difficulty, f64>,
    ) -> Self {
        let mut chooser = Self::new();
        chooser.categories.wanted = categories;
        chooser.difficulties.wanted = difficulties;
        chooser
    }

    /// Marks the best survivor: by its score, by how much its category, its difficulty and its pace are short of their shares of what was
    /// chosen so far, and by how seldom its maneuver was. The first one on ties.
    pub fn choose(&mut self, record: &mut ScenarioRecord) {
        self.choose_among(record, |_| true);
    }

    /// As [`Chooser::choose`], among the survivors that are wanted. The candidate that is marked now.
    pub fn choose_among<'r>(
        &mut self,
        record: &'r mut ScenarioRecord,
        is_wanted: impl Fn(&CandidateRecord) -> bool,
    ) -> Option<&'r CandidateRecord> {
        let mut best: Option<(f64, usize)> = None;
        for (i, candidate) in record.candidates.iter().enumerate() {
            if candidate.rejected_by.is_some() || !is_wanted(candidate) {
                continue;
            }
            let value = candidate.score + self.merit(candidate);
            if best.is_none_or(|b| value > b.0) {
                best = Some((value, i));
            }
        }
        let (_, i) = best?;
        record.candidates[i].chosen = true;
        let candidate = &record.candidates[i];
        self.categories.count(candidate.taxonomy.category);
        candidate.difficulty().into_iter().for_each(|d| self.difficulties.count(d));
        self.paces.count(pace(candidate));
        *self.maneuvers.entry(name(candidate).to_owned()).or_default() += 1;
        Some(candidate)
    }

    /// What a candidate adds to the balance and the variety of the set.
    fn merit(&self, candidate: &CandidateRecord) -> f64 {
        let total: u64 = self.maneuvers.values().sum();
        let same = self.maneuvers.get(name(candidate)).copied().unwrap_or(0);
        BALANCE * self.categories.shortfall(candidate.taxonomy.category)
            + BALANCE * candidate.difficulty().map_or(0.0, |d| self.difficulties.shortfall(d))
            + PACE_BALANCE * self.paces.shortfall(pace(candidate))
            - VARIETY * (same as f64 / total.max(1) as f64)
    }

    /// How many were chosen, by category.
    pub fn counts(&self) -> &BTreeMap<Deviation, u64> {
        &self.categories.chosen
    }
}

fn pace(candidate: &CandidateRecord) -> Pace {
    if candidate.offsets.mean_speed_difference > 0.0 { Pace::Faster } else { Pace::Slower }
}

/// The words of a maneuver before its first number: what it is, however hard or far.
fn name(candidate: &CandidateRecord) -> &str {
    let text = &candidate.candidate.maneuver;
    text.split(|c: char| c.is_ascii_digit()).next().unwrap_or(text)
}
