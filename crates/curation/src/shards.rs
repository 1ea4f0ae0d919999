//! Curation in units: candidates are found unit by unit, and chosen when the units are merged, because a
//! choice depends on those before it.

use std::path::Path;
use std::sync::atomic::AtomicBool;

use reactsim_formats::FormatError;
use reactsim_shards::{FinishedUnit, RecordRange, ShardError, UnitResults};

use super::driver::{Curated, Curation, CurationObserver, ResultCollector};
use super::outcomes::{OutcomeReader, OutcomeWriter};
use super::store::Writer;
use super::{CurationProvenance, InputFile};

impl Curation<'_> {
    /// Finds and filters the candidates of a range of records, and writes the outcomes to a folder. `None`
    /// if `stop` was set meanwhile.
    ///
    /// # Errors
    /// [`FormatError`] if the folder cannot be written.
    pub fn run_range(
        &self,
        range: RecordRange,
        folder: &Path,
        observer: &dyn CurationObserver,
        stop: &AtomicBool,
    ) -> Result<Option<UnitResults>, FormatError> {
        let mut writer = OutcomeWriter::create(folder)?;
        let (mut records, mut failed) = (0, 0);
        let finished = self.each(self.range(range), stop, |curated| {
            records += 1;
            failed += usize::from(writer.write(curated.outcome)?);
            observer.scenario_done(records);
            Ok(())
        })?;
        if !finished {
            return Ok(None);
        }
        let files = writer.finish()?.to_vec();
        Ok(Some(UnitResults { records, failed, files }))
    }
}

/// Chooses among the candidates of all units and writes the scenarios that passed step 1, as a curation on
/// one machine would. The provenance is `base` plus the results; the caller finishes the file with it.
///
/// # Errors
/// [`ShardError`] if a unit is damaged or the file cannot be written.
pub fn merge(
    base: CurationProvenance,
    units: &[FinishedUnit],
    writer: &mut Writer,
    observer: &dyn CurationObserver,
) -> Result<Curated, ShardError> {
    let inputs: Vec<InputFile> = base.inputs.clone();
    let mut collector = ResultCollector::new(base, observer);
    for finished in units {
        let RecordRange { input, first, .. } = finished.unit.range;
        let Some(file) = inputs.get(input) else {
            return Err(finished.damaged(format!("the plan has no input {input}")));
        };
        let outcomes =
            OutcomeReader::open(&finished.results()).map_err(|e| finished.damaged(e.to_string()))?;
        for (number, outcome) in outcomes.enumerate() {
            let outcome = outcome.map_err(|error| finished.damaged(error.to_string()))?;
            collector.take(file, first + number, outcome, writer).map_err(ShardError::work)?;
        }
        observer.scenario_done(collector.done());
    }
    Ok(collector.finish())
}
