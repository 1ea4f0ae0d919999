//! What drives the AV of a run, where it is more than a name: a simulator, a program, or a planner of the caller.

use std::collections::BTreeMap;
use std::slice;
use std::sync::Arc;

use rand_chacha::rand_core::Rng;
use reactsim_external::{self as external, ExternalPlanner, PlannerEpisode};
use reactsim_nn::Backend;
use reactsim_planning::Trajectory;
use reactsim_planning::av::{PlannerAv, PlannerAvError};
use reactsim_planning::from_scene::planning_lanes;
use reactsim_planning::planner::{Planner, PlannerError, PlannerInput};
use reactsim_rollout::{Av, Controller, Purpose, SimulatedAv, Simulator, stream};
use reactsim_scene::{FUTURE, Scenario};

use super::av::{AvChoice, AvDriver, PlannedAv};
use super::provenance::{ExternalRecord, SimulatorRecord};
use super::{Adjustments, EvaluationError, PlannedSimulator};

/// Creates a planner for one rollout.
type NewPlanner = Arc<dyn Fn() -> Box<dyn Planner> + Send + Sync>;

/// What drives the AV of a run.
#[derive(Clone)]
pub struct Driver {
    /// Its name in the AV policy.
    pub(super) driver: AvDriver,
    /// What determines its plans, for the provenance; `None` for planners of the calling program.
    pub(super) record: Option<SimulatorRecord>,
    /// Backend of its network, if it has one.
    pub(super) backend: Option<Backend>,
    kind: DriverKind,
}

#[derive(Clone)]
enum DriverKind {
    Simulator(Arc<dyn Simulator>),
    External(ExternalPlanner),
    Own(NewPlanner),
}

impl Driver {
    /// Creates the simulator that an AV policy names, if it names one.
    ///
    /// # Errors
    /// [`EvaluationError`] if the simulator is unknown, has no weights, or observes the logged future.
    pub fn of(av: &AvChoice) -> Result<Option<Self>, EvaluationError> {
        let AvChoice::Planned(PlannedAv { driver: AvDriver::Simulator(id), .. }) = av else {
            return Ok(None);
        };
        // `all` and `default` are not names of one simulator.
        let Ok([planned]) =
            <[_; 1]>::try_from(PlannedSimulator::adjusted(slice::from_ref(id), &Adjustments::default())?)
        else {
            return Err(EvaluationError::SeveralDrivers { id: id.clone() });
        };
        let (record, backend) = (SimulatorRecord::of(&planned), planned.backend);
        let Controller::Fair(simulator) = planned.controller else {
            return Err(EvaluationError::OracleDriver { id: id.clone() });
        };
        let kind = DriverKind::Simulator(Arc::from(simulator));
        Ok(Some(Self { driver: AvDriver::Simulator(id.clone()), record: Some(record), backend, kind }))
    }

    /// Creates the driver `external:NAME` from a running program.
    pub fn external(planner: ExternalPlanner) -> Self {
        let name = planner.name().to_owned();
        let stated = planner.description();
        let record = SimulatorRecord {
            id: name.clone(),
            title: name.clone(),
            oracle: false,
            card: String::new(),
            parameters: BTreeMap::new(),
            weights: None,
            external: Some(ExternalRecord {
                command: planner.command().text().to_owned(),
                protocol: external::PROTOCOL.to_owned(),
                name: stated.name.clone(),
                version: stated.version.clone(),
                weights_sha256: stated.weights_sha256.clone(),
                batch: 1,
                reveals_ids: false,
            }),
        };
        let kind = DriverKind::External(planner);
        Self { driver: AvDriver::External(name), record: Some(record), backend: None, kind }
    }

    /// Creates a driver from planners of the calling program; `new_planner` is called once per rollout.
    pub fn own(
        name: impl Into<String>,
        new_planner: impl Fn() -> Box<dyn Planner> + Send + Sync + 'static,
    ) -> Self {
        let kind = DriverKind::Own(Arc::new(new_planner));
        Self { driver: AvDriver::Own(name.into()), record: None, backend: None, kind }
    }

    /// Returns its name.
    pub fn driver(&self) -> &AvDriver {
        &self.driver
    }

    /// Returns whether its plans come from outside of this program, so that their motion is checked.
    pub(super) fn is_foreign(&self) -> bool {
        !matches!(self.kind, DriverKind::Simulator(_))
    }

    /// Returns the reason why its processes were given up, if they were.
    pub(super) fn given_up(&self) -> Option<String> {
        match &self.kind {
            DriverKind::External(planner) => planner.processes().given_up(),
            DriverKind::Simulator(_) | DriverKind::Own(_) => None,
        }
    }

    /// Returns the AV of a scenario. `seed`: seed of the run.
    ///
    /// # Errors
    /// [`PlannerAvError`] if a planner cannot drive in the scenario.
    pub(super) fn av(
        &self,
        scenario: &Scenario,
        planned: &PlannedAv,
        seed: u64,
    ) -> Result<Arc<dyn Av>, PlannerAvError> {
        let &PlannedAv { controller, every, .. } = planned;
        Ok(match &self.kind {
            DriverKind::Simulator(simulator) => {
                Arc::new(SimulatedAv::new(scenario, Arc::clone(simulator), every, seed))
            }
            DriverKind::External(planner) => {
                let (planner, id, steps) = (planner.clone(), scenario.id.clone(), every.steps());
                let new_planner = move |rollout: u32| -> Box<dyn Planner> {
                    let seed = stream(seed, &id, rollout, Purpose::AvBegin).next_u64();
                    Box::new(RemotePlanner { episode: planner.begin(seed), steps, route: None })
                };
                Arc::new(PlannerAv::with_planner(scenario, new_planner, controller, every)?)
            }
            DriverKind::Own(new_planner) => {
                let new_planner = Arc::clone(new_planner);
                Arc::new(PlannerAv::with_planner(scenario, move |_| new_planner(), controller, every)?)
            }
        })
    }
}

/// The planner of one rollout, which plans in another process.
struct RemotePlanner {
    episode: PlannerEpisode,
    /// Number of steps between two plans.
    steps: usize,
    /// Lanes of the route in the map of the scenario.
    route: Option<Vec<usize>>,
}

impl Planner for RemotePlanner {
    fn plan(&mut self, input: &PlannerInput<'_>) -> Result<Trajectory, PlannerError> {
        let seen = input.seen.ok_or_else(|| PlannerError::Failed("it plans in rollouts only".to_owned()))?;
        let route = self.route.get_or_insert_with(|| {
            let lanes = planning_lanes(&seen.start().map);
            input.route.lanes(input.map).into_iter().map(|lane| lanes[lane]).collect()
        });
        let steps = self.steps.min(FUTURE - seen.step());
        let poses = self.episode.plan(&seen, steps, route).map_err(PlannerError::Failed)?;
        Ok(Trajectory::through_centers(&poses, input.ego(), input.shape)?)
    }
}
