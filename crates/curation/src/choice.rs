//! Step 4, the automatic choice: one candidate per scenario, by score, with categories, difficulties and
//! paces kept in balance.

use std::collections::BTreeMap;

use reactsim_scene::{Certificate, Deviation, Difficulty, EASY_TIME_TO_REACT};

use super::filters::comfort;
use super::{CandidateRecord, ScenarioRecord};

/// Score weight of a vehicle that collides by its own fault under log replay.
const AT_FAULT_WEIGHT: f64 = 2.0;
/// Score weight of any contact.
const CONTACT_WEIGHT: f64 = 0.5;
/// Score weight of a short time to react: 1 at no time, 0 at the time that makes a conflict easy. It
/// keeps hard conflicts from being just past the threshold.
const URGENCY_WEIGHT: f64 = 1.5;
/// Score weight of an early conflict, which leaves time to observe its outcome: 1 up to
/// [`EARLY_CONFLICT_STEP`], 0 at the last step.
const EARLY_CONFLICT_WEIGHT: f64 = 1.0;
/// Last step at which a conflict counts fully as early.
const EARLY_CONFLICT_STEP: f64 = 50.0;
/// Score weight of a comfortable AV: 1 if it uses none of nuPlan's comfort bounds, 0 if it uses twice a
/// bound or more.
const COMFORT_WEIGHT: f64 = 0.5;
/// Score weight of the distance from the log: 1 at [`FULL_DISTANCE`] or more.
const DISTANCE_WEIGHT: f64 = 0.5;
/// Average distance from the log that counts fully, metres.
const FULL_DISTANCE: f64 = 8.0;
/// Score weight of a second vehicle that collides by its own fault: several agents are pressured at
/// once.
const SEVERAL_WEIGHT: f64 = 0.5;
/// Weight of the shortfall of a category's, or a difficulty's, share.
const BALANCE_WEIGHT: f64 = 60.0;
/// Weight of the shortfall of the share of AVs that are faster, or slower, than their log.
const PACE_BALANCE_WEIGHT: f64 = 40.0;
/// Penalty weight of the share of the same maneuver among earlier choices, for variety within the set.
const VARIETY_WEIGHT: f64 = 4.0;

/// Returns the quality of a survivor, 0 to 6.5.
///
/// High scores go to pressure that the log cannot answer, early enough to observe its outcome, from an
/// AV that drives comfortably and well away from its log and leaves agents little time to react. The
/// required deceleration does not count here: difficulties are balanced over the set.
pub(super) fn score(record: &CandidateRecord) -> f64 {
    let pressure = &record.pressure;
    let time_to_react = record.certificate.as_ref().and_then(Certificate::time_to_react);
    let steps = record.candidate.track.len().saturating_sub(1) as f64;
    let step = record.taxonomy.conflict_step.map_or(steps, f64::from);
    let comfort = record.figures.iter().find(|f| f.filter == comfort::ID).and_then(|f| f.value);
    AT_FAULT_WEIGHT * f64::from(pressure.at_fault.min(1))
        + SEVERAL_WEIGHT * f64::from(u8::from(pressure.at_fault > 1))
        + CONTACT_WEIGHT * f64::from(pressure.overlaps.min(1))
        + URGENCY_WEIGHT * time_to_react.map_or(0.0, |t| (1.0 - t / EASY_TIME_TO_REACT).clamp(0.0, 1.0))
        + EARLY_CONFLICT_WEIGHT * ((steps - step) / (steps - EARLY_CONFLICT_STEP).max(1.0)).clamp(0.0, 1.0)
        + COMFORT_WEIGHT * comfort.map_or(0.0, |share| (1.0 - share / 2.0).clamp(0.0, 1.0))
        + DISTANCE_WEIGHT * (record.offsets.ade / FULL_DISTANCE).min(1.0)
}

