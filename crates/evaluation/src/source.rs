//! Sources of scenarios, and their distribution to several threads.

pub(crate) mod selection;
pub(crate) mod file_record;
pub(crate) mod shipped;
pub(crate) mod benchmarks;
pub(crate) mod case_study;
pub(crate) mod scenario_files;

use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use parking_lot::{Mutex, MutexGuard};
use rayon::prelude::*;
use reactsim_formats::{
    FormatError, Input, Opener, Partition, PendingScenarios, Scenarios, UndecodedScenario, count_records,
    decoded,
};
use reactsim_scene::Scenario;

use crate::error::EvaluationError;
use crate::row::RecordPosition;
use crate::source::file_record::{FileRecord, Registrar};

/// A file of scenarios, or scenarios that ship with the program.
pub struct Source {
    /// Name, size and digest.
    pub file: FileRecord,
    /// Function that opens the source.
    pub open: Opener,
    /// Number of records, if it is known before they are read; for progress.
    pub count: Option<usize>,
}

/// A scenario file with the number of records that are used.
pub type Share = (Input, usize);

/// Returns the first files that have `most` scenarios which are run, all without `is_run`; the last one is
/// used as far as it is needed. Without `most`, all files. Records are decoded only to ask `is_run`.
pub fn limited(
    inputs: Vec<Input>,
    most: Option<usize>,
    is_run: Option<&dyn Fn(&Scenario) -> bool>,
) -> Vec<Share> {
    let Some(mut left) = most else {
        return inputs.into_iter().map(|input| (input, usize::MAX)).collect();
    };
    let mut shares = Vec::new();
    for input in inputs {
        if left == 0 {
            break;
        }
        let (records, run) = match (is_run, input.count()) {
            (None, Some(count)) => (left, count.min(left)),
            // What cannot be opened is reported when it is run.
            _ => input.open_from(0).map_or((usize::MAX, 0), |records| first_records(records, left, is_run)),
        };
        left -= run;
        shares.push((input, records));
    }
    shares
}

/// Returns the shipped scenarios up to the one with which `most` are run, all without `is_run`; all scenarios
/// without `most`.
///
/// # Errors
/// [`FormatError`] if they cannot be read.
pub fn limited_shipped(
    most: Option<usize>,
    is_run: Option<&dyn Fn(&Scenario) -> bool>,
) -> Result<Source, FormatError> {
    let (Some(most), Some(_)) = (most, is_run) else {
        return Ok(Source::shipped(most.unwrap_or(usize::MAX)));
    };
    let records = (Source::shipped(usize::MAX).open)(0)?;
    Ok(Source::shipped(first_records(records, most, is_run).0))
}

/// Returns the number of records up to the one with which `most` scenarios are run, and that of the
/// scenarios.
fn first_records(
    records: PendingScenarios,
    most: usize,
    is_run: Option<&dyn Fn(&Scenario) -> bool>,
) -> (usize, usize) {
    let read = |record: Result<UndecodedScenario, FormatError>| record.and_then(UndecodedScenario::decode);
    let are_run = records
        .map(|record| is_run.is_none_or(|is_run| read(record).is_ok_and(|scenario| is_run(&scenario))));
    first_run(are_run, most)
}

/// Returns the number of records up to the one with which `most` are run, and that of those that are run.
fn first_run(mut are_run: impl Iterator<Item = bool>, most: usize) -> (usize, usize) {
    let (mut read, mut run) = (0, 0);
    while run < most {
        let Some(is_run) = are_run.next() else { break };
        (read, run) = (read + 1, run + usize::from(is_run));
    }
    (read, run)
}

impl Source {
    /// Scenario files.
    ///
    /// # Errors
    /// [`EvaluationError::Read`] if a file cannot be read for its digest.
    pub fn of_inputs(inputs: Vec<Share>) -> Result<Vec<Self>, EvaluationError> {
        let mut registrar = Registrar::default();
        let mut files = Vec::with_capacity(inputs.len());
        for (input, _) in &inputs {
            files.push(registrar.record(input)?);
        }
        let mut sources = Self::unread(inputs);
        sources.iter_mut().zip(files).for_each(|(source, file)| source.file = file);
        Ok(sources)
    }

