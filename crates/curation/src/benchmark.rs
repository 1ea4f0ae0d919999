//! The recipe of a benchmark: generates and curates scenarios until the quotas are full.

use std::ops::ControlFlow;
use std::sync::atomic::AtomicBool;

use reactsim_formats::FormatError;
use reactsim_generation::{Ending, GenerationError, in_order};
use reactsim_scene::{DeviatedTrack, Scenario};

use super::driver::{CurationObserver, count};
use super::{
    CandidateSource, CurationOutcome, CurationProvenance, CurationSettings, Quota, ScenarioRecord,
    Strictness, curate_scenario,
};

/// Default of [`Recipe::patience`], a number of scenarios: about one in so many has the rarest
/// combination of group and category.
pub const PATIENCE: u64 = 2000;

/// Name in the provenance of the number of places that were filled with any difficulty.
pub const ANY_DIFFICULTY: &str = "benchmark.places_of_any_difficulty";
/// Name in the provenance of the number of places that were filled with any category and difficulty.
pub const ANY_CATEGORY: &str = "benchmark.places_of_any_category";
/// Name in the provenance of the number of places that were filled with any category, difficulty and group.
pub const ANY_GROUP: &str = "benchmark.places_of_any_group";
/// Name in the provenance of the quotas that are not filled.
pub const MISSING: &str = "benchmark.missing";

/// Reason why a benchmark could not be generated.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct BenchmarkError(pub String);

impl From<FormatError> for BenchmarkError {
    fn from(error: FormatError) -> Self {
        Self(error.to_string())
    }
}

/// A scenario that was tried.
pub struct TriedScenario {
    /// Its group.
    pub source: String,
    /// The scenario; may be absent if none of its candidates can be chosen.
    pub scenario: Option<Scenario>,
    /// Its candidates; absent if it was not curated because its group was full.
    pub outcome: Option<CurationOutcome>,
}

/// A scenario of a benchmark.
pub struct Entry {
    /// The scenario with its deviated AV.
    pub scenario: Scenario,
    /// Record of the same AV, its certificate included: the only candidate in it.
    pub record: ScenarioRecord,
}

/// The specification of a benchmark.
pub struct Recipe<'a> {
    /// Number of requested scenarios.
    pub wanted: u64,
    /// Groups of scenarios, by [`Scenario::source`]: none occurs more often than twice its share, and each
    /// occurs at least once if there are places for all.
    pub groups: &'a [String],
    /// Source of the candidates.
    pub source: &'a dyn CandidateSource,
    /// Settings that determine the deviated AVs.
    pub settings: &'a CurationSettings,
    /// Number of scenarios tried in vain for the next one before the quotas are relaxed or the recipe ends.
    pub patience: u64,
    /// Number of threads; does not affect the result.
    pub jobs: usize,
}

/// Progress of a recipe.
struct State {
    quota: Quota,
    provenance: CurationProvenance,
    tried: u64,
    /// Number of scenarios tried since the last one that was taken.
    fruitless: u64,
    chosen: u64,
}

