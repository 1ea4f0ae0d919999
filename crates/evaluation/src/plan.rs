//! The plan of a run, checked before the first scenario.

pub(crate) mod of_spec;

use std::collections::BTreeMap;
use std::num::NonZeroUsize;
use std::path::Path;
use std::sync::Arc;

use reactsim_formats::{
    Partition,
    deviations::{self, DeviationRecord},
};
use reactsim_metrics::{Metrics, Options};
use reactsim_nn::cpu_class;
use reactsim_planning::PlanningError;
use reactsim_planning::av::PlannerAv;
use reactsim_planning::from_scene::{ego_shape, planning_map};
use reactsim_rollout::{Av, AvError, DeviatedAv, LogAv, Protocol, ScriptedAv};
use reactsim_scene::{DeviatedTrack, Frame, Scenario};

use crate::av::{AvChoice, AvDriver, PlannedAv};
use crate::deviation::labels::DeviationLabels;
use crate::deviation::pose::Pose;
use crate::driver::{Driver, GivenPlans};
use crate::error::EvaluationError;
use crate::folder::RunFolder;
use crate::metric_record::MetricRecord;
use crate::motion::{CheckedScene, Finding};
use crate::provenance::{Provenance, SettingsRecord, named_options, program_commit, program_version};
use crate::simulators::PlannedSimulator;
use crate::source::Source;
use crate::source::benchmarks::BenchmarkRecord;
use crate::source::file_record::FileRecord;
use crate::source::selection::Selection;
use crate::spec::RunSpec;
use crate::statistics::tally::Tally;

/// Deviated AVs by scenario id, with their file.
pub struct Deviations {
    /// The file.
    pub file: FileRecord,
    /// Deviated AVs by scenario id.
    pub tracks: BTreeMap<String, DeviationRecord>,
    /// The point of the AV whose poses they are.
    pub pose: Pose,
}

impl Deviations {
    /// Reads a file of deviations, Parquet or JSON.
    ///
    /// # Errors
    /// [`EvaluationError`] if the file cannot be read or is invalid.
    pub fn read(path: &Path) -> Result<Self, EvaluationError> {
        let tracks = deviations::read(path)?;
        let trajectories = Some(digest(&tracks));
        let file = FileRecord { trajectories, ..FileRecord::of(path, "deviations")? };
        Ok(Self { file, tracks, pose: Pose::Centre })
    }

    /// Returns the deviated trajectory of a scenario in its coordinate frame.
    ///
    /// # Errors
    /// If the file has none for the scenario, or one for another scenario of this id.
    pub fn of(&self, scenario: &Scenario) -> Result<DeviatedTrack, NoAv> {
        let record = self.tracks.get(&scenario.id).ok_or(NoAv::Missing)?;
        if let Some(wanted) = &record.scenario_digest {
            let found = scenario.digest();
            if found != *wanted {
                return Err(NoAv::Unfit(format!(
                    "the deviated AV was made for a scenario with the digest {wanted}, this one has {found} \
                     (in {}); if it was made from these files, read them with the same keys: `all-agents`, \
                     `current-frame`, `history`, `future`",
                    self.file.name
                )));
            }
        }
        let mut track = record.track_in(scenario.origin);
        let entry0 = record.now_in(scenario.origin).map(|given| (given, scenario.start.now(0)));
        let converted = self.pose.to_centre(&scenario.start.agents[0], entry0, track.iter_mut());
        converted.map_err(NoAv::Unfit)?;
        let certificate = record.certificate_in(scenario.origin);
        Ok(DeviatedTrack { category: record.category, track, certificate })
    }
}

/// Returns the BLAKE3 digest of deviated AVs by scenario id.
fn digest(records: &BTreeMap<String, DeviationRecord>) -> String {
    let mut hasher = blake3::Hasher::new();
    for (id, record) in records {
        let origin = record.origin.map(|origin| [origin.x.to_bits(), origin.y.to_bits()]);
        let track = record.now.iter().chain(&record.track).copied().collect();
        let deviated =
            DeviatedTrack { category: record.category, track, certificate: record.certificate.clone() };
        let line = format!("{id:?} {:?} {origin:?} {}\n", record.scenario_digest, deviated.digest());
        hasher.update(line.as_bytes());
    }
    hasher.finalize().to_hex().to_string()
}

