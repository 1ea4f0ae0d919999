//! Simulators as planners of the AV: at each plan they start from what others did, not from what they had
//! imagined.

use std::sync::Arc;

use reactsim::models;
use reactsim::rollout::{
    Beginning, Controller, Episode, Memory, PlanError, Replan, Request, Rollout, Settings, SimulatedAv,
    Simulator, roll_out,
};
use reactsim::scene::{DT, Scenario};

use super::every_baseline;
use crate::scenes::{car, contact, future, mini, real, scene, straight};

/// A simulator whose plans are checked: the next state of an agent is near its realised state.
struct Watched {
    id: &'static str,
    /// Largest distance beyond what the speed explains, metres: tokens of networks that are not trained jump,
    /// and `nuplan-idm` puts vehicles on their centre lines.
    most: f64,
    inner: Box<dyn Simulator>,
}

impl Simulator for Watched {
    fn begin_batch(&self, batch: &mut [Beginning<'_>]) -> Result<(), PlanError> {
        self.inner.begin_batch(batch)
    }

    fn wants_identity(&self) -> bool {
        self.inner.wants_identity()
    }

    fn end_batch(&self, memories: Vec<Memory>) {
        self.inner.end_batch(memories);
    }

    fn plan(&self, batch: &mut [Episode<'_>]) -> Result<(), PlanError> {
        self.inner.plan(batch)?;
        for Episode { seen, plan, .. } in batch {
            for (slot, agent) in seen.start().agents.iter().enumerate() {
                let (Some(now), Some(next)) = (seen.state(slot), plan.get(slot, 0)) else { continue };
                let off = (next.position() - now.position()).norm() - now.speed() * DT;
                let what = format!("{}: `{}` at step {}", self.id, agent.id, seen.step());
                assert!(off < self.most, "{what}: planned {off:.1} m from where it is");
            }
        }
        Ok(())
    }
}

/// Rolls out a scene whose others follow the log, and whose AV a simulator drives.
fn drive(scenario: &Scenario, simulator: &Arc<dyn Simulator>, every: usize) -> Rollout {
    let every = Replan::every(every).unwrap();
    let av = Arc::new(SimulatedAv::new(scenario, Arc::clone(simulator), every, 0));
    let traffic = models::find("log-replay").unwrap().simulator().unwrap();
    let request = Request { scenario, av: Some(av), rollout: 0 };
    roll_out(vec![request], &traffic, &Settings::default()).remove(0).unwrap()
}

/// Scenes with a car 80 m ahead of the AV, which drives 12 m/s.
fn ahead(speed: f64) -> Scenario {
    let agents = vec![car("av", 0.0, 0.0, 0.0, 12.0), car("ahead", 80.0, 0.0, 0.0, speed)];
    scene(&format!("a car ahead at {speed} m/s"), agents, straight())
}

/// Returns the simulators that are no oracles.
fn simulators() -> impl Iterator<Item = (&'static str, bool, Arc<dyn Simulator>)> {
    every_baseline().filter_map(|(model, controller)| match controller {
        Controller::Fair(inner) => {
            let jumps = model.needs_weights || model.id == "nuplan-idm";
            let most = if jumps { 5.0 } else { 1.0 };
            let watched: Arc<dyn Simulator> = Arc::new(Watched { id: model.id, most, inner });
            Some((model.id, model.needs_weights, watched))
        }
        Controller::Oracle(_) => None,
    })
}

#[test]
fn plans_start_from_what_was_executed() {
    let scenes: Vec<Scenario> = [ahead(0.0), ahead(3.0)].into_iter().chain(mini()).chain(real(2)).collect();
    for (_, is_network, simulator) in simulators() {
        for (n, scenario) in scenes.iter().enumerate() {
            // Networks are slow.
            for every in [5, 1, 23].into_iter().take(if is_network && n > 0 { 1 } else { 3 }) {
                drive(scenario, &simulator, every);
            }
        }
    }
}

#[test]
fn an_av_of_rules_meets_nobody_ahead() {
    for (id, _, simulator) in simulators().filter(|(id, ..)| ["idm", "ntp-guarded"].contains(id)) {
        for scenario in [ahead(0.0), ahead(3.0)] {
            for every in [1, 5, 10] {
                let rollout = drive(&scenario, &simulator, every);
                let met = contact(&scenario, &rollout);
                assert_eq!(met, None, "{id} every {every}: {}", scenario.id);
                let driven = future(&scenario, &rollout, "av")[80].x;
                assert!(driven > 40.0, "{id} every {every}: {}: stands at {driven} m", scenario.id);
            }
        }
    }
}

/// A car that goes out of sight of the recording is no longer in the way, and is again when it is back.
#[test]
fn an_absent_car_is_not_in_the_way() {
    let (_, _, idm) = simulators().find(|(id, ..)| *id == "idm").unwrap();
    let mut agents = vec![car("av", 0.0, 0.0, 0.0, 12.0), car("ahead", 60.0, 0.0, 0.0, 0.0)];
    agents[1].track[25..].fill(None);
    let gone = drive(&scene("gone", agents.clone(), straight()), &idm, 5);
    assert!(gone.tracks[0][90].unwrap().x > 85.0, "{:?}", gone.tracks[0][90]);
    agents[1].track = car("ahead", 60.0, 0.0, 0.0, 0.0).track;
    agents[1].track[15..25].fill(None);
    let back = scene("back", agents, straight());
    assert_eq!(contact(&back, &drive(&back, &idm, 5)), None);
}
