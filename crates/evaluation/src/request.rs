//! Runs that are asked for, and the only way to plan them.

use std::path::{Path, PathBuf};

use reactsim_formats::Partition;
use reactsim_metrics::Options;
use reactsim_rollout::{Protocol, Settings};

use super::EvaluationError;
use super::av::{AvChoice, AvDriver, PlannedAv};
use super::benchmarks::BenchmarkRecord;
use super::driver::Driver;
use super::plan::{Deviations, Plan, RunSettings};
use super::pose::Pose;
use super::rollout_checks::RolloutCheck;
use super::selection::Selection;
use super::simulators::PlannedSimulator;
use super::source::Source;

/// A run that is asked for. [`Self::plan`] checks that its parts fit together.
pub struct PlanRequest {
    /// Sources of scenarios, opened with `limit`.
    pub sources: Vec<Source>,
    /// Simulators in the order of the tables.
    pub simulators: Vec<PlannedSimulator>,
    /// File of deviated AVs, Parquet or JSON.
    pub deviations: Option<PathBuf>,
    /// The point of the AV whose poses the file of deviations has.
    pub pose: Pose,
    /// AV policy in the reactive protocol; `None` for the deviated AV.
    pub av: Option<AvChoice>,
    /// Planners that the AV policy may name, without simulators.
    pub drivers: Vec<Driver>,
    /// Protocol, replan interval, lookahead, seed.
    pub rollout: Settings,
    /// Number of rollouts per scenario and simulator.
    pub rollouts: u32,
    /// Variants of the metrics.
    pub options: Options,
    /// Maximum number of scenarios per source.
    pub limit: Option<usize>,
    /// Scenarios of the sources that are used.
    pub selection: Selection,
    /// Whether the run folder keeps the rollouts.
    pub keep_rollouts: bool,
    /// Checks of given motion that need not be met.
    pub allowed: Vec<RolloutCheck>,
    /// The partition to run, for which `sources` were opened; `None` for the whole.
    pub partition: Option<Partition>,
}

impl PlanRequest {
    /// Asks for one rollout of all scenarios by these simulators, with the default settings.
    pub fn new(sources: Vec<Source>, simulators: Vec<PlannedSimulator>) -> Self {
        Self {
            sources,
            simulators,
            deviations: None,
            pose: Pose::Centre,
            av: None,
            drivers: Vec::new(),
            rollout: Settings::default(),
            rollouts: 1,
            options: Options::default(),
            limit: None,
            selection: Selection::default(),
            keep_rollouts: false,
            allowed: Vec::new(),
            partition: None,
        }
    }

    /// Plans the run. Every error of its inputs is reported here, before the first scenario.
    ///
    /// # Errors
    /// [`EvaluationError`] if a simulator is repeated, there are no rollouts, the AV and the deviations do
    /// not fit together or to the protocol, the AV policy names a planner that is not given, the file of
    /// deviations cannot be read, or no AV is chosen and the scenarios have no deviated one.
    pub fn plan(self) -> Result<Plan, EvaluationError> {
        for (i, simulator) in self.simulators.iter().enumerate() {
            if self.simulators[..i].iter().any(|earlier| earlier.id == simulator.id) {
                return Err(EvaluationError::RepeatedSimulator { id: simulator.id.clone() });
            }
        }
        if self.rollouts == 0 {
            return Err(EvaluationError::ZeroRollouts);
        }
        let is_realism = self.rollout.protocol == Protocol::Realism;
        if is_realism && self.av.is_some() {
            return Err(EvaluationError::AvInRealism);
        }
        let mut deviations = self.deviations_file()?.map(Deviations::read).transpose()?;
        match &mut deviations {
            Some(deviations) => deviations.pose = self.pose,
            None if self.pose != Pose::Centre => return Err(EvaluationError::PoseUnused),
            None => {}
        }
        let av = match self.av {
            Some(av) => av,
            // Never asked: the simulator moves the AV.
            None if is_realism => AvChoice::Log,
            None if deviations.is_none() && !self.sources.is_empty() && !are_deviated(&self.sources) => {
                return Err(EvaluationError::NoDeviatedAv);
            }
            None => AvChoice::Deviated,
        };
        let drivers = with_driver(&av, self.drivers)?;
        let settings = RunSettings {
            rollout: self.rollout,
            av,
            rollouts: self.rollouts,
            options: self.options,
            limit: self.limit,
            selection: self.selection,
        };
        let Self { sources, simulators, keep_rollouts, allowed, partition, .. } = self;
        Ok(Plan { sources, simulators, deviations, drivers, settings, keep_rollouts, allowed, partition })
    }

    /// Returns the file of deviations, which the AV policy may name too.
    fn deviations_file(&self) -> Result<Option<&Path>, EvaluationError> {
        match (&self.deviations, &self.av) {
            (Some(_), Some(AvChoice::File(_))) => Err(EvaluationError::DeviationsTwice),
            (Some(_), Some(AvChoice::Log | AvChoice::Scripted(_) | AvChoice::Planned(_))) => {
                Err(EvaluationError::DeviationsUnused)
            }
            (Some(path), None | Some(AvChoice::Deviated | AvChoice::DeviatedOrLog))
            | (None, Some(AvChoice::File(path))) => Ok(Some(path)),
            (None, _) => Ok(None),
        }
    }
}

/// Returns these drivers and, if the AV policy names a simulator, this one.
///
/// # Errors
/// [`EvaluationError`] if the policy names a planner that is not given, or a simulator that cannot drive.
pub(super) fn with_driver(av: &AvChoice, mut drivers: Vec<Driver>) -> Result<Vec<Driver>, EvaluationError> {
    drivers.extend(Driver::of(av)?);
    let AvChoice::Planned(PlannedAv { driver, .. }) = av else { return Ok(drivers) };
    let needs_driver = matches!(driver, AvDriver::External(_) | AvDriver::Own(_));
    if needs_driver && !drivers.iter().any(|given| given.driver == *driver) {
        return Err(EvaluationError::NoDriver { name: driver.to_string() });
    }
    Ok(drivers)
}

/// Returns whether the first readable scenario has a deviated AV; `true` if no scenario is readable, which the
/// run reports later. Known benchmarks are not read for it.
pub(super) fn are_deviated(sources: &[Source]) -> bool {
    if sources.first().is_some_and(|source| BenchmarkRecord::of(&source.file).is_some()) {
        return true;
    }
    let scenarios = sources.iter().filter_map(|source| source.scenarios().ok()).flatten();
    scenarios.filter_map(Result::ok).next().is_none_or(|scenario| scenario.deviation.is_some())
}
