//! Planning of all vehicles at one replan, those nearest to the AV first.

use reactsim_geometry::{Bounds, OrientedBox, direction, heading_of};
use reactsim_rollout::Observation;
use reactsim_scene::dynamics::{Pose, REAR_AXLE, STANDSTILL_SPEED, VehicleMotion};
use reactsim_scene::{Agent, AgentKind, AgentState, Road};

use super::drive::halt;
use super::ending::{Ending, Endings};
use super::forecast::{self, AvForecast};
use super::guard::{Decision, GuardSettings, Proposal, Surroundings};
use super::mode::Mode;
use super::obstacle::{Extent, Obstacle};
use super::planned_vehicle::PlannedVehicle;
use super::settings::Settings;
use super::speed::STEPS;
use super::vehicle::{Planner, STANDSTILL_REACH, reverses, stays};
use super::walkers::{around, out_of_boxes};

/// Intended motion of an agent.
#[derive(Clone, Debug, PartialEq)]
pub enum Intent {
    /// No plan: the agent is absent, or moved from outside.
    None,
    /// Fixed states, 0.1 s apart, that others keep clear of. Only pedestrians are led around static
    /// obstacles.
    Fixed(Vec<AgentState>),
    /// Modes of a vehicle, one of which it follows. Invalid modes are left out; without a valid one the
    /// vehicle brakes.
    Vehicle(Vec<Mode>),
    /// States of a vehicle, 0.1 s apart and at least as many as are planned, which it executes unless its
    /// guard decides otherwise. Without a guard they are the only mode of the vehicle.
    Guarded(Vec<AgentState>),
}

/// Agents and objects that vehicles keep clear of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum KeepClear {
    /// The AV, other agents and static obstacles.
    Everybody,
    /// None: plans are smooth, within limits and on the road.
    Nobody,
}

/// The stage: turns intents into plans.
pub struct Stage {
    planner: Planner,
    keep_clear: KeepClear,
    guard: Option<GuardSettings>,
}

/// Speed in m/s below which the present curvature of a vehicle is free.
const CRAWLING_SPEED: f64 = 0.5;
/// Frames over which the curvature of a logged vehicle is measured.
const LOGGED_FRAMES: usize = 5;
/// Frames over which the curvature of a vehicle that was driven here is measured.
const DRIVEN_FRAMES: usize = 2;
/// Margin in metres around the reach of a vehicle; obstacles beyond it are ignored.
const REACH_MARGIN: f64 = 4.0;

/// A vehicle that is not planned yet.
struct Waiting<'a> {
    slot: usize,
    agent: &'a Agent,
    now: AgentState,
    intent: &'a Intent,
    /// Squared distance to the AV, m²; negative for the AV, which is planned first.
    distance: f64,
    /// Height of the road under it, metres; NaN if unknown, and in scenarios of one level.
    height: f64,
    /// Index of the obstacle that represents the vehicle to others.
    obstacle: Option<usize>,
}

/// Agents and objects around the vehicles of one replan; empty lists where nothing is kept clear of.
#[derive(Default)]
struct Around {
    obstacles: Vec<Obstacle>,
    /// Forecasts of an AV that is moved from outside, the first that it goes on; without a guard no others.
    av_forecasts: Vec<(AvForecast, Obstacle)>,
    /// Boxes that pedestrians are led around, with their heights.
    standing: Vec<(OrientedBox, f64)>,
    /// Boxes that pedestrians step out of, if the stage has a guard, with their heights.
    vehicles: Vec<(OrientedBox, f64)>,
}

impl Around {
    /// Adds an obstacle; returns its index.
    fn add(&mut self, obstacle: Obstacle) -> usize {
        self.obstacles.push(obstacle);
        self.obstacles.len() - 1
    }

    fn replace(&mut self, index: Option<usize>, obstacle: impl FnOnce() -> Obstacle) {
        if let Some(index) = index {
            let height = self.obstacles[index].height;
            self.obstacles[index] = obstacle().at_height(height);
        }
    }

    /// Returns the obstacles within `reach` metres of a vehicle, except its own and those on other levels.
    fn near(&self, road: &Road<'_>, vehicle: &Waiting<'_>, reach: f64) -> Vec<&Obstacle> {
        let (own, p) = (vehicle.obstacle, vehicle.now.position());
        let bounds = Bounds::around(p, reach);
        let near = |(i, o): &(usize, &Obstacle)| {
            own != Some(*i) && o.bounds.intersects(&bounds) && !o.is_apart(road, p, vehicle.height)
        };
        self.obstacles.iter().enumerate().filter(near).map(|p| p.1).collect()
    }

