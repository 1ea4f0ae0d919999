//! Specifications of runs. The options of the command line, files, and programs give the same values: the keys of
//! a file are the long names of the options.

#![expect(
    rustdoc::broken_intra_doc_links,
    rustdoc::invalid_html_tags,
    reason = "comments of fields are the help of options, which is plain text"
)]

mod axes;
mod external;
pub(crate) mod file;
mod scenarios;
mod stage;
mod text;
mod time;

use std::path::Path;

use clap::Args;
use reactsim_baseline::WeightsFile;
use reactsim_metrics::Options;
use reactsim_nn::Backend;
use reactsim_qp::Smoothing;
use reactsim_rollout::{Entering, Protocol, Replan, Settings};
use reactsim_scene::Deviation;
use serde::{Deserialize, Serialize};

use crate::av::AvChoice;
use crate::deviation::pose::Pose;
use crate::error::EvaluationError;
use crate::motion::kind::RolloutCheck;
use crate::simulators::{Adjustments, PlannedSimulator, weights_file};

pub use axes::{Axis, AxisValue};
pub use external::{ExternalPrograms, ExternalSpec};
pub use file::Specification;
pub use scenarios::{NuplanSpec, Opening, ReadingSpec, ScenarioSpec, SelectionSpec};
pub use stage::Stage;
pub use time::Time;

/// Largest number of rollouts per scenario and simulator.
pub(crate) const MOST_ROLLOUTS: u32 = 10_000;

/// What determines the results of a run.
#[derive(Clone, Debug, Default, PartialEq, Args, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case")]
pub struct RunSpec {
    /// Scenarios, simulators and the driver of the AV.
    #[command(flatten)]
    #[serde(flatten)]
    pub subject: SubjectSpec,
    /// How simulators are rolled out.
    #[command(flatten)]
    #[serde(flatten)]
    pub rollout: RolloutSpec,
    /// Keep the rollouts in the run folder
    #[arg(long, num_args = 0..=1, require_equals = true, default_missing_value = "true", hide_possible_values = true)]
    pub keep_rollouts: Option<bool>,
}

/// How simulators are rolled out.
#[derive(Clone, Debug, PartialEq, Args, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case")]
pub struct RolloutSpec {
    /// Smoothing stage after every simulator except log replay: qp (smooth, within limits, on the
    /// road, clear of other agents) or qp-alone (ignores other agents). It becomes part of the id, as
    /// in idm+qp; --models takes such ids too [default: off]
    #[arg(long, value_name = "STAGE")]
    #[serde(with = "text")]
    pub smooth: Stage,
    /// reactive: the AV is an external input (Algorithm 1); realism: the simulator also moves the AV
    /// (Algorithm 2) [default: reactive]
    #[arg(long, value_name = "PROTOCOL")]
    #[serde(with = "text")]
    pub protocol: Protocol,
    /// Replan rate or interval, such as 2hz or 5steps [default: 2hz]
    #[arg(long, value_name = "RATE")]
    #[serde(with = "text")]
    pub replan: Replan,
    /// For step t+1, agents see the AV up to t+1 (1) or only up to t (0) [default: 1]
    #[arg(long, value_name = "0|1", value_parser = clap::value_parser!(u8).range(0..=1))]
    pub av_lookahead: u8,
    /// Agents of the log that appear after the current frame: off (they never exist, as in the benchmark) or
    /// log (they enter where the log shows them first, and the simulator moves them) [default: log if a
    /// planner drives on logs, else off]
    #[arg(long, value_name = "off|log")]
    #[serde(with = "text::option")]
    pub entering: Option<Entering>,
    /// Rollouts per scenario and simulator [default: 1]
    #[arg(long, value_name = "R", value_parser = clap::value_parser!(u32).range(1..=MOST_ROLLOUTS.into()))]
    pub rollouts: u32,
}

impl Default for RolloutSpec {
    fn default() -> Self {
        let Settings { protocol, replan, av_lookahead, .. } = Settings::default();
        let av_lookahead = u8::from(av_lookahead);
        Self { smooth: Stage(None), protocol, replan, av_lookahead, entering: None, rollouts: 1 }
    }
}

