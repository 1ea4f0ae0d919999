//! Evaluates simulators in a few lines: scenarios, an AV, simulators, results.
//!
//! ```
//! use reactsim::Benchmark;
//! use reactsim::rollout::{PlanError, Planning, SingleEpisode, Stream};
//! use reactsim::scene::{AgentState, DT, Start};
//!
//! /// Every agent keeps its velocity.
//! struct Mine;
//!
//! impl SingleEpisode for Mine {
//!     type Memory = ();
//!
//!     fn id(&self) -> &'static str {
//!         "mine"
//!     }
//!
//!     fn begin(&self, _start: &Start, _stream: &mut Stream) {}
//!
//!     fn plan_one(&self, _memory: &mut (), episode: &mut Planning<'_, '_>) -> Result<(), PlanError> {
//!         for agent in 0..episode.plan.agents() {
//!             let Some(now) = episode.seen.state(agent) else { continue };
//!             for step in 0..episode.plan.steps() {
//!                 let t = (step + 1) as f64 * DT;
//!                 let next = AgentState { x: now.x + now.vx * t, y: now.y + now.vy * t, ..now };
//!                 episode.plan.set(agent, step, Some(next));
//!             }
//!         }
//!         Ok(())
//!     }
//! }
//!
//! let results = Benchmark::shipped().limit(2).baseline("idm").simulator("mine", Mine).run()?;
//! println!("{}", results.table());
//! assert!(results.mean("mine", "aav-collision") >= results.mean("idm", "aav-collision"));
//! # Ok::<(), reactsim::BenchmarkError>(())
//! ```

use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use crate::evaluation::{
    self, AvChoice, Driver, EvaluationError, Execution, Opening, Outcome, Plan, PlannedAv, PlannedSimulator,
    RolloutCheck, RunObserver, RunParts, RunSpec, Selection, Summary,
};
use crate::external::{Command, ExternalError, ExternalSettings, ExternalSimulator};
use crate::metrics::{Metric, MetricError, Metrics, Options};
use crate::models::nn::Backend;
use crate::planning::planner::Planner;
use crate::planning::tracking::Controller as PlanTracking;
use crate::report::{self, Run, TableStyle};
use crate::rollout::{Controller, Entering, Oracle, Protocol, Replan, Simulator};
use crate::scene::Scenario;
use crate::work::available_threads;

/// Scenarios that a thread steps together, if nothing else is chosen.
const DEFAULT_BATCH: NonZeroUsize = NonZeroUsize::new(4).expect("4 is not 0");

/// A benchmark run that is being put together. Wrong settings are reported by [`Benchmark::run`], before the
/// first scenario.
#[must_use = "a benchmark does nothing until `run` is called"]
pub struct Benchmark {
    /// Scenarios in memory; `None` if the specification names them.
    scenarios: Option<Vec<Scenario>>,
    spec: RunSpec,
    /// Whether the default baselines run if no simulator is named, as for `reactsim run`.
    has_defaults: bool,
    /// The largest number of scenarios of a file, if it is not that of the specification.
    limit: Option<usize>,
    /// Planners of the calling program.
    drivers: Vec<Driver>,
    simulators: Vec<Entry>,
    metrics: Vec<Box<dyn Metric>>,
    threads: Option<NonZeroUsize>,
    batch: NonZeroUsize,
    folder: Option<PathBuf>,
    resume: bool,
    observer: Arc<dyn RunObserver + Send>,
    stop: Arc<AtomicBool>,
}

/// A simulator that is not a baseline.
enum Entry {
    Own(Box<PlannedSimulator>),
    External(Box<ExternalSettings>),
}