    /// Scenario files that are not read for their digests.
    pub fn unread(inputs: Vec<Share>) -> Vec<Self> {
        let of = |(input, most): Share| Self {
            file: FileRecord::unread(&input),
            count: input.count().map(|count| count.min(most)),
            open: input.opener(most),
        };
        inputs.into_iter().map(of).collect()
    }

    /// Scenario files of which a partition is run. Only files with records of it are read for their digests.
    /// If there are fewer files than partitions, all are read through for the numbers of their records.
    ///
    /// # Errors
    /// [`EvaluationError::Read`] if a file cannot be read for its digest.
    pub(crate) fn of_partition(
        inputs: Vec<Share>,
        partition: Partition,
    ) -> Result<Vec<Self>, EvaluationError> {
        let mut sources = Self::unread(inputs.clone());
        if sources.len() < partition.count() {
            sources.par_iter_mut().for_each(|source| source.count = Some(count_records(&source.open)));
        }
        let mut registrar = Registrar::default();
        let ranges = Self::ranges(&sources, Some(partition), 1);
        let is_single = sources.len() == 1;
        for ((source, (input, _)), range) in sources.iter_mut().zip(&inputs).zip(ranges) {
            // A single file may be a known benchmark, which a partition without records names as well.
            if is_single || !range.is_empty() {
                source.file = registrar.record(input)?;
            }
        }
        Ok(sources)
    }

    /// Returns which records of each source a partition has, all without one. The sources were opened for
    /// this partition.
    pub(super) fn ranges(sources: &[Self], partition: Option<Partition>, block: usize) -> Vec<Range<usize>> {
        match partition {
            None => vec![0..usize::MAX; sources.len()],
            Some(partition) => {
                partition.of_inputs(sources.len(), block, |i| sources[i].count.unwrap_or_default())
            }
        }
    }

    /// Opens the source and decodes its scenarios one after the other.
    ///
    /// # Errors
    /// [`FormatError`] if the source cannot be opened; scenarios that cannot be read are errors of their own.
    pub fn scenarios(&self) -> Result<Scenarios, FormatError> {
        Ok(Box::new((self.open)(0)?.map(|record| record.and_then(UndecodedScenario::decode))))
    }

    /// Scenarios in memory, used up to the one with which `most` are run, all without `is_run`. Their digest
    /// is taken over those of all scenarios.
    pub fn of_scenarios(
        scenarios: impl Into<Arc<[Scenario]>>,
        most: usize,
        is_run: Option<&dyn Fn(&Scenario) -> bool>,
    ) -> Self {
        let scenarios = scenarios.into();
        let are_run = scenarios.iter().map(|scenario| is_run.is_none_or(|is_run| is_run(scenario)));
        let used = first_run(are_run, most).0;
        let digests: String = scenarios.iter().map(Scenario::digest).collect();
        let file = FileRecord::of_content("memory", "memory", digests.as_bytes());
        let open = move |first: usize| -> Result<PendingScenarios, FormatError> {
            let scenarios: Vec<_> =
                scenarios.iter().take(used).skip(first).cloned().map(|s| Ok(decoded(s))).collect();
            Ok(Box::new(scenarios.into_iter()))
        };
        Self { file, open: Box::new(open), count: Some(used) }
    }
}

/// A record that is not yet decoded, with its position.
pub(super) struct UndecodedRecord {
    pub(super) place: RecordPosition,
    pub(super) content: Result<UndecodedScenario, FormatError>,
}

/// Sources that are being read. A thread holds the lock of one source only while it splits off records, so
/// that decoding and all other work run in parallel.
pub(super) struct Supply<'a> {
    readers: Vec<Reader<'a>>,
}

struct Reader<'a> {
    input: usize,
    source: &'a Source,
    /// Indices of the records that are read.
    range: Range<usize>,
    ended: AtomicBool,
    state: Mutex<State>,
}

#[derive(Default)]
struct State {
    scenarios: Option<PendingScenarios>,
    /// Number of records that were read.
    read: usize,
}

