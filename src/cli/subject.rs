//! Arguments that `run` and the studies share: scenarios, simulators, the driver of the AV, threads.

use std::num::NonZeroUsize;
use std::path::Path;

use anyhow::bail;
use clap::{Args, ValueEnum};

use super::external::{ExternalArgs, Outside};
use super::log_sources;
use super::metric_options;
use super::scenario_args::ScenarioArgs;
use crate::evaluation::realism::LogSource;
use crate::evaluation::{
    Adjustments, AvChoice, Driver, Execution, Plan, PlanRequest, PlannedSimulator, Pose, RolloutCheck,
    Source, weights_file,
};
use crate::external::RunOutline;
use crate::formats::Partition;
use crate::models::WeightsFile;
use crate::models::nn::Backend;
use crate::models::qp::Smoothing;
use crate::rollout::{Protocol, Settings};
use crate::work::available_threads;

/// Scenarios, simulators and the driver of the AV.
#[derive(Debug, Args)]
pub(super) struct EvaluationArgs {
    #[command(flatten)]
    input: ScenarioArgs,
    /// Simulators, separated by commas; `all` for all baselines that have weights, `default` for the ones
    /// that run by default; `reactsim list models` shows them [default: default]
    #[arg(long, value_delimiter = ',', value_name = "IDS")]
    pub(super) models: Vec<String>,
    /// Weights of a simulator, such as pufferdrive=puffer.safetensors, or of a variant next to the
    /// shipped one, such as ntp-reactive@mine=new.safetensors; may be repeated
    #[arg(long = "model-weights", value_name = "ID=FILE")]
    model_weights: Vec<String>,
    /// Override a parameter of a simulator's card, such as idm.vehicle.headway=1.5, or of a variant next
    /// to it, such as idm@calm.vehicle.headway=2.5; may be repeated.
    /// `reactsim list parameters idm` shows parameters and ranges
    #[arg(long, value_name = "ID.KEY=VALUE")]
    set: Vec<String>,
    /// Driver of the AV: deviated, log, deviated-or-log, constant-velocity, brake:<m/s²>, retime:<factor>,
    /// shift:<m>, file:<path> or a planner, which is judged: planner:pdm-closed, planner:idm,
    /// planner:diffusion-planner, planner:log, planner:simulator:<id> or planner:external:<name>; with
    /// settings such as planner:idm,tracker=perfect,every=5 [default: deviated]
    #[arg(long, value_name = "POLICY")]
    pub(super) av: Option<AvChoice>,
    /// Tensor backend of the networks; `reactsim list backends` shows which this program has
    #[arg(long, default_value_t, value_name = "NAME")]
    backend: Backend,
    /// Seed of all random choices
    #[arg(long, default_value_t = 0)]
    pub(super) seed: u64,
    #[command(flatten)]
    pub(super) external: ExternalArgs,
    #[command(flatten)]
    pub(super) motion: MotionArgs,
    /// Variant of the metrics, such as fault_order=nuplan; may be repeated. `reactsim list
    /// metric-options` shows all
    #[arg(long = "metric-option", value_name = "NAME=VALUE")]
    metric_options: Vec<String>,
}

/// Treatment of motion that other programs made.
#[derive(Debug, Args)]
pub(super) struct MotionArgs {
    /// Judge motion of external simulators, deviations or rollouts although it fails a check, and mark its
    /// rows in every table: jumps, coordinates, rear-axle, units, time, agent-order, headings,
    /// velocities, teleports, freeze, float32 or resolution; for `score` also other-av (the AV does not
    /// follow the deviated trajectory), missing-agents (agents of the log are absent) and partial (scenarios
    /// without rollouts); may be repeated
    #[arg(long, value_name = "CHECK", value_delimiter = ',', value_parser = allowance)]
    pub(super) allow: Vec<RolloutCheck>,
    /// Point of vehicles whose poses the deviations or rollouts have: centre, rear-axle (distance from entry
    /// 0 of 81 states), rear-axle=METRES or rear-axle=SHARE% of the length
    #[arg(long, value_name = "POINT", default_value_t, hide_default_value = true)]
    pub(super) pose: Pose,
}

/// Parses the name of an allowance.
fn allowance(name: &str) -> Result<RolloutCheck, String> {
    let known = || RolloutCheck::ALL.map(RolloutCheck::allowance).join(", ");
    RolloutCheck::from_allowance(name).ok_or_else(|| format!("expected one of {}", known()))
}

/// Name of a protocol.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub(super) enum ProtocolName {
    // No doc comments here: clap would list them, and the help of the flag explains both.
    Reactive,
    Realism,
}

impl From<ProtocolName> for Protocol {
    fn from(name: ProtocolName) -> Self {
        match name {
            ProtocolName::Reactive => Self::Reactive,
            ProtocolName::Realism => Self::Realism,
        }
    }
}

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

