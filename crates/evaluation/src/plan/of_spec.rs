//! Plans of specified runs.

use std::path::Path;

use reactsim_formats::Partition;
use reactsim_metrics::Metrics;
use reactsim_rollout::Protocol;

use super::{Deviations, Plan};
use crate::av::{AvChoice, AvDriver, PlannedAv};
use crate::deviation::pose::Pose;
use crate::driver::Driver;
use crate::error::{AV_CHOICES, EvaluationError};
use crate::simulators::{PlannedSimulator, refuse_repeated};
use crate::source::Source;
use crate::source::benchmarks::BenchmarkRecord;
use crate::spec::{RunSpec, SubjectSpec};

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
    /// Returns the file of deviations, if there is one.
    ///
    /// # Errors
    /// [`EvaluationError`] as for [`Self::check_values`], and if the AV and the deviations do not fit
    /// together or to the protocol.
    pub(crate) fn check(&self) -> Result<Option<&Path>, EvaluationError> {
        self.check_values()?;
        if self.rollout.protocol == Protocol::Realism && self.subject.av.is_some() {
            let text = "the simulator moves the AV in the realism protocol: leave `av` out";
            return Err(EvaluationError::Refused(text.to_owned()));
        }
        deviations_file(&self.subject)
    }

    /// Plans the run. Every error of its inputs is reported here, before the first scenario.
    ///
    /// # Errors
    /// [`EvaluationError`] as for [`Self::check_values`], and if a simulator is repeated, the AV and the
    /// deviations do not fit together or to the protocol, the AV policy names a planner that is not given, the
    /// file of deviations cannot be read, or no AV is chosen and the scenarios have no deviated one.
    pub fn plan(&self, parts: RunParts) -> Result<Plan, EvaluationError> {
        let RunParts { sources, simulators, drivers, metrics, partition } = parts;
        refuse_repeated(simulators.iter().map(|simulator| simulator.id.as_str()))?;
        let (subject, file) = (&self.subject, self.check()?);
        let is_realism = self.rollout.protocol == Protocol::Realism;
        let mut deviations = file.map(Deviations::read).transpose()?;
        let pose = subject.motion.pose.unwrap_or(Pose::Centre);
        match &mut deviations {
            Some(deviations) => deviations.pose = pose,
            None if pose != Pose::Centre => {
                let text =
                    "`pose` is the point of the AV whose poses a file of deviations has: give `deviations`";
                return Err(EvaluationError::Refused(text.to_owned()));
            }
            None => {}
        }
        let av = match subject.av.clone() {
            Some(av) => Some(av),
            None if is_realism => None,
            None if deviations.is_none() && !sources.is_empty() && !are_deviated(&sources) => {
                return Err(EvaluationError::Refused(format!(
                    "the scenarios have no deviated AV: give `deviations`, or choose a driver with `av`: \
                     {AV_CHOICES}"
                )));
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

/// Returns the file of deviations, which the AV policy may name too.
fn deviations_file(subject: &SubjectSpec) -> Result<Option<&Path>, EvaluationError> {
    let refuse = |text: &str| Err(EvaluationError::Refused(text.to_owned()));
    match (&subject.input.deviations, &subject.av) {
        (Some(_), Some(AvChoice::File(_))) => refuse("give either `deviations` or `av` file:<path>"),
        (Some(_), Some(AvChoice::Log | AvChoice::Scripted(_) | AvChoice::Planned(_))) => {
            refuse("`deviations` goes with `av` deviated or deviated-or-log only")
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
        return Err(EvaluationError::Refused(format!(
            "the AV policy names the planner `{driver}`, which is not given: define it with `planner` \
             NAME=COMMAND"
        )));
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

#[cfg(test)]
mod tests {
    use reactsim_formats::FutureChoice;

    use super::*;

    #[test]
    fn values_are_checked_wherever_they_come_from() {
        type Change = fn(&mut RunSpec);
        let cases: [(Change, &str); 11] = [
            (|spec| spec.rollout.av_lookahead = 2, "av-lookahead `2`: write 0 or 1"),
            (|spec| spec.rollout.rollouts = 0, "0 rollouts"),
            (|spec| spec.rollout.rollouts = 10_001, "rollouts `10001`: write at most 10000"),
            (|spec| spec.subject.input.selection.category.push("x".into()), "category `x`: write one of "),
            (
                |spec| spec.subject.external.reveal_ids = Some(true),
                "reveal-ids has no effect without external",
            ),
            (
                |spec| {
                    let reading = &mut spec.subject.input.reading;
                    (reading.current_frame, reading.window_step) =
                        (Some(12), std::num::NonZeroUsize::new(10));
                },
                "window-step and current-frame exclude each other",
            ),
            (|spec| spec.subject.input.reading.history = Some(1), "history `1`: write 2 to 100"),
            (
                |spec| spec.subject.input.reading.future = Some(FutureChoice::Steps(6001)),
                "future `6001`: write 1 to 6000",
            ),
            (
                |spec| spec.subject.input.reading.nuplan.nuplan.push("logs".into()),
                "nuplan has no effect without filter",
            ),
            (
                |spec| spec.subject.input.reading.nuplan.filter = Some("f.yaml".into()),
                "filter has no effect without nuplan",
            ),
            (
                |spec| spec.subject.input.reading.nuplan.maps = Some("maps".into()),
                "maps has no effect without nuplan",
            ),
        ];
        for (change, message) in cases {
            let mut spec = RunSpec::default();
            change(&mut spec);
            let error = spec.check_values().unwrap_err().to_string();
            assert!(error.starts_with(message), "{error}");
            assert_eq!(spec.plan(RunParts::default()).err().map(|error| error.to_string()), Some(error));
        }
        let mut most = RunSpec::default();
        (most.rollout.rollouts, most.rollout.av_lookahead) = (crate::spec::MOST_ROLLOUTS, 0);
        most.subject.external.reveal_ids = Some(false);
        most.check_values().unwrap();
    }
}