impl Recipe<'_> {
    /// Curates scenarios 0, 1, … and passes the accepted ones to `take`, until the requested number is
    /// reached. If `stop` is set meanwhile, the run ends before the first unfinished scenario, and the
    /// provenance records it.
    ///
    /// The provenance is `base` plus the results. Scenarios that cannot be generated are failures: they
    /// are reported to the observer and listed in the provenance, and do not end the run.
    ///
    /// After `patience` scenarios in vain the remaining places may be of any difficulty, after as many
    /// again of any category too, and then of any group; the provenance counts these places
    /// ([`ANY_DIFFICULTY`], [`ANY_CATEGORY`], [`ANY_GROUP`]). If that is in vain as well, the recipe ends
    /// with what was taken, and the provenance states what is missing ([`MISSING`]). Scenarios of which
    /// nothing can be taken any more, whatever their candidates, are not counted in the funnel.
    ///
    /// `tried` has the scenarios that were tried before: their number, and the outcomes of scenarios 0, 1, …,
    /// each one the scenario or the reason why it could not be generated.
    ///
    /// # Errors
    /// [`BenchmarkError`] if not a single scenario can be taken, and the first error of `take` and of
    /// `tried`.
    pub fn run(
        &self,
        (known, mut tried): (u64, impl Iterator<Item = Result<Result<TriedScenario, String>, FormatError>>),
        scenario: impl Fn(u64) -> Result<Scenario, GenerationError> + Sync,
        base: CurationProvenance,
        mut take: impl FnMut(Entry) -> Result<(), FormatError>,
        observer: &dyn CurationObserver,
        stop: &AtomicBool,
    ) -> Result<CurationProvenance, BenchmarkError> {
        let quota = Quota::new(self.wanted, self.groups);
        let mut state = State { quota, provenance: base, tried: 0, fruitless: 0, chosen: 0 };
        let curate = |scenario: &Scenario| curate_scenario(scenario, self.source, self.settings);
        let make = |state: &State, number| {
            // The outcome is taken from those that are known.
            let is_new = number >= known;
            let new = is_new.then(|| {
                let scenario = scenario(number).map_err(|error| error.to_string())?;
                let outcome = (!state.quota.refuses(&scenario.source)).then(|| curate(&scenario));
                Ok(TriedScenario { source: scenario.source.clone(), scenario: Some(scenario), outcome })
            });
            (number, new)
        };
        let ending = in_order(0.., self.jobs, stop, &mut state, make, |state, (number, new)| {
            let generated = match new {
                Some(new) => new,
                None => tried.next().ok_or_else(|| {
                    BenchmarkError(format!(
                        "the partitions have {number} of {known} tried scenarios: generate them again"
                    ))
                })??,
            };
            if let Some(entry) = state.judge(generated, curate, observer) {
                take(entry)?;
                state.fruitless = 0;
                state.chosen += 1;
                observer.scenario_done(usize::try_from(state.chosen).unwrap_or(usize::MAX));
            }
            if state.quota.left() == 0 {
                return Ok(ControlFlow::Break(()));
            }
            if state.fruitless < self.patience || state.relax() {
                return Ok(ControlFlow::Continue(()));
            }
            if state.chosen == 0 {
                return Err(BenchmarkError(format!(
                    "no suitable scenario was found among {}; try another seed or other map types",
                    state.tried
                )));
            }
            state.provenance.settings.insert(MISSING.to_owned(), state.quota.missing());
            Ok(ControlFlow::Break(()))
        })?;
        state.provenance.interrupted = ending == Ending::Stopped;
        Ok(state.provenance)
    }
}

impl State {
    /// Returns the entry that is taken from a scenario, if any.
    fn judge(
        &mut self,
        generated: Result<TriedScenario, String>,
        curate: impl Fn(&Scenario) -> CurationOutcome,
        observer: &dyn CurationObserver,
    ) -> Option<Entry> {
        self.tried += 1;
        self.fruitless += 1;
        let TriedScenario { source, scenario, outcome } = match generated {
            Ok(generated) => generated,
            Err(error) => {
                observer.failed(&error);
                self.provenance.failures.push(error);
                return None;
            }
        };
        // Checked again: the quota may have changed while the scenario was curated in parallel, and the
        // result must not depend on the threads.
        if self.quota.refuses(&source) {
            return None;
        }
        let funnel = &mut self.provenance.funnel;
        funnel.scenarios += 1;
        // If the quota was relaxed meanwhile, it may not be curated yet.
        let outcome = outcome.or_else(|| scenario.as_ref().map(curate))?;
        let (mut record, unproposed) = match outcome {
            CurationOutcome::Rejected { rule } => {
                *funnel.preselection.entry(rule).or_default() += 1;
                return None;
            }
            CurationOutcome::Retained(record, unproposed) => (*record, unproposed),
        };
        let taken = self.quota.take(&source, &mut record);
        count(funnel, &record, unproposed);
        if !taken {
            return None;
        }
        record.candidates.retain(|c| c.chosen);
        let chosen = record.chosen()?;
        let mut scenario = scenario?;
        scenario.deviation = Some(DeviatedTrack {
            category: Some(chosen.taxonomy.category),
            track: chosen.candidate.track.iter().skip(1).copied().collect(),
            certificate: chosen.certificate.clone(),
        });
        // The record refers to the scenario as written, deviation included.
        record.scenario_digest = scenario.digest();
        record.scene = None;
        Some(Entry { scenario, record })
    }

    /// Relaxes the requirements of the remaining places. Returns whether anything could be relaxed.
    fn relax(&mut self) -> bool {
        let name = match self.quota.relax() {
            Some(Strictness::Category) => ANY_DIFFICULTY,
            Some(Strictness::Any) => ANY_CATEGORY,
            Some(Strictness::AnyGroup) => ANY_GROUP,
            Some(Strictness::CategoryAndDifficulty) | None => return false,
        };
        self.provenance.settings.insert(name.to_owned(), self.quota.left().to_string());
        self.fruitless = 0;
        true
    }
}
