//! Logs and drivers of specifications, and the threads of a command.

use std::num::NonZeroUsize;

use anyhow::bail;
use clap::Args;

use super::inputs::simulated_logs;
use crate::evaluation::realism::LogSource;
use crate::evaluation::{AvChoice, AvDriver, Driver, Execution, ExternalPrograms, SubjectSpec};
use crate::work::available_threads;

/// Number of threads, which does not change any result.
#[derive(Clone, Copy, Debug, Args)]
pub(super) struct JobsArg {
    /// Threads; they do not change the result [default: one per core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub(super) jobs: Option<u16>,
}

impl JobsArg {
    /// Returns the number of threads.
    pub(super) fn count(self) -> usize {
        self.jobs.map_or_else(available_threads, usize::from)
    }
}

/// Threads and batches; they do not change any result.
#[derive(Debug, Args)]
pub(super) struct ExecutionArgs {
    #[command(flatten)]
    jobs: JobsArg,
    /// Scenarios that a thread steps together; larger batches need more memory
    #[arg(long, default_value = "4", value_name = "N")]
    batch: NonZeroUsize,
}

impl ExecutionArgs {
    pub(super) fn execution(&self) -> Execution {
        Execution { jobs: self.jobs.count(), batch: self.batch.get() }
    }
}

pub(super) fn log_sources(subject: &SubjectSpec) -> anyhow::Result<Vec<LogSource>> {
    simulated_logs(&subject.input.scenarios, &subject.input.reading)
}

/// Returns the external planners as drivers. Each must be named by one of these AV policies.
pub(super) fn drivers<'a>(
    programs: &ExternalPrograms,
    avs: impl Iterator<Item = Option<&'a AvChoice>> + Clone,
) -> anyhow::Result<Vec<Driver>> {
    let drivers: Vec<Driver> = programs.planners.iter().cloned().map(Driver::external).collect();
    let is_named = |driver: &AvDriver| {
        let mut named = avs.clone().flatten();
        named.any(|av| matches!(av, AvChoice::Planned(planned) if planned.driver == *driver))
    };
    match drivers.iter().map(Driver::driver).find(|driver| !is_named(driver)) {
        Some(unused) => {
            bail!("--planner: no AV is driven by `{unused}`: add --av planner:{unused}")
        }
        None => Ok(drivers),
    }
}