    /// Returns fixed states; pedestrians step out of vehicles, or are led around what stands.
    fn led(
        &self,
        road: &Road<'_>,
        agent: &Agent,
        now: &AgentState,
        height: f64,
        states: &[AgentState],
    ) -> Vec<AgentState> {
        if agent.kind != AgentKind::Pedestrian {
            return states.to_vec();
        }
        let reach = 0.5 * agent.length.max(agent.width);
        let on_level = |boxes: &[(OrientedBox, f64)]| -> Vec<OrientedBox> {
            let own = (now.position(), height);
            boxes.iter().filter(|(b, z)| !road.is_apart((b.center, *z), own)).map(|(b, _)| *b).collect()
        };
        let out = out_of_boxes(now, reach, states.len(), &on_level(&self.vehicles));
        out.unwrap_or_else(|| around(now, reach, states, &on_level(&self.standing)))
    }
}

impl Stage {
    /// Creates a stage; `None` if the solver rejects the programs, which a test rules out.
    pub fn new(settings: &Settings, keep_clear: KeepClear) -> Option<Self> {
        Some(Self { planner: Planner::new(settings)?, keep_clear, guard: None })
    }

    /// Creates a stage that keeps clear of everybody and executes guarded intents as they are where it can;
    /// `None` as for [`Self::new`].
    pub fn guarded(settings: &Settings, guard: GuardSettings) -> Option<Self> {
        let planner = Planner::new(settings)?;
        Some(Self { planner, keep_clear: KeepClear::Everybody, guard: Some(guard) })
    }

    /// Returns the outcomes of plans since the last call.
    pub fn take_endings(&mut self) -> Endings {
        std::mem::take(&mut self.planner.endings)
    }

    /// Returns the next states of every agent with an intent, 0.1 s apart: at least `steps` for
    /// vehicles, and as many as intended for others. Plans cover 5 s; after that vehicles brake to a
    /// halt. `intents` has one entry per agent, in the order of the scenario. An AV without an intent
    /// is forecast from its observed motion.
    pub fn plan(
        &mut self,
        seen: &Observation<'_>,
        intents: &[Intent],
        steps: usize,
    ) -> Vec<Option<Vec<AgentState>>> {
        let (start, agents) = (seen.start(), &seen.start().agents);
        let heights = seen.heights();
        let height = |slot: usize| heights.get(slot).copied().unwrap_or(f64::NAN);
        let mut plans: Vec<Option<Vec<AgentState>>> = vec![None; agents.len()];
        let mut around = Around::default();
        let everybody = self.keep_clear == KeepClear::Everybody;
        if everybody {
            let obstacles = start.obstacles.iter().enumerate();
            around
                .obstacles
                .extend(obstacles.map(|(i, b)| Obstacle::standing(*b).at_height(start.obstacle_height(i))));
            around.standing = static_boxes(seen, intents, &height);
        }
        if self.guard.is_some() {
            around.vehicles = vehicle_boxes(seen, &height);
        }
        let av = seen.state(0).map(|s| s.position());
        let mut waiting: Vec<Waiting<'_>> = Vec::new();
        for (slot, intent) in intents.iter().enumerate() {
            let Some(now) = seen.state(slot) else { continue };
            let agent = &agents[slot];
            match intent {
                Intent::None if slot == 0 && everybody => self.forecast_av(seen, height(0), &mut around),
                Intent::None => {}
                Intent::Fixed(states) => {
                    let states = around.led(&start.road(), agent, &now, height(slot), states);
                    if everybody {
                        around
                            .obstacles
                            .push(proposed_obstacle(agent, &now, &states).at_height(height(slot)));
                    }
                    plans[slot] = Some(states);
                }
                Intent::Vehicle(_) | Intent::Guarded(_) => {
                    let distance = av.map_or(0.0, |av| (av - now.position()).norm_squared());
                    let distance = if slot == 0 { -1.0 } else { distance };
                    let obstacle = Self::unplanned(agent, &now, intent).filter(|_| everybody);
                    let height = height(slot);
                    let obstacle = obstacle.map(|obstacle| around.add(obstacle.at_height(height)));
                    waiting.push(Waiting { slot, agent, now, intent, distance, height, obstacle });
                }
            }
        }
        waiting.sort_by(|a, b| a.distance.total_cmp(&b.distance).then(a.slot.cmp(&b.slot)));
        for vehicle in waiting {
            plans[vehicle.slot] = self.drive(seen, &vehicle, &mut around, steps);
        }
        plans
    }

