//! Progress of a training on stderr, and the plot of its curves in the folder.

use std::cell::{Cell, RefCell};
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs::File;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

use crate::cli::output::{say, write_result};
use crate::report::tensorboard::{self, EVENTS};
use crate::report::training_curves;
use crate::training::{LOG, Observer, Row, StepRow, ValidationRow, read_log};

/// File name of the plot of the curves.
pub(super) const CURVES: &str = "curves.svg";
/// Maximum number of skipped scenarios printed one by one.
const MAX_PRINTED_SKIPS: usize = 5;

/// Line with loss, metrics, speed and remaining time, hidden if stderr is not a terminal. Validations are
/// always printed, with the metrics that only steps have.
pub(super) struct Progress {
    bar: ProgressBar,
    folder: PathBuf,
    began: Instant,
    /// Step at which this session of the training began.
    first: Cell<u64>,
    steps: Cell<u64>,
    samples: Cell<usize>,
    /// Exponential moving averages of the loss and of the metrics of steps.
    loss: Cell<Option<f64>>,
    metrics: RefCell<BTreeMap<String, f64>>,
    skipped: RefCell<usize>,
    /// Event file for TensorBoard; none if it cannot be written.
    events: RefCell<Option<File>>,
}

impl Progress {
    pub(super) fn new(folder: &Path) -> Self {
        let bar = ProgressBar::new(0);
        if let Ok(style) = ProgressStyle::with_template("{spinner} step {pos} of {len}{msg}") {
            bar.set_style(style);
        }
        bar.enable_steady_tick(Duration::from_millis(120));
        Self {
            bar,
            folder: folder.to_owned(),
            began: Instant::now(),
            first: Cell::new(0),
            steps: Cell::new(0),
            samples: Cell::new(0),
            loss: Cell::new(None),
            metrics: RefCell::default(),
            skipped: RefCell::new(0),
            events: RefCell::new(None),
        }
    }

    /// Begins the event file with the rows that the log has already. An error does not end the training.
    fn begin_events(&self) {
        let begin = || -> anyhow::Result<File> {
            let (log, path) = (self.folder.join(LOG), self.folder.join(EVENTS));
            let mut bytes = tensorboard::header();
            for row in read_log(&log)? {
                bytes.extend(tensorboard::record(&row));
            }
            let mut file = File::create(path)?;
            file.write_all(&bytes)?;
            Ok(file)
        };
        match begin() {
            Ok(file) => *self.events.borrow_mut() = Some(file),
            Err(error) => say(format_args!("warning: no events for TensorBoard: {error:#}")),
        }
    }

    /// Appends a row to the event file.
    fn append_event(&self, row: &Row) {
        let mut events = self.events.borrow_mut();
        let written = events.as_mut().map(|file| file.write_all(&tensorboard::record(row)));
        if let Some(Err(error)) = written {
            *events = None;
            self.bar.suspend(|| say(format_args!("warning: no more events for TensorBoard: {error}")));
        }
    }

    /// Scenarios per second since this session of the training began.
    pub(super) fn per_second(&self) -> f64 {
        self.samples.get() as f64 / self.began.elapsed().as_secs_f64().max(1e-9)
    }

    /// Removes the line and draws the curves a last time.
    pub(super) fn end(&self) {
        self.bar.finish_and_clear();
        let skipped = *self.skipped.borrow();
        if skipped > MAX_PRINTED_SKIPS {
            let more = skipped - MAX_PRINTED_SKIPS;
            say(format_args!("{more} more scenarios were skipped for the same reason"));
        }
        self.draw();
    }

    /// Draws the log. An error in drawing does not end the training.
    fn draw(&self) {
        let drawn = read_log(&self.folder.join(LOG)).map_err(anyhow::Error::from).and_then(|rows| {
            let svg = training_curves::draw(&rows)?;
            write_result(Some(&self.folder.join(CURVES)), |out| out.write_all(svg.as_bytes()))
        });
        if let Err(error) = drawn {
            self.bar.suspend(|| say(format_args!("warning: no curves: {error:#}")));
        }
    }

    fn step(&self, row: &StepRow) {
        self.samples.set(self.samples.get() + row.samples);
        let moved = |mean: f64, value: f64| 0.95 * mean + 0.05 * value;
        if let Some(loss) = row.loss {
            self.loss.set(Some(self.loss.get().map_or(loss, |mean| moved(mean, loss))));
        }
        let mut metrics = self.metrics.borrow_mut();
        for (name, value) in &row.metrics {
            metrics.entry(name.clone()).and_modify(|mean| *mean = moved(*mean, *value)).or_insert(*value);
        }
        let done = row.step.saturating_sub(self.first.get()).max(1) as f64;
        let steps = self.steps.get().saturating_sub(row.step) as f64;
        let left = self.began.elapsed().as_secs_f64() / done * steps;
        let mut text = self.loss.get().map(|loss| format!(", loss {loss:.4}")).unwrap_or_default();
        put_metrics(&mut text, metrics.iter());
        write!(text, ", {:.1} scenarios/s, {} left", self.per_second(), span(left)).ok();
        self.bar.set_position(row.step);
        self.bar.set_message(text);
    }

    fn validation(&self, row: &ValidationRow) -> String {
        let mut text = format!("step {}: validation loss {:.4}", row.step, row.loss);
        if row.best {
            text.push_str(" (lowest so far)");
        }
        put_metrics(&mut text, row.metrics.iter().chain(&row.closed_loop));
        let metrics = self.metrics.borrow();
        let mut of_steps = metrics.iter().filter(|(name, _)| !row.metrics.contains_key(*name)).peekable();
        if of_steps.peek().is_some() {
            text.push_str("; in training");
            put_metrics(&mut text, of_steps);
        }
        text
    }
}

impl Observer for Progress {
    fn begun(&self, step: u64, steps: u64) {
        self.first.set(step);
        self.steps.set(steps);
        self.begin_events();
        self.bar.set_length(steps);
        self.bar.set_position(step);
    }

    fn row(&self, row: &Row) {
        self.append_event(row);
        match row {
            Row::Step(row) => self.step(row),
            Row::Validation(row) => {
                self.bar.suspend(|| say(format_args!("{}", self.validation(row))));
                self.draw();
            }
        }
    }

    fn passed_over(&self, id: &str) {
        let mut n = self.skipped.borrow_mut();
        *n += 1;
        if *n <= MAX_PRINTED_SKIPS {
            self.bar.suspend(|| say(format_args!("scenario {id} is skipped: it has nothing to learn from")));
        }
    }
}

/// Appends metrics by name.
fn put_metrics<'m>(text: &mut String, metrics: impl Iterator<Item = (&'m String, &'m f64)>) {
    for (name, value) in metrics {
        write!(text, ", {} {value:.4}", name.replace('_', " ")).ok();
    }
}

/// Formats a duration.
fn span(seconds: f64) -> String {
    let s = seconds as u64;
    match s {
        0..60 => format!("{s} s"),
        60..3600 => format!("{} min {:02} s", s / 60, s % 60),
        _ => format!("{} h {:02} min", s / 3600, s / 60 % 60),
    }
}
