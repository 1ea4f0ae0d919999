//! A planner of the AV whose trajectories come from a process.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use parking_lot::Mutex;
use reactsim_geometry::Vec2;
use reactsim_rollout::{Identity, Observation};
use reactsim_scene::{FUTURE, Length};

use super::connection::RequestError;
use super::document::{Frame, FrameWriter, Values};
use super::processes::Processes;
use super::replies::{self, PlannedPoses, Role};
use super::settings::{ExternalSettings, RunOutline};
use super::workers::Worker;
use super::{ExternalError, length, realised, scenes};

/// A planner that runs as a program of its own, in one or several processes, each of which plans for many
/// episodes at the same time. Clones share the processes, which end when the last clone is dropped.
#[derive(Clone)]
pub struct ExternalPlanner {
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
    length: Length,
    names: Option<EpisodeNames>,
    planned: Vec<PlanRequest>,
    open: Option<Open>,
    /// The episode that the next one continues, until that has begun.
    before: Option<Open>,
    /// Number of times that agents had entered or left when the episode was begun.
    changes: usize,
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
    /// Steps of the rollout that were realised at the current frame of its start.
    first_step: usize,
    /// Ids of its agents.
    agents: Vec<String>,
}

impl Open {
    /// Adds to `begin` that the episode continues this one.
    fn add_to(&self, request: &mut FrameWriter, seen: &Observation<'_>) {
        let start = seen.start();
        let frame = start.current() + first_step(seen) - self.first_step;
        let slot = |id: &String| self.agents.iter().position(|before| before == id).map_or(-1, |k| k as i32);
        request.text("continues", self.handle.to_string()).text("continued_frame", frame.to_string()).tensor(
            "continued_slot",
            Values::i32(&[1, start.agents.len()], start.agents.iter().map(|agent| slot(&agent.id))),
        );
    }
}

/// Returns the number of steps that were realised at the current frame of the start.
fn first_step(seen: &Observation<'_>) -> usize {
    seen.step() - (seen.frame() - seen.start().current())
}

impl ExternalPlanner {
    /// Starts one process, which states what it is.
    ///
    /// # Errors
    /// [`ExternalError`] for wrong settings, or if the process does not start or greet, or is no planner.
    pub fn start(settings: ExternalSettings, outline: RunOutline) -> Result<Self, ExternalError> {
        let processes = Processes::start(settings, outline, Role::Planner)?;
        let slots = (0..processes.workers.settings.workers).map(|_| Mutex::default()).collect();
        Ok(Self { processes, slots, episodes: Arc::default() })
    }

    /// Returns its processes.
    pub fn processes(&self) -> &Processes {
        &self.processes
    }

    /// Creates an episode in a scenario of this length. `seed`: seed of all random choices in it; `names`:
    /// sent to the planner.
    pub fn begin(&self, seed: u64, length: Length, names: Option<EpisodeNames>) -> PlannerEpisode {
        let slot = self.episodes.fetch_add(1, Ordering::Relaxed) % self.slots.len();
        PlannerEpisode {
            planner: self.clone(),
            slot,
            seed,
            length,
            names,
            planned: Vec::new(),
            open: None,
            before: None,
            changes: 0,
        }
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
    /// Returns the trajectory from the present on. There are at least `steps` poses, the number of steps
    /// until the next plan, and no more than 80, or the steps that are left if they are more. `route`:
    /// indices into the lanes of the map, in driving order; it is sent once. `ego`: present motion of the AV.
    /// When agents have entered or left, the process begins an episode with the new agents and the latest
    /// frames, which continues the one before.
    ///
    /// # Errors
    /// The reason, if the planner fails, answers something else, or does not support the length of the
    /// scenario.
    pub fn plan(
        &mut self,
        seen: &Observation<'_>,
        steps: usize,
        route: &[usize],
        ego: EgoMotion,
    ) -> Result<PlannedPoses, String> {
        length::check(&self.planner.processes.description, self.length)?;
        let slots = Arc::clone(&self.planner.slots);
        let mut slot = slots[self.slot].lock();
        if self.changes != seen.changes() {
            self.before = self.open.take();
            self.planned.clear();
            self.changes = seen.changes();
        }
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
            let before = self.before.take();
            self.end(slot, before);
            for earlier in self.planned.clone() {
                self.planned_at(slot, seen, earlier)?;
            }
        }
        let reply = self.planned_at(slot, seen, now)?;
        let planned = replies::trajectory(&reply, now.steps, self.most_poses(now.frame));
        let planned =
            planned.map_err(|e| format!("`planned` cannot be used: {e}")).and_then(|planned| planned);
        planned.map_err(|text| {
            self.planner.processes.workers.failed(&[self.seed], &text, false);
            RequestError::Refused(text)
        })
    }

