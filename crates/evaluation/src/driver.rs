//! Drivers of the AV that an AV policy only names: simulators, networks, programs and planners of the caller.

mod along_route;
mod given_plans;
mod remote;

use std::slice;
use std::sync::Arc;

use rand_chacha::rand_core::Rng;
use reactsim_baseline::weights::{PLANNER, shipped};
use reactsim_external::{EpisodeNames, ExternalPlanner};
use reactsim_models::diffusion_planner::PlannerPolicy;
use reactsim_nn::{Backend, device};
use reactsim_planning::PlanningError;
use reactsim_planning::av::PlannerAv;
use reactsim_planning::planner::Planner;
use reactsim_rollout::{Av, Controller, Entering, Purpose, SimulatedAv, Simulator, stream};
use reactsim_scene::Scenario;

use along_route::{AlongRoute, Network, TEMPERATURE};
pub(super) use given_plans::GivenPlans;
use remote::RemotePlanner;

use crate::av::{AvChoice, AvDriver, PlannedAv};
use crate::error::EvaluationError;
use crate::simulators::record::{ExternalRecord, SimulatorRecord, WeightsRecord};
use crate::simulators::{Adjustments, PlannedSimulator};

/// Creates a planner for one rollout.
type NewPlanner = Arc<dyn Fn() -> Box<dyn Planner> + Send + Sync>;

/// A driver of the AV.
#[derive(Clone)]
pub struct Driver {
    /// Its name in the AV policy.
    pub(super) driver: AvDriver,
    /// Its record in the provenance; `None` for planners of the calling program.
    pub(super) record: Option<SimulatorRecord>,
    /// Backend of its network, if it has one.
    pub(super) backend: Option<Backend>,
    kind: DriverKind,
}

#[derive(Clone)]
enum DriverKind {
    Simulator(Arc<dyn Simulator>),
    AlongRoute(Arc<Network>),
    External(Box<ExternalPlanner>),
    Own(NewPlanner),
}

impl Driver {
    /// Creates the simulator or the network that an AV policy names, if it names one.
    ///
    /// # Errors
    /// [`EvaluationError`] if the simulator is unknown or observes the logged future, or there are no
    /// weights.
    pub fn of(av: &AvChoice) -> Result<Option<Self>, EvaluationError> {
        match av {
            AvChoice::Planned(PlannedAv { driver: AvDriver::Simulator(id), .. }) => {
                Self::simulator(id).map(Some)
            }
            AvChoice::Planned(PlannedAv { driver: AvDriver::DiffusionPlanner, .. }) => {
                Self::diffusion_planner().map(Some)
            }
            _ => Ok(None),
        }
    }

    /// Creates the driver from the weights of the diffusion planner that ship.
    fn diffusion_planner() -> Result<Self, EvaluationError> {
        let absent = || {
            let text = "ship with this program: build it with the feature `weights`";
            EvaluationError::Refused(format!("no weights of `{PLANNER}` {text}"))
        };
        let file = shipped(PLANNER)?.ok_or_else(absent)?;
        let device = device();
        let policy = PlannerPolicy::read(&file.bytes, &device)?;
        let network: Arc<Network> = Arc::new(move |seen, stream| {
            policy.plans(seen, TEMPERATURE, slice::from_mut(stream), &device).pop()
        });
        let record = SimulatorRecord {
            weights: Some(WeightsRecord::of(&file)),
            ..SimulatorRecord::named(PLANNER, "Diffusion-Planner")
        };
        Ok(Self {
            driver: AvDriver::DiffusionPlanner,
            record: Some(record),
            backend: Some(Backend::default()),
            kind: DriverKind::AlongRoute(network),
        })
    }

    fn simulator(id: &str) -> Result<Self, EvaluationError> {
        let ids = [id.to_owned()];
        // `all` and `default` are not names of one simulator.
        let Ok([planned]) = <[_; 1]>::try_from(PlannedSimulator::adjusted(&ids, &Adjustments::default())?)
        else {
            return Err(EvaluationError::Refused(format!(
                "`{id}` names several simulators, and one drives the AV: choose one"
            )));
        };
        let (record, backend) = (planned.record(Entering::Off), planned.backend);
        let Controller::Fair(simulator) = planned.controller else {
            return Err(EvaluationError::Refused(format!(
                "`{id}` observes the logged future and cannot drive the AV: choose another simulator, or \
                 planner:log"
            )));
        };
        let kind = DriverKind::Simulator(Arc::from(simulator));
        Ok(Self { driver: AvDriver::Simulator(id.to_owned()), record: Some(record), backend, kind })
    }

    /// Creates the driver `external:NAME` from a running program.
    pub fn external(planner: ExternalPlanner) -> Self {
        let name = planner.processes().name().to_owned();
        let external = ExternalRecord::of(planner.processes(), 1);
        let record = SimulatorRecord { external: Some(external), ..SimulatorRecord::named(&name, &name) };
        let kind = DriverKind::External(Box::new(planner));
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
        matches!(self.kind, DriverKind::External(_) | DriverKind::Own(_))
    }

    /// Returns the reason why its processes were given up, if they were.
    pub(super) fn given_up(&self) -> Option<String> {
        match &self.kind {
            DriverKind::External(planner) => planner.processes().given_up(),
            DriverKind::Simulator(_) | DriverKind::AlongRoute(_) | DriverKind::Own(_) => None,
        }
    }

    /// Returns the AV of a scenario. `seed`: seed of the run. `given` receives the plans from outside of this
    /// program that a tracker follows.
    ///
    /// # Errors
    /// [`PlanningError`] if a planner cannot drive in the scenario.
    pub(super) fn av(
        &self,
        scenario: &Scenario,
        planned: &PlannedAv,
        seed: u64,
        given: &Arc<GivenPlans>,
    ) -> Result<Arc<dyn Av>, PlanningError> {
        let &PlannedAv { controller, every, .. } = planned;
        let given = Arc::clone(given);
        Ok(match &self.kind {
            DriverKind::Simulator(simulator) => {
                Arc::new(SimulatedAv::new(scenario, Arc::clone(simulator), every, seed))
            }
            DriverKind::AlongRoute(network) => {
                let (network, id) = (Arc::clone(network), scenario.id.clone());
                let new_planner = move |rollout: u32| -> Box<dyn Planner> {
                    let stream = stream(seed, &id, rollout, Purpose::AvPlan);
                    Box::new(AlongRoute { network: Arc::clone(&network), stream, path: None })
                };
                Arc::new(PlannerAv::with_planner(scenario, new_planner, controller, every)?)
            }
            DriverKind::External(planner) => {
                let (planner, id, steps) = (planner.as_ref().clone(), scenario.id.clone(), every.steps());
                let (origin, length) = (scenario.origin, scenario.length());
                let new_planner = move |rollout: u32| -> Box<dyn Planner> {
                    let seed = stream(seed, &id, rollout, Purpose::AvBegin).next_u64();
                    let names = || EpisodeNames { scenario: id.clone(), origin, rollout };
                    let episode = planner.begin(seed, length, planner.processes().reveals_ids().then(names));
                    let remote = RemotePlanner::new(episode, steps, length.future);
                    given.keep(Box::new(remote), controller, rollout)
                };
                Arc::new(PlannerAv::with_planner(scenario, new_planner, controller, every)?)
            }
            DriverKind::Own(new_planner) => {
                let new_planner = Arc::clone(new_planner);
                let new_planner = move |rollout| given.keep(new_planner(), controller, rollout);
                Arc::new(PlannerAv::with_planner(scenario, new_planner, controller, every)?)
            }
        })
    }
}