impl EvaluationArgs {
    /// Returns the requested weights and parameters, with this stage behind all simulators.
    pub(super) fn adjustments(&self, smoothing: Option<Smoothing>) -> anyhow::Result<Adjustments> {
        let weights = read_weights(&self.model_weights)?;
        let backend = self.backend;
        let parameters = read_parameters(&self.set)?;
        Ok(Adjustments { weights, parameters, smoothing, backend })
    }

    /// Returns the sources of the scenarios' logs.
    pub(super) fn log_sources(&self) -> anyhow::Result<Vec<LogSource>> {
        log_sources::simulated(&self.input.scenarios, &self.input.reading)
    }

    /// Creates the simulators: baselines with the requested weights and parameters, then external ones, each
    /// with this stage behind it. The second value has the external ones and the external planners.
    pub(super) fn simulators(
        &self,
        smoothing: Option<Smoothing>,
        outline: &RunOutline,
    ) -> anyhow::Result<(Vec<PlannedSimulator>, Outside)> {
        self.simulators_or(&[], smoothing, outline)
    }

    /// Like [`Self::simulators`]; `default` has the ids of the baselines if none are named.
    pub(super) fn simulators_or(
        &self,
        default: &[String],
        smoothing: Option<Smoothing>,
        outline: &RunOutline,
    ) -> anyhow::Result<(Vec<PlannedSimulator>, Outside)> {
        let external_only = self.external.is_any() && self.models.is_empty();
        let adjustments = self.adjustments(smoothing)?;
        let ids = if self.models.is_empty() { default } else { self.models.as_slice() };
        let mut simulators =
            if external_only { Vec::new() } else { PlannedSimulator::adjusted(ids, &adjustments)? };
        let outside = self.external.start(outline)?;
        for simulator in &outside.simulators {
            simulators.push(PlannedSimulator::external(simulator.clone(), smoothing)?);
        }
        Ok((simulators, outside))
    }

    /// Finds the files of scenarios, of which a partition may be run.
    pub(super) fn sources(&self, partition: Option<Partition>) -> anyhow::Result<Vec<Source>> {
        self.input.sources(partition)
    }

    /// Finds the files of scenarios, which are not read for their digests.
    pub(super) fn unread_sources(&self) -> anyhow::Result<Vec<Source>> {
        self.input.unread_sources()
    }

    /// Plans these simulators on the scenarios. Every input error is reported here, before the first
    /// scenario.
    pub(super) fn plan(
        &self,
        sources: Vec<Source>,
        simulators: Vec<PlannedSimulator>,
        outside: &Outside,
        rollout: Settings,
        rollouts: u32,
        keep_rollouts: bool,
    ) -> anyhow::Result<Plan> {
        let drivers: Vec<Driver> = outside.planners.iter().cloned().map(Driver::external).collect();
        let named = match &self.av {
            Some(AvChoice::Planned(planned)) => Some(&planned.driver),
            _ => None,
        };
        if let Some(unused) = drivers.iter().map(Driver::driver).find(|driver| named != Some(driver)) {
            bail!("--planner: no AV is driven by `{unused}`: add --av planner:{unused}");
        }
        let request = PlanRequest {
            drivers,
            av: self.av.clone(),
            rollouts,
            ..self.request(sources, simulators, rollout, keep_rollouts)?
        };
        Ok(request.plan()?)
    }

    /// Asks for one rollout of these simulators with the default AV.
    pub(super) fn request(
        &self,
        sources: Vec<Source>,
        simulators: Vec<PlannedSimulator>,
        rollout: Settings,
        keep_rollouts: bool,
    ) -> anyhow::Result<PlanRequest> {
        Ok(PlanRequest {
            deviations: self.input.deviations.clone(),
            pose: self.motion.pose,
            rollout,
            options: metric_options(&self.metric_options)?,
            limit: self.input.limit.map(NonZeroUsize::get),
            selection: self.input.selection.selection(),
            keep_rollouts,
            allowed: self.motion.allow.clone(),
            ..PlanRequest::new(sources, simulators)
        })
    }
}

/// Parses the texts of `--set`: id, dotted path, value.
pub(super) fn read_parameters(texts: &[String]) -> anyhow::Result<Vec<(String, String, String)>> {
    let read = |text: &String| {
        let parts = text.split_once('=').and_then(|(path, value)| Some((path.split_once('.')?, value)));
        let Some(((id, key), value)) = parts else {
            bail!("--set `{text}`: write ID.KEY=VALUE, such as idm.vehicle.headway=1.5");
        };
        Ok((id.trim().to_owned(), key.trim().to_owned(), value.trim().to_owned()))
    };
    texts.iter().map(read).collect()
}

/// Reads the files of `--model-weights`, with the ids that they are for.
pub(super) fn read_weights(texts: &[String]) -> anyhow::Result<Vec<(String, WeightsFile)>> {
    let mut weights = Vec::new();
    for text in texts {
        match text.split_once('=') {
            Some((id, file)) if !id.is_empty() && !file.is_empty() => {
                weights.push((id.to_owned(), weights_file(Path::new(file))?));
            }
            _ => bail!("--model-weights `{text}`: write ID=FILE, such as pufferdrive=puffer.safetensors"),
        }
    }
    Ok(weights)
}