    /// Returns the largest number of poses of a trajectory that is planned at a frame.
    fn most_poses(&self, frame: usize) -> usize {
        FUTURE.max(self.length.frames() - 1 - frame)
    }

    /// Begins the episode in the process.
    fn begun(&self, slot: &mut Slot, seen: &Observation<'_>, route: &[usize]) -> Result<Open, RequestError> {
        if slot.worker.is_none() {
            let worker = self.planner.processes.workers.take(true);
            slot.worker = Some(worker.map_err(RequestError::Refused)?);
            slot.generation += 1;
        }
        let Some(worker) = &mut slot.worker else { unreachable!("it was taken") };
        let handle = worker.handles(1)[0];
        let mut request = FrameWriter::new("begin");
        request
            .text("moves_av", "1")
            .text("steps", self.length.future.to_string())
            .tensor("episode", Values::u64(&[1], [handle]))
            .tensor("seed", Values::u64(&[1], [self.seed]))
            .tensor("route", Values::i32(&[route.len()], route.iter().map(|lane| *lane as i32)));
        length::add(&mut request, self.length);
        scenes::add_scenes(&mut request, &[seen.start()]);
        if let Some(EpisodeNames { scenario, origin, rollout }) = &self.names {
            let identity = Identity { scenario, origin: *origin, rollout: *rollout };
            scenes::add_identities(&mut request, &[identity], &[seen.start()]);
        }
        let generation = slot.generation;
        if let Some(before) = self.before.as_ref().filter(|before| before.generation == generation) {
            before.add_to(&mut request, seen);
        }
        self.request(slot, request, "begun", 0)?;
        let agents = seen.start().agents.iter().map(|agent| agent.id.clone()).collect();
        Ok(Open { generation, handle, frames: self.length.history, first_step: first_step(seen), agents })
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
        let numbers = self.most_poses(at.frame) * 3 * size_of::<f64>();
        let reply = self.request(slot, request, "planned", numbers)?;
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
        let limits = workers.settings.limits;
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

impl PlannerEpisode {
    /// Ends an episode in the process that holds it, if one does.
    fn end(&self, slot: &mut Slot, open: Option<Open>) {
        let Some(open) = open.filter(|open| open.generation == slot.generation) else { return };
        let mut request = FrameWriter::new("end");
        request.tensor("episode", Values::u64(&[1], [open.handle]));
        if self.request(slot, request, "ended", 0).is_ok() {
            self.planner.processes.workers.succeeded();
        }
    }
}

impl Drop for PlannerEpisode {
    fn drop(&mut self) {
        let slots = Arc::clone(&self.planner.slots);
        let mut slot = slots[self.slot].lock();
        for open in [self.before.take(), self.open.take()] {
            self.end(&mut slot, open);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::io::{self, Write};
    use std::thread::{self, JoinHandle};

    use reactsim_rollout::{
        Av, AvError, AvPolicy, Controller, Entering, PlanError, Planning, Replan, Request, Settings,
        SingleEpisode, Stream, roll_out,
    };
    use reactsim_scene::{Agent, AgentKind, AgentState, LoggedAgent, Scenario, ScenarioParts, Start};
    use safetensors::SafeTensors;

    use super::*;
    use crate::{Command, Parent, read_frame};

    /// Starts a planner, which returns the documents that it received.
    fn program() -> (Parent, JoinHandle<Vec<Vec<u8>>>) {
        let ((from_child, to_parent), (from_parent, to_child)) = (io::pipe().unwrap(), io::pipe().unwrap());
        let answer = move || {
            let (mut reader, mut writer, mut received) = (from_parent, to_parent, Vec::new());
            while let Ok(Some(bytes)) = read_frame(&mut reader, || 1 << 30) {
                let frame = Frame::read(bytes.clone()).unwrap();
                let reply = match frame.text("type").unwrap() {
                    "hello" => "welcome",
                    "begin" => "begun",
                    "plan" => "planned",
                    "end" => "ended",
                    _ => continue,
                };
                let mut answer = FrameWriter::new(reply);
                answer
                    .text("seq", frame.text("seq").unwrap())
                    .text("name", "any")
                    .text("role", "planner")
                    .text("lengths", "any")
                    .tensor("trajectory", Values::f64(&[1, 5, 3], [0.0; 15]));
                received.push(bytes);
                writer.write_all(&answer.to_frame().unwrap()).unwrap();
            }
            received
        };
        (Parent::new(from_child, to_child), thread::spawn(answer))
    }

    /// An AV that stands still and asks its planner every 5 steps.
    struct Planned(ExternalPlanner, Length);

    impl Av for Planned {
        fn begin(&self, _: u32) -> Box<dyn AvPolicy + '_> {
            Box::new(Policy(self.0.begin(7, self.1, None)))
        }
    }

    struct Policy(PlannerEpisode);

    impl AvPolicy for Policy {
        fn next(&mut self, seen: &Observation<'_>) -> Result<AgentState, AvError> {
            if seen.step().is_multiple_of(5) {
                let planned = self.0.plan(seen, 5, &[], [0.0; 7]);
                planned.map_err(AvError)?;
            }
            Ok(seen.state(0).expect("the AV is present"))
        }
    }

    /// Agents that stand still.
    struct Still;

    impl SingleEpisode for Still {
        type Memory = ();

        fn id(&self) -> &'static str {
            "still"
        }

        fn begin(&self, _: &Start, _: &mut Stream) {}

        fn plan_one(&self, (): &mut (), episode: &mut Planning<'_, '_>) -> Result<(), PlanError> {
            for agent in 0..episode.plan.agents() {
                for step in 0..episode.plan.steps() {
                    episode.plan.set(agent, step, episode.seen.state(agent));
                }
            }
            Ok(())
        }
    }

    /// Returns a message to a planner in words: its type, the frame of a plan, the episode that it continues.
    fn summary(bytes: &[u8]) -> String {
        let (frame, tensors) =
            (Frame::read(bytes.to_vec()).unwrap(), SafeTensors::deserialize(bytes).unwrap());
        let kind = frame.text("type").unwrap();
        let handle = || u64::from_le_bytes(tensors.tensor("episode").unwrap().data().try_into().unwrap());
        match (kind, frame.optional_text("continues")) {
            ("plan", _) => format!("plan {} at {}", handle(), frame.text("frame").unwrap()),
            ("begin", Some(before)) => {
                let slots = tensors.tensor("continued_slot").unwrap().data();
                let slots: Vec<i32> =
                    slots.as_chunks::<4>().0.iter().map(|b| i32::from_le_bytes(*b)).collect();
                let at = frame.text("continued_frame").unwrap();
                format!("begin {} after {before} at {at} with {slots:?}", handle())
            }
            ("hello", _) => kind.to_owned(),
            _ => format!("{kind} {}", handle()),
        }
    }

    #[test]
    fn episodes_continue_when_agents_enter_or_leave() {
        let length = Length { history: 11, future: 30 };
        let agent = |id: &str, (x, y): (f64, f64), present: std::ops::Range<usize>| LoggedAgent {
            agent: Agent { id: id.into(), kind: AgentKind::Vehicle, length: 4.5, width: 2.0 },
            track: (0..length.frames())
                .map(|f| present.contains(&f).then_some(AgentState { x, y, heading: 0.0, vx: 0.0, vy: 0.0 }))
                .collect(),
            heights: Vec::new(),
        };
        let end = length.frames();
        // The log loses `far` at frame 20, step 10, far from the AV, and shows `new` from frame 14, step 4.
        let agents = vec![
            agent("av", (0.0, 0.0), 0..end),
            agent("far", (60.0, 0.0), 0..21),
            agent("new", (0.0, 20.0), 14..end),
        ];
        let parts = ScenarioParts { id: "a".into(), length, agents, ..ScenarioParts::default() };
        let scenario = Scenario::assemble(parts).unwrap();
        let (parent, received) = program();
        let outline = RunOutline { intervals: vec![5], protocols: vec!["reactive"] };
        let settings = ExternalSettings::new("mine", Command::Parent(parent));
        let planner = ExternalPlanner::start(settings, outline).unwrap();
        let av = Arc::new(Planned(planner, length));
        let requests = vec![Request { scenario: &scenario, av: Some(av), rollout: 0 }];
        let settings =
            Settings { entering: Entering::Log, replan: Replan::every(5).unwrap(), ..Settings::default() };
        let mut done = roll_out(requests, &Controller::Fair(Box::new(Still)), &settings);
        done.remove(0).unwrap();
        let received: Vec<String> = received.join().unwrap().iter().map(|bytes| summary(bytes)).collect();
        // Planners observe changes at once: at step 4, at which an agent enters, and at 10, at which one
        // leaves.
        let [a, b, c] = [0, 1, 2].map(|k| {
            let begun = received.iter().filter_map(|text| text.strip_prefix("begin "));
            begun.map(|text| text.split(' ').next().unwrap()).nth(k).unwrap()
        });
        assert_eq!(
            received,
            [
                "hello".to_owned(),
                format!("begin {a}"),
                format!("plan {a} at 10"),
                format!("begin {b} after {a} at 14 with [0, 1, -1]"),
                format!("end {a}"),
                format!("plan {b} at 11"),
                format!("begin {c} after {b} at 16 with [0, 2]"),
                format!("end {b}"),
                format!("plan {c} at 10"),
                format!("plan {c} at 15"),
                format!("plan {c} at 20"),
                format!("plan {c} at 25"),
                format!("end {c}"),
            ]
        );
    }
}