    fn forecast_av(&self, seen: &Observation<'_>, height: f64, around: &mut Around) {
        let settings = &self.planner.settings;
        let forecasts = match self.guard {
            Some(_) => forecast::all_of_av(seen, height, settings),
            None => forecast::av(seen, settings).into_iter().collect(),
        };
        around.av_forecasts = forecasts.into_iter().map(|(f, o)| (f, o.at_height(height))).collect();
        around.obstacles.extend(around.av_forecasts.first().map(|(_, goes_on)| goes_on.clone()));
    }

    /// Plans a vehicle and updates its obstacle; `None` if its motion is unknown.
    fn drive(
        &mut self,
        seen: &Observation<'_>,
        waiting: &Waiting<'_>,
        around: &mut Around,
        steps: usize,
    ) -> Option<Vec<AgentState>> {
        let Waiting { agent, now, .. } = waiting;
        let moving = VehicleMotion::after(seen.track(waiting.slot))?;
        let vehicle = self.planned_vehicle(seen, waiting, moving);
        let (modes, proposed) = match waiting.intent {
            Intent::Vehicle(modes) => (sorted(modes, now), None),
            Intent::Guarded(states) => (vec![mode_of(states)], self.guard.map(|guard| (guard, states))),
            Intent::None | Intent::Fixed(_) => return None,
        };
        let reach = reach(&moving, &modes) + vehicle.extent.length + REACH_MARGIN;
        let road = seen.start().road();
        let near = around.near(&road, waiting, reach);
        let guarded = proposed.filter(|_| !stays(&vehicle, &modes[0]) && !reverses(&vehicle, &modes[0]));
        let moves = match guarded {
            None => self.planner.plan(&vehicle, &modes, &near),
            Some((guard, states)) => {
                let others: Vec<&Obstacle> = near.iter().copied().filter(|o| !o.is_av).collect();
                let apart = |o: &(AvForecast, Obstacle)| o.1.is_apart(&road, now.position(), waiting.height);
                let av = if around.av_forecasts.iter().all(apart) { &[] } else { &around.av_forecasts[..] };
                let surroundings = Surroundings { av, others: &others };
                match guard.decide(&vehicle, &Proposal::new(*now, states, steps), surroundings) {
                    Decision::AsProposed => {
                        self.planner.endings.count(Ending::AsProposed);
                        around.replace(waiting.obstacle, || proposed_obstacle(agent, now, states));
                        return Some(states[..steps].to_vec());
                    }
                    Decision::AlongProposal => self.planner.plan(&vehicle, &modes, &others),
                    Decision::Maneuver(mode) => self.planner.plan(&vehicle, &[mode], &others),
                }
            }
        };
        around.replace(waiting.obstacle, || forecast::known_obstacle(agent, now, |k| moves[k].pose));
        let mut before = now.position();
        let states = moves.iter().map(|m| {
            let state = m.state(before);
            before = m.pose.position;
            state
        });
        let mut states: Vec<AgentState> = states.collect();
        halt(now, &mut states, steps);
        Some(states)
    }

    /// Returns the obstacle of a vehicle that is not planned yet and moves as intended.
    fn unplanned(agent: &Agent, now: &AgentState, intent: &Intent) -> Option<Obstacle> {
        let mut obstacle = match intent {
            Intent::Guarded(states) => proposed_obstacle(agent, now, states),
            Intent::Vehicle(modes) => obstacle_of_mode(agent, now, most_probable(modes)?),
            Intent::None | Intent::Fixed(_) => return None,
        };
        obstacle.leader_only = true;
        Some(obstacle)
    }

    fn planned_vehicle<'a>(
        &self,
        seen: &Observation<'a>,
        &Waiting { slot, agent, height, .. }: &Waiting<'_>,
        now: VehicleMotion,
    ) -> PlannedVehicle<'a> {
        // Vehicles driven here move smoothly; the headings of logs jitter.
        let driven = seen.step() >= DRIVEN_FRAMES;
        let frames = if driven { DRIVEN_FRAMES } else { LOGGED_FRAMES };
        let least = if driven { CRAWLING_SPEED * 0.1 * DRIVEN_FRAMES as f64 } else { 1.0 };
        let limit = self.planner.settings.curvature;
        let rear = REAR_AXLE * agent.length;
        let road = seen.start().road().on_level(now.pose.position, height);
        // Without a known drivable area everything is drivable; lanes are known all the same.
        let on_road = road.drivable(now.pose.position, &mut None) != Some(false);
        let keeps_corners = self.guard.is_some_and(|guard| guard.corners);
        let mut vehicle = PlannedVehicle {
            now,
            rear,
            extent: Extent { length: 0.5 * agent.length, width: 0.5 * agent.width },
            curvature: forecast::curvature(seen.track(slot), frames, least).map(|c| {
                // Convert the curvature of the centre's path to that of the rear axle's path.
                let c = c.clamp(-limit, limit);
                c / (1.0 - (rear * c) * (rear * c)).max(0.25).sqrt()
            }),
            road: on_road.then_some(road),
            keeps_corners,
        };
        let mut near = None;
        let axis = direction(now.pose.heading);
        let mut corners = vehicle.kept_corners(now.pose.position, axis);
        vehicle.keeps_corners &= corners.all(|corner| road.drivable(corner, &mut near) != Some(false));
        vehicle
    }
}

