//! The results of all units as one run folder.

use std::collections::{BTreeSet, HashMap};
use std::fs::File;
use std::io::{self, BufRead, BufReader, BufWriter, Write};
use std::path::Path;

use reactsim_files::NewFile;
use reactsim_formats::rollouts::{Writer, read};
use reactsim_shards::{FinishedUnit, ShardError, Unit};

use super::{LEFT_OUT, ShardedRun};
use crate::folder::{
    EVENTS, FAILURES, ROLLOUTS, ROWS, SUMMARY, cannot_read, cannot_write, for_parsed_lines, line, replace,
};
use crate::left_out::LeftOut;
use crate::row::{Failure, RecordPosition, Row};
use crate::summary_builder::SummaryBuilder;
use crate::{EvaluationError, RunFolder, Summary, Tally, long_tables};

/// Merges the results of all units of a run into its run folder, as a run on one machine would write it;
/// returns the folder with its summary, which is written. `done` is called after every unit with the number
/// of records so far. Memory does not grow with events and rollouts, and by some tens of bytes per scenario
/// beyond the first 100,000.
///
/// # Errors
/// [`ShardError`] if results of a unit are damaged; if `out` has anything but an unfinished merge of this
/// run; or if a file cannot be read or written. The units stay as they are.
pub fn merge(
    units: &[FinishedUnit],
    planned: &ShardedRun,
    out: &Path,
    done: &dyn Fn(usize),
) -> Result<(RunFolder, Summary), ShardError> {
    let provenance = &planned.provenance;
    let run = match RunFolder::begin_again(out, provenance) {
        Err(EvaluationError::Exists { path }) if RunFolder::is_of(&path, provenance).is_ok() => {
            return Err(ShardError::Merged { path });
        }
        run => run?,
    };
    let mut merger = Merger::new(units, planned, &run);
    merger.rows(done)?;
    merger.failures()?;
    merger.events()?;
    long_tables::write(out)?;
    if provenance.keep_rollouts == Some(true) {
        merger.rollouts()?;
    }
    let mut left_out = LeftOut::default();
    for unit in units {
        for_parsed_lines(&unit.results().join(LEFT_OUT), |of_unit| left_out.add(of_unit))?;
    }
    let mut summary = merger.builder.finish(&merger.failed);
    left_out.describe(planned.deviations, &mut summary.provenance);
    run.put(SUMMARY, &summary.to_json())?;
    Ok((run, summary))
}

impl From<EvaluationError> for ShardError {
    fn from(error: EvaluationError) -> Self {
        Self::work(error)
    }
}

struct Merger<'a> {
    units: &'a [FinishedUnit],
    planned: &'a ShardedRun,
    run: &'a RunFolder,
    simulators: Vec<String>,
    builder: SummaryBuilder<'a>,
    /// First scenario with each id, which is kept as half of its digest.
    seen: HashMap<[u8; 16], RecordPosition>,
    /// Scenarios with the id of an earlier one.
    refused: BTreeSet<RecordPosition>,
    failed: Vec<Failure>,
}

/// Lines and values of the rows of one scenario.
struct PendingScenario {
    place: RecordPosition,
    lines: String,
    values: Tally,
    /// Rows of the pair that is being read.
    pair: Vec<Row>,
    /// Index of the simulator of the pair before, from which order follows.
    before: Option<usize>,
}

impl<'a> Merger<'a> {
    fn new(units: &'a [FinishedUnit], planned: &'a ShardedRun, run: &'a RunFolder) -> Self {
        let simulators: Vec<String> = planned.provenance.simulators.iter().map(|s| s.id.clone()).collect();
        let metrics = Tally::new(Vec::new(), 1).metrics;
        Self {
            units,
            planned,
            run,
            builder: SummaryBuilder::new(&simulators, &metrics, &planned.provenance),
            simulators,
            seen: HashMap::new(),
            refused: BTreeSet::new(),
            failed: Vec::new(),
        }
    }