/// Reason why a benchmark cannot be run.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BenchmarkError {
    /// A file cannot be read, a simulator is unknown or repeated, or the run folder cannot be written.
    #[error(transparent)]
    Evaluation(#[from] EvaluationError),
    /// The id of a metric is taken or malformed, or tables cannot print its title or unit.
    #[error(transparent)]
    Metric(#[from] MetricError),
    /// An external simulator does not start or does not support the run.
    #[error(transparent)]
    External(#[from] ExternalError),
    /// No simulator was added.
    #[error("no simulator: add one with `simulator`, `oracle`, `baseline` or `baselines`")]
    NoSimulator,
    /// No AV is driven by a planner of the specification.
    #[error("no AV is driven by `{0}`: set `av` to planner:{0}")]
    UnusedPlanner(String),
    /// The limit of scenarios is 0.
    #[error("`limit` is 0, expected at least 1 scenario")]
    ZeroLimit,
    /// A run is to be resumed, but no folder is given.
    #[error("`resume` continues the run in a folder: give one with `folder`")]
    NoFolder,
    /// No scenario has a result.
    #[error("no scenario could be run; the first failure: {0}")]
    NothingRun(String),
    /// The stop flag was set during the run.
    #[error("interrupted; finished rows are in the run folder, where there is one")]
    Interrupted,
}

/// Results of a benchmark run.
#[derive(Clone, Debug)]
pub struct Results {
    /// Estimates, provenance and failures.
    pub summary: Summary,
}

impl Benchmark {
    /// The benchmark that ships with the crate, with its deviated AVs.
    pub fn shipped() -> Self {
        Self::of(RunSpec::default())
    }

    /// Scenarios from files, folders and URLs in any of [`FORMATS`](crate::formats::FORMATS).
    pub fn files<P: Into<PathBuf>>(paths: impl IntoIterator<Item = P>) -> Self {
        let mut spec = RunSpec::default();
        spec.subject.input.scenarios = paths.into_iter().map(Into::into).collect();
        Self::of(spec)
    }

    /// What a specification states, as `reactsim run FILE` reads it: without scenarios, the shipped ones;
    /// without simulators, of its own or added ones, the default baselines. Its external programs are started.
    /// Its smoothing stage is behind all simulators but those of [`Self::simulator`] and [`Self::oracle`].
    pub fn specified(spec: RunSpec) -> Self {
        Self { has_defaults: true, ..Self::of(spec) }
    }

    /// Scenarios in memory.
    pub fn scenarios(scenarios: impl IntoIterator<Item = Scenario>) -> Self {
        let scenarios = Some(scenarios.into_iter().collect());
        Self { scenarios, ..Self::of(RunSpec::default()) }
    }

    fn of(spec: RunSpec) -> Self {
        Self {
            scenarios: None,
            spec,
            has_defaults: false,
            limit: None,
            drivers: Vec::new(),
            simulators: Vec::new(),
            metrics: Vec::new(),
            threads: None,
            batch: DEFAULT_BATCH,
            folder: None,
            resume: false,
            observer: Arc::new(()),
            stop: Arc::default(),
        }
    }

    /// Adds a simulator under an id, which is also its title.
    pub fn simulator(self, id: impl Into<String>, simulator: impl Simulator + 'static) -> Self {
        self.own(id.into(), Controller::Fair(Box::new(simulator)))
    }

    /// Adds a simulator that observes the logged future; tables mark it with †.
    pub fn oracle(self, id: impl Into<String>, oracle: impl Oracle + 'static) -> Self {
        self.own(id.into(), Controller::Oracle(Box::new(oracle)))
    }

    /// Adds a simulator that is a program of its own: a command line for `sh` that speaks the protocol for
    /// external simulators. Tables mark it with ‡.
    pub fn external(self, name: impl Into<String>, command: impl Into<String>) -> Self {
        self.external_with(ExternalSettings::new(name, Command::Shell(command.into())))
    }

    /// Adds an external simulator with settings of its own: processes, batches, time limits.
    pub fn external_with(mut self, settings: ExternalSettings) -> Self {
        self.simulators.push(Entry::External(Box::new(settings)));
        self
    }

    fn own(mut self, id: String, controller: Controller) -> Self {
        self.simulators.push(Entry::Own(Box::new(PlannedSimulator::own(id, controller))));
        self
    }

    /// Adds a baseline by its id, such as `idm` or `idm+qp`, or a variant of it, such as `idm@calm`. `default`
    /// adds all that run by default, `all` all that have weights, `mix:idm=1+stop=1` mixed traffic. Tables list
    /// baselines first.
    pub fn baseline(mut self, id: impl Into<String>) -> Self {
        self.spec.subject.models.push(id.into());
        self
    }

    /// Adds several baselines.
    pub fn baselines<I: Into<String>>(self, ids: impl IntoIterator<Item = I>) -> Self {
        ids.into_iter().fold(self, Self::baseline)
    }

    /// Sets a parameter of a baseline that was added, or of a variant, by its dotted path:
    /// `.baseline("idm@calm").parameter("idm@calm", "vehicle.headway", "2.5")`. The value is in TOML notation.
    pub fn parameter(
        mut self,
        id: impl Into<String>,
        key: impl Into<String>,
        value: impl Into<String>,
    ) -> Self {
        let (id, key, value) = (id.into(), key.into(), value.into());
        self.spec.subject.set.push(format!("{id}.{key}={value}"));
        self
    }

    /// Reads the weights of a baseline that was added, or of a variant, from a file.
    pub fn weights(mut self, id: impl Into<String>, file: impl Into<PathBuf>) -> Self {
        let (id, file) = (id.into(), file.into());
        self.spec.subject.model_weights.push(format!("{id}={}", file.display()));
        self
    }

    /// Tensor backend of the networks [default: flex].
    pub fn backend(mut self, backend: Backend) -> Self {
        self.spec.subject.backend = backend;
        self
    }

    /// Deviated AVs from a file, Parquet or JSON. Scenarios without an entry are skipped, or driven by the
    /// logged AV with [`AvChoice::DeviatedOrLog`]. Policies without deviated AVs are refused.
    pub fn deviations(mut self, path: impl Into<PathBuf>) -> Self {
        self.spec.subject.input.deviations = Some(path.into());
        self
    }

    /// Policy of the AV [default: the deviated trajectory].
    pub fn av(mut self, av: AvChoice) -> Self {
        self.spec.subject.av = Some(av);
        self
    }

    /// Lets a planner of your own drive the AV, at every step, along the route of the log: the AV is then
    /// judged by nuPlan's closed-loop metrics, next to the agents. `new_planner` is called once per rollout.
    /// The last call of [`Self::av`], `planner` and [`Self::planner_with`] counts.
    pub fn planner(
        self,
        name: impl Into<String>,
        new_planner: impl Fn() -> Box<dyn Planner> + Send + Sync + 'static,
    ) -> Self {
        self.planner_with(Driver::own(name, new_planner), PlanTracking::LqrBicycle, Replan::EVERY_STEP)
    }

    /// Lets a planner drive the AV, tracked by `tracking`, with a plan every `every` steps.
    pub fn planner_with(mut self, driver: Driver, tracking: PlanTracking, every: Replan) -> Self {
        let planned = PlannedAv { driver: driver.driver().clone(), controller: tracking, every };
        self.spec.subject.av = Some(AvChoice::Planned(planned));
        self.drivers.push(driver);
        self
    }

    /// Protocol [default: reactive].
    pub fn protocol(mut self, protocol: Protocol) -> Self {
        self.spec.rollout.protocol = protocol;
        self
    }

    /// Replan interval [default: 5 steps].
    pub fn replan(mut self, replan: Replan) -> Self {
        self.spec.rollout.replan = replan;
        self
    }

    /// Whether agents at t + 1 observe the AV at t + 1 [default: true].
    pub fn av_lookahead(mut self, lookahead: bool) -> Self {
        self.spec.rollout.av_lookahead = u8::from(lookahead);
        self
    }

    /// Whether agents of the log that appear later enter [default: if a planner drives on logs].
    pub fn entering(mut self, entering: Entering) -> Self {
        self.spec.rollout.entering = Some(entering);
        self
    }

    /// Seed of all random choices [default: 0].
    pub fn seed(mut self, seed: u64) -> Self {
        self.spec.subject.seed = seed;
        self
    }

    /// Rollouts per scenario and simulator [default: 1].
    pub fn rollouts(mut self, rollouts: u32) -> Self {
        self.spec.rollout.rollouts = rollouts;
        self
    }

    /// Adds a metric of your own: rows, intervals, tables, comparisons and the page show it like those of the
    /// benchmark, and the run folder has its title and unit for later reports.
    pub fn metric(mut self, metric: Box<dyn Metric>) -> Self {
        self.metrics.push(metric);
        self
    }

    /// Variants of the metrics [default: those of the benchmark].
    pub fn metric_options(mut self, options: Options) -> Self {
        let named = options.named().into_iter();
        self.spec.subject.metric_option = named.map(|(name, value)| format!("{name}={value}")).collect();
        self
    }

    /// At most this number of scenarios that are run, over all files; 0 is refused.
    pub fn limit(mut self, scenarios: usize) -> Self {
        self.limit = Some(scenarios);
        self
    }

    /// Scenarios with certain ids or categories [default: all].
    pub fn selection(mut self, selection: Selection) -> Self {
        self.spec.subject.input.selection = selection.into();
        self
    }

    /// Number of threads [default: one per core]. Results do not depend on it.
    pub fn threads(mut self, threads: NonZeroUsize) -> Self {
        self.threads = Some(threads);
        self
    }

    /// Scenarios that a thread steps together [default: 4]. Results do not depend on it.
    pub fn batch(mut self, batch: NonZeroUsize) -> Self {
        self.batch = batch;
        self
    }

    /// Continues the run in the folder, if it was interrupted.
    pub fn resume(mut self) -> Self {
        self.resume = true;
        self
    }

    /// A run folder for provenance, rows, events and summary.
    pub fn folder(mut self, path: impl Into<PathBuf>) -> Self {
        self.folder = Some(path.into());
        self
    }

    /// Keeps the rollouts in the run folder.
    pub fn keep_rollouts(mut self) -> Self {
        self.spec.keep_rollouts = Some(true);
        self
    }

    /// Judges motion of external simulators and deviations although it fails a check, and marks its rows in
    /// every table.
    pub fn allow(mut self, check: RolloutCheck) -> Self {
        self.spec.subject.motion.allow.push(check);
        self
    }

    /// Reports progress to an observer.
    pub fn observer(mut self, observer: Arc<impl RunObserver + Send + 'static>) -> Self {
        self.observer = observer;
        self
    }

    /// Ends the run early with [`BenchmarkError::Interrupted`] when the flag is set.
    pub fn stop(mut self, flag: Arc<AtomicBool>) -> Self {
        self.stop = flag;
        self
    }

    /// Rolls out every simulator in every scenario and computes all metrics.
    ///
    /// Scenarios that fail are listed in [`Summary::provenance`]; the others are evaluated.
    ///
    /// # Errors
    /// [`BenchmarkError`] if a setting is wrong, an input cannot be read, or no scenario could be run.
    pub fn run(self) -> Result<Results, BenchmarkError> {
        if self.resume && self.folder.is_none() {
            return Err(BenchmarkError::NoFolder);
        }
        crate::evaluation::set_program_commit(crate::COMMIT);
        let threads = self.threads.map_or_else(available_threads, NonZeroUsize::get);
        let execution = Execution { jobs: threads, batch: self.batch.get() };
        let (observer, stop) = (Arc::clone(&self.observer), Arc::clone(&self.stop));
        let (folder, resume) = (self.folder.clone(), self.resume);
        let plan = self.plan()?;
        let (folder, tally) = plan.open_folder(folder.as_deref(), resume)?;
        let outcome = evaluation::run(&plan, execution, folder.as_ref(), tally, observer.as_ref(), &stop)?;
        let Outcome::Finished(summary) = outcome else { return Err(BenchmarkError::Interrupted) };
        if summary.provenance.scenarios == 0 {
            let first = summary.provenance.failures.first();
            let reason = first.map_or_else(|| "there are no scenarios".to_owned(), |f| f.error.clone());
            return Err(BenchmarkError::NothingRun(reason));
        }
        Ok(Results { summary: *summary })
    }

    /// Builds the simulators, opens the scenarios and plans the run.
    fn plan(self) -> Result<Plan, BenchmarkError> {
        let Self {
            scenarios, mut spec, mut drivers, simulators: entries, metrics, has_defaults, limit, ..
        } = self;
        if let Some(limit) = limit {
            spec.subject.input.limit = Some(NonZeroUsize::new(limit).ok_or(BenchmarkError::ZeroLimit)?);
        }
        let metrics = Metrics::with(metrics)?;
        let mut simulators = if !spec.subject.models.is_empty() || (has_defaults && entries.is_empty()) {
            spec.baselines()?
        } else if entries.is_empty() {
            return Err(BenchmarkError::NoSimulator);
        } else if let Some(id) = spec.subject.adjustments(spec.rollout.smooth.0)?.ids().next() {
            return Err(EvaluationError::not_run(id).into());
        } else {
            Vec::new()
        };
        let outline = RunSpec::outline([&spec]);
        let programs = spec.subject.external.start(&outline)?;
        simulators.extend(programs.planned(&spec)?);
        for driver in programs.planners.iter().cloned().map(Driver::external) {
            let name = driver.driver();
            if !matches!(&spec.subject.av, Some(AvChoice::Planned(planned)) if planned.driver == *name) {
                return Err(BenchmarkError::UnusedPlanner(name.to_string()));
            }
            drivers.push(driver);
        }
        for entry in entries {
            simulators.push(match entry {
                Entry::Own(simulator) => *simulator,
                Entry::External(external) => {
                    let external = ExternalSimulator::start(*external, outline.clone())?;
                    PlannedSimulator::external(external, spec.rollout.smooth.0)?
                }
            });
        }
        let (input, av) = (&spec.subject.input, spec.subject.av.as_ref());
        let sources = match scenarios {
            None => input.open(Opening::Whole, av)?.0,
            Some(scenarios) => vec![input.in_memory(scenarios, av)?],
        };
        Ok(spec.plan(RunParts { sources, simulators, drivers, metrics, partition: None })?)
    }
}

impl Results {
    /// The table of all simulators as Markdown, followed by the tables of categories and difficulties.
    pub fn table(&self) -> String {
        let mut text = Vec::new();
        let exporter = report::exporter("markdown").expect("Markdown is one of the exporters");
        let run = Run { name: "", summary: &self.summary };
        exporter.export(&[run], TableStyle::default(), &mut text).expect("writing to memory does not fail");
        String::from_utf8_lossy(&text).into_owned()
    }

    /// The mean of a metric over scenarios; `None` if there is no such simulator or metric, or nothing was
    /// judged.
    pub fn mean(&self, simulator: &str, metric: &str) -> Option<f64> {
        self.summary.simulators.get(simulator)?.metrics.get(metric)?.mean
    }
}