/// A run: sources × simulators × rollouts.
pub struct Plan {
    /// Sources of scenarios.
    pub sources: Vec<Source>,
    /// Simulators in the order of the tables.
    pub simulators: Vec<PlannedSimulator>,
    /// Deviated AVs from a file. If given, the deviated AVs that scenarios carry are ignored, so that two
    /// sets are not mixed. In the realism protocol, which has no deviated AVs, the file selects the
    /// scenarios.
    pub deviations: Option<Deviations>,
    /// Drivers of the AV, of which the AV policy names one or none.
    pub drivers: Vec<Driver>,
    /// The specification. It names an AV policy, except in the realism protocol, in which the simulator moves
    /// the AV.
    pub spec: RunSpec,
    /// Metrics, with those of the calling program.
    pub metrics: Metrics,
    /// Variants of the metrics that the specification names.
    pub options: Options,
    /// Scenarios that the specification selects.
    pub selection: Selection,
    /// The partition that is run; `None` for the whole.
    pub partition: Option<Partition>,
}

/// The reason why a scenario has no AV.
#[derive(Debug, thiserror::Error)]
pub enum NoAv {
    /// The scenario carries no deviated trajectory.
    #[error("no deviated AV; give `deviations` with one for this scenario, or choose another `av`")]
    Missing,
    /// The trajectory is for another scenario or invalid, or the planner that drives the AV is not given.
    #[error("{0}")]
    Unfit(String),
    /// The trajectory is invalid.
    #[error(transparent)]
    Refused(#[from] AvError),
    /// The planner cannot drive in the scenario.
    #[error(transparent)]
    Planner(#[from] PlanningError),
}

impl Plan {
    /// Returns the provenance of the run.
    pub fn provenance(&self) -> Provenance {
        let (subject, rollout) = (&self.spec.subject, &self.spec.rollout);
        let limit = subject.input.limit.map(NonZeroUsize::get);
        let entering = self.spec.settings().entering;
        let of_driver = || self.driver().and_then(|driver| driver.backend);
        let backend = self.simulators.iter().find_map(|s| s.backend).or_else(of_driver);
        Provenance {
            version: program_version().to_owned(),
            commit: program_commit().to_owned(),
            settings: SettingsRecord {
                protocol: rollout.protocol.name().to_owned(),
                av: self.policy().map_or_else(|| "simulator".to_owned(), ToString::to_string),
                replan_steps: rollout.replan.steps(),
                av_lookahead: rollout.av_lookahead == 1,
                entering: SettingsRecord::entering(entering),
                seed: subject.seed,
                rollouts: rollout.rollouts,
                limit,
                pose: self.deviations.as_ref().and_then(|d| SettingsRecord::pose(d.pose)),
                selection: self.selection.clone(),
            },
            metric_options: named_options(&self.options),
            own_metrics: self.metrics.own_specs().into_iter().map(MetricRecord::of).collect(),
            simulators: self.simulators.iter().map(|simulator| simulator.record(entering)).collect(),
            driver: self.driver().and_then(|driver| driver.record.clone()),
            inputs: self.sources.iter().map(|s| s.file.clone()).collect(),
            deviations: self.deviations.as_ref().map(|d| d.file.clone()),
            benchmark: match (self.sources.as_slice(), &self.deviations, limit) {
                ([source], None, None) if self.selection.is_all() => BenchmarkRecord::of(&source.file),
                _ => None,
            },
            backend: backend.map(|b| b.name().to_owned()),
            cpu: backend.map(|_| cpu_class().to_owned()),
            keep_rollouts: Some(self.spec.keeps_rollouts()),
            partition: self.partition,
        }
    }

    /// Returns the AV policy; `None` if the simulator moves the AV.
    pub fn policy(&self) -> Option<&AvChoice> {
        self.spec.subject.av.as_ref().filter(|_| self.spec.rollout.protocol == Protocol::Reactive)
    }

    /// Returns the driver that the AV policy names, if it names one.
    pub(super) fn driver(&self) -> Option<&Driver> {
        match self.policy() {
            Some(AvChoice::Planned(planned)) => self.drivers.iter().find(|d| d.driver == planned.driver),
            _ => None,
        }
    }

    /// Returns the number of deviations in the file whose scenarios are selected by id.
    pub(super) fn selected_deviations(&self) -> usize {
        let ids = self.deviations.iter().flat_map(|d| d.tracks.keys());
        ids.filter(|id| self.selection.has_id(id)).count()
    }

    /// Opens the folder of the run, if it has one, and returns it with the values of the run so far. `resume`
    /// continues an interrupted run in it; otherwise the folder must be new or empty.
    ///
    /// # Errors
    /// As for [`RunFolder::create`] and [`RunFolder::resume`].
    pub fn open_folder(
        &self,
        path: Option<&Path>,
        resume: bool,
    ) -> Result<(Option<RunFolder>, Tally), EvaluationError> {
        let provenance = self.provenance();
        let mut tally = provenance.tally();
        let open = |path| match resume {
            true => RunFolder::resume(path, &provenance, &mut tally),
            false => RunFolder::create(path, &provenance),
        };
        let folder = path.map(open).transpose()?;
        Ok((folder, tally))
    }

    /// Returns an empty tally for the values of the run.
    pub fn tally(&self) -> Tally {
        self.provenance().tally()
    }

    /// Returns whether a scenario that has no AV for this reason is skipped rather than failed: a file of
    /// deviations selects the scenarios.
    pub(super) fn skips(&self, reason: &NoAv) -> bool {
        matches!(reason, NoAv::Missing) && self.deviations.is_some()
    }

    /// Returns the deviated trajectory of a scenario in its coordinate frame.
    fn deviated(&self, scenario: &Scenario) -> Result<DeviatedTrack, NoAv> {
        match &self.deviations {
            Some(deviations) => deviations.of(scenario),
            None => scenario.deviation.clone().ok_or(NoAv::Missing),
        }
    }

    /// Checks the trajectory that the file of deviations has for a scenario, if there is one.
    pub(super) fn check_deviation(&self, scenario: &Scenario) -> Vec<Finding> {
        let Some(deviations) = &self.deviations else { return Vec::new() };
        let Some(record) = deviations.tracks.get(&scenario.id) else { return Vec::new() };
        let Ok(deviated) = self.deviated(scenario) else { return Vec::new() };
        let mut entry0 = record.now_in(scenario.origin);
        let given = entry0.map(|given| (given, scenario.start.now(0)));
        // The track could be converted, so that this can be, too.
        deviations.pose.to_centre(&scenario.start.agents[0], given, entry0.iter_mut()).ok();
        let track: Vec<Frame> = deviated.track.into_iter().map(Some).collect();
        CheckedScene::of_av(scenario, entry0, &track).findings()
    }

    /// Returns the AV of a scenario, `None` if the simulator moves it, and the properties of its deviation from
    /// the log.
    ///
    /// # Errors
    /// [`NoAv`] if the scenario has no AV, or an invalid trajectory.
    pub fn av(&self, scenario: &Scenario) -> Result<(Option<Arc<dyn Av>>, DeviationLabels), NoAv> {
        self.checked_av(scenario, &Arc::default())
    }

    /// Returns the same as [`Self::av`]; `given` receives the plans that have to be checked.
    pub(super) fn checked_av(
        &self,
        scenario: &Scenario,
        given: &Arc<GivenPlans>,
    ) -> Result<(Option<Arc<dyn Av>>, DeviationLabels), NoAv> {
        let Some(av) = self.policy() else {
            if self.deviations.is_some() {
                self.deviated(scenario)?;
            }
            return Ok((None, DeviationLabels::default()));
        };
        let undeviated = |av: Arc<dyn Av>| (av, DeviationLabels::default());
        let (av, deviation) = match av {
            AvChoice::Deviated | AvChoice::File(_) => self.deviated_av(scenario)?,
            AvChoice::Log => undeviated(Arc::new(LogAv::new(scenario)?)),
            AvChoice::DeviatedOrLog => match self.deviated_av(scenario) {
                Err(NoAv::Missing) => undeviated(Arc::new(LogAv::new(scenario)?)),
                deviated => deviated?,
            },
            AvChoice::Scripted(script) => undeviated(Arc::new(ScriptedAv::new(scenario, *script)?)),
            AvChoice::Planned(PlannedAv { driver: AvDriver::Log, .. }) => {
                // The log needs no map, but the metrics do.
                ego_shape(scenario).and_then(|_| planning_map(scenario))?;
                undeviated(Arc::new(LogAv::new(scenario)?))
            }
            AvChoice::Planned(PlannedAv { driver: AvDriver::Planner(planner), controller, every }) => {
                undeviated(Arc::new(PlannerAv::new(scenario, *planner, *controller, *every)?))
            }
            AvChoice::Planned(planned) => {
                let absent = || NoAv::Unfit(format!("there is no planner `{}`", planned.driver));
                let driver = self.driver().ok_or_else(absent)?;
                undeviated(driver.av(scenario, planned, self.spec.subject.seed, given)?)
            }
        };
        Ok((Some(av), deviation))
    }

    /// Returns the deviated AV of a scenario and the properties of its deviation.
    fn deviated_av(&self, scenario: &Scenario) -> Result<(Arc<dyn Av>, DeviationLabels), NoAv> {
        let deviated = self.deviated(scenario)?;
        let known = DeviationLabels::of(&deviated);
        let av = DeviatedAv::new(scenario, deviated.track);
        let av = av.map_err(|error| match &self.deviations {
            Some(deviations) => NoAv::Unfit(format!("{error} (in {})", deviations.file.name)),
            None => NoAv::Refused(error),
        })?;
        Ok((Arc::new(av), known))
    }
}
