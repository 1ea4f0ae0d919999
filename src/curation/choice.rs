//! Step 4, the automatic choice: one candidate per scenario, by a score, with the categories kept in balance.

use std::collections::BTreeMap;

use super::filters::comfort;
use super::{CandidateRecord, ScenarioRecord};
use crate::scene::Deviation;

/// Weight of a vehicle that collides by its own fault under log replay.
const AT_FAULT: f64 = 2.0;
/// Weight of any contact.
const CONTACT: f64 = 0.5;
/// Weight of a reaction that is neither next to none nor an emergency: braking at `FIRM` (m/s²) counts 1, none and the hardest that agents
/// are granted count 0.
const REACTION: f64 = 1.5;
const FIRM: f64 = 2.5;
/// Weight of a conflict that leaves time to see how it goes on: 1 up to that step, 0 at the last.
const TIME: (f64, f64) = (1.0, 50.0);
/// Weight of a comfortable AV: as for its share of nuPlan's comfort bounds, 2 bounds give 0.
const COMFORT: f64 = 0.5;
/// Weight of a deviation of that many metres on average, or more.
const DISTANCE: (f64, f64) = (0.5, 8.0);
/// How much the share that a category lacks weighs.
const BALANCE: f64 = 60.0;
/// How much the share of the same maneuver among those chosen before weighs against a candidate: a set of stops would be a poor one.
const VARIETY: f64 = 4.0;

/// How good a survivor is: pressure that the log can not answer, early enough, that asks for a firm reaction and no emergency, by an AV
/// that drives as one would, well away from the log. 0 to 6.
pub fn score(record: &CandidateRecord) -> f64 {
    let pressure = &record.pressure;
    let peak = record.certificate.as_ref().map_or(0.0, |c| c.peak_deceleration());
    let step = record.taxonomy.conflict_step.map_or(80.0, f64::from);
    let comfort = record.figures.iter().find(|f| f.filter == comfort::ID).and_then(|f| f.value);
    AT_FAULT * f64::from(pressure.at_fault.min(1))
        + CONTACT * f64::from(pressure.overlaps.min(1))
        + REACTION * (1.0 - (peak - FIRM).abs() / FIRM).clamp(0.0, 1.0)
        + TIME.0 * ((80.0 - step) / (80.0 - TIME.1)).clamp(0.0, 1.0)
        + COMFORT * comfort.map_or(0.0, |share| (1.0 - share / 2.0).clamp(0.0, 1.0))
        + DISTANCE.0 * (record.offsets.ade / DISTANCE.1).min(1.0)
}

/// Chooses scenario by scenario, in the order of the input: the choice of one depends on those before it, and on nothing else.
#[derive(Clone, Debug, Default)]
pub struct Chooser {
    /// The share that each category should have; a third where none is named.
    shares: BTreeMap<Deviation, f64>,
    chosen: BTreeMap<Deviation, u64>,
    maneuvers: BTreeMap<String, u64>,
}

impl Chooser {
    /// Nothing chosen yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Nothing chosen yet; each category should have the share that is named.
    pub fn with_shares(shares: BTreeMap<Deviation, f64>) -> Self {
        Self { shares, ..Self::default() }
    }

    /// Marks the best survivor: by its score, by how much its category lacks to its share of what was chosen so far, and by how seldom its
    /// maneuver was. The first one on ties.
    pub fn choose(&mut self, record: &mut ScenarioRecord) {
        self.choose_among(record, |_| true);
    }

    /// As [`Chooser::choose`], among the survivors that are wanted. The category of the one that is marked now.
    pub fn choose_among(
        &mut self,
        record: &mut ScenarioRecord,
        is_wanted: impl Fn(&CandidateRecord) -> bool,
    ) -> Option<Deviation> {
        let total: u64 = self.chosen.values().sum();
        let lack = |category: Deviation| {
            let count = self.chosen.get(&category).copied().unwrap_or(0);
            let share = self.shares.get(&category).copied().unwrap_or(1.0 / 3.0);
            if total == 0 { 0.0 } else { share - count as f64 / total as f64 }
        };
        let mut best: Option<(f64, usize)> = None;
        for (i, candidate) in record.candidates.iter().enumerate() {
            if candidate.rejected_by.is_some() || !is_wanted(candidate) {
                continue;
            }
            let same = self.maneuvers.get(name(candidate)).copied().unwrap_or(0);
            let worn = same as f64 / total.max(1) as f64;
            let value = candidate.score + BALANCE * lack(candidate.taxonomy.category) - VARIETY * worn;
            if best.is_none_or(|b| value > b.0) {
                best = Some((value, i));
            }
        }
        let (_, i) = best?;
        record.candidates[i].chosen = true;
        let candidate = &record.candidates[i];
        let category = candidate.taxonomy.category;
        *self.chosen.entry(category).or_default() += 1;
        *self.maneuvers.entry(name(candidate).to_owned()).or_default() += 1;
        Some(category)
    }

    /// How many were chosen, by category.
    pub fn counts(&self) -> &BTreeMap<Deviation, u64> {
        &self.chosen
    }
}

/// The words of a maneuver before its first number: what it is, however hard or far.
fn name(candidate: &CandidateRecord) -> &str {
    let text = &candidate.candidate.maneuver;
    text.split(|c: char| c.is_ascii_digit()).next().unwrap_or(text)
}