    /// Joins the rows, adds their values to the summary, and refuses scenarios whose id is taken.
    fn rows(&mut self, done: &dyn Fn(usize)) -> Result<(), ShardError> {
        let path = self.run.path().join(ROWS);
        let mut out = BufWriter::new(NewFile::create(&path).map_err(cannot_write(&path))?);
        let mut records = 0;
        for finished in self.units {
            let (folder, range) = (finished.results(), finished.unit.range);
            let damaged = |reason: String| finished.damaged(reason);
            let mut pending: Option<PendingScenario> = None;
            for (i, text) in lines(&folder.join(ROWS))?.enumerate() {
                let text = text.map_err(cannot_read(&folder.join(ROWS)))?;
                let row: Row = serde_json::from_str(&text)
                    .map_err(|error| damaged(format!("{ROWS}, line {}: {error}", i + 1)))?;
                let place = row.place();
                let is_next = pending.as_ref().is_none_or(|p| p.place < place);
                if !range.contains(place.input, place.record)
                    || !(is_next || pending.as_ref().is_some_and(|p| p.place == place))
                {
                    return Err(damaged(format!("{ROWS}, line {}: the row is out of place", i + 1)));
                }
                if is_next {
                    if let Some(finished) = pending.take() {
                        self.scenario(finished, &mut out).map_err(|e| e.of(&path, &damaged))?;
                    }
                    pending = Some(PendingScenario::new(place, &self.simulators, &self.planned.provenance));
                }
                if let Some(pending) = &mut pending {
                    pending.add(row, &text).map_err(|reason| damaged(format!("{ROWS}: {reason}")))?;
                }
            }
            if let Some(finished) = pending {
                self.scenario(finished, &mut out).map_err(|e| e.of(&path, &damaged))?;
            }
            records += range.count;
            done(records);
        }
        let file = out.into_inner().map_err(|e| cannot_write(&path)(e.into_error()))?;
        Ok(file.finish().map_err(cannot_write(&path))?)
    }

    /// Writes the rows of a scenario and adds its values to the summary, unless its id is taken.
    fn scenario(&mut self, mut pending: PendingScenario, out: &mut impl Write) -> Result<(), RowsError> {
        pending.end_pair().map_err(RowsError::Damaged)?;
        let place = pending.place;
        let Some(entry) = pending.values.entries.remove(&place) else { return Ok(()) };
        let mut id = [0; 16];
        id.copy_from_slice(&blake3::hash(entry.scenario.as_bytes()).as_bytes()[..16]);
        if let Some(earlier) = self.seen.get(&id) {
            let inputs = &self.planned.provenance.inputs;
            self.failed.push(Failure::repeated(
                place,
                *earlier,
                entry.scenario,
                &inputs[place.input].name,
                &inputs[earlier.input].name,
            ));
            self.refused.insert(place);
            return Ok(());
        }
        self.seen.insert(id, place);
        self.builder.add(&entry);
        out.write_all(pending.lines.as_bytes()).map_err(RowsError::Write)
    }

    /// Joins the failures and adds scenarios whose id is taken.
    fn failures(&mut self) -> Result<(), ShardError> {
        for unit in self.units {
            for_parsed_lines(&unit.results().join(FAILURES), |failure| self.failed.push(failure))?;
        }
        self.failed.sort();
        let failed = &self.failed;
        Ok(replace(&self.run.path().join(FAILURES), |out| {
            failed.iter().try_for_each(|failure| out.write_all(line(failure).as_bytes()))
        })?)
    }

