//! Plans of specified runs.

use std::path::Path;

use reactsim_formats::Partition;
use reactsim_metrics::Metrics;
use reactsim_rollout::{Protocol, Settings};

use super::{RunSpec, SubjectSpec};
use crate::av::{AvChoice, AvDriver, PlannedAv};
use crate::deviation::pose::Pose;
use crate::driver::Driver;
use crate::error::EvaluationError;
use crate::plan::{Deviations, Plan};
use crate::simulators::PlannedSimulator;
use crate::source::Source;
use crate::source::benchmarks::BenchmarkRecord;

/// What is opened and started for a run.
#[derive(Default)]
pub struct RunParts {
    /// Sources of scenarios.
    pub sources: Vec<Source>,
    /// Simulators in the order of the tables.
    pub simulators: Vec<PlannedSimulator>,
    /// Planners that the AV policy may name, without simulators.
    pub drivers: Vec<Driver>,
    /// Metrics, with those of the calling program.
    pub metrics: Metrics,
    /// The partition to run, for which the sources were opened; `None` for the whole.
    pub partition: Option<Partition>,
}

impl RunSpec {
    /// Returns whether the run folder keeps the rollouts.
    pub fn keeps_rollouts(&self) -> bool {
        self.keep_rollouts == Some(true)
    }

    /// Returns protocol, replan interval, lookahead and seed.
    pub fn settings(&self) -> Settings {
        let rollout = &self.rollout;
        Settings {
            protocol: rollout.protocol,
            replan: rollout.replan,
            av_lookahead: rollout.av_lookahead == 1,
            seed: self.subject.seed,
        }
    }

    /// Returns the file of deviations, if there is one.
    ///
    /// # Errors
    /// [`EvaluationError`] if there are no rollouts, or the AV and the deviations do not fit together or to
    /// the protocol.
    pub(crate) fn check(&self) -> Result<Option<&Path>, EvaluationError> {
        if self.rollout.rollouts == 0 {
            return Err(EvaluationError::ZeroRollouts);
        }
        if self.rollout.protocol == Protocol::Realism && self.subject.av.is_some() {
            return Err(EvaluationError::AvInRealism);
        }
        deviations_file(&self.subject)
    }

    /// Plans the run. Every error of its inputs is reported here, before the first scenario.
    ///
    /// # Errors
    /// [`EvaluationError`] if a simulator is repeated, there are no rollouts, the AV and the deviations do
    /// not fit together or to the protocol, the AV policy names a planner that is not given, the file of
    /// deviations cannot be read, or no AV is chosen and the scenarios have no deviated one.
    pub fn plan(&self, parts: RunParts) -> Result<Plan, EvaluationError> {
        let RunParts { sources, simulators, drivers, metrics, partition } = parts;
        refuse_repeated(&simulators)?;
        let (subject, file) = (&self.subject, self.check()?);
        let is_realism = self.rollout.protocol == Protocol::Realism;
        let mut deviations = file.map(Deviations::read).transpose()?;
        let pose = subject.motion.pose.unwrap_or(Pose::Centre);
        match &mut deviations {
            Some(deviations) => deviations.pose = pose,
            None if pose != Pose::Centre => return Err(EvaluationError::PoseUnused),
            None => {}
        }
        let av = match subject.av.clone() {
            Some(av) => Some(av),
            None if is_realism => None,
            None if deviations.is_none() && !sources.is_empty() && !are_deviated(&sources) => {
                return Err(EvaluationError::NoDeviatedAv);
            }
            None => Some(AvChoice::Deviated),
        };
        let drivers = with_driver(av.as_ref(), drivers)?;
        let (options, selection) = (subject.options()?, subject.input.selection.selection());
        let mut spec = self.clone();
        spec.subject.av = av;
        Ok(Plan { sources, simulators, deviations, drivers, spec, metrics, options, selection, partition })
    }
}

/// Refuses simulators with the same id.
pub(crate) fn refuse_repeated(simulators: &[PlannedSimulator]) -> Result<(), EvaluationError> {
    for (i, simulator) in simulators.iter().enumerate() {
        if simulators[..i].iter().any(|earlier| earlier.id == simulator.id) {
            return Err(EvaluationError::RepeatedSimulator { id: simulator.id.clone() });
        }
    }
    Ok(())
}

/// Returns the file of deviations, which the AV policy may name too.
fn deviations_file(subject: &SubjectSpec) -> Result<Option<&Path>, EvaluationError> {
    match (&subject.input.deviations, &subject.av) {
        (Some(_), Some(AvChoice::File(_))) => Err(EvaluationError::DeviationsTwice),
        (Some(_), Some(AvChoice::Log | AvChoice::Scripted(_) | AvChoice::Planned(_))) => {
            Err(EvaluationError::DeviationsUnused)
        }
        (Some(path), None | Some(AvChoice::Deviated | AvChoice::DeviatedOrLog))
        | (None, Some(AvChoice::File(path))) => Ok(Some(path)),
        (None, _) => Ok(None),
    }
}

/// Returns these drivers and, if the AV policy names a simulator, this one.
///
/// # Errors
/// [`EvaluationError`] if the policy names a planner that is not given, or a simulator that cannot drive.
pub(crate) fn with_driver(
    av: Option<&AvChoice>,
    mut drivers: Vec<Driver>,
) -> Result<Vec<Driver>, EvaluationError> {
    let Some(av @ AvChoice::Planned(PlannedAv { driver, .. })) = av else { return Ok(drivers) };
    if !drivers.iter().any(|given| given.driver == *driver) {
        drivers.extend(Driver::of(av)?);
    }
    let needs_driver = matches!(driver, AvDriver::External(_) | AvDriver::Own(_));
    if needs_driver && !drivers.iter().any(|given| given.driver == *driver) {
        return Err(EvaluationError::NoDriver { name: driver.to_string() });
    }
    Ok(drivers)
}

/// Returns whether the first readable scenario has a deviated AV; `true` if no scenario is readable, which the
/// run reports later. Known benchmarks are not read for it.
pub fn are_deviated(sources: &[Source]) -> bool {
    if sources.first().is_some_and(|source| BenchmarkRecord::of(&source.file).is_some()) {
        return true;
    }
    let scenarios = sources.iter().filter_map(|source| source.scenarios().ok()).flatten();
    scenarios.filter_map(Result::ok).next().is_none_or(|scenario| scenario.deviation.is_some())
}
