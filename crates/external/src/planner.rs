//! A planner of the AV whose trajectories come from a process.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use parking_lot::Mutex;
use reactsim_geometry::Vec2;
use reactsim_rollout::{Identity, Observation};
use reactsim_scene::{FUTURE, HISTORY};

use super::connection::RequestError;
use super::document::{Frame, FrameWriter, Values};
use super::processes::Processes;
use super::replies::{self, Description, PlannedPoses, Role};
use super::settings::{ExternalSettings, RunOutline};
use super::workers::Worker;
use super::{Command, ExternalError, realised, scenes};

/// A planner that runs as a program of its own, in one or several processes, each of which plans for many
/// episodes at the same time. Clones share the processes, which end when the last clone is dropped.
#[derive(Clone)]
pub struct ExternalPlanner {
    settings: ExternalSettings,
    description: Description,
    processes: Processes,
    slots: Arc<[Mutex<Slot>]>,
    /// Number of episodes so far, which are distributed over the processes in turn.
    episodes: Arc<AtomicUsize>,
}

/// A process. It is taken when the first episode begins in it.
#[derive(Default)]
struct Slot {
    worker: Option<Worker>,
    /// Number of processes so far: episodes of an earlier one have to be begun again.
    generation: usize,
}

/// An episode of an [`ExternalPlanner`]: one AV in one rollout. It ends when it is dropped.
///
/// If the process ends, the episode is begun in another one, which plans again what was planned so far, so
/// that a planner whose plans depend on its input and seed continues as if nothing had happened. An episode
/// whose own request ends the process is repeated once.
pub struct PlannerEpisode {
    planner: ExternalPlanner,
    slot: usize,
    seed: u64,
    names: Option<EpisodeNames>,
    planned: Vec<PlanRequest>,
    open: Option<Open>,
}

/// Names of an episode, which planners normally do not receive.
#[derive(Clone, Debug, PartialEq)]
pub struct EpisodeNames {
    /// Id of the scenario.
    pub scenario: String,
    /// World point that is the origin of the coordinates of the scenario, metres.
    pub origin: Vec2,
    /// Index among the rollouts of the scenario.
    pub rollout: u32,
}

/// Motion of the rear axle of the AV: velocity along and to the left of the heading, m/s; acceleration along
/// and to the left of it, m/s²; steering angle, radians; yaw rate, rad/s; yaw acceleration, rad/s².
pub type EgoMotion = [f64; 7];

/// A request for a plan.
#[derive(Clone, Copy, Debug)]
struct PlanRequest {
    /// The present frame.
    frame: usize,
    /// Number of steps until the next plan.
    steps: usize,
    ego: EgoMotion,
}

/// An episode that a process holds.
struct Open {
    generation: usize,
    handle: u64,
    /// Number of frames that the process has received.
    frames: usize,
}

impl ExternalPlanner {
    /// Starts one process, which states what it is.
    ///
    /// # Errors
    /// [`ExternalError`] for wrong settings, or if the process does not start or greet, or is no planner.
    pub fn start(settings: ExternalSettings, outline: RunOutline) -> Result<Self, ExternalError> {
        let (processes, description) = Processes::start(&settings, outline, Role::Planner)?;
        let slots = (0..settings.workers).map(|_| Mutex::default()).collect();
        Ok(Self { settings, description, processes, slots, episodes: Arc::default() })
    }

    /// Returns its name.
    pub fn name(&self) -> &str {
        self.processes.name()
    }

    /// Returns how it is reached.
    pub fn command(&self) -> &Command {
        &self.settings.command
    }

    /// Returns what it states about itself.
    pub fn description(&self) -> &Description {
        &self.description
    }

    /// Returns its processes.
    pub fn processes(&self) -> &Processes {
        &self.processes
    }

    /// Returns whether it receives the names of episodes.
    pub fn reveals_ids(&self) -> bool {
        self.settings.reveal_ids
    }

    /// Creates an episode. `seed`: seed of all random choices in it; `names`: sent to the planner.
    pub fn begin(&self, seed: u64, names: Option<EpisodeNames>) -> PlannerEpisode {
        let slot = self.episodes.fetch_add(1, Ordering::Relaxed) % self.slots.len();
        PlannerEpisode { planner: self.clone(), slot, seed, names, planned: Vec::new(), open: None }
    }
}

impl Drop for ExternalPlanner {
    fn drop(&mut self) {
        // Each clone gives the workers back if it is the last one; `Workers` then closes them.
        let Some(slots) = Arc::get_mut(&mut self.slots) else { return };
        for slot in slots {
            if let Some(worker) = slot.get_mut().worker.take() {
                self.processes.workers.put_back(Some(worker));
            }
        }
    }
}