    /// Joins the events.
    fn events(&self) -> Result<(), ShardError> {
        let path = self.run.path().join(EVENTS);
        let mut out = BufWriter::new(NewFile::create(&path).map_err(cannot_write(&path))?);
        for finished in self.units {
            let from = finished.results().join(EVENTS);
            if self.is_whole(&finished.unit) {
                let mut file = File::open(&from).map_err(cannot_read(&from))?;
                io::copy(&mut file, &mut out).map_err(cannot_write(&path))?;
                continue;
            }
            for text in lines(&from)? {
                let text = text.map_err(cannot_read(&from))?;
                let place: RecordPosition = serde_json::from_str(&text)
                    .map_err(|error| finished.damaged(format!("{EVENTS}: {error}")))?;
                if !self.refused.contains(&place) {
                    writeln!(out, "{text}").map_err(cannot_write(&path))?;
                }
            }
        }
        let file = out.into_inner().map_err(|e| cannot_write(&path)(e.into_error()))?;
        Ok(file.finish().map_err(cannot_write(&path))?)
    }

    /// Returns whether no scenario of a unit is refused, so that its files are joined as they are.
    fn is_whole(&self, unit: &Unit) -> bool {
        self.refused.iter().all(|place| !unit.range.contains(place.input, place.record))
    }

    /// Joins the rollouts.
    fn rollouts(&self) -> Result<(), ShardError> {
        let mut writer = Writer::create(self.run.path().join(ROLLOUTS)).map_err(EvaluationError::from)?;
        for finished in self.units {
            let folder = finished.results();
            let mut places = match self.is_whole(&finished.unit) {
                true => None,
                false => Some(places_of_rollouts(&folder)?.into_iter()),
            };
            for record in read(folder.join(ROLLOUTS)).map_err(EvaluationError::from)? {
                let record = record.map_err(EvaluationError::from)?;
                let place = places.as_mut().and_then(Iterator::next);
                if place.is_none_or(|place| !self.refused.contains(&place)) {
                    writer.write(&record).map_err(EvaluationError::from)?;
                }
            }
        }
        Ok(writer.finish().map_err(EvaluationError::from)?)
    }
}

/// Returns the position of the scenario of every rollout of a unit: rows and rollouts have the same order.
/// Ids do not tell scenarios apart here.
fn places_of_rollouts(folder: &Path) -> Result<Vec<RecordPosition>, ShardError> {
    let mut places = Vec::new();
    for_parsed_lines(&folder.join(ROWS), |row: Row| {
        if row.rollout.is_some() {
            places.push(row.place());
        }
    })?;
    Ok(places)
}

/// The reason why the rows of a scenario cannot be merged.
enum RowsError {
    Damaged(String),
    Write(io::Error),
}

impl RowsError {
    fn of(self, out: &Path, damaged: &impl Fn(String) -> ShardError) -> ShardError {
        match self {
            Self::Damaged(reason) => damaged(format!("{ROWS}: {reason}")),
            Self::Write(error) => cannot_write(out)(error).into(),
        }
    }
}

impl PendingScenario {
    fn new(place: RecordPosition, simulators: &[String], run: &crate::Provenance) -> Self {
        let values = Tally::new(simulators.to_vec(), run.settings.rollouts);
        Self { place, lines: String::new(), values, pair: Vec::new(), before: None }
    }

    fn add(&mut self, row: Row, text: &str) -> Result<(), String> {
        if self.pair.first().is_some_and(|first| first.simulator != row.simulator) {
            self.end_pair()?;
        }
        self.pair.push(row);
        self.lines.push_str(text);
        self.lines.push('\n');
        Ok(())
    }

    /// Adds the values of the pair that was read.
    fn end_pair(&mut self) -> Result<(), String> {
        let rows = std::mem::take(&mut self.pair);
        let Some(first) = rows.first() else { return Ok(()) };
        let simulator = self.values.simulators.iter().position(|s| *s == first.simulator);
        if simulator.is_none() || self.before >= simulator || !self.values.is_complete(&rows) {
            let (scenario, simulator) = (&first.scenario, &first.simulator);
            return Err(format!("rows of scenario `{scenario}` with `{simulator}` are incomplete"));
        }
        self.before = simulator;
        self.values.add(&rows);
        Ok(())
    }
}

fn lines(path: &Path) -> Result<io::Lines<BufReader<File>>, ShardError> {
    Ok(BufReader::with_capacity(1 << 18, File::open(path).map_err(cannot_read(path))?).lines())
}
