use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

use reactsim_scene::{AgentState, CURRENT, FRAMES, LoggedAgent, Scenario, ScenarioParts};

use super::*;
use crate::{Controller, LogAv, Protocol, Request, Rollout, Settings, roll_out};

/// A simulator whose agents advance from where they are by `step` metres and a random distance.
struct Pace {
    step: f64,
    noise: f64,
    /// Number of memories that it gave out and did not get back.
    memories: Arc<AtomicUsize>,
}

fn pace(step: f64, noise: f64) -> Box<Pace> {
    Box::new(Pace { step, noise, memories: Arc::default() })
}

fn random(stream: &mut Stream) -> f64 {
    f64::from(stream.next_u32()) / f64::from(u32::MAX)
}

impl Simulator for Pace {
    fn begin(&self, _start: &Start, stream: &mut Stream) -> Memory {
        self.memories.fetch_add(1, Relaxed);
        Memory::new(random(stream) * self.noise)
    }

    fn end_batch(&self, memories: Vec<Memory>) {
        self.memories.fetch_sub(memories.len(), Relaxed);
    }

    fn plan(&self, batch: &mut [Episode<'_>]) -> Result<(), PlanError> {
        for episode in batch {
            let own = *episode.memory.get::<f64>().expect("its own memory");
            for agent in 0..episode.plan.agents() {
                let Some(mut state) = episode.seen.state(agent) else { continue };
                for k in 0..episode.plan.steps() {
                    state.x += self.step + own + self.noise * random(episode.stream);
                    episode.plan.set(agent, k, Some(state));
                }
            }
            *episode.outcomes.entry("plans").or_default() += 1;
        }
        Ok(())
    }
}

/// A scenario of a vehicle, which is the AV, and agents of every kind in turn.
fn scenario(id: &str, agents: usize) -> Scenario {
    let logged = |i: usize| {
        let state = |f: usize| AgentState { x: f as f64, y: 9.0 * i as f64, heading: 0.0, vx: 10.0, vy: 0.0 };
        let kind = AgentKind::ALL[i % 3];
        let agent = Agent { id: i.to_string(), kind, length: 1.8, width: 0.8 };
        LoggedAgent { agent, track: (0..FRAMES).map(|f| Some(state(f))).collect(), heights: Vec::new() }
    };
    let agents = (0..agents).map(logged).collect();
    Scenario::assemble(ScenarioParts { id: id.to_owned(), agents, ..ScenarioParts::default() }).unwrap()
}

fn member(simulator: Box<Pace>, share: f64, kinds: &[AgentKind]) -> MixMember {
    MixMember { simulator, share, kinds: kinds.to_vec() }
}

fn mix(members: Vec<MixMember>) -> Controller {
    Controller::Fair(Box::new(Mix::new(members).unwrap()))
}

fn roll(scenarios: &[Scenario], controller: &Controller, protocol: Protocol) -> Vec<Rollout> {
    let av = |scenario| Some(Arc::new(LogAv::new(scenario).unwrap()) as Arc<dyn crate::Av>);
    let request = |scenario| Request { scenario, av: av(scenario), rollout: 1 };
    let settings = Settings { protocol, seed: 3, ..Settings::default() };
    let done = roll_out(scenarios.iter().map(request).collect(), controller, &settings);
    done.into_iter().map(Result::unwrap).collect()
}

/// Returns the mean advance per step of each agent except the AV, rounded to metres.
fn paces(rollout: &Rollout) -> Vec<f64> {
    let x = |track: &[Option<AgentState>], f: usize| track[f].unwrap().x;
    let pace =
        |t: &Vec<Option<AgentState>>| (x(t, FRAMES - 1) - x(t, CURRENT)) / (FRAMES - 1 - CURRENT) as f64;
    rollout.tracks[1..].iter().map(|track| pace(track).round()).collect()
}

#[test]
fn a_mix_of_one_simulator_makes_its_rollouts() {
    let scenarios = [scenario("a", 5), scenario("b", 3)];
    for protocol in [Protocol::Reactive, Protocol::Realism] {
        let alone = roll(&scenarios, &Controller::Fair(pace(1.0, 0.5)), protocol);
        let mixed = roll(&scenarios, &mix(vec![member(pace(1.0, 0.5), 0.3, &[])]), protocol);
        assert_eq!(alone, mixed);
        // The draws of a member do not depend on the other members.
        let other = member(pace(7.0, 0.5), 1.0, &[]);
        let mixed = roll(&scenarios, &mix(vec![other, member(pace(1.0, 0.5), 1.0, &[])]), protocol);
        let same = |rollouts: &[Rollout]| {
            let tracks = rollouts.iter().zip(&alone).flat_map(|(a, b)| a.tracks.iter().zip(&b.tracks));
            tracks.filter(|(a, b)| a[CURRENT + 1] == b[CURRENT + 1]).count()
        };
        assert!((2..8).contains(&same(&mixed)), "{}", same(&mixed));
    }
}

#[test]
fn agents_keep_their_simulator_which_starts_from_what_all_did() {
    let scenarios = [scenario("a", 40)];
    let shares = || {
        let pedestrians = member(pace(3.0, 0.0), 0.0, &[AgentKind::Pedestrian]);
        vec![member(pace(1.0, 0.0), 3.0, &[]), member(pace(2.0, 0.0), 1.0, &[]), pedestrians]
    };
    let rollout = roll(&scenarios, &mix(shares()), Protocol::Reactive).remove(0);
    let paces = paces(&rollout);
    for (pace, agent) in paces.iter().zip(&scenarios[0].start.agents[1..]) {
        assert_eq!(*pace == 3.0, agent.kind == AgentKind::Pedestrian);
    }
    let count = |of: f64| paces.iter().filter(|pace| **pace == of).count();
    assert_eq!(count(1.0) + count(2.0) + count(3.0), 39, "{paces:?}");
    assert!(count(1.0) > 2 && count(2.0) > 2, "{paces:?}");
    // 16 plans by each of three members.
    assert_eq!(rollout.outcomes["plans"], 48);
    // The scenario names the draws; others of the batch do not change them.
    let batch = [scenario("b", 40), scenario("a", 40)];
    let both = roll(&batch, &mix(shares()), Protocol::Reactive);
    assert_eq!(both[1], rollout);
    assert_ne!(self::paces(&both[0]), paces);
}

#[test]
fn members_without_agents_do_not_plan() {
    let walking = pace(3.0, 0.0);
    let memories = Arc::clone(&walking.memories);
    let walkers = member(walking, 0.0, &[AgentKind::Pedestrian]);
    let controller = mix(vec![walkers, member(pace(1.0, 0.0), 1.0, &[])]);
    let rollouts = roll(&[scenario("a", 1), scenario("b", 2)], &controller, Protocol::Reactive);
    assert!(rollouts[0].outcomes.is_empty(), "only the AV is in the scene");
    assert_eq!(rollouts[1].outcomes["plans"], 16);
    assert_eq!(memories.load(Relaxed), 0, "memories are given back");
}

#[test]
fn invalid_shares_are_refused() {
    for shares in [&[][..], &[0.0], &[-1.0, 2.0], &[f64::NAN], &[f64::INFINITY], &[f64::MAX, f64::MAX]] {
        let members = shares.iter().map(|share| member(pace(1.0, 0.0), *share, &[])).collect();
        assert!(Mix::new(members).is_none(), "{shares:?}");
    }
}

#[test]
fn shares_are_lengths_of_a_row() {
    let members = [1.0, 0.0, 3.0, 0.0].map(|share| member(pace(1.0, 0.0), share, &[]));
    let mix = Mix::new(members.into()).unwrap();
    let at = [0.0, 0.24, 0.25, 0.9, 1.0].map(|drawn| mix.member_at(drawn));
    assert_eq!(at, [0, 0, 2, 2, 2]);
    let scenario = scenario("a", 40);
    let draw = |seed| mix.draw(&scenario.start, &crate::stream(seed, "a", 0, crate::Purpose::Begin));
    let drawn: Vec<usize> = (0..250).flat_map(draw).collect();
    let share = drawn.iter().filter(|member| **member == 0).count() as f64 / drawn.len() as f64;
    assert!((share - 0.25).abs() < 0.015, "{share}");
}

#[test]
fn memories_of_other_simulators_are_refused() {
    let scenarios = [scenario("a", 2)];
    let start = &scenarios[0].start;
    let mix = Mix::new(vec![member(pace(1.0, 0.0), 1.0, &[])]).unwrap();
    let mut episode = [Episode {
        seen: crate::Observation::new(start, &start.history, &start.light_history, None),
        memory: &mut Memory::new(1.0),
        stream: &mut crate::stream(0, "a", 0, crate::Purpose::Plan),
        moves_av: false,
        shares_traffic: false,
        plan: JointPlan::new(2, 5),
        outcomes: Default::default(),
        error: None,
    }];
    mix.plan(&mut episode).unwrap();
    assert!(matches!(episode[0].error, Some(PlanError::ForeignMemory("mix"))));
}
