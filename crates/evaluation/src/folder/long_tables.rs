//! Rows and events of a finished run as Parquet tables in long form, for data frames and databases.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use arrow_array::builder::{
    BooleanBuilder, Float64Builder, MapBuilder, StringBuilder, StringDictionaryBuilder, UInt32Builder,
};
use arrow_array::types::Int32Type;
use arrow_array::{ArrayRef, RecordBatch};
use arrow_schema::ArrowError;
use parquet::arrow::ArrowWriter;
use reactsim_files::NewFile;
use reactsim_formats::table::properties;
use reactsim_metrics::{MetricSpec, Score};

use crate::error::EvaluationError;
use crate::folder::{cannot_write, for_parsed_lines};
use crate::layout::{EVENTS, EVENTS_TABLE, ROWS, VALUES_TABLE};
use crate::row::{EventLine, Row};

/// Number of rows that are written at once.
const BATCH: usize = 65_536;

/// Writes both tables of a folder with finished rows and events.
pub(crate) fn write(folder: &Path, metrics: &[&'static MetricSpec]) -> Result<(), EvaluationError> {
    let values = Values { metrics: metrics.to_vec(), ..Values::default() };
    let mut values = Table::new(&folder.join(VALUES_TABLE), values);
    for_parsed_lines(&folder.join(ROWS), |row: Row| values.add(&row))?;
    values.finish()?;
    let mut events = Table::new(&folder.join(EVENTS_TABLE), Events::default());
    for_parsed_lines(&folder.join(EVENTS), |event: EventLine| events.add(&event))?;
    events.finish()
}

/// Columns that are being filled.
trait Columns {
    type Record;

    /// Adds a record and returns the number of rows that it has.
    fn add(&mut self, record: &Self::Record) -> usize;

    /// Returns the filled columns and empties them.
    fn batch(&mut self) -> Result<RecordBatch, ArrowError>;
}

/// A Parquet file that is written in batches. The first error is kept until the end.
struct Table<C> {
    path: PathBuf,
    columns: C,
    rows: usize,
    file: Option<ArrowWriter<NewFile>>,
    error: Option<io::Error>,
}

impl<C: Columns> Table<C> {
    fn new(path: &Path, columns: C) -> Self {
        Self { path: path.to_owned(), columns, rows: 0, file: None, error: None }
    }

    fn add(&mut self, record: &C::Record) {
        self.rows += self.columns.add(record);
        if self.rows >= BATCH && self.error.is_none() {
            self.error = self.write().err();
        }
    }

    fn write(&mut self) -> io::Result<()> {
        self.rows = 0;
        let batch = self.columns.batch().map_err(io::Error::other)?;
        let file = match &mut self.file {
            Some(file) => file,
            None => {
                let file = NewFile::create(&self.path)?;
                let writer = ArrowWriter::try_new(file, batch.schema(), Some(properties().build()));
                self.file.insert(writer.map_err(io::Error::other)?)
            }
        };
        file.write(&batch).map_err(io::Error::other)
    }

    fn finish(mut self) -> Result<(), EvaluationError> {
        let done = match self.error.take() {
            Some(error) => Err(error),
            None => self.write(),
        };
        let file = self.file.take();
        let done = done.and_then(|()| match file {
            Some(file) => file.into_inner().map_err(io::Error::other)?.finish(),
            None => Ok(()),
        });
        done.map_err(cannot_write(&self.path))
    }
}

/// Texts of which few are different.
type Names = StringDictionaryBuilder<Int32Type>;

/// Columns of the table of values: a row per rollout and metric.
#[derive(Default)]
struct Values {
    metrics: Vec<&'static MetricSpec>,
    scenario_id: Names,
    simulator: Names,
    rollout: UInt32Builder,
    metric: Names,
    value: Float64Builder,
    unit: Names,
    category: Names,
    difficulty: Names,
}

impl Columns for Values {
    type Record = Row;

    fn add(&mut self, row: &Row) -> usize {
        for spec in &self.metrics {
            let Some(value) = row.metrics.get(spec.id) else { continue };
            self.scenario_id.append_value(&row.scenario);
            self.simulator.append_value(&row.simulator);
            self.rollout.append_option(row.rollout);
            self.metric.append_value(spec.id);
            self.value.append_option(value.and_then(Score::value));
            self.unit.append_value(spec.unit.name());
            self.category.append_option(row.category.as_deref());
            self.difficulty.append_option(row.difficulty.as_deref());
        }
        row.metrics.len()
    }

    fn batch(&mut self) -> Result<RecordBatch, ArrowError> {
        RecordBatch::try_from_iter_with_nullable([
            ("scenario_id", Arc::new(self.scenario_id.finish()) as ArrayRef, false),
            ("simulator", Arc::new(self.simulator.finish()), false),
            ("rollout", Arc::new(self.rollout.finish()), true),
            ("metric", Arc::new(self.metric.finish()), false),
            ("value", Arc::new(self.value.finish()), true),
            ("unit", Arc::new(self.unit.finish()), false),
            ("category", Arc::new(self.category.finish()), true),
            ("difficulty", Arc::new(self.difficulty.finish()), true),
        ])
    }
}

/// Columns of the table of events.
struct Events {
    scenario_id: Names,
    simulator: Names,
    rollout: UInt32Builder,
    metric: Names,
    step: UInt32Builder,
    last_step: UInt32Builder,
    agent: Names,
    partner: Names,
    reason: Names,
    counted: BooleanBuilder,
    values: MapBuilder<StringBuilder, Float64Builder>,
}

impl Default for Events {
    fn default() -> Self {
        Self {
            scenario_id: Names::default(),
            simulator: Names::default(),
            rollout: UInt32Builder::default(),
            metric: Names::default(),
            step: UInt32Builder::default(),
            last_step: UInt32Builder::default(),
            agent: Names::default(),
            partner: Names::default(),
            reason: Names::default(),
            counted: BooleanBuilder::default(),
            values: MapBuilder::new(None, StringBuilder::default(), Float64Builder::default()),
        }
    }
}

impl Columns for Events {
    type Record = EventLine;

    fn add(&mut self, EventLine { scenario, simulator, event, .. }: &EventLine) -> usize {
        let step = |step: usize| u32::try_from(step).unwrap_or(u32::MAX);
        self.scenario_id.append_value(scenario);
        self.simulator.append_value(simulator);
        self.rollout.append_value(event.rollout);
        self.metric.append_value(&event.metric);
        self.step.append_value(step(event.step));
        self.last_step.append_value(step(event.last_step));
        self.agent.append_value(&event.agent);
        self.partner.append_option(event.partner.as_deref());
        self.reason.append_option(event.reason.as_deref());
        self.counted.append_value(event.counted);
        for (name, value) in &event.values {
            self.values.keys().append_value(name);
            self.values.values().append_value(*value);
        }
        self.values.append(true).expect("as many names as values");
        1
    }

    fn batch(&mut self) -> Result<RecordBatch, ArrowError> {
        RecordBatch::try_from_iter_with_nullable([
            ("scenario_id", Arc::new(self.scenario_id.finish()) as ArrayRef, false),
            ("simulator", Arc::new(self.simulator.finish()), false),
            ("rollout", Arc::new(self.rollout.finish()), false),
            ("metric", Arc::new(self.metric.finish()), false),
            ("step", Arc::new(self.step.finish()), false),
            ("last_step", Arc::new(self.last_step.finish()), false),
            ("agent", Arc::new(self.agent.finish()), false),
            ("partner", Arc::new(self.partner.finish()), true),
            ("reason", Arc::new(self.reason.finish()), true),
            ("counted", Arc::new(self.counted.finish()), false),
            ("values", Arc::new(self.values.finish()), false),
        ])
    }
}
