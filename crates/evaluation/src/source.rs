//! Sources of scenarios, and their distribution to several threads.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use parking_lot::{Mutex, MutexGuard};
use reactsim_formats::{FormatError, Input, Opener, PendingScenarios, Scenarios, UndecodedScenario, decoded};
use reactsim_scene::Scenario;
use reactsim_shards::RecordRange;

use super::EvaluationError;
use super::file_record::{FileRecord, Registrar};
use super::row::RecordPosition;

/// A file of scenarios, or scenarios that ship with the program.
pub struct Source {
    /// Name, size and digest.
    pub file: FileRecord,
    /// Function that opens the source.
    pub open: Opener,
    /// Number of records, if it is known before they are read; for progress.
    pub count: Option<usize>,
}

impl Source {
    fn of_input(input: Input, most: usize, file: FileRecord) -> Self {
        let count = input.count().map(|count| count.min(most));
        Self { file, open: input.opener(most), count }
    }

    /// Scenario files, of each of which at most `most` scenarios are read.
    ///
    /// # Errors
    /// [`EvaluationError::Read`] if a file cannot be read for its digest.
    pub fn of_inputs(inputs: Vec<Input>, most: usize) -> Result<Vec<Self>, EvaluationError> {
        let mut registrar = Registrar::default();
        let record = |input: Input| registrar.record(&input).map(|file| Self::of_input(input, most, file));
        inputs.into_iter().map(record).collect()
    }

    /// Scenario files that are recorded already. Only those with an index in `checked` are read for their
    /// digest; of the others, names are compared alone, so that a part of a run need not read all files.
    ///
    /// # Errors
    /// [`EvaluationError::OtherInputs`] if there are other files, [`EvaluationError::Read`] if a file cannot
    /// be read. A file with another content is recorded as it is.
    pub fn of_known_inputs(
        inputs: Vec<Input>,
        most: usize,
        known: &[FileRecord],
        checked: &BTreeSet<usize>,
    ) -> Result<Vec<Self>, EvaluationError> {
        if inputs.len() != known.len() {
            return Err(EvaluationError::OtherInputs { planned: known.len(), found: inputs.len() });
        }
        let mut registrar = Registrar::default();
        let record = |((index, input), known): ((usize, Input), &FileRecord)| {
            let is_known = !checked.contains(&index) && known.is_named(&input);
            let file = if is_known { known.clone() } else { registrar.record(&input)? };
            Ok(Self::of_input(input, most, file))
        };
        inputs.into_iter().enumerate().zip(known).map(record).collect()
    }

    /// Opens the source and decodes its scenarios one after the other.
    ///
    /// # Errors
    /// [`FormatError`] if the source cannot be opened; scenarios that cannot be read are errors of their own.
    pub fn scenarios(&self) -> Result<Scenarios, FormatError> {
        Ok(Box::new((self.open)(0)?.map(|record| record.and_then(|decode| decode()))))
    }

    /// Scenarios in memory, of which at most `most` are used. Their digest is taken over those of the
    /// scenarios.
    pub fn of_scenarios(scenarios: impl Into<Arc<[Scenario]>>, most: usize) -> Self {
        let scenarios = scenarios.into();
        let digests: String = scenarios.iter().map(Scenario::digest).collect();
        let file = FileRecord::of_content("memory", "memory", digests.as_bytes());
        let count = Some(scenarios.len().min(most));
        let open = move |first: usize| -> Result<PendingScenarios, FormatError> {
            let scenarios: Vec<_> =
                scenarios.iter().take(most).skip(first).cloned().map(|s| Ok(decoded(s))).collect();
            Ok(Box::new(scenarios.into_iter()))
        };
        Self { file, open: Box::new(open), count }
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
    /// Indices of the first record that is read and after the last one.
    first: usize,
    end: usize,
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
    /// Supplies all records of the sources, or a range of them.
    pub(super) fn new(sources: &'a [Source], range: Option<RecordRange>) -> Self {
        let (ended, state) = (|| AtomicBool::new(false), Mutex::default);
        let readers = match range {
            None => {
                let whole = |(input, source)| Reader {
                    input,
                    source,
                    first: 0,
                    end: usize::MAX,
                    ended: ended(),
                    state: state(),
                };
                sources.iter().enumerate().map(whole).collect()
            }
            Some(range) => {
                let RecordRange { input, first, .. } = range;
                let part = |source| Reader {
                    input,
                    source,
                    first,
                    end: range.end(),
                    ended: ended(),
                    state: state(),
                };
                sources.get(input).map(part).into_iter().collect()
            }
        };
        Self { readers }
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
            let next = self.first + state.read;
            let content = match &mut state.scenarios {
                Some(_) if next >= self.end => None,
                Some(scenarios) => scenarios.next(),
                None => match (self.source.open)(self.first) {
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
