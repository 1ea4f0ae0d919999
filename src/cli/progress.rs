//! Progress of a command on stderr.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use indicatif::{HumanDuration, ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};
use parking_lot::Mutex;

use super::live_table::LiveTable;
use super::output::{is_quiet, say};
use crate::curation::driver::CurationObserver;
use crate::evaluation::{Failure, Row, RunObserver};

/// Maximum number of failures printed as they happen; the run folder lists all.
const MAX_PRINTED_FAILURES: usize = 20;

/// Time between two drawings of the preliminary table.
const TABLE_INTERVAL: Duration = Duration::from_millis(500);

/// Time without a finished scenario after which the step that is being computed is shown; without a terminal,
/// in a line when one is due.
const STEP_DELAY: Duration = Duration::from_secs(2);

/// Style with a known number of scenarios, and without.
const WITH_TOTAL: &str = "{bar:24} {pos} of {len} scenarios, {rate}, {left}{prefix}{msg}";
const WITHOUT_TOTAL: &str = "{spinner} {pos} scenarios, {rate}, {elapsed}{prefix}{msg}";

/// Text in place of the time left if there is no rate.
const TIME_UNKNOWN: &str = "time left unknown";

/// Time until the first line of progress without a terminal, and between the others.
const LINE_INTERVALS: [Duration; 2] = [Duration::from_secs(10), Duration::from_secs(30)];

/// Time in which the scenarios of an earlier run are passed over.
const RESUMING: Duration = Duration::from_secs(1);

/// Bar with the number of scenarios, and the preliminary table of a run below it. If stderr is not a
/// terminal, lines in place of the bar. Failures are always printed.
pub(super) struct Progress {
    bar: ProgressBar,
    began: Instant,
    lines: Mutex<Lines>,
    failures: AtomicUsize,
    /// Time of the last finished scenario.
    last_done: Mutex<Instant>,
    table: Option<Mutex<Preliminary>>,
}

/// The lines of progress without a terminal.
struct Lines {
    /// Time of the next line since the start.
    next: Duration,
    /// Time since the start and number of scenarios from which the rate is taken: those of the last line, and
    /// before it those of the first second, in which the scenarios of an earlier run are passed over.
    from: (Duration, usize),
}

/// The table of what is finished.
struct Preliminary {
    table: LiveTable,
    drawn: Instant,
}

impl Progress {
    /// Shows progress without a table.
    pub(super) fn new() -> Self {
        let bar = ProgressBar::new_spinner();
        bar.set_style(style(WITHOUT_TOTAL));
        if is_quiet() {
            bar.set_draw_target(ProgressDrawTarget::hidden());
        }
        bar.enable_steady_tick(Duration::from_millis(120));
        let (began, failures, table) = (Instant::now(), AtomicUsize::new(0), None);
        let lines = Mutex::new(Lines { next: LINE_INTERVALS[0], from: (Duration::ZERO, 0) });
        Self { bar, began, lines, failures, last_done: Mutex::new(began), table }
    }

    /// Shows progress with a table of what is finished.
    pub(super) fn with_table(table: LiveTable) -> Self {
        let preliminary = Preliminary { table, drawn: Instant::now() };
        Self { table: Some(Mutex::new(preliminary)), ..Self::new() }
    }

    /// States the number of scenarios, if it is known.
    pub(super) fn set_total(&self, total: Option<usize>) {
        if let Some(total) = total {
            self.bar.set_style(style(WITH_TOTAL));
            self.bar.set_length(total as u64);
        }
    }

    /// Prints something above the bar.
    pub(super) fn suspend(&self, print: impl FnOnce()) {
        self.bar.suspend(print);
    }

    /// Shows how many scenarios are finished.
    pub(super) fn set_done(&self, done: usize) {
        *self.last_done.lock() = Instant::now();
        self.bar.set_prefix("");
        self.bar.set_position(done as u64);
        let elapsed = self.began.elapsed();
        if self.bar.is_hidden() && !is_quiet() {
            let mut lines = self.lines.lock();
            if elapsed < RESUMING {
                lines.from = (elapsed, done);
            } else if elapsed >= lines.next {
                let text = line_of(done, self.bar.length(), elapsed, lines.from);
                say(format_args!("{text}{}", self.failure_count()));
                *lines = Lines { next: elapsed + LINE_INTERVALS[1], from: (elapsed, done) };
            }
        }
    }

    /// Prints that a scenario failed; `text` begins with a colon.
    pub(super) fn failure(&self, text: std::fmt::Arguments<'_>) {
        let n = self.failures.fetch_add(1, Ordering::Relaxed) + 1;
        if self.table.is_none() {
            self.bar.set_message(self.failure_count());
        }
        if n <= MAX_PRINTED_FAILURES {
            // A foreign text cannot pass for another message.
            let text = text.to_string().replace('\n', "\n    ");
            self.bar.suspend(|| say(format_args!("warning: failed{text}")));
        }
    }

    /// Returns the number of failures as the end of the bar's text.
    fn failure_count(&self) -> String {
        match self.failures.load(Ordering::Relaxed) {
            0 => String::new(),
            n => format!(", {n} failed"),
        }
    }

    /// Removes the bar and prints how many failures were not printed.
    pub(super) fn end(&self) {
        self.bar.finish_and_clear();
        let failures = self.failures.load(Ordering::Relaxed);
        if failures > MAX_PRINTED_FAILURES {
            let more = failures - MAX_PRINTED_FAILURES;
            say(format_args!("warning: {more} more failures were not printed"));
        }
    }
}