/// Scenarios, simulators and the driver of the AV.
#[derive(Clone, Debug, Default, PartialEq, Args, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case")]
pub struct SubjectSpec {
    /// Scenarios and their deviated AVs.
    #[command(flatten)]
    #[serde(flatten)]
    pub input: ScenarioSpec,
    /// Simulators, separated by commas; `all` for all baselines that have weights, `default` for the ones
    /// that run by default; `reactsim list models` shows them. mix:idm=0.5+ntp-guarded=0.5 draws a simulator
    /// for each agent by these shares; +pedestrian=ID and +cyclist=ID name that of a class
    /// [default: default]
    #[arg(long, value_delimiter = ',', value_name = "IDS")]
    pub models: Vec<String>,
    /// Weights of a simulator, such as pufferdrive=puffer.safetensors, or of a variant next to the
    /// shipped one, such as ntp-reactive@mine=new.safetensors; may be repeated
    #[arg(long, value_name = "ID=FILE")]
    pub model_weights: Vec<String>,
    /// Override a parameter of a simulator's card, such as idm.vehicle.headway=1.5, or of a variant next
    /// to it, such as idm@calm.vehicle.headway=2.5; may be repeated.
    /// `reactsim list parameters idm` shows parameters and ranges
    #[arg(long, value_name = "ID.KEY=VALUE")]
    pub set: Vec<String>,
    /// Driver of the AV: deviated, log, deviated-or-log, constant-velocity, brake:<m/s²>, retime:<factor>,
    /// shift:<m>, file:<path> or a planner, which is judged: planner:pdm-closed, planner:idm,
    /// planner:diffusion-planner, planner:log, planner:simulator:<id> or planner:external:<name>; with
    /// settings such as planner:idm,tracker=perfect,every=5 [default: deviated]
    #[arg(long, value_name = "POLICY")]
    #[serde(with = "text::option")]
    pub av: Option<AvChoice>,
    /// Tensor backend of the networks; `reactsim list backends` shows which this program has [default: flex]
    #[arg(long, value_name = "NAME")]
    #[serde(with = "text")]
    pub backend: Backend,
    /// Seed of all random choices [default: 0]
    #[arg(long, value_name = "SEED")]
    #[serde(with = "text::seed")]
    pub seed: u64,
    /// External simulators and planners.
    #[command(flatten)]
    #[serde(flatten)]
    pub external: ExternalSpec,
    /// Treatment of motion that other programs made.
    #[command(flatten)]
    #[serde(flatten)]
    pub motion: MotionSpec,
    /// Variant of the metrics, such as fault_order=nuplan; may be repeated. `reactsim list
    /// metric-options` shows all
    #[arg(long, value_name = "NAME=VALUE")]
    pub metric_option: Vec<String>,
}

/// Treatment of motion that other programs made.
#[derive(Clone, Debug, Default, PartialEq, Args, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case")]
pub struct MotionSpec {
    /// Judge motion of external simulators, deviations or rollouts although it fails a check, and mark its
    /// rows in every table: jumps, coordinates, rear-axle, units, time, agent-order, headings,
    /// velocities, teleports, freeze, float32 or resolution; for `score` also other-av (the AV does not
    /// follow the deviated trajectory), missing-agents (agents of the log are absent) and partial (scenarios
    /// without rollouts); may be repeated
    #[arg(long, value_name = "CHECK", value_delimiter = ',')]
    #[serde(with = "text::list")]
    pub allow: Vec<RolloutCheck>,
    /// Point of vehicles whose poses the deviations or rollouts have: centre, rear-axle (distance from entry
    /// 0 of 81 states), rear-axle=METRES or rear-axle=SHARE% of the length
    #[arg(long, value_name = "POINT")]
    #[serde(with = "text::option")]
    pub pose: Option<Pose>,
}

impl RunSpec {
    /// Returns whether the run folder keeps the rollouts.
    pub fn keeps_rollouts(&self) -> bool {
        self.keep_rollouts == Some(true)
    }

    /// Returns protocol, replan interval, lookahead, entering agents and seed.
    pub fn settings(&self) -> Settings {
        let (rollout, subject) = (&self.rollout, &self.subject);
        let is_planned = matches!(subject.av, Some(AvChoice::Planned(_)));
        let by_default =
            if is_planned && !subject.input.is_shipped() { Entering::Log } else { Entering::Off };
        Settings {
            protocol: rollout.protocol,
            replan: rollout.replan,
            av_lookahead: rollout.av_lookahead == 1,
            entering: rollout.entering.unwrap_or(by_default),
            seed: subject.seed,
        }
    }

