use std::sync::Mutex;

use rand_chacha::rand_core::Rng;
use reactsim_scene::{Agent, AgentKind, CURRENT, FRAMES, LoggedAgent, ScenarioParts};

use super::*;
use crate::{Controller, LogAv, Request, Rollout, RolloutError, Settings, roll_out};

/// A scenario of two cars that drive along the x axis at 10 m/s.
fn scenario() -> Scenario {
    let car = |id: &str, y: f64| {
        let state = |f: usize| AgentState { x: f as f64, y, heading: 0.0, vx: 10.0, vy: 0.0 };
        let agent = Agent { id: id.into(), kind: AgentKind::Vehicle, length: 4.8, width: 2.0 };
        LoggedAgent { agent, track: (0..FRAMES).map(|f| Some(state(f))).collect(), heights: Vec::new() }
    };
    let agents = vec![car("av", 0.0), car("other", 10.0)];
    Scenario::assemble(ScenarioParts { id: "pair".into(), agents, ..ScenarioParts::default() }).unwrap()
}

/// A call of the simulator.
#[derive(Clone, Debug, PartialEq)]
enum Call {
    Begin { moves_av: bool, steps: usize, identity: Option<(String, u32)> },
    Plan { step: usize, moves_av: bool, shows_av_next: bool, steps: usize },
    End(usize),
}

/// A simulator whose agents move forwards by random distances, and which records its calls.
#[derive(Default)]
struct Random {
    calls: Arc<Mutex<Vec<Call>>>,
    wants_identity: bool,
    leaves_out_av_from: Option<usize>,
    fails_at: Option<usize>,
    cannot_begin: bool,
}

impl Random {
    fn log(&self, call: Call) {
        self.calls.lock().unwrap().push(call);
    }
}

impl Simulator for Random {
    fn begin_batch(&self, batch: &mut [Beginning<'_>]) -> Result<(), PlanError> {
        let [episode] = batch else { panic!("one episode is expected") };
        let identity = episode.identity.map(|i| (i.scenario.to_owned(), i.rollout));
        self.log(Call::Begin { moves_av: episode.moves_av, steps: episode.steps, identity });
        episode.memory = Memory::new(episode.stream.next_u32());
        if self.cannot_begin { Err(PlanError::Failed("no room".into())) } else { Ok(()) }
    }

    fn wants_identity(&self) -> bool {
        self.wants_identity
    }

    fn end_batch(&self, memories: Vec<Memory>) {
        self.log(Call::End(memories.len()));
    }

    fn plan(&self, batch: &mut [Episode<'_>]) -> Result<(), PlanError> {
        for episode in batch {
            let (step, steps) = (episode.seen.step(), episode.plan.steps());
            let shows_av_next = episode.seen.av_next().is_some();
            self.log(Call::Plan { step, moves_av: episode.moves_av, shows_av_next, steps });
            assert!(episode.memory.get::<u32>().is_some());
            if self.fails_at == Some(step) {
                episode.error = Some(PlanError::Failed("no way ahead".into()));
                continue;
            }
            for agent in 0..episode.plan.agents() {
                let Some(mut state) = episode.seen.state(agent) else { continue };
                for k in 0..steps {
                    state.x += f64::from(episode.stream.next_u32()) / f64::from(u32::MAX);
                    let is_left_out = agent == 0 && self.leaves_out_av_from == Some(step + k);
                    episode.plan.set(agent, k, (!is_left_out).then_some(state));
                }
            }
        }
        Ok(())
    }
}

fn replan(steps: usize) -> Replan {
    Replan::every(steps).unwrap()
}

fn run(scenario: &Scenario, av: Arc<dyn Av>, rollout: u32) -> Result<Rollout, RolloutError> {
    let request = Request { scenario, av: Some(av), rollout };
    let traffic = Controller::Fair(Box::new(Random::default()));
    roll_out(vec![request], &traffic, &Settings::default()).remove(0)
}

fn simulated(scenario: &Scenario, simulator: Random, steps: usize) -> Arc<dyn Av> {
    Arc::new(SimulatedAv::new(scenario, Arc::new(simulator), replan(steps), 7))
}

#[test]
fn the_av_executes_slot_0_of_the_plans() {
    let scenario = scenario();
    let calls = Arc::default();
    let simulator = Random { calls: Arc::clone(&calls), ..Random::default() };
    let rollout = run(&scenario, simulated(&scenario, simulator, 30), 0).unwrap();
    let x: Vec<f64> = rollout.tracks[0].iter().map(|frame| frame.unwrap().x).collect();
    assert!(x[CURRENT..].windows(2).all(|pair| (0.0..=1.0).contains(&(pair[1] - pair[0]))));
    let plan = |step, steps| Call::Plan { step, moves_av: true, shows_av_next: false, steps };
    let begin = Call::Begin { moves_av: true, steps: 30, identity: None };
    assert_eq!(*calls.lock().unwrap(), [begin, plan(0, 30), plan(30, 30), plan(60, 20), Call::End(1)]);
}

#[test]
fn random_numbers_depend_on_the_rollout_and_change_no_traffic() {
    let scenario = scenario();
    let av = simulated(&scenario, Random::default(), 5);
    let log: Arc<dyn Av> = Arc::new(LogAv::new(&scenario).unwrap());
    let first = run(&scenario, Arc::clone(&av), 0).unwrap();
    assert_eq!(run(&scenario, Arc::clone(&av), 0).unwrap(), first);
    assert_ne!(run(&scenario, av, 1).unwrap().tracks[0], first.tracks[0]);
    assert_eq!(run(&scenario, log, 0).unwrap().tracks[1], first.tracks[1]);
}

#[test]
fn the_identity_is_given_on_request() {
    let scenario = scenario();
    let calls = Arc::default();
    let simulator = Random { calls: Arc::clone(&calls), wants_identity: true, ..Random::default() };
    run(&scenario, simulated(&scenario, simulator, 80), 3).unwrap();
    let identity = Some(("pair".to_owned(), 3));
    assert_eq!(calls.lock().unwrap()[0], Call::Begin { moves_av: true, steps: 80, identity });
}

#[test]
fn failures_name_the_step_and_the_reason() {
    let scenario = scenario();
    let error = |simulator: Random| {
        let calls = Arc::clone(&simulator.calls);
        let error = run(&scenario, simulated(&scenario, simulator, 10), 0).unwrap_err();
        assert_eq!(calls.lock().unwrap().last(), Some(&Call::End(1)));
        error.to_string()
    };
    assert_eq!(
        error(Random { fails_at: Some(20), ..Random::default() }),
        "scenario `pair`: the simulator does not move the AV to step 21: no way ahead"
    );
    assert_eq!(
        error(Random { cannot_begin: true, ..Random::default() }),
        "scenario `pair`: the simulator does not move the AV to step 1: no room"
    );
    assert_eq!(
        error(Random { leaves_out_av_from: Some(33), ..Random::default() }),
        "scenario `pair`: the simulator does not move the AV to step 34: its plan of step 30 has no state of \
         the AV (slot 0), which simulators plan if `moves_av` is set; choose a simulator that supports the \
         realism protocol"
    );
}