impl<'a> Supply<'a> {
    /// Supplies these records of each source.
    pub(super) fn new(sources: &'a [Source], ranges: Vec<Range<usize>>) -> Self {
        let of = |((input, source), range): ((usize, &'a Source), Range<usize>)| Reader {
            input,
            source,
            ended: AtomicBool::new(range.is_empty()),
            range,
            state: Mutex::default(),
        };
        Self { readers: sources.iter().enumerate().zip(ranges).map(of).collect() }
    }

    /// Returns at least one and at most `n` records of one source; `None` when all sources are exhausted.
    pub(super) fn take(&self, n: usize) -> Option<Vec<UndecodedRecord>> {
        loop {
            let mut busy = None;
            for (index, reader) in self.readers.iter().enumerate() {
                if reader.ended.load(Ordering::Acquire) {
                    continue;
                }
                let Some(state) = reader.state.try_lock() else {
                    busy = busy.or(Some(index));
                    continue;
                };
                let items = reader.take(state, n);
                if !items.is_empty() {
                    return Some(items);
                }
            }
            let reader = &self.readers[busy?];
            let items = reader.take(reader.state.lock(), n);
            if !items.is_empty() {
                return Some(items);
            }
        }
    }
}

impl Reader<'_> {
    fn take(&self, mut state: MutexGuard<'_, State>, n: usize) -> Vec<UndecodedRecord> {
        let mut items = Vec::new();
        if self.ended.load(Ordering::Acquire) {
            return items;
        }
        while items.len() < n.max(1) {
            let next = self.range.start + state.read;
            let content = match &mut state.scenarios {
                Some(_) if next >= self.range.end => None,
                Some(scenarios) => scenarios.next(),
                None => match (self.source.open)(self.range.start) {
                    Ok(scenarios) => {
                        state.scenarios = Some(scenarios);
                        continue;
                    }
                    Err(error) => Some(Err(error)),
                },
            };
            let unopened = state.scenarios.is_none();
            if let Some(content) = content {
                let place = RecordPosition { input: self.input, record: next };
                items.push(UndecodedRecord { place, content });
                state.read += 1;
                if !unopened {
                    continue;
                }
            }
            state.scenarios = None;
            self.ended.store(true, Ordering::Release);
            break;
        }
        items
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    #[test]
    fn a_limit_counts_the_scenarios_that_are_run_over_all_files() {
        // One scenario per file.
        let mini = concat!(env!("CARGO_MANIFEST_DIR"), "/../../scenarios/mini");
        let inputs = reactsim_formats::find_inputs(Path::new(mini)).unwrap();
        let names = |is_run: Option<&dyn Fn(&Scenario) -> bool>, most| -> Vec<String> {
            let shares = limited(inputs.clone(), Some(most), is_run);
            let name = |(input, _): Share| input.path.file_stem().unwrap().to_string_lossy().into_owned();
            shares.into_iter().map(name).collect()
        };
        assert_eq!(names(None, 2), ["crossing", "crosswalk"]);
        assert_eq!(names(None, 99).len(), inputs.len());
        // Files are used up to the last scenario that is run.
        let is_run = |scenario: &Scenario| matches!(scenario.id.as_str(), "crosswalk" | "left-turn-across");
        assert_eq!(names(Some(&is_run), 1), ["crossing", "crosswalk"]);
        assert_eq!(names(Some(&is_run), 2), ["crossing", "crosswalk", "cut-in", "left-turn-across"]);
        // Records of one file.
        let bench = || (Source::shipped(usize::MAX).open)(0).unwrap();
        assert_eq!(first_records(bench(), 0, None), (0, 0));
        assert_eq!(first_records(bench(), 7, None), (7, 7));
        assert_eq!(first_records(bench(), 1000, None), (150, 150));
        let lateral = |scenario: &Scenario| {
            scenario
                .deviation
                .as_ref()
                .is_some_and(|d| d.category == Some(reactsim_scene::Deviation::Lateral))
        };
        let (read, run) = first_records(bench(), 3, Some(&lateral));
        assert!(run == 3 && read > 3, "{read}");
    }
}
