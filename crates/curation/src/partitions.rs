//! Curation in partitions: candidates are found by each, and chosen when the partitions are joined, because a
//! choice depends on those before it.

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use reactsim_formats::{Cause, FormatError};

use super::driver::{Curated, Curation, CurationObserver, ResultCollector};
use super::outcomes::{OutcomeReader, OutcomeWriter};
use super::store::Writer;
use super::{CurationProvenance, InputFile};

impl Curation<'_> {
    /// Finds and filters the candidates of these records of each input, and writes the outcomes to a folder.
    /// Returns the number of failures; `None` if `stop` was set meanwhile.
    ///
    /// # Errors
    /// [`FormatError`] if the folder cannot be written.
    pub fn find(
        &self,
        ranges: &[Range<usize>],
        folder: &Path,
        observer: &dyn CurationObserver,
        stop: &AtomicBool,
    ) -> Result<Option<usize>, FormatError> {
        let mut writer = OutcomeWriter::create(folder)?;
        let (mut records, mut failed) = (0, 0);
        let pending = ranges.iter().enumerate().filter(|(_, range)| !range.is_empty());
        let pending = pending.flat_map(|(input, range)| self.pending(input, range.start).take(range.len()));
        let finished = self.each(pending, stop, |curated| {
            records += 1;
            failed += usize::from(writer.write((curated.input, curated.number), curated.outcome)?);
            observer.scenario_done(records);
            Ok(())
        })?;
        if !finished {
            return Ok(None);
        }
        writer.finish()?;
        Ok(Some(failed))
    }
}

/// Chooses among the candidates of all partitions, whose folders are in order, and writes the scenarios that
/// passed step 1, as the whole curation would. The provenance is `base` plus the results; the caller finishes
/// the file with it.
///
/// # Errors
/// [`FormatError`] if a folder is damaged or the file cannot be written.
pub fn merge(
    base: CurationProvenance,
    folders: &[PathBuf],
    writer: &mut Writer,
    observer: &dyn CurationObserver,
) -> Result<Curated, FormatError> {
    let inputs: Vec<InputFile> = base.inputs.clone();
    let mut collector = ResultCollector::new(base, observer);
    for folder in folders {
        for outcome in OutcomeReader::open(folder)? {
            let ((input, record), outcome) = outcome?;
            let Some(file) = inputs.get(input) else {
                let expected = format!("one of {} inputs", inputs.len());
                return Err(FormatError::file(folder, Cause::value("the input", input, &expected)));
            };
            collector.take(file, record, outcome, writer)?;
            observer.scenario_done(collector.done);
        }
    }
    Ok(collector.finish())
}