    /// Checks the values of which each text is valid: their ranges, and whether they fit together.
    ///
    /// # Errors
    /// [`EvaluationError`] names the key.
    pub fn check_values(&self) -> Result<(), EvaluationError> {
        let (RolloutSpec { rollouts, av_lookahead, .. }, SubjectSpec { input, external, .. }) =
            (&self.rollout, &self.subject);
        if *rollouts == 0 {
            return Err(EvaluationError::Refused("0 rollouts: at least 1 is needed".to_owned()));
        }
        if *rollouts > MOST_ROLLOUTS {
            let expected = format!("at most {MOST_ROLLOUTS}");
            return Err(EvaluationError::spec("rollouts", &rollouts.to_string(), expected));
        }
        if *av_lookahead > 1 {
            return Err(EvaluationError::spec("av-lookahead", &av_lookahead.to_string(), "0 or 1"));
        }
        let is_unknown = |name: &&String| Deviation::from_name(name).is_none();
        if let Some(name) = input.selection.category.iter().find(is_unknown) {
            let expected = Deviation::ALL.map(Deviation::name).join(", ");
            return Err(EvaluationError::spec("category", name, format!("one of {expected}")));
        }
        if external.reveal_ids == Some(true) && external.external.is_empty() && external.planner.is_empty() {
            return Err(EvaluationError::needs("reveal-ids", "external or planner"));
        }
        input.reading.check()
    }

    /// Creates the simulators that are baselines, with the stage behind each. There are none if only external
    /// programs are named.
    ///
    /// # Errors
    /// [`EvaluationError`] as for [`PlannedSimulator::adjusted`].
    pub fn baselines(&self) -> Result<Vec<PlannedSimulator>, EvaluationError> {
        let SubjectSpec { models, external, .. } = &self.subject;
        let adjustments = self.subject.adjustments(self.rollout.smooth.0)?;
        match models.is_empty() && !external.external.is_empty() {
            true => Ok(Vec::new()),
            false => PlannedSimulator::adjusted(models, &adjustments),
        }
    }

    /// Returns whether another specification names the same simulators.
    pub(crate) fn has_simulators_of(&self, other: &Self) -> bool {
        let named = |spec: &Self| {
            let SubjectSpec { models, model_weights, set, backend, external, .. } = spec.subject.clone();
            (models, model_weights, set, backend, external.external, spec.rollout.smooth)
        };
        named(self) == named(other)
    }
}

impl SubjectSpec {
    /// Returns the weights and parameters, with this stage behind all simulators.
    ///
    /// # Errors
    /// [`EvaluationError`] if a text is not of the form that the key needs, or a file of weights cannot be read.
    pub fn adjustments(&self, smoothing: Option<Smoothing>) -> Result<Adjustments, EvaluationError> {
        Ok(Adjustments {
            weights: weights(&self.model_weights)?,
            parameters: parameters(&self.set)?,
            smoothing,
            backend: self.backend,
        })
    }

    /// Returns the variants of the metrics.
    ///
    /// # Errors
    /// [`EvaluationError`] for an unknown variant or value.
    pub fn options(&self) -> Result<Options, EvaluationError> {
        metric_options(&self.metric_option)
    }
}

/// Reads texts such as `fault_order=nuplan` as variants of the metrics.
///
/// # Errors
/// [`EvaluationError`] for another text, an unknown variant or value.
pub fn metric_options(texts: &[String]) -> Result<Options, EvaluationError> {
    let mut options = Options::default();
    for text in texts {
        let (name, value) = split_metric_option(text)?;
        options.set(name, value)?;
    }
    Ok(options)
}

/// Splits a variant of the metrics into name and value.
///
/// # Errors
/// [`EvaluationError`] if there is no value.
pub fn split_metric_option(text: &str) -> Result<(&str, &str), EvaluationError> {
    let expected = "NAME=VALUE, such as fault_order=nuplan";
    text.split_once('=').ok_or_else(|| EvaluationError::spec("metric-option", text, expected))
}

/// Reads texts such as `idm.vehicle.headway=1.5`: id, dotted path, value.
fn parameters(texts: &[String]) -> Result<Vec<(String, String, String)>, EvaluationError> {
    let read = |text: &String| {
        let parts = text.split_once('=').and_then(|(path, value)| Some((path.split_once('.')?, value)));
        let ((id, key), value) = parts.ok_or_else(|| {
            EvaluationError::spec("set", text, "ID.KEY=VALUE, such as idm.vehicle.headway=1.5")
        })?;
        Ok((id.trim().to_owned(), key.trim().to_owned(), value.trim().to_owned()))
    };
    texts.iter().map(read).collect()
}

/// Reads the files of texts such as `ntp-reactive@mine=new.safetensors`, with the ids that they are for.
///
/// # Errors
/// [`EvaluationError`] for another text, and if a file cannot be read.
pub fn weights(texts: &[String]) -> Result<Vec<(String, WeightsFile)>, EvaluationError> {
    let read = |text: &String| match text.split_once('=') {
        Some((id, file)) if !id.is_empty() && !file.is_empty() => {
            Ok((id.to_owned(), weights_file(Path::new(file))?))
        }
        _ => Err(EvaluationError::spec(
            "model-weights",
            text,
            "ID=FILE, such as pufferdrive=puffer.safetensors",
        )),
    };
    texts.iter().map(read).collect()
}
