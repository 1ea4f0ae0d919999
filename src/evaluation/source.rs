//! Sources of scenarios, and their distribution to several threads.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError, TryLockError};

use super::EvaluationError;
use super::file_record::{FileRecord, Registrar};
use super::row::RecordPosition;
use crate::formats::{FormatError, Input, PendingScenarios, Scenarios, UndecodedScenario, decoded};
use crate::scene::Scenario;

/// Opens a source for reading from its beginning.
pub type Opener = Box<dyn Fn() -> Result<PendingScenarios, FormatError> + Send + Sync>;

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
    fn of_input(input: Input, most: usize, registrar: &mut Registrar) -> Result<Self, EvaluationError> {
        let file = registrar.record(&input)?;
        let count = input.count().map(|count| count.min(most));
        let open = move || -> Result<PendingScenarios, FormatError> {
            Ok(Box::new(input.open_undecoded()?.take(most)))
        };
        Ok(Self { file, open: Box::new(open), count })
    }

    /// Scenario files, of each of which at most `most` scenarios are read.
    ///
    /// # Errors
    /// [`EvaluationError::Read`] if a file cannot be read for its digest.
    pub fn of_inputs(inputs: Vec<Input>, most: usize) -> Result<Vec<Self>, EvaluationError> {
        let mut registrar = Registrar::default();
        inputs.into_iter().map(|input| Self::of_input(input, most, &mut registrar)).collect()
    }

    /// Opens the source and decodes its scenarios one after the other.
    ///
    /// # Errors
    /// [`FormatError`] if the source cannot be opened; scenarios that cannot be read are errors of their own.
    pub fn scenarios(&self) -> Result<Scenarios, FormatError> {
        Ok(Box::new((self.open)()?.map(|record| record.and_then(|decode| decode()))))
    }

    /// Scenarios in memory, of which at most `most` are used. Their digest is taken over those of the
    /// scenarios.
    pub fn of_scenarios(scenarios: Vec<Scenario>, most: usize) -> Self {
        let digests: String = scenarios.iter().map(Scenario::digest).collect();
        let file = FileRecord::of_content("memory", "memory", digests.as_bytes());
        let count = Some(scenarios.len().min(most));
        let open = move || -> Result<PendingScenarios, FormatError> {
            let scenarios: Vec<_> = scenarios.iter().take(most).cloned().map(|s| Ok(decoded(s))).collect();
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
    source: &'a Source,
    ended: AtomicBool,
    state: Mutex<State>,
}

#[derive(Default)]
struct State {
    scenarios: Option<PendingScenarios>,
    next: usize,
}

impl<'a> Supply<'a> {
    pub(super) fn new(sources: &'a [Source]) -> Self {
        let reader = |source| Reader { source, ended: AtomicBool::new(false), state: Mutex::default() };
        Self { readers: sources.iter().map(reader).collect() }
    }

    /// Returns at least one and at most `n` records of one source; `None` when all sources are exhausted.
    pub(super) fn take(&self, n: usize) -> Option<Vec<UndecodedRecord>> {
        loop {
            let mut busy = None;
            for (input, reader) in self.readers.iter().enumerate() {
                if reader.ended.load(Ordering::Acquire) {
                    continue;
                }
                let state = match reader.state.try_lock() {
                    Ok(state) => state,
                    Err(TryLockError::Poisoned(poisoned)) => poisoned.into_inner(),
                    Err(TryLockError::WouldBlock) => {
                        busy = busy.or(Some(input));
                        continue;
                    }
                };
                let items = reader.take(input, state, n);
                if !items.is_empty() {
                    return Some(items);
                }
            }
            let input = busy?;
            let reader = &self.readers[input];
            let items = reader.take(input, reader.state.lock().unwrap_or_else(PoisonError::into_inner), n);
            if !items.is_empty() {
                return Some(items);
            }
        }
    }
}

impl Reader<'_> {
    fn take(&self, input: usize, mut state: MutexGuard<'_, State>, n: usize) -> Vec<UndecodedRecord> {
        let mut items = Vec::new();
        if self.ended.load(Ordering::Acquire) {
            return items;
        }
        while items.len() < n.max(1) {
            let content = match &mut state.scenarios {
                Some(scenarios) => scenarios.next(),
                None => match (self.source.open)() {
                    Ok(scenarios) => {
                        state.scenarios = Some(scenarios);
                        continue;
                    }
                    Err(error) => Some(Err(error)),
                },
            };
            let unopened = state.scenarios.is_none();
            if let Some(content) = content {
                items.push(UndecodedRecord { place: RecordPosition { input, record: state.next }, content });
                state.next += 1;
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
