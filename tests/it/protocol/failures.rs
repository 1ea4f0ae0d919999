//! A failure in one episode does not affect the others.

use reactsim::rollout::{
    Controller, Episode, Memory, PlanError, Planning, Settings, Simulator, SingleEpisode, Stream, roll_out,
    roll_out_while,
};
use reactsim::scene::{AgentState, Scenario, Start};

use super::settings;
use crate::scenes::{bits, coasting, request};
use crate::small_scenarios;

#[derive(Clone, Copy)]
enum Fault {
    GivesUp,
    NotFinite,
    Vanishes,
}

/// Keeps all agents where they are; in the scenario with this number of agents it fails.
struct Faulty {
    agents: usize,
    from: usize,
    fault: Fault,
}

impl SingleEpisode for Faulty {
    type Memory = ();

    fn id(&self) -> &'static str {
        "faulty"
    }

    fn begin(&self, _start: &Start, _stream: &mut Stream) {}

    fn plan_one(&self, _memory: &mut (), episode: &mut Planning<'_, '_>) -> Result<(), PlanError> {
        let (seen, steps) = (episode.seen, episode.plan.steps());
        let here = seen.start().agents.len() == self.agents;
        for agent in 0..episode.plan.agents() {
            for k in 0..steps {
                let mut state = seen.state(agent);
                if here && seen.step() + k >= self.from && agent == 2 {
                    match self.fault {
                        Fault::GivesUp => return Err(PlanError::Failed("no way on".into())),
                        Fault::NotFinite => {
                            state = state.map(|s| AgentState { y: f64::NAN, ..s });
                        }
                        Fault::Vanishes => state = None,
                    }
                }
                episode.plan.set(agent, k, state);
            }
        }
        Ok(())
    }
}

fn faulty(from: usize, fault: Fault) -> Controller {
    Controller::Fair(Box::new(Faulty { agents: 3, from, fault }))
}

/// Returns three scenarios; the middle one has one agent fewer.
fn three() -> Vec<Scenario> {
    let mut all: Vec<Scenario> = Vec::new();
    for i in 0..3 {
        let mut parts = small_scenarios::parts(i, true);
        if i == 1 {
            parts.agents.truncate(3);
        }
        all.push(Scenario::assemble(parts).unwrap());
    }
    all
}

/// Returns the errors of a batch, and checks that the other rollouts are as they are alone.
fn errors(controller: &Controller, settings: &Settings) -> Vec<Option<String>> {
    let all = three();
    let batch = all.iter().map(|s| request(s, coasting(s), 0)).collect();
    let done = roll_out(batch, controller, settings);
    let sound = faulty(usize::MAX, Fault::GivesUp);
    done.into_iter()
        .zip(&all)
        .map(|(result, scenario)| match result {
            Err(error) => Some(error.to_string()),
            Ok(rollout) => {
                let alone = roll_out(vec![request(scenario, coasting(scenario), 0)], &sound, settings);
                let alone = alone.into_iter().next().unwrap().unwrap();
                assert_eq!(bits(&rollout.tracks), bits(&alone.tracks), "{}", scenario.id);
                None
            }
        })
        .collect()
}

#[test]
fn a_plan_that_fails_leaves_the_other_episodes() {
    for (from, named) in [(0, "step 0"), (12, "step 10"), (79, "step 75")] {
        let found = errors(&faulty(from, Fault::GivesUp), &settings(5, true));
        let [None, Some(error), None] = found.as_slice() else { panic!("{found:?}") };
        assert!(
            error.contains("`road-001`") && error.contains(named) && error.contains("no way on"),
            "{error}"
        );
    }
}

#[test]
fn states_that_are_not_finite_are_refused_by_name() {
    for (from, named) in [(0, "step 1"), (12, "step 13"), (79, "step 80")] {
        let found = errors(&faulty(from, Fault::NotFinite), &settings(5, true));
        let [None, Some(error), None] = found.as_slice() else { panic!("{found:?}") };
        let names = ["`road-001`", "agent `ahead`", named, "not finite"];
        let names = names.map(|n| n.replace("ahead", &three()[1].start.agents[2].id));
        assert!(names.iter().all(|n| error.contains(n.as_str())), "{error}");
    }
}

#[test]
fn a_request_without_an_av_fails_in_the_reactive_protocol() {
    let all = three();
    let mut batch: Vec<_> = all.iter().map(|s| request(s, coasting(s), 0)).collect();
    batch[1].av = None;
    let done = roll_out(batch, &faulty(usize::MAX, Fault::GivesUp), &settings(5, true));
    let errors: Vec<_> = done.into_iter().map(|result| result.err().map(|error| error.to_string())).collect();
    let [None, Some(error), None] = errors.as_slice() else { panic!("{errors:?}") };
    assert!(error.contains("`road-001`") && error.contains("has no AV"), "{error}");
}

#[test]
fn rollouts_stop_when_they_are_no_longer_wanted() {
    let (all, steps) = (three(), std::cell::RefCell::default());
    // The middle one has failed before.
    let batch = || all.iter().map(|s| request(s, coasting(s), 0)).collect();
    let controller = faulty(12, Fault::GivesUp);
    let wanted = |step: usize| {
        Vec::push(&mut steps.borrow_mut(), step);
        step < 33
    };
    let done = roll_out_while(batch(), &controller, &settings(5, true), &wanted);
    assert_eq!(*steps.borrow(), (0..=33).collect::<Vec<_>>());
    let errors: Vec<String> = done.into_iter().map(|result| result.unwrap_err().to_string()).collect();
    assert_eq!(errors[0], "scenario `road-000`: stopped after 33 steps");
    assert!(errors[1].contains("no way on"), "{}", errors[1]);
    assert_eq!(errors[2], "scenario `road-002`: stopped after 33 steps");
    let done = roll_out_while(batch(), &controller, &settings(5, true), &|step| step < 80);
    assert!(done[0].is_ok() && done[1].is_err() && done[2].is_ok());
}

#[test]
fn an_agent_that_is_planned_absent_is_absent() {
    let all = three();
    let controller = faulty(30, Fault::Vanishes);
    let done = roll_out(vec![request(&all[1], coasting(&all[1]), 0)], &controller, &settings(5, true));
    let track = &done[0].as_ref().unwrap().tracks[2];
    let first = track.iter().position(Option::is_none);
    assert_eq!(first, Some(41), "thirty steps after frame 10 are realised");
    assert!(track[41..].iter().all(Option::is_none));
}

/// Fails as a whole, or plans without having begun.
struct Hopeless {
    begins: bool,
}

impl Simulator for Hopeless {
    fn begin(&self, _start: &Start, _stream: &mut Stream) -> Memory {
        if self.begins { Memory::new(7_u32) } else { Memory::NONE }
    }

    fn plan(&self, batch: &mut [Episode<'_>]) -> Result<(), PlanError> {
        if self.begins {
            return Err(PlanError::Failed("out of memory".into()));
        }
        let inner = Faulty { agents: 0, from: 0, fault: Fault::GivesUp };
        Simulator::plan(&inner, batch)
    }
}

#[test]
fn a_simulator_that_fails_as_a_whole_says_so_for_every_scenario() {
    for (begins, text) in [(true, "out of memory"), (false, "memory of another simulator")] {
        let controller = Controller::Fair(Box::new(Hopeless { begins }));
        for error in errors(&controller, &Settings::default()) {
            assert!(error.as_ref().is_some_and(|e| e.contains(text) && e.contains("step 0")), "{error:?}");
        }
    }
}
