//! PufferDrive 2.0: an externally trained self-play policy as a simulator.
//!
//! The network acts every 0.1 s. A plan of n steps is n steps of its own environment. The vehicles that
//! it drives move by their actions and observe each other's motion. All other agents keep their
//! velocity; so does the AV, after its next state, if that is known.
// Tests may call the mathematical functions of the platform: their comparisons have tolerances.
#![cfg_attr(test, allow(clippy::disallowed_methods))]

mod memory;
mod motion;
pub mod network;
mod road;
mod route;
mod world;

use burn::tensor::{Device, Tensor, TensorData};
use rand::RngExt;
use reactsim_baseline::{Baseline, ModelError, Setup};
use reactsim_geometry::{direction, math};
use reactsim_nn::{Initializer, Tensors, device_of};
use reactsim_rollout::{Continuation, Controller, Episode, Memory, PlanError, Simulator, Stream};
use reactsim_scene::dynamics::{MotionLimits, Pose, Tracker, VehicleMotion};
use reactsim_scene::{AgentKind, Start};
use serde::Deserialize;

use self::memory::{EpisodeMemory, Vehicle};
use self::motion::{Body, keeps_limit};
use self::network::{ACTIONS, EGO, HIDDEN, Network, PARTNER, ROAD, Recurrent};
use self::world::World;

/// Its entry in the list of baselines.
pub const ENTRY: Baseline = Baseline {
    by_default: true,
    ..Baseline::of_network("pufferdrive", include_str!("card.toml"), include_str!("ranges.toml"), make)
};

/// Parameters of the card.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Parameters {
    projection: bool,
    greedy: bool,
    goal_seconds: f64,
    goal_nearest: f64,
    goal_farthest: f64,
    speed_limit: f64,
    parked: ParkedCriteria,
}

/// Criteria by which a standing vehicle counts as parked.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct ParkedCriteria {
    travel: f64,
    speed: f64,
    offset: f64,
    angle: f64,
}

fn make(setup: Setup) -> Result<Controller, ModelError> {
    let parameters = setup.parameters()?;
    setup.parameters.require_order("goal_nearest", "goal_farthest")?;
    let device = device_of(setup.backend);
    let network = Network::init(&mut Initializer::blank(&device), &device);
    let network = setup.read_weights(|bytes| Tensors::read(bytes)?.load(network))?;
    Ok(Controller::Fair(Box::new(PufferDrive { parameters, network, device })))
}

/// Simulator whose vehicles are driven by the network.
#[derive(Debug)]
pub struct PufferDrive {
    parameters: Parameters,
    network: Network,
    device: Device,
}

/// A vehicle in the course of one plan.
struct DrivenVehicle {
    /// Index of the episode in the batch.
    episode: usize,
    /// Index among the vehicles that the episode's memory holds.
    vehicle: usize,
    /// Index of the agent.
    agent: usize,
    /// Planned poses so far.
    path: Vec<Pose>,
}

impl Simulator for PufferDrive {
    fn begin(&self, start: &Start, _stream: &mut Stream) -> Memory {
        Memory::new(EpisodeMemory::begin(start, &self.parameters))
    }

