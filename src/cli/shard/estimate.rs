//! How much time and space work in units takes.

use std::fmt::{Display, Formatter};
use std::path::Path;
use std::time::Instant;

use anyhow::Context;
use serde::{Deserialize, Serialize};

use crate::cli::progress::Progress;
use crate::cli::sharded::{Sharded, WorkSettings};
use crate::cli::{stop_on_interrupt, write_file};
use crate::shards::{ShardPlan, UnitWorker};

/// Name of the file with the estimate.
const ESTIMATE: &str = "estimate.json";
/// Number of records of a unit in the first sample: opening a file costs time too.
const RECORDS: usize = 8;
/// Least duration of a sample, seconds: records differ, and clocks of busy machines are coarse.
const LEAST_SECONDS: f64 = 2.0;

/// Measured cost of some records, and what follows for all of them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Estimate {
    /// Number of records that were worked on.
    measured: usize,
    /// Number of all records.
    records: usize,
    /// Number of all units.
    units: usize,
    /// Time of one record on one core, seconds.
    seconds_per_record: f64,
    /// Time of one unit on one core apart from its records, seconds.
    seconds_per_unit: f64,
    /// Size of the results of one record, bytes.
    bytes_per_record: f64,
    /// Memory of a process with one thread, bytes.
    memory: u64,
}

impl Estimate {
    /// Works on about `least` records of units that are spread over the plan, on one core, and on more if
    /// these take too short a time; writes the estimate to the folder of units. `None` if interrupted.
    pub(super) fn measure(
        folder: &Path,
        plan: &ShardPlan,
        command: &dyn Sharded,
        least: usize,
    ) -> anyhow::Result<Option<Self>> {
        let stop = stop_on_interrupt("leaving out the estimate")?;
        let progress = Progress::hidden();
        let count = plan.units.len().min(least.div_ceil(RECORDS));
        let units: Vec<usize> = plan.spread(count).map(|(number, _)| number).collect();
        let settings = WorkSettings { folder, jobs: 1, progress: &progress, stop: &stop };
        let work = command.prepare(plan, &units, settings)?;
        let worker = UnitWorker { folder, plan, work: work.as_ref(), jobs: 1 };
        let timed = |units, records| {
            let begin = Instant::now();
            let sample = worker.sample(units, records)?;
            Ok::<_, anyhow::Error>(sample.map(|sample| (sample, begin.elapsed().as_secs_f64())))
        };
        // The first record pays for what happens once per process.
        worker.sample(1, 1)?;
        let Some((single, shortest)) = timed(count, 1)? else { return Ok(None) };
        let largest = plan.spread(count).map(|(_, unit)| unit.range.count).max().unwrap_or(1);
        let mut each = least.div_ceil(count.max(1));
        let (sample, seconds) = loop {
            let Some((sample, seconds)) = timed(count, each)? else { return Ok(None) };
            if seconds >= LEAST_SECONDS || each >= largest {
                break (sample, seconds);
            }
            each *= 2;
        };
        let measured = sample.records.max(1);
        // Costs that do not grow with the records of a unit are paid once per unit.
        let more = sample.records.saturating_sub(single.records);
        let seconds_per_record = match more {
            0 => seconds / measured as f64,
            more => (seconds - shortest).max(0.0) / more as f64,
        };
        let of_units = seconds - seconds_per_record * sample.records as f64;
        let estimate = Self {
            measured,
            records: plan.records(),
            units: plan.units.len(),
            seconds_per_record,
            seconds_per_unit: of_units.max(0.0) / count.max(1) as f64,
            bytes_per_record: sample.bytes as f64 / measured as f64,
            memory: memory_stats::memory_stats().map_or(0, |memory| memory.physical_mem as u64),
        };
        let path = folder.join(ESTIMATE);
        let text = serde_json::to_string_pretty(&estimate).context("an estimate is numbers")?;
        write_file(&path, |out| writeln!(out, "{text}"))
            .with_context(|| format!("could not write {}", path.display()))?;
        Ok(Some(estimate))
    }

    /// Returns the estimate in a folder of units, if there is one.
    pub(super) fn kept(folder: &Path) -> anyhow::Result<Option<Self>> {
        let path = folder.join(ESTIMATE);
        if !path.exists() {
            return Ok(None);
        }
        let text = std::fs::read_to_string(&path);
        let text = text.with_context(|| format!("could not read {}", path.display()))?;
        let estimate = serde_json::from_str(&text);
        Ok(Some(estimate.with_context(|| format!("{} is damaged: remove it", path.display()))?))
    }

    /// Returns the estimated time of all records on one core, seconds.
    fn seconds(&self) -> f64 {
        self.seconds_per_record * self.records as f64 + self.seconds_per_unit * self.units as f64
    }

    /// Compares the estimated time with what all units took, core-seconds.
    pub(super) fn against(&self, core_seconds: f64) -> String {
        let estimated = self.seconds();
        format!(
            "{} used, {} estimated ({:+.0} %)",
            time(core_seconds),
            time(estimated),
            100.0 * (core_seconds / estimated.max(1e-9) - 1.0)
        )
    }
}

impl Display for Estimate {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "estimate from {} records: {} ({:.3} s per record), {:.1} GB of results and as much again after \
             the merge, {:.1} GB of memory per process and some more per thread",
            self.measured,
            time(self.seconds()),
            self.seconds_per_record,
            self.bytes_per_record * self.records as f64 / 1e9,
            self.memory as f64 / 1e9,
        )
    }
}

/// Returns a time on one core as text.
fn time(seconds: f64) -> String {
    match seconds {
        s if s < 600.0 => format!("{s:.0} core-seconds"),
        s => format!("{:.1} core-hours", s / 3600.0),
    }
}
