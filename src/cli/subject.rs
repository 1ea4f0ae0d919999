//! Simulators and plans of specifications, and the threads of a command.

use std::num::NonZeroUsize;

use anyhow::bail;
use clap::Args;

use super::inputs::simulated_logs;
use crate::evaluation::realism::LogSource;
use crate::evaluation::{
    AvChoice, Driver, Execution, ExternalPrograms, Plan, PlannedSimulator, RunParts, RunSpec, Source,
    SubjectSpec,
};
use crate::external::RunOutline;
use crate::formats::Partition;
use crate::models::qp::Smoothing;
use crate::work::available_threads;

/// Number of threads, which does not change any result.
#[derive(Debug, Args)]
pub(super) struct JobsArg {
    /// Threads; they do not change the result [default: one per core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    jobs: Option<u16>,
}

impl JobsArg {
    /// Returns the number of threads, or another one if none is given.
    pub(super) fn or(&self, other: usize) -> usize {
        self.jobs.map_or(other, usize::from)
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
        Execution { jobs: self.jobs.or(available_threads()), batch: self.batch.get() }
    }
}

/// Returns the sources of the scenarios' logs.
pub(super) fn log_sources(subject: &SubjectSpec) -> anyhow::Result<Vec<LogSource>> {
    simulated_logs(&subject.input.scenarios, &subject.input.reading)
}

/// Creates the simulators: baselines with the requested weights and parameters, then external ones, each with this
/// stage behind it. The second value has the external simulators and planners. `default` has the ids of the
/// baselines if none are named.
pub(super) fn simulators(
    subject: &SubjectSpec,
    default: &[String],
    smoothing: Option<Smoothing>,
    outline: &RunOutline,
) -> anyhow::Result<(Vec<PlannedSimulator>, ExternalPrograms)> {
    let external_only = !subject.external.external.is_empty() && subject.models.is_empty();
    let adjustments = subject.adjustments(smoothing)?;
    let ids = if subject.models.is_empty() { default } else { subject.models.as_slice() };
    let mut simulators =
        if external_only { Vec::new() } else { PlannedSimulator::adjusted(ids, &adjustments)? };
    let programs = subject.external.start(outline)?;
    for simulator in &programs.simulators {
        simulators.push(PlannedSimulator::external(simulator.clone(), smoothing)?);
    }
    Ok((simulators, programs))
}

/// Plans these simulators on the scenarios. Every input error is reported here, before the first scenario.
pub(super) fn plan(
    spec: &RunSpec,
    sources: Vec<Source>,
    simulators: Vec<PlannedSimulator>,
    programs: &ExternalPrograms,
    partition: Option<Partition>,
) -> anyhow::Result<Plan> {
    let drivers: Vec<Driver> = programs.planners.iter().cloned().map(Driver::external).collect();
    let named = match &spec.subject.av {
        Some(AvChoice::Planned(planned)) => Some(&planned.driver),
        _ => None,
    };
    if let Some(unused) = drivers.iter().map(Driver::driver).find(|driver| named != Some(driver)) {
        bail!("--planner: no AV is driven by `{unused}`: add --av planner:{unused}");
    }
    Ok(spec.plan(RunParts { sources, simulators, drivers, partition })?)
}