    fn continue_batch(&self, batch: &mut [Continuation<'_>]) -> Result<(), PlanError> {
        for Continuation { before, kept, beginning } in batch {
            let Some(before) = before.take::<EpisodeMemory>() else {
                return Err(PlanError::ForeignMemory(ENTRY.id));
            };
            let begun = EpisodeMemory::begin(beginning.start, &self.parameters);
            beginning.memory = Memory::new(begun.resumed(before, kept));
        }
        Ok(())
    }

    fn plan(&self, batch: &mut [Episode<'_>]) -> Result<(), PlanError> {
        let mut worlds = Vec::with_capacity(batch.len());
        let mut driven = Vec::new();
        for (index, episode) in batch.iter_mut().enumerate() {
            let (seen, moves_av) = (episode.seen, episode.moves_av);
            let Some(drive) = episode.memory.get::<EpisodeMemory>() else {
                episode.error = Some(PlanError::ForeignMemory(ENTRY.id));
                worlds.push(World::now(&seen, |_| true));
                continue;
            };
            for vehicle in &mut drive.vehicles {
                vehicle.renew(&seen, episode.plan.steps(), &self.parameters);
            }
            let vehicle = |agent: usize| drive.vehicles.binary_search_by_key(&agent, |v| v.agent).ok();
            let agents = &seen.start().agents;
            // Vehicles that are not driven are parked.
            let stays = |i: usize| i > 0 && agents[i].kind == AgentKind::Vehicle && vehicle(i).is_none();
            worlds.push(World::now(&seen, stays));
            for agent in usize::from(!moves_av)..episode.plan.agents() {
                if let (Some(vehicle), Some(_)) = (vehicle(agent), seen.state(agent)) {
                    driven.push(DrivenVehicle { episode: index, vehicle, agent, path: Vec::new() });
                }
            }
        }
        // All episodes of a batch are planned for the same number of steps.
        let steps = batch.iter().map(|e| e.plan.steps()).max().unwrap_or(0);
        let mut states = self.load_states(batch, &driven);
        for step in 0..steps {
            let logits;
            (logits, states) = self.run_network(batch, &worlds, &driven, states);
            let mut moves = vec![Vec::new(); batch.len()];
            for (one, logits) in driven.iter_mut().zip(logits.chunks_exact(ACTIONS)) {
                let world = &worlds[one.episode];
                if let Some(body) = self.act(&mut batch[one.episode], world, one, logits) {
                    moves[one.episode].push((one.agent, body));
                }
            }
            for ((world, episode), moves) in worlds.iter_mut().zip(batch.iter_mut()).zip(moves) {
                let av = episode.seen.av_next().filter(|_| step == 0 && !episode.moves_av);
                world.advance(&moves, av);
                if step < episode.plan.steps() {
                    for agent in 0..episode.plan.agents() {
                        episode.plan.set(agent, step, world.state(agent));
                    }
                }
            }
        }
        store_states(batch, &driven, states);
        if self.parameters.projection {
            project(batch, &driven);
        }
        Ok(())
    }
}

impl PufferDrive {
    /// Returns the LSTM states of the vehicles.
    fn load_states(&self, batch: &mut [Episode<'_>], driven: &[DrivenVehicle]) -> Recurrent {
        let (mut hidden, mut cell) = (Vec::new(), Vec::new());
        for one in driven {
            if let Some(vehicle) = vehicle(batch, one) {
                hidden.extend_from_slice(&vehicle.hidden);
                cell.extend_from_slice(&vehicle.cell);
            }
        }
        let tensor =
            |values| Tensor::from_data(TensorData::new(values, [driven.len(), HIDDEN]), &self.device);
        Recurrent { hidden: tensor(hidden), cell: tensor(cell) }
    }

    /// Runs the network on the observations of all vehicles: [`ACTIONS`] logits for each, and the next
    /// LSTM states.
    fn run_network(
        &self,
        batch: &mut [Episode<'_>],
        worlds: &[World],
        driven: &[DrivenVehicle],
        states: Recurrent,
    ) -> (Vec<f32>, Recurrent) {
        let n = driven.len();
        if n == 0 {
            return (Vec::new(), states);
        }
        let (road_size, partners_size) = (road::ROWS * ROAD, world::ROWS * PARTNER);
        let mut ego = vec![0.0; n * EGO];
        let mut road = vec![0.0; n * road_size];
        let mut partners = vec![0.0; n * partners_size];
        let rows = ego.chunks_exact_mut(EGO).zip(road.chunks_exact_mut(road_size));
        let rows = rows.zip(partners.chunks_exact_mut(partners_size));
        for (one, ((ego, road), partners)) in driven.iter().zip(rows) {
            let world = &worlds[one.episode];
            let Some(body) = world.body(one.agent) else { continue };
            let Some(drive) = batch[one.episode].memory.get::<EpisodeMemory>() else { continue };
            let Parameters { goal_seconds, goal_nearest, goal_farthest, .. } = self.parameters;
            let distance = (body.speed * goal_seconds).min(goal_farthest).max(goal_nearest);
            let goal = drive.vehicles[one.vehicle].route.ahead(body.pose.position, distance);
            drive.road.fill(body.pose.position, direction(body.pose.heading), road);
            world.fill(one.agent, goal, ego, partners);
        }
        let table = |values, rows, width| {
            Tensor::<3>::from_data(TensorData::new(values, [n, rows, width]), &self.device)
        };
        let output = self.network.forward(
            Tensor::from_data(TensorData::new(ego, [n, EGO]), &self.device),
            table(road, road::ROWS, ROAD),
            table(partners, world::ROWS, PARTNER),
            states,
        );
        (output.logits.into_data().iter::<f32>().collect(), output.next)
    }

    /// Returns a vehicle after the action that it takes; `None` if it is absent, or if the network
    /// output is not finite, which is an error of the episode.
    fn act(
        &self,
        episode: &mut Episode<'_>,
        world: &World,
        one: &mut DrivenVehicle,
        logits: &[f32],
    ) -> Option<Body> {
        let body = world.body(one.agent)?;
        if logits.iter().any(|l| !l.is_finite()) {
            let text = format!(
                "the network output for agent `{}` is not finite",
                episode.seen.start().agents[one.agent].id
            );
            episode.error.get_or_insert(PlanError::Failed(text));
            return None;
        }
        let vehicle = &episode.memory.get::<EpisodeMemory>()?.vehicles[one.vehicle];
        let (limit, length) = (vehicle.limit, vehicle.length);
        let allowed: Vec<usize> = (0..ACTIONS).filter(|&a| keeps_limit(a, body.speed, limit)).collect();
        let best =
            allowed.iter().copied().max_by(|&a, &b| logits[a].total_cmp(&logits[b]).then(b.cmp(&a)))?;
        let chosen = if self.parameters.greedy { best } else { draw(&allowed, logits, best, episode.stream) };
        let moved = body.moved(chosen, length);
        one.path.push(moved.pose);
        Some(moved)
    }
}

/// Draws one of the allowed actions by its probability among them.
fn draw(allowed: &[usize], logits: &[f32], best: usize, stream: &mut Stream) -> usize {
    let weight = |a: usize| math::exp(f64::from(logits[a]) - f64::from(logits[best]));
    let mut left = stream.random::<f64>() * allowed.iter().map(|&a| weight(a)).sum::<f64>();
    for &a in allowed {
        left -= weight(a);
        if left < 0.0 {
            return a;
        }
    }
    best
}

fn vehicle<'a>(batch: &'a mut [Episode<'_>], one: &DrivenVehicle) -> Option<&'a mut Vehicle> {
    batch[one.episode].memory.get::<EpisodeMemory>()?.vehicles.get_mut(one.vehicle)
}

/// Stores the LSTM states for the next plan.
fn store_states(batch: &mut [Episode<'_>], driven: &[DrivenVehicle], states: Recurrent) {
    let values = |tensor: Tensor<2>| tensor.into_data().iter::<f32>().collect::<Vec<f32>>();
    let (hidden, cell) = (values(states.hidden), values(states.cell));
    let states = hidden.chunks_exact(HIDDEN).zip(cell.chunks_exact(HIDDEN));
    for (one, (hidden, cell)) in driven.iter().zip(states) {
        if let Some(vehicle) = vehicle(batch, one) {
            vehicle.hidden.copy_from_slice(hidden);
            vehicle.cell.copy_from_slice(cell);
        }
    }
}

/// Drives the planned poses within the limits of the metrics. The environment's vehicles turn about
/// their rear end.
fn project(batch: &mut [Episode<'_>], driven: &[DrivenVehicle]) {
    let mut tracker = Tracker::new(MotionLimits::of_vehicle(0.0));
    let mut moves = Vec::new();
    for one in driven {
        let Some(length) = vehicle(batch, one).map(|v| v.length) else { continue };
        let episode = &mut batch[one.episode];
        let Some(now) = VehicleMotion::after(episode.seen.track(one.agent)) else { continue };
        tracker.set_limits(MotionLimits::of_vehicle(0.5 * length));
        tracker.track(now, &one.path, &mut moves);
        let mut from = now.pose.position;
        for (step, moving) in moves.iter().enumerate().take(episode.plan.steps()) {
            episode.plan.set(one.agent, step, Some(moving.state(from)));
            from = moving.pose.position;
        }
    }
}
