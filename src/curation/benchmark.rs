//! The recipe of a benchmark: scenarios are made and curated until the quotas are full.

use std::ops::ControlFlow;
use std::sync::atomic::AtomicBool;

use super::driver::{CurationObserver, count};
use super::{
    CandidateSource, Curated, CurationProvenance, CurationSettings, Quota, ScenarioRecord, Strictness,
    curate_scenario,
};
use crate::formats::FormatError;
use crate::generation::{Ending, GenerationError, in_order};
use crate::scene::{DeviatedTrack, Scenario};

/// Usual [`Recipe::patience`]: as rare as one scenario of the rarest group and category together may be.
pub const PATIENCE: u64 = 2000;

/// Why there is no benchmark.
#[derive(Debug, thiserror::Error)]
pub enum BenchmarkError {
    /// Fewer scenarios are wanted than there are groups, of which each must be there.
    #[error(
        "{wanted} scenarios can not hold all of {groups} map types; ask for {groups} or more, or for fewer map types"
    )]
    TooFew {
        /// What was asked for.
        wanted: u64,
        /// How many there are.
        groups: usize,
    },
    /// The quotas can not be filled.
    #[error(
        "{chosen} of {wanted} scenarios were found among {tried}, and none among the last {patience}; still lacking: {lacking}; try another \
         seed or other map types"
    )]
    Lacking {
        /// How many were found.
        chosen: u64,
        /// What was asked for.
        wanted: u64,
        /// Scenarios that were tried.
        tried: u64,
        /// Scenarios that were tried for the next one.
        patience: u64,
        /// Categories and groups.
        lacking: String,
    },
    /// What was found could not be written.
    #[error(transparent)]
    Write(#[from] FormatError),
}

/// A scenario of a benchmark.
pub struct Entry {
    /// The scenario with its deviated AV.
    pub scenario: Scenario,
    /// The same AV with what was found out about it, the certificate among it: the one candidate of this record.
    pub record: ScenarioRecord,
}

/// What is asked of a benchmark.
pub struct Recipe<'a> {
    /// Scenarios to be found.
    pub wanted: u64,
    /// What scenarios must come from ([`Scenario::source`]): of each there is one at least, and of none more than twice its share.
    pub groups: &'a [String],
    /// Who proposes candidates.
    pub source: &'a dyn CandidateSource,
    /// What decides the deviated AVs.
    pub settings: &'a CurationSettings,
    /// Scenarios that are tried for the next one, before it is given up.
    pub patience: u64,
    /// Threads; decide no byte of the result.
    pub jobs: usize,
}

/// How far it got.
struct State {
    quota: Quota,
    provenance: CurationProvenance,
    tried: u64,
    /// Scenarios tried since the last one that was taken.
    fruitless: u64,
    chosen: u64,
}

