//! Scenarios of runs, found again by the digest of their file and their place in it.

use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

use super::EvaluationError;
use super::file_record::FileRecord;
use super::source::{Opener, Source};
use crate::formats::native::ByNumber;
use crate::formats::{Input, PendingScenarios};
use crate::scene::Scenario;

/// Files of scenarios by the digest of their content: a run names its inputs by digest, not by path.
#[derive(Default)]
pub struct Shelf {
    books: BTreeMap<String, Book>,
}

enum Book {
    /// A native file: any scenario at once.
    Native(ByNumber),
    /// Any other: read from its beginning. The position is kept, so that going through it in order reads it once.
    Stream { open: Opener, position: Mutex<(usize, Option<PendingScenarios>)>, input: Option<Input> },
}

impl Shelf {
    /// Adds a file.
    ///
    /// # Errors
    /// [`EvaluationError`] when it can not be read.
    pub fn add_file(&mut self, input: &Input) -> Result<(), EvaluationError> {
        let file = FileRecord::of(&input.path, input.format.id())?;
        if file.format == "native" {
            self.books.insert(file.blake3, Book::Native(ByNumber::open(&input.path)?));
            return Ok(());
        }
        let (reader, input) = (input.clone(), Some(input.clone()));
        let open = Box::new(move || reader.open_undecoded());
        self.books.insert(file.blake3, Book::Stream { open, position: Mutex::default(), input });
        Ok(())
    }

    /// Adds what is read in order.
    pub fn add(&mut self, source: Source) {
        let book = Book::Stream { open: source.open, position: Mutex::default(), input: None };
        self.books.insert(source.file.blake3, book);
    }

    /// Whether a file is there.
    pub fn has(&self, file: &FileRecord) -> bool {
        self.books.contains_key(&file.blake3)
    }

    /// A scenario by its file, its place there and its digest; `None` where the file is not there.
    ///
    /// # Errors
    /// [`EvaluationError`] when the file can not be read, or holds another scenario in this place.
    pub fn read(
        &self,
        file: &FileRecord,
        record: usize,
        digest: &str,
    ) -> Result<Option<Scenario>, EvaluationError> {
        let Some(book) = self.books.get(&file.blake3) else { return Ok(None) };
        let found = match book {
            Book::Native(scenarios) if record < scenarios.len() => Some(scenarios.read(record)?),
            Book::Native(_) => None,
            // Whoever adds a file need not know how a run read it.
            Book::Stream { input: Some(input), .. } if file.current_frame.is_some() && record == 0 => {
                let input = Input { current_frame: file.current_frame, ..input.clone() };
                input.open()?.next().transpose()?
            }
            Book::Stream { open, position, .. } => {
                let mut position = position.lock().unwrap_or_else(PoisonError::into_inner);
                let (next, scenarios) = &mut *position;
                if scenarios.is_none() || *next > record {
                    (*next, *scenarios) = (0, Some(open()?));
                }
                let skipped = record - *next;
                *next = record + 1;
                let pending = scenarios.as_mut().and_then(|s| s.nth(skipped));
                pending.map(|decode| decode.and_then(|d| d())).transpose()?
            }
        };
        match found {
            Some(scenario) if scenario.digest() == digest => Ok(Some(scenario)),
            _ => Err(EvaluationError::NotThatScenario {
                file: file.name.clone(),
                record,
                digest: digest.to_owned(),
            }),
        }
    }
}
