//! Lookup of the scenarios of runs by the digest of their file and their position in it.

use std::collections::BTreeMap;
use std::path::Path;

use parking_lot::Mutex;
use reactsim_formats::{
    CurrentFrames, FormatError, Input, Opener, PendingScenarios, UndecodedScenario, crop, native::ByNumber,
};
use reactsim_scene::Scenario;

use crate::error::EvaluationError;
use crate::source::Source;
use crate::source::file_record::FileRecord;

/// Scenario files by the digest of their content: runs identify their inputs by digest, not by path.
#[derive(Default)]
pub struct ScenarioFiles {
    files: BTreeMap<String, ScenarioFile>,
}

enum ScenarioFile {
    /// A native file, with random access to its scenarios.
    Native(ByNumber, Input),
    /// Any other file, read from its beginning. The position is kept, so that reading in order reads the file
    /// once.
    Stream { open: Opener, position: Mutex<(usize, Option<PendingScenarios>)>, input: Option<Input> },
}

impl ScenarioFiles {
    /// Adds a file.
    ///
    /// # Errors
    /// [`EvaluationError`] if it cannot be read.
    pub fn add_file(&mut self, input: &Input) -> Result<(), EvaluationError> {
        let file = FileRecord::of(&input.path, input.format.id())?;
        if file.format == "native" {
            let native = ScenarioFile::Native(ByNumber::open(&input.path)?, input.clone());
            self.files.insert(file.blake3, native);
            return Ok(());
        }
        let (reader, input) = (input.clone(), Some(input.clone()));
        let open = Box::new(move |first| reader.open_from(first));
        self.files.insert(file.blake3, ScenarioFile::Stream { open, position: Mutex::default(), input });
        Ok(())
    }

    /// Adds a source that is read in order.
    pub fn add(&mut self, source: Source) {
        let file = ScenarioFile::Stream { open: source.open, position: Mutex::default(), input: None };
        self.files.insert(source.file.blake3, file);
    }

    /// Returns whether a file was added.
    pub fn has(&self, file: &FileRecord) -> bool {
        self.files.contains_key(&file.blake3)
    }

    /// Reads a scenario by its file, its position there and its digest; `None` if the file was not added.
    ///
    /// # Errors
    /// [`EvaluationError`] if the file cannot be read, or has another scenario at this position.
    pub fn read(
        &self,
        file: &FileRecord,
        record: usize,
        digest: &str,
    ) -> Result<Option<Scenario>, EvaluationError> {
        let Some(scenario_file) = self.files.get(&file.blake3) else { return Ok(None) };
        let with = |input: &Input| -> Result<Option<Scenario>, FormatError> {
            let input = Input { frames: file.frames(), length: file.length(), ..input.clone() };
            input
                .open_from(record)?
                .next()
                .map(|decode| decode.and_then(UndecodedScenario::decode))
                .transpose()
        };
        let found = match scenario_file {
            ScenarioFile::Native(_, input) if file.frames() != CurrentFrames::Stated => with(input)?,
            ScenarioFile::Native(scenarios, _) if record < scenarios.len() => {
                let mut scenario = scenarios.read(record)?;
                match crop(&mut scenario, file.length()) {
                    Ok(()) => Some(scenario),
                    Err(cause) => {
                        let (path, id) = (Path::new(&file.name), Some(scenario.id));
                        return Err(FormatError::record(path, record as u64, id, cause).into());
                    }
                }
            }
            ScenarioFile::Native(..) => None,
            // The run may have read the file with other current frames, or another length, than it was added
            // with.
            ScenarioFile::Stream { input: Some(input), .. }
                if (file.frames(), file.length()) != (input.frames, input.length) =>
            {
                with(input)?
            }
            ScenarioFile::Stream { open, position, .. } => {
                let mut position = position.lock();
                let (next, scenarios) = &mut *position;
                if scenarios.is_none() || *next > record {
                    (*next, *scenarios) = (0, Some(open(0)?));
                }
                let skipped = record - *next;
                *next = record + 1;
                let pending = scenarios.as_mut().and_then(|s| s.nth(skipped));
                pending.map(|decode| decode.and_then(UndecodedScenario::decode)).transpose()?
            }
        };
        let found = if file.all_agents { found.map(Scenario::with_all_agents) } else { found };
        match found {
            Some(scenario) if scenario.digest() == digest => Ok(Some(scenario)),
            _ => Err(EvaluationError::Refused(format!(
                "{}: record {record} is not the scenario with the digest {digest} that the run found there; \
                 was it read by another version of the program?",
                file.name
            ))),
        }
    }
}