impl Recipe<'_> {
    /// Curates the scenarios 0, 1, … and hands those over that are taken, until there are as many as wanted. Where `stop` is set meanwhile,
    /// it ends before the first scenario that was not finished, and the provenance says so.
    ///
    /// The provenance is `base` with what was found. Scenarios that can not be made are failures: told to the observer, listed in
    /// the provenance. They end nothing. Where as many scenarios as `patience` were tried in vain for the next one, the places that are
    /// left may be of any difficulty, and where as many were in vain again, of any category too; the provenance counts these places
    /// (`benchmark.places_of_any_difficulty`, `benchmark.places_of_any_category`). Scenarios of which nothing can be taken any more,
    /// whatever their candidates, are not counted in the funnel.
    ///
    /// # Errors
    /// [`BenchmarkError`] when the quotas can not be filled, and the first error of `take`.
    pub fn run(
        &self,
        scenario: impl Fn(u64) -> Result<Scenario, GenerationError> + Sync,
        base: CurationProvenance,
        mut take: impl FnMut(Entry) -> Result<(), FormatError>,
        observer: &dyn CurationObserver,
        stop: &AtomicBool,
    ) -> Result<CurationProvenance, BenchmarkError> {
        let (wanted, groups) = (self.wanted, self.groups.len());
        if wanted < groups as u64 {
            return Err(BenchmarkError::TooFew { wanted, groups });
        }
        let quota = Quota::new(wanted, self.groups);
        let mut state = State { quota, provenance: base, tried: 0, fruitless: 0, chosen: 0 };
        let make = |state: &State, number| {
            let scenario = scenario(number)?;
            let curated = (!state.quota.refuses(&scenario.source))
                .then(|| curate_scenario(&scenario, self.source, self.settings));
            Ok((scenario, curated))
        };
        let ending = in_order(u64::MAX, self.jobs, stop, &mut state, make, |state, _, made| {
            if let Some(entry) = state.judge(made, observer) {
                take(entry)?;
                state.fruitless = 0;
                state.chosen += 1;
                observer.scenario_done(usize::try_from(state.chosen).unwrap_or(usize::MAX));
            }
            if state.quota.left() == 0 {
                return Ok(ControlFlow::Break(()));
            }
            if state.fruitless >= self.patience && !state.relax() {
                return Err(state.give_up(wanted, self.patience));
            }
            Ok(ControlFlow::Continue(()))
        })?;
        state.provenance.interrupted = ending == Ending::Stopped;
        Ok(state.provenance)
    }
}

impl State {
    /// What is taken of a scenario, where anything is.
    fn judge(
        &mut self,
        made: Result<(Scenario, Option<Curated>), GenerationError>,
        observer: &dyn CurationObserver,
    ) -> Option<Entry> {
        self.tried += 1;
        self.fruitless += 1;
        let (mut scenario, curated) = match made {
            Ok(made) => made,
            Err(error) => {
                observer.failed(&error.to_string());
                self.provenance.failures.push(error.to_string());
                return None;
            }
        };
        // Asked again, since what was curated meanwhile for nothing depends on the threads.
        if self.quota.refuses(&scenario.source) {
            return None;
        }
        let funnel = &mut self.provenance.funnel;
        funnel.scenarios += 1;
        let (mut record, unproposed) = match curated? {
            Curated::Dropped { rule } => {
                *funnel.preselection.entry(rule).or_default() += 1;
                return None;
            }
            Curated::Kept(record, unproposed) => (*record, unproposed),
        };
        for (reason, n) in unproposed {
            *funnel.unproposed.entry(reason).or_default() += n;
        }
        let taken = self.quota.take(&scenario.source, &mut record);
        count(funnel, &record);
        if !taken {
            return None;
        }
        record.candidates.retain(|c| c.chosen);
        let chosen = record.chosen()?;
        scenario.deviation = Some(DeviatedTrack {
            category: Some(chosen.taxonomy.category),
            track: chosen.candidate.track.iter().skip(1).copied().collect(),
            certificate: chosen.certificate.clone(),
        });
        // The record goes with the scenario as it is written.
        record.scenario_digest = scenario.digest();
        record.scene = None;
        Some(Entry { scenario, record })
    }

    /// Asks less of the places that are left; whether anything could be given up.
    fn relax(&mut self) -> bool {
        let name = match self.quota.relax() {
            Some(Strictness::Category) => "benchmark.places_of_any_difficulty",
            Some(Strictness::Any) => "benchmark.places_of_any_category",
            Some(Strictness::CategoryAndDifficulty) | None => return false,
        };
        self.provenance.settings.insert(name.to_owned(), self.quota.left().to_string());
        self.fruitless = 0;
        true
    }

    fn give_up(&self, wanted: u64, patience: u64) -> BenchmarkError {
        BenchmarkError::Lacking {
            chosen: self.chosen,
            wanted,
            tried: self.tried,
            patience,
            lacking: self.quota.lacking(),
        }
    }
}