impl PlannerEpisode {
    /// Returns the trajectory from the present on, with at least `steps` poses, the number of steps until
    /// the next plan, and no more than 80. `route`: indices into the lanes of the map, in driving order; it
    /// is sent once. `ego`: present motion of the AV.
    ///
    /// # Errors
    /// The reason, if the planner fails or answers something else.
    pub fn plan(
        &mut self,
        seen: &Observation<'_>,
        steps: usize,
        route: &[usize],
        ego: EgoMotion,
    ) -> Result<PlannedPoses, String> {
        let slots = Arc::clone(&self.planner.slots);
        let mut slot = slots[self.slot].lock();
        let now = PlanRequest { frame: seen.frame(), steps, ego };
        let mut result = self.attempt(&mut slot, seen, now, route);
        if matches!(result, Err(RequestError::Broken(_))) {
            result = self.attempt(&mut slot, seen, now, route);
        }
        self.planned.push(now);
        result.map_err(RequestError::text)
    }

    /// Plans once. An episode that the process does not hold is begun, and its earlier plans are repeated.
    fn attempt(
        &mut self,
        slot: &mut Slot,
        seen: &Observation<'_>,
        now: PlanRequest,
        route: &[usize],
    ) -> Result<PlannedPoses, RequestError> {
        let is_held = |open: &Open| open.generation == slot.generation && slot.worker.is_some();
        if !self.open.as_ref().is_some_and(is_held) {
            self.open = Some(self.begun(slot, seen, route)?);
            for earlier in self.planned.clone() {
                self.planned_at(slot, seen, earlier)?;
            }
        }
        let reply = self.planned_at(slot, seen, now)?;
        let planned = replies::trajectory(&reply, now.steps);
        let planned =
            planned.map_err(|e| format!("`planned` cannot be used: {e}")).and_then(|planned| planned);
        planned.map_err(|text| {
            self.planner.processes.workers.failed(&[self.seed], &text, false);
            RequestError::Refused(text)
        })
    }

    /// Begins the episode in the process.
    fn begun(&self, slot: &mut Slot, seen: &Observation<'_>, route: &[usize]) -> Result<Open, RequestError> {
        if slot.worker.is_none() {
            let worker = self.planner.processes.workers.take();
            slot.worker = Some(worker.map_err(RequestError::Refused)?);
            slot.generation += 1;
        }
        let Some(worker) = &mut slot.worker else { unreachable!("it was taken") };
        let handle = worker.handles(1)[0];
        let mut request = FrameWriter::new("begin");
        request
            .text("moves_av", "1")
            .text("steps", FUTURE.to_string())
            .tensor("episode", Values::u64(&[1], [handle]))
            .tensor("seed", Values::u64(&[1], [self.seed]))
            .tensor("route", Values::i32(&[route.len()], route.iter().map(|lane| *lane as i32)));
        scenes::add_scenes(&mut request, &[seen.start()]);
        if let Some(EpisodeNames { scenario, origin, rollout }) = &self.names {
            let identity = Identity { scenario, origin: *origin, rollout: *rollout };
            scenes::add_identities(&mut request, &[identity], &[seen.start()]);
        }
        self.request(slot, request, "begun", 0)?;
        Ok(Open { generation: slot.generation, handle, frames: HISTORY })
    }

    /// Asks for the plan at a frame up to the present one.
    fn planned_at(
        &mut self,
        slot: &mut Slot,
        seen: &Observation<'_>,
        at: PlanRequest,
    ) -> Result<Frame, RequestError> {
        let Some(open) = &mut self.open else { unreachable!("the episode was begun") };
        let new = open.frames..at.frame + 1;
        open.frames = at.frame + 1;
        let (agents, lights) = (seen.tracks().len(), [seen.start().lights.len()]);
        let mut request = realised::request(&[open.handle], agents, &lights, new, &[Some(*seen)], at.steps);
        request.tensor("ego", Values::f64(&[1, at.ego.len()], at.ego));
        let reply = self.request(slot, request, "planned", FUTURE * 3 * size_of::<f64>())?;
        if let Some(worker) = &mut slot.worker {
            worker.has_planned = true;
        }
        Ok(reply)
    }

    fn request(
        &self,
        slot: &mut Slot,
        request: FrameWriter,
        wanted: &str,
        numbers: usize,
    ) -> Result<Frame, RequestError> {
        let workers = &self.planner.processes.workers;
        let Some(worker) = &mut slot.worker else {
            return Err(RequestError::Broken("its process has ended".to_owned()));
        };
        let limits = self.planner.settings.limits;
        let limit = if worker.has_planned { limits.plan } else { limits.first };
        worker.connection.request(request, wanted, numbers, limit).inspect_err(|error| {
            let is_broken = matches!(error, RequestError::Broken(_));
            workers.failed(&[self.seed], &error.clone().text(), is_broken);
            if is_broken {
                slot.worker = None;
                workers.put_back(None);
            }
        })
    }
}

impl Drop for PlannerEpisode {
    fn drop(&mut self) {
        let slots = Arc::clone(&self.planner.slots);
        let mut slot = slots[self.slot].lock();
        let Some(open) = self.open.take().filter(|open| open.generation == slot.generation) else { return };
        let mut request = FrameWriter::new("end");
        request.tensor("episode", Values::u64(&[1], [open.handle]));
        if self.request(&mut slot, request, "ended", 0).is_ok() {
            self.planner.processes.workers.succeeded();
        }
    }
}
