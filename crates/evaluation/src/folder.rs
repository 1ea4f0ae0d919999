//! The run folder: the files of a run, and how the run resumes after being killed.

pub(crate) mod finished_run;
pub(crate) mod long_tables;
pub(crate) mod rollouts;
pub(crate) mod rows_table;
mod scenario_files;
mod spec_file;

use std::collections::{BTreeMap, BTreeSet};
use std::fs::{self, File, OpenOptions};
use std::io::{self, BufRead, BufReader, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use parking_lot::Mutex;
use reactsim_files::{self as files, FolderLock};
use reactsim_metrics::{Event, METRICS, Score};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::error::EvaluationError;
use crate::layout::{
    EVENTS, FAILURES, PROVENANCE, REFERENCE_RECORD, ROLLOUTS, ROWS, ROWS_TABLE, RUN_FILES, SUMMARY,
};
use crate::provenance::Provenance;
use crate::row::{EventHead, EventLine, Failure, RecordPosition, Row};
use crate::statistics::tally::Tally;
use crate::summary::Summary;

/// Name of the folder of rollouts that are not yet joined.
const PARTS: &str = "parts";

/// A run folder that is being written. Rows and events are appended as they are produced, and sorted when the
/// run is finished.
#[derive(Debug)]
pub struct RunFolder {
    path: PathBuf,
    rows: Mutex<Appender>,
    events: Mutex<Appender>,
    failures: Mutex<Appender>,
    /// Lock held during the run: two runs must not write to one folder.
    _lock: FolderLock,
}

impl RunFolder {
    /// Creates a folder for a new run. It may exist if it is empty.
    ///
    /// # Errors
    /// [`EvaluationError`] if the folder is not empty or cannot be written.
    pub fn create(path: &Path, provenance: &Provenance) -> Result<Self, EvaluationError> {
        Self::begin(path, lock_unbegun(path, PROVENANCE)?, provenance)
    }

    /// Opens the folder of an earlier run with the same settings: drops truncated lines and incomplete pairs,
    /// and adds the complete pairs to the tally.
    ///
    /// # Errors
    /// [`EvaluationError`] if the folder has no run or a run with other settings, or cannot be written.
    pub fn resume(path: &Path, provenance: &Provenance, tally: &mut Tally) -> Result<Self, EvaluationError> {
        // A refused folder is not written to; what it contains is certain when it is locked.
        Self::is_of(path, provenance)?;
        let lock = lock(path)?;
        if is_unbegun(path, PROVENANCE) {
            return Self::begin(path, lock, provenance);
        }
        Self::is_of(path, provenance)?;
        let folder = Self::open(path, lock)?;
        folder.keep_complete_pairs(tally, provenance)?;
        Ok(folder)
    }

    /// Checks that a folder contains a run with these settings, or no run yet, as [`Self::resume`] requires.
    ///
    /// # Errors
    /// [`EvaluationError`] if it contains anything else, or a run with other settings; names the setting.
    pub(crate) fn is_of(path: &Path, provenance: &Provenance) -> Result<(), EvaluationError> {
        if is_unbegun(path, PROVENANCE) {
            return Ok(());
        }
        match read_provenance(path)?.difference(provenance) {
            Some((setting, old, new)) => Err(EvaluationError::other_settings(path, &setting, &old, &new)),
            None => Ok(()),
        }
    }

    fn begin(path: &Path, lock: FolderLock, provenance: &Provenance) -> Result<Self, EvaluationError> {
        write_json(&path.join(PROVENANCE), provenance)?;
        Self::open(path, lock)
    }

    /// Opens the folder of a finished run, to which metrics are added.
    pub(super) fn of_finished(path: &Path) -> Result<Self, EvaluationError> {
        read_summary(path)?;
        Self::open(path, lock(path)?)
    }

    fn open(path: &Path, lock: FolderLock) -> Result<Self, EvaluationError> {
        let append = |name| Appender::open(path.join(name)).map(Mutex::new);
        let (rows, events, failures) = (append(ROWS)?, append(EVENTS)?, append(FAILURES)?);
        let folder = Self { path: path.to_owned(), rows, events, failures, _lock: lock };
        folder.remove_temporary_files()?;
        Ok(folder)
    }

    /// Returns the path of the folder.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Appends the events of each rollout and then the rows of one scenario and one simulator, so that complete
    /// rows imply complete events.
    ///
    /// # Errors
    /// [`EvaluationError::Write`]; nothing is written after it, so that only the last line can be truncated.
    pub fn append(&self, rows: &[Row], events: &[Vec<Event>]) -> Result<(), EvaluationError> {
        let of_rollout = |((rollout, row), events): ((u32, _), &'_ Vec<Event>)| {
            events.iter().map(|event| line(&EventLine::new(row, rollout, event))).collect::<String>()
        };
        write_to(&self.events, &(0..).zip(rows).zip(events).map(of_rollout).collect::<String>())?;
        write_to(&self.rows, &rows.iter().map(line).collect::<String>())
    }

    /// Appends a failure.
    ///
    /// # Errors
    /// [`EvaluationError::Write`].
    pub(crate) fn append_failure(&self, failure: &Failure) -> Result<(), EvaluationError> {
        write_to(&self.failures, &line(failure))
    }

    /// Returns the file for the rollouts of one scenario and one simulator until the run is finished.
    ///
    /// # Errors
    /// [`EvaluationError::Write`].
    pub fn part(&self, place: RecordPosition, simulator: usize) -> Result<PathBuf, EvaluationError> {
        let folder = self.path.join(PARTS);
        fs::create_dir_all(&folder).map_err(cannot_write(&folder))?;
        Ok(folder.join(format!("{:06}-{:08}-{simulator:03}.parquet", place.input, place.record)))
    }

    /// Removes the rollouts that are not yet joined.
    fn remove_parts(&self) -> Result<(), EvaluationError> {
        let folder = self.path.join(PARTS);
        removed(fs::remove_dir_all(&folder), &folder)
    }

    /// Sorts rows and events and writes them as tables, joins the rollouts if they are kept, and writes the
    /// summary, whose existence marks the folder as finished.
    pub(crate) fn complete(
        &self,
        tally: &Tally,
        failures: &[Failure],
        summary: &Summary,
        keep_rollouts: bool,
    ) -> Result<(), EvaluationError> {
        self.sort(tally, failures)?;
        long_tables::write(&self.path, &tally.metrics)?;
        if keep_rollouts {
            rollouts::join_parts(self, tally)?;
        }
        self.put(SUMMARY, &summary.to_json())?;
        self.remove_parts()
    }

    /// Sorts the rows and events of the tally's scenarios into canonical order and writes the failures.
    fn sort(&self, tally: &Tally, failures: &[Failure]) -> Result<(), EvaluationError> {
        for name in [ROWS, EVENTS] {
            let path = self.path.join(name);
            let mut lines = index(&path, tally)?;
            lines.retain(|(key, _, _)| tally.has(key.0, key.1));
            lines.sort_by_key(|(key, at, _)| (*key, *at));
            rewrite(&path, &lines)?;
        }
        replace(&self.path.join(FAILURES), |out| {
            failures.iter().try_for_each(|f| out.write_all(line(f).as_bytes()))
        })
    }

    /// Writes a file of the folder atomically.
    ///
    /// # Errors
    /// [`EvaluationError::Write`]; the old file is then left unchanged.
    pub fn put(&self, name: &str, text: &str) -> Result<(), EvaluationError> {
        replace(&self.path.join(name), |out| out.write_all(text.as_bytes()))
    }

    /// Removes what was written, so that the folder is empty again.
    ///
    /// # Errors
    /// [`EvaluationError::Write`].
    pub fn discard(self) -> Result<(), EvaluationError> {
        self.remove_parts()?;
        RUN_FILES.iter().map(|name| self.path.join(name)).try_for_each(|p| removed(fs::remove_file(&p), &p))
    }

    /// Removes temporary files left by a killed run. The lock is held, so no other run writes here.
    fn remove_temporary_files(&self) -> Result<(), EvaluationError> {
        for entry in fs::read_dir(&self.path).map_err(cannot_read(&self.path))? {
            let entry = entry.map_err(cannot_read(&self.path))?;
            let name = entry.file_name();
            let name = name.to_string_lossy();
            if files::target_of(&name).is_some_and(|n| RUN_FILES.contains(&n)) {
                fs::remove_file(entry.path()).map_err(cannot_write(&entry.path()))?;
            }
        }
        Ok(())
    }

    /// Returns whether an earlier run finished without a failure and with exactly these values, so that
    /// nothing is left to run.
    fn is_finished(&self, values: &Tally) -> bool {
        let complete = |s: &Summary| s.provenance.failures.is_empty() && s.is_of(values);
        rollouts::are_there(&self.path.join(ROLLOUTS)) && read_summary(&self.path).is_ok_and(|s| complete(&s))
    }

    fn keep_complete_pairs(&self, tally: &mut Tally, provenance: &Provenance) -> Result<(), EvaluationError> {
        let mut pairs = complete_pairs(&self.path, provenance.inputs.len(), tally)?;
        let events = counted_events(&self.path.join(EVENTS))?;
        pairs.retain(|_, rows| rows.iter().all(|row| has_its_events(row, &events)));
        let mut all = tally.clone();
        pairs.values().for_each(|rows| all.add(rows));
        let keeps_rollouts = provenance.keep_rollouts == Some(true);
        let is_finished = keeps_rollouts && self.is_finished(&all);
        if is_finished {
            // The earlier run was killed while it removed them.
            self.remove_parts()?;
        }
        // Rollouts cannot be appended to a joined file, so a pair without its part is run again.
        let with_rollouts = keeps_rollouts && !is_finished;
        for ((place, simulator), rows) in &pairs {
            let Some(index) = tally.simulators.iter().position(|s| s == simulator) else { continue };
            if !with_rollouts || rollouts::are_there(&self.part(*place, index)?) {
                tally.add(rows);
            }
        }
        for (name, appender) in [(ROWS, &self.rows), (EVENTS, &self.events)] {
            let path = self.path.join(name);
            let mut lines = index(&path, tally)?;
            lines.retain(|(key, _, _)| tally.has(key.0, key.1));
            rewrite(&path, &lines)?;
            *appender.lock() = Appender::open(path)?;
        }
        let failures = self.path.join(FAILURES);
        // Failed pairs are tried again.
        replace(&failures, |_| Ok(()))?;
        *self.failures.lock() = Appender::open(failures)?;
        Ok(())
    }
}

/// Returns the result of removing a file or a folder, which may have been absent.
fn removed(result: io::Result<()>, path: &Path) -> Result<(), EvaluationError> {
    match result {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(cannot_write(path)(error)),
        _ => Ok(()),
    }
}

/// Creates a folder, if it is absent, and locks it.
pub(super) fn lock(path: &Path) -> Result<FolderLock, EvaluationError> {
    files::create_folder(path).map_err(cannot_write(path))?;
    let lock = files::lock_folder(path).map_err(cannot_write(&path.join(files::LOCK)))?;
    lock.ok_or_else(|| EvaluationError::busy(path))
}

/// Creates a folder, if it is absent, and locks it. A folder in which the file `first` or others exist is refused,
/// and not written to.
pub(super) fn lock_unbegun(path: &Path, first: &str) -> Result<FolderLock, EvaluationError> {
    let check = || match is_unbegun(path, first) || !path.is_dir() {
        true => Ok(()),
        false => Err(EvaluationError::Resumable(format!(
            "{} exists and is not empty: continue the run in it, or choose another folder",
            path.display()
        ))),
    };
    // Without the first check a lock would be written into a folder of others; only the second one is certain.
    check()?;
    let lock = lock(path)?;
    check()?;
    Ok(lock)
}

/// Returns whether a folder is absent or empty, or was left by a process that was killed before it wrote the
/// file `first`.
pub(super) fn is_unbegun(path: &Path, first: &str) -> bool {
    let is_left = |name: &str| name == files::LOCK || files::target_of(name) == Some(first);
    match fs::read_dir(path) {
        Ok(mut entries) => entries.all(|e| e.is_ok_and(|e| is_left(&e.file_name().to_string_lossy()))),
        Err(error) => error.kind() == io::ErrorKind::NotFound,
    }
}

/// Events that count: position, simulator, rollout and metric.
type CountedEvents = BTreeSet<(RecordPosition, String, u32, String)>;

/// Reads which events an unfinished run counted. The last line may be truncated.
fn counted_events(path: &Path) -> Result<CountedEvents, EvaluationError> {
    let (mut counted, mut line, mut damaged) = (CountedEvents::new(), 0, None);
    for_lines(path, |_, text| {
        line += 1;
        match serde_json::from_str::<EventHead>(text) {
            Ok(line) if line.counted => {
                counted.insert((line.place(), line.simulator, line.rollout, line.metric));
            }
            Ok(_) => {}
            Err(source) => {
                let path = path.to_owned();
                damaged.get_or_insert(EvaluationError::DamagedLine { path, line, source });
            }
        }
    })?;
    damaged.map_or(Ok(counted), Err)
}

/// Returns whether the events that a row counts are there.
fn has_its_events(row: &Row, events: &CountedEvents) -> bool {
    let Some(rollout) = row.rollout else { return true };
    METRICS.iter().filter(|metric| metric.has_events()).all(|metric| {
        let id = metric.spec().id;
        let score = row.metrics.get(id).copied().flatten().and_then(Score::value);
        let key = || (row.place(), row.simulator.clone(), rollout, id.to_owned());
        score.is_none_or(|score| score == 0.0) || events.contains(&key())
    })
}

/// Reads the provenance of a run folder.
///
/// # Errors
/// [`EvaluationError`] if there is none or it is damaged.
pub fn read_provenance(folder: &Path) -> Result<Provenance, EvaluationError> {
    let found = read_json(&folder.join(PROVENANCE))?;
    found.ok_or_else(|| EvaluationError::NoRun { path: folder.to_owned() })
}

/// Reads the result in a run folder.
///
/// # Errors
/// [`EvaluationError`] if there is none yet or it is damaged.
pub fn read_summary(folder: &Path) -> Result<Summary, EvaluationError> {
    if let Some(summary) = read_json(&folder.join(SUMMARY))? {
        return Ok(summary);
    }
    read_provenance(folder)?;
    Err(EvaluationError::unfinished(folder))
}

/// Reads the values in the folder of a finished run.
///
/// # Errors
/// [`EvaluationError`] if there is no run, it is not finished, or its files are damaged.
pub fn read_tally(folder: &Path) -> Result<Tally, EvaluationError> {
    let run = read_summary(folder)?.provenance.run;
    whole_tally(folder, &run, &read_rows(folder)?)
}

/// Returns the values of the rows of a finished run, all of which must be complete.
pub(super) fn whole_tally(folder: &Path, run: &Provenance, rows: &[Row]) -> Result<Tally, EvaluationError> {
    match tally_of(run, rows) {
        (tally, None) => Ok(tally),
        (_, Some((scenario, simulator))) => {
            Err(EvaluationError::IncompleteRows { path: folder.to_owned(), scenario, simulator })
        }
    }
}

/// Reads the rows of an unfinished run by scenario and simulator, for the pairs with all rows.
fn complete_pairs(folder: &Path, inputs: usize, tally: &Tally) -> Result<Pairs, EvaluationError> {
    let mut pairs = Pairs::new();
    for_lines(&folder.join(ROWS), |_, text| {
        // A line that is not a row was truncated by a kill or by a full disk; a row with an unknown input is
        // damaged.
        if let Some(row) = serde_json::from_str::<Row>(text).ok().filter(|row| row.input < inputs) {
            pairs.entry((row.place(), row.simulator.clone())).or_default().push(row);
        }
    })?;
    pairs.retain(|_, rows| tally.is_complete(rows));
    Ok(pairs)
}

/// Rows by scenario and simulator.
type Pairs = BTreeMap<(RecordPosition, String), Vec<Row>>;

/// Calls `each` with every row of a finished run, or of a reference.
fn for_rows(folder: &Path, each: impl FnMut(Row)) -> Result<(), EvaluationError> {
    let (lines, table) = (folder.join(ROWS), folder.join(ROWS_TABLE));
    if lines.exists() || !folder.join(REFERENCE_RECORD).exists() {
        return for_parsed_lines(&lines, each);
    }
    if !table.exists() {
        let text = "holds aggregates only: rows of its scenarios are not published";
        return Err(EvaluationError::Refused(format!("{} {text}", folder.display())));
    }
    rows_table::read(&table)?.into_iter().for_each(each);
    Ok(())
}

/// Reads all rows in the folder of a finished run, or of a reference, in their order.
///
/// # Errors
/// [`EvaluationError`] if there is no run, it is not finished, or its rows cannot be read.
pub fn read_rows(folder: &Path) -> Result<Vec<Row>, EvaluationError> {
    read_summary(folder)?;
    let mut rows = Vec::new();
    for_rows(folder, |row| rows.push(row))?;
    Ok(rows)
}

/// Returns the tally of rows, and the first pair of scenario and simulator whose rows are incomplete or not
/// of this run.
pub(super) fn tally_of(run: &Provenance, rows: &[Row]) -> (Tally, Option<(String, String)>) {
    let mut tally = run.tally();
    let mut pairs = Pairs::new();
    for row in rows {
        pairs.entry((row.place(), row.simulator.clone())).or_default().push(row.clone());
    }
    let mut dropped = None;
    for ((place, simulator), rows) in &pairs {
        if tally.is_complete(rows) && tally.simulators.contains(simulator) && place.input < run.inputs.len() {
            tally.add(rows);
        } else {
            dropped.get_or_insert_with(|| (rows[0].scenario.clone(), simulator.clone()));
        }
    }
    (tally, dropped)
}

/// Appends to a file, one system call per text.
#[derive(Debug)]
struct Appender {
    path: PathBuf,
    file: File,
    broken: bool,
}

impl Appender {
    fn open(path: PathBuf) -> Result<Self, EvaluationError> {
        let file = OpenOptions::new().append(true).create(true).open(&path).map_err(cannot_write(&path))?;
        Ok(Self { path, file, broken: false })
    }
}

fn write_to(appender: &Mutex<Appender>, text: &str) -> Result<(), EvaluationError> {
    let mut appender = appender.lock();
    if text.is_empty() {
        return Ok(());
    }
    if appender.broken {
        let source = io::Error::other("an earlier line could not be written completely");
        return Err(EvaluationError::Write { path: appender.path.clone(), source });
    }
    let result = appender.file.write_all(text.as_bytes());
    appender.broken = result.is_err();
    result.map_err(cannot_write(&appender.path))
}

/// Returns one line of JSON with its line end.
pub(super) fn line<T: serde::Serialize>(value: &T) -> String {
    let mut text = serde_json::to_string(value).expect("lines hold finite numbers and text only");
    text.push('\n');
    text
}

/// The sort key of a line: scenario, simulator, rollout (the row over all rollouts last).
type Key = (RecordPosition, usize, u32);

#[derive(Deserialize)]
struct LineKey {
    input: usize,
    record: usize,
    simulator: String,
    rollout: Option<u32>,
}

/// Returns key, offset and length of every complete line.
fn index(path: &Path, tally: &Tally) -> Result<Vec<(Key, u64, usize)>, EvaluationError> {
    let mut lines = Vec::new();
    for_lines(path, |at, text| {
        let Ok(key) = serde_json::from_str::<LineKey>(text) else { return };
        let Some(simulator) = tally.simulators.iter().position(|s| *s == key.simulator) else { return };
        let place = RecordPosition { input: key.input, record: key.record };
        lines.push(((place, simulator, key.rollout.unwrap_or(u32::MAX)), at, text.len()));
    })?;
    Ok(lines)
}

/// Calls `each` with offset and text of every complete line.
pub(super) fn for_lines(path: &Path, mut each: impl FnMut(u64, &str)) -> Result<(), EvaluationError> {
    let mut reader = BufReader::new(File::open(path).map_err(cannot_read(path))?);
    let (mut at, mut bytes) = (0, Vec::new());
    loop {
        bytes.clear();
        let n = reader.read_until(b'\n', &mut bytes).map_err(cannot_read(path))?;
        if n == 0 || bytes.last() != Some(&b'\n') {
            return Ok(());
        }
        if let Ok(text) = std::str::from_utf8(&bytes) {
            each(at, text);
        }
        at += n as u64;
    }
}

/// Calls `each` with every line as a value.
pub(super) fn for_parsed_lines<T: DeserializeOwned>(
    path: &Path,
    mut each: impl FnMut(T),
) -> Result<(), EvaluationError> {
    let reader = BufReader::new(File::open(path).map_err(cannot_read(path))?);
    for (i, line) in reader.lines().enumerate() {
        let damaged = |source| EvaluationError::DamagedLine { path: path.to_owned(), line: i + 1, source };
        each(serde_json::from_str(&line.map_err(cannot_read(path))?).map_err(damaged)?);
    }
    Ok(())
}

/// Replaces a file of lines by a selection of its lines.
fn rewrite(path: &Path, lines: &[(Key, u64, usize)]) -> Result<(), EvaluationError> {
    let mut old = File::open(path).map_err(cannot_read(path))?;
    replace(path, |out| {
        let (mut buffer, mut position) = (Vec::new(), 0);
        for (_, at, length) in lines {
            if *at != position {
                old.seek(SeekFrom::Start(*at))?;
            }
            buffer.resize(*length, 0);
            old.read_exact(&mut buffer)?;
            position = at + *length as u64;
            out.write_all(&buffer)?;
        }
        Ok(())
    })
}

/// Writes a file as a whole, or not at all.
pub(super) fn replace(
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<(), EvaluationError> {
    files::replace(path, write).map_err(cannot_write(path))
}

/// Writes a value as a JSON file.
pub(super) fn write_json(path: &Path, value: &impl Serialize) -> Result<(), EvaluationError> {
    replace(path, |out| {
        serde_json::to_writer_pretty(&mut *out, value)?;
        out.write_all(b"\n")
    })
}

/// Reads a JSON file; `None` if there is none.
pub(super) fn read_json<T: DeserializeOwned>(path: &Path) -> Result<Option<T>, EvaluationError> {
    let text = match fs::read_to_string(path) {
        Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(None),
        other => other.map_err(cannot_read(path))?,
    };
    let value = serde_json::from_str(&text);
    value.map(Some).map_err(|source| EvaluationError::Damaged { path: path.to_owned(), source })
}

pub(super) fn cannot_read(path: &Path) -> impl Fn(io::Error) -> EvaluationError + use<> {
    let path = path.to_owned();
    move |source| EvaluationError::Read { path: path.clone(), source }
}

pub(super) fn cannot_write(path: &Path) -> impl Fn(io::Error) -> EvaluationError + use<> {
    let path = path.to_owned();
    move |source| EvaluationError::Write { path: path.clone(), source }
}