/// Counts of chosen candidates by kind, compared with target shares.
#[derive(Clone, Debug)]
struct Shares<K> {
    targets: BTreeMap<K, f64>,
    chosen: BTreeMap<K, u64>,
}

impl<K: Ord + Copy> Shares<K> {
    /// Creates counts with the same target share for every kind.
    fn equal(kinds: impl ExactSizeIterator<Item = K>) -> Self {
        let share = 1.0 / kinds.len() as f64;
        Self { targets: kinds.map(|k| (k, share)).collect(), chosen: BTreeMap::new() }
    }

    /// Returns the target share of a kind minus its current share.
    fn shortfall(&self, kind: K) -> f64 {
        let total: u64 = self.chosen.values().sum();
        let count = self.chosen.get(&kind).copied().unwrap_or(0);
        let target = self.targets.get(&kind).copied().unwrap_or(0.0);
        if total == 0 { 0.0 } else { target - count as f64 / total as f64 }
    }

    fn count(&mut self, kind: K) {
        *self.chosen.entry(kind).or_default() += 1;
    }
}

/// Speed of an AV relative to its log.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Pace {
    Faster,
    Slower,
}

/// Chooses one candidate per scenario, in the order of the input: a choice depends on the previous ones
/// and on nothing else.
#[derive(Clone, Debug)]
pub struct Chooser {
    categories: Shares<Deviation>,
    difficulties: Shares<Difficulty>,
    paces: Shares<Pace>,
    maneuvers: BTreeMap<String, u64>,
}

impl Default for Chooser {
    /// Creates a chooser without previous choices, with equal target shares for all categories,
    /// difficulties and paces.
    fn default() -> Self {
        Self {
            categories: Shares::equal(Deviation::ALL.into_iter()),
            difficulties: Shares::equal(Difficulty::ALL.into_iter()),
            paces: Shares::equal([Pace::Faster, Pace::Slower].into_iter()),
            maneuvers: BTreeMap::new(),
        }
    }
}

impl Chooser {
    /// Like the default, with the given target shares of categories and difficulties.
    pub(super) fn with_shares(
        categories: BTreeMap<Deviation, f64>,
        difficulties: BTreeMap<Difficulty, f64>,
    ) -> Self {
        let mut chooser = Self::default();
        chooser.categories.targets = categories;
        chooser.difficulties.targets = difficulties;
        chooser
    }

    /// Marks the best survivor, the first one on ties.
    ///
    /// Survivors are compared by score, by how far their category, difficulty and pace fall short of
    /// their target shares among earlier choices, and by how rare their maneuver was.
    pub fn choose(&mut self, record: &mut ScenarioRecord) {
        self.choose_among(record, |_| true);
    }

    /// Like [`Chooser::choose`], among the survivors that satisfy `is_wanted`. Returns the marked
    /// candidate.
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

    /// Returns the contribution of a candidate to the balance and variety of the set.
    fn merit(&self, candidate: &CandidateRecord) -> f64 {
        let total: u64 = self.maneuvers.values().sum();
        let same = self.maneuvers.get(name(candidate)).copied().unwrap_or(0);
        BALANCE_WEIGHT * self.categories.shortfall(candidate.taxonomy.category)
            + BALANCE_WEIGHT * candidate.difficulty().map_or(0.0, |d| self.difficulties.shortfall(d))
            + PACE_BALANCE_WEIGHT * self.paces.shortfall(pace(candidate))
            - VARIETY_WEIGHT * (same as f64 / total.max(1) as f64)
    }
}

fn pace(candidate: &CandidateRecord) -> Pace {
    if candidate.offsets.mean_speed_difference > 0.0 { Pace::Faster } else { Pace::Slower }
}

/// Returns the words of a maneuver before its first number: its kind, without its strength or distance.
fn name(candidate: &CandidateRecord) -> &str {
    let text = &candidate.candidate.maneuver;
    text.split(|c: char| c.is_ascii_digit()).next().unwrap_or(text)
}
