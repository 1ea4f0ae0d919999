//! The logs of scenarios by id, from files in any order.

use std::collections::BTreeMap;
use std::path::PathBuf;

use reactsim_formats::{FormatError, wosac::WosacLogs};
use reactsim_scene::wosac::WosacLog;

/// Position of a record: index of the file, and index of the record in it.
type RecordPlace = (usize, u64);

/// Files with logs, from which any scenario is read by its id. One log is in memory at a time. Scenarios that
/// are asked for in the order of the files are found without a search.
pub struct LogFiles {
    files: Vec<PathBuf>,
    /// The file that is open, and the index of its next record.
    open: Option<(usize, u64, WosacLogs)>,
    /// Places of the scenarios up to `seen`.
    places: BTreeMap<String, RecordPlace>,
    /// First place whose scenario is not known.
    seen: RecordPlace,
    errors: Vec<FormatError>,
}

impl LogFiles {
    /// Creates access to these files, which are opened when they are needed.
    pub fn new(files: Vec<PathBuf>) -> Self {
        Self { files, open: None, places: BTreeMap::new(), seen: (0, 0), errors: Vec::new() }
    }

    /// Reads the log of a scenario; `None` if no file has it. Records and files that cannot be read are
    /// passed over and kept for [`Self::take_errors`].
    ///
    /// # Errors
    /// [`FormatError`] if the file has changed or cannot be read any more.
    pub fn get(&mut self, id: &str) -> Result<Option<WosacLog>, FormatError> {
        if let Some(&(file, record)) = self.places.get(id) {
            self.go_to(file, record)?;
            let log = self.next_log().transpose()?;
            return Ok(log.filter(|log| log.scenario_id == id));
        }
        while self.seen.0 < self.files.len() {
            if let Some(log) = self.next_unseen(|found| found == id) {
                return Ok(Some(log));
            }
        }
        Ok(None)
    }

    /// Returns the ids of all scenarios of all files, in the order of the files.
    pub fn ids(&mut self) -> Vec<String> {
        while self.seen.0 < self.files.len() {
            self.next_unseen(|_| false);
        }
        let mut ids: Vec<(RecordPlace, &String)> =
            self.places.iter().map(|(id, place)| (*place, id)).collect();
        ids.sort_unstable();
        ids.into_iter().map(|(_, id)| id.clone()).collect()
    }

    /// Returns the errors of records and files that were passed over since the last call.
    pub fn take_errors(&mut self) -> Vec<FormatError> {
        std::mem::take(&mut self.errors)
    }

    /// Goes over the first record whose scenario is not known; returns its log if it is wanted.
    fn next_unseen(&mut self, wanted: impl FnOnce(&str) -> bool) -> Option<WosacLog> {
        let (file, record) = self.seen;
        self.seen = (file, record + 1);
        let found = self.go_to(file, record).map(|()| {
            let (_, next, logs) = self.open.as_mut()?;
            *next += 1;
            logs.next_if(wanted)
        });
        match found {
            Ok(Some(Ok((id, log)))) => {
                self.places.entry(id).or_insert((file, record));
                return log;
            }
            Ok(None) => self.seen = (file + 1, 0),
            Ok(Some(Err(error))) if !error.ends_file() => self.errors.push(error),
            Ok(Some(Err(error))) | Err(error) => {
                self.errors.push(error);
                self.seen = (file + 1, 0);
            }
        }
        None
    }

    /// Opens a file, if it is not open, and passes over the records before this one.
    fn go_to(&mut self, file: usize, record: u64) -> Result<(), FormatError> {
        let is_before = |open: &(usize, u64, WosacLogs)| open.0 == file && open.1 <= record;
        let (_, next, mut logs) = match self.open.take().filter(is_before) {
            Some(open) => open,
            None => (file, 0, WosacLogs::open(&self.files[file])?),
        };
        logs.pass_over(record - next);
        self.open = Some((file, record, logs));
        Ok(())
    }

    fn next_log(&mut self) -> Option<Result<WosacLog, FormatError>> {
        let (_, next, logs) = self.open.as_mut()?;
        *next += 1;
        logs.next()
    }
}