fn most_probable(modes: &[Mode]) -> Option<&Mode> {
    modes.iter().filter(|m| m.is_valid()).reduce(|a, b| if b.probability > a.probability { b } else { a })
}

/// Returns the present boxes of all vehicles.
fn vehicle_boxes(seen: &Observation<'_>, height: &dyn Fn(usize) -> f64) -> Vec<(OrientedBox, f64)> {
    let agents = seen.start().agents.iter().enumerate().filter(|(_, a)| a.kind == AgentKind::Vehicle);
    agents.filter_map(|(slot, agent)| Some((seen.state(slot)?.footprint(agent), height(slot)))).collect()
}

/// Returns static boxes: obstacles of the map, vehicles whose modes do not set off, and an AV at
/// standstill.
fn static_boxes(
    seen: &Observation<'_>,
    intents: &[Intent],
    height: &dyn Fn(usize) -> f64,
) -> Vec<(OrientedBox, f64)> {
    let start = seen.start();
    let obstacles = start.obstacles.iter().enumerate();
    let mut boxes: Vec<(OrientedBox, f64)> = obstacles.map(|(i, b)| (*b, start.obstacle_height(i))).collect();
    for (slot, (agent, intent)) in start.agents.iter().zip(intents).enumerate() {
        let Some(now) = seen.state(slot) else { continue };
        let still = now.velocity().is_none_or(|v| v.norm() < STANDSTILL_SPEED);
        let ends_here =
            |m: &Mode| (m.centres(now.position())[STEPS - 1] - now.position()).norm() < STANDSTILL_REACH;
        let stands_on = match intent {
            Intent::Vehicle(modes) => most_probable(modes).is_none_or(ends_here),
            Intent::Guarded(states) => ends_here(&mode_of(states)),
            Intent::None => slot == 0,
            Intent::Fixed(_) => false,
        };
        if still && stands_on {
            boxes.push((now.footprint(agent), height(slot)));
        }
    }
    boxes
}

/// Returns the valid modes, the most probable first; without one, a mode that stays here.
fn sorted(modes: &[Mode], now: &AgentState) -> Vec<Mode> {
    let mut valid: Vec<Mode> = modes.iter().filter(|m| m.is_valid()).cloned().collect();
    valid.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    if valid.is_empty() {
        valid.push(Mode::of(vec![now.position(); STEPS]));
    }
    valid
}

/// Returns how far a vehicle may get within the planned time, metres.
fn reach(now: &VehicleMotion, modes: &[Mode]) -> f64 {
    let from = now.pose.position;
    let far = modes.iter().map(|m| (m.centres(from)[STEPS - 1] - from).norm()).fold(0.0, f64::max);
    far.max(now.speed * now.speed / 8.0)
}

pub(super) fn mode_of(states: &[AgentState]) -> Mode {
    Mode::of(states.iter().map(AgentState::position).collect())
}

/// Returns the obstacle of a vehicle that moves as proposed and then keeps its last velocity.
fn proposed_obstacle(agent: &Agent, now: &AgentState, states: &[AgentState]) -> Obstacle {
    let poses = forecast::continued_poses(now, states);
    forecast::known_obstacle(agent, now, |k| poses[k])
}

/// Returns the obstacle of a vehicle that moves as its mode.
fn obstacle_of_mode(agent: &Agent, now: &AgentState, mode: &Mode) -> Obstacle {
    let centres = mode.centres(now.position());
    let mut heading = now.heading;
    let mut before = now.position();
    let poses: Vec<Pose> = centres
        .into_iter()
        .map(|position| {
            let step = position - before;
            if step.norm() > 0.1 {
                heading = heading_of(step);
            }
            before = position;
            Pose { position, heading }
        })
        .collect();
    forecast::known_obstacle(agent, now, |k| poses[k])
}

/// Returns whether the stage plans agents of a kind. The metrics judge the motion of vehicles only.
/// Pedestrians and cyclists turn and halt in ways that a car's bicycle model does not allow; their
/// plans are taken as they are.
pub fn is_planned(kind: AgentKind) -> bool {
    kind == AgentKind::Vehicle
}