/// Returns a line of progress: how many scenarios are finished, and the time left if their number is known.
/// The rate is that since a time at which a number of them was finished.
fn line_of(done: usize, total: Option<u64>, elapsed: Duration, from: (Duration, usize)) -> String {
    let seconds = elapsed.saturating_sub(from.0).as_secs_f64();
    let since = done.saturating_sub(from.1) as f64;
    let rate = if seconds > 0.0 { since / seconds } else { 0.0 };
    let text = rate_text(rate);
    match total {
        Some(total) => {
            let left = match (total as f64 - done as f64).max(0.0) {
                left if left > 0.0 && rate == 0.0 => TIME_UNKNOWN.to_owned(),
                left if left > 0.0 => left_text(Duration::from_secs_f64(left / rate)),
                _ => left_text(Duration::ZERO),
            };
            format!("{}, {text}, {left}", count_of(done, Some(total)))
        }
        None => format!("{}, {text}", count_of(done, None)),
    }
}

/// Returns how many scenarios are finished, as text.
fn count_of(done: usize, total: Option<u64>) -> String {
    match total {
        Some(total) => format!("{done} of {total} scenarios"),
        None => format!("{done} scenarios"),
    }
}

/// Returns the time left as text.
fn left_text(left: Duration) -> String {
    format!("{:#} left", HumanDuration(left))
}

/// Returns a rate per second in three digits.
fn rate_text(rate: f64) -> String {
    let digits = if rate < 1.0 { 2 } else { usize::from(rate < 100.0) };
    format!("{rate:.digits$}/s")
}

/// Returns a style with the rate in three digits, and with the time left as soon as there is a rate.
fn style(template: &str) -> ProgressStyle {
    let style = ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar());
    let style = style.with_key("rate", |state: &ProgressState, out: &mut dyn std::fmt::Write| {
        out.write_str(&rate_text(state.per_sec())).ok();
    });
    style.with_key("left", |state: &ProgressState, out: &mut dyn std::fmt::Write| {
        match state.pos() {
            0 => out.write_str(TIME_UNKNOWN).ok(),
            _ => out.write_str(&left_text(state.eta())).ok(),
        };
    })
}

impl RunObserver for Progress {
    fn started(&self, total: Option<usize>) {
        self.set_total(total);
    }

    fn stepped(&self, step: usize, steps: usize) {
        if self.last_done.lock().elapsed() < STEP_DELAY {
            return;
        }
        let text = format!(", step {step} of {steps}");
        if !self.bar.is_hidden() {
            self.bar.set_prefix(text);
            return;
        }
        let (elapsed, mut lines) = (self.began.elapsed(), self.lines.lock());
        if elapsed >= lines.next && !is_quiet() {
            // The rate of the next line is since the last one with a rate.
            lines.next = elapsed + LINE_INTERVALS[1];
            let done = count_of(self.bar.position() as usize, self.bar.length());
            say(format_args!("{done}{text}{}", self.failure_count()));
        }
    }

    fn scenario_done(&self, done: usize) {
        self.set_done(done);
    }

    fn rows(&self, rows: &[Row]) {
        let Some(table) = &self.table else { return };
        let mut preliminary = table.lock();
        preliminary.table.add(rows);
        if preliminary.drawn.elapsed() >= TABLE_INTERVAL && !self.bar.is_hidden() {
            preliminary.drawn = Instant::now();
            self.bar.set_message(format!("{}\n{}", self.failure_count(), preliminary.table));
        }
    }

    fn failed(&self, failure: &Failure) {
        let simulator = failure.simulator.as_deref().map(|s| format!(" ({s})")).unwrap_or_default();
        self.failure(format_args!("{simulator}: {}", failure.error));
    }
}

impl CurationObserver for Progress {
    fn scenario_done(&self, done: usize) {
        self.set_done(done);
    }

    fn failed(&self, error: &str) {
        self.failure(format_args!(": {error}"));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_have_the_time_left_if_it_is_known() {
        let of = |done, total| line_of(done, total, Duration::from_secs(60), (Duration::ZERO, 0));
        assert_eq!(of(30, Some(90)), "30 of 90 scenarios, 0.50/s, 2m left");
        assert_eq!(of(600, None), "600 scenarios, 10.0/s");
        assert_eq!(of(90, Some(90)), "90 of 90 scenarios, 1.5/s, 0s left");
    }

    #[test]
    fn scenarios_of_an_earlier_run_do_not_count_for_the_rate() {
        let from = (Duration::from_secs(1), 9000);
        let of = |done, elapsed| line_of(done, Some(10_000), Duration::from_secs(elapsed), from);
        // 40 scenarios in 40 s, and 960 are left.
        assert_eq!(of(9040, 41), "9040 of 10000 scenarios, 1.0/s, 16m left");
        assert_eq!(of(9000, 11), "9000 of 10000 scenarios, 0.00/s, time left unknown");
        assert_eq!(of(9010, 1), "9010 of 10000 scenarios, 0.00/s, time left unknown");
        assert_eq!(of(10_000, 1), "10000 of 10000 scenarios, 0.00/s, 0s left");
    }

    #[test]
    fn steps_of_long_scenarios_have_lines_without_a_terminal() {
        let progress = Progress::new();
        progress.bar.set_draw_target(ProgressDrawTarget::hidden());
        let next = || progress.lines.lock().next;
        progress.lines.lock().next = Duration::ZERO;
        progress.stepped(10, 600);
        assert_eq!(next(), Duration::ZERO, "a scenario may be finished soon");
        std::thread::sleep(STEP_DELAY);
        progress.stepped(40, 600);
        let after = next();
        assert!(after >= STEP_DELAY + LINE_INTERVALS[1], "no line was printed");
        progress.stepped(41, 600);
        assert_eq!(next(), after, "lines are not printed for every step");
        assert_eq!(count_of(3, Some(90)), "3 of 90 scenarios");
    }
}
