//! All vehicles of a scene at one replan, those nearest to the AV first.

use reactsim::dynamics::{Moving, Pose, REAR_AXLE};
use reactsim::geometry::{OrientedBox, math};
use reactsim::rollout::Observation;
use reactsim::scene::{AgentKind, AgentState, CURRENT};

use super::drive::halt;
use super::ending::Endings;
use super::forecast;
use super::mode::Mode;
use super::obstacle::{Extent, Obstacle};
use super::settings::Settings;
use super::speed::STEPS;
use super::vehicle::{Planner, STANDS, Subject};
use super::walkers::around;

/// What an agent is meant to do.
#[derive(Clone, Debug, PartialEq)]
pub enum Intent {
    /// Nothing is planned for it: it is absent, or moved from outside.
    None,
    /// It moves like this, 0.1 s apart, and others look out for it. Only people on foot go round what stands.
    Fixed(Vec<AgentState>),
    /// A vehicle that would like one of these. Modes that are not valid are left out; without any it brakes.
    Vehicle(Vec<Mode>),
}

/// What is kept clear.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum KeepClear {
    /// Of the AV, of others and of what stands.
    Everybody,
    /// Of nobody: smooth, within limits and on the road.
    Nobody,
}

/// The stage: intents in, plans out.
pub struct Stage {
    planner: Planner,
    keep_clear: KeepClear,
}

/// Slower vehicles may turn the wheel as they like, m/s.
const CRAWLING: f64 = 0.5;
/// Frames over which the curvature of a logged vehicle is taken, and of one that was driven here.
const LOGGED_FRAMES: usize = 5;
const DRIVEN_FRAMES: usize = 2;
/// Who is farther than this from everything that a vehicle can reach is no obstacle to it, metres.
const ASIDE: f64 = 4.0;

impl Stage {
    /// A stage; `None` where the solver refuses the programs, which a test excludes.
    pub fn new(settings: &Settings, keep_clear: KeepClear) -> Option<Self> {
        Some(Self { planner: Planner::new(settings)?, keep_clear })
    }

    /// How plans ended since the last time that this was asked.
    pub fn take_endings(&mut self) -> Endings {
        std::mem::take(&mut self.planner.endings)
    }

    /// The next states of every agent with an intent, 0.1 s apart: at least `steps` of vehicles, and as many of others as are intended.
    /// What is planned are 5 s; later on vehicles brake to a halt. `intents` has one entry per agent, in the order of the scenario. Unless the
    /// AV has an intent, it is forecast from what is seen of it.
    pub fn plan(
        &mut self,
        seen: &Observation<'_>,
        intents: &[Intent],
        steps: usize,
    ) -> Vec<Option<Vec<AgentState>>> {
        let agents = &seen.start().agents;
        let mut plans: Vec<Option<Vec<AgentState>>> = vec![None; agents.len()];
        let mut obstacles: Vec<Obstacle> = Vec::new();
        // The obstacle that stands for an agent until it is planned.
        let mut own: Vec<Option<usize>> = vec![None; agents.len()];
        let everybody = self.keep_clear == KeepClear::Everybody;
        let settings = self.planner.settings.clone();
        if everybody {
            obstacles.extend(seen.start().obstacles.iter().map(|b| Obstacle::standing(*b)));
        }
        let standing = if everybody { standing(seen, intents) } else { Vec::new() };
        let mut order: Vec<(f64, usize)> = Vec::new();
        let av = seen.state(0).map(|s| s.position());
        for (slot, intent) in intents.iter().enumerate() {
            let Some(now) = seen.state(slot) else { continue };
            match intent {
                Intent::None if slot == 0 && everybody => obstacles.extend(forecast::av(seen, &settings)),
                Intent::None => {}
                Intent::Fixed(states) => {
                    let agent = &agents[slot];
                    let states = match agent.kind {
                        AgentKind::Pedestrian => {
                            around(&now, 0.5 * agent.length.max(agent.width), states, &standing)
                        }
                        _ => states.clone(),
                    };
                    if everybody {
                        let poses = forecast::going_on(&now, &states);
                        obstacles.push(forecast::known(agent, &now, |k| poses[k]));
                    }
                    plans[slot] = Some(states);
                }
                Intent::Vehicle(modes) => {
                    let distance = av.map_or(0.0, |av| (av - now.position()).norm_squared());
                    order.push((if slot == 0 { -1.0 } else { distance }, slot));
                    if let Some(mode) = likeliest(modes).filter(|_| everybody) {
                        own[slot] = Some(obstacles.len());
                        obstacles.push(wished(seen, slot, &now, mode));
                    }
                }
            }
        }
        order.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        for (_, slot) in order {
            let (Intent::Vehicle(modes), Some(now)) = (&intents[slot], seen.state(slot)) else { continue };
            let Some(moving) = Moving::after(seen.track(slot)) else { continue };
            let agent = &agents[slot];
            let subject = self.subject(seen, slot, moving);
            let modes = sorted(modes, &now);
            let reach = reach(&moving, &modes) + subject.extent.length + ASIDE;
            let around = reactsim::geometry::Bounds::around(now.position(), reach);
            let near = |(i, o): (usize, &Obstacle)| own[slot] != Some(i) && o.bounds.intersects(&around);
            let obstacles_near: Vec<&Obstacle> =
                obstacles.iter().enumerate().filter(|p| near(*p)).map(|p| p.1).collect();
            let moves = self.planner.plan(&subject, &modes, &obstacles_near);
            if let Some(i) = own[slot] {
                obstacles[i] = forecast::known(agent, &now, |k| moves[k].pose);
            }
            let mut before = now.position();
            let states = moves.iter().map(|m| {
                let state = m.state(before);
                before = m.pose.position;
                state
            });
            let mut states: Vec<AgentState> = states.collect();
            halt(&now, &mut states, steps);
            plans[slot] = Some(states);
        }
        plans
    }

    fn subject<'a>(&self, seen: &Observation<'a>, slot: usize, now: Moving) -> Subject<'a> {
        let agent = &seen.start().agents[slot];
        // Who was driven here moves smoothly; the headings of logs jitter.
        let driven = seen.frame() >= CURRENT + DRIVEN_FRAMES;
        let frames = if driven { DRIVEN_FRAMES } else { LOGGED_FRAMES };
        let least = if driven { CRAWLING * 0.1 * DRIVEN_FRAMES as f64 } else { 1.0 };
        let limit = self.planner.settings.curvature;
        let rear = REAR_AXLE * agent.length;
        let road = seen.start().road();
        // Where no ground is known all of it is drivable; lanes are known all the same.
        let on_road = road.drivable(now.pose.position, &mut None) != Some(false);
        Subject {
            now,
            rear,
            extent: Extent { length: 0.5 * agent.length, width: 0.5 * agent.width },
            curvature: forecast::curvature(seen.track(slot), frames, least).map(|c| {
                // From the curvature by the centre's way to that of the axle's.
                let c = c.clamp(-limit, limit);
                c / (1.0 - (rear * c) * (rear * c)).max(0.25).sqrt()
            }),
            road: on_road.then_some(road),
        }
    }
}

fn likeliest(modes: &[Mode]) -> Option<&Mode> {
    modes.iter().filter(|m| m.is_valid()).reduce(|a, b| if b.probability > a.probability { b } else { a })
}

/// What stands and stays: boxes of the map, vehicles that do not want to set off, and an AV that does not move.
fn standing(seen: &Observation<'_>, intents: &[Intent]) -> Vec<OrientedBox> {
    let mut boxes = seen.start().obstacles.clone();
    for (slot, (agent, intent)) in seen.start().agents.iter().zip(intents).enumerate() {
        let Some(now) = seen.state(slot) else { continue };
        let still = now.velocity().is_none_or(|v| v.norm() < STANDS.0);
        let stays = match intent {
            Intent::Vehicle(modes) => likeliest(modes)
                .is_none_or(|m| (m.centres(now.position())[STEPS - 1] - now.position()).norm() < STANDS.1),
            Intent::None => slot == 0,
            Intent::Fixed(_) => false,
        };
        if still && stays {
            boxes.push(now.footprint(agent));
        }
    }
    boxes
}

/// The valid modes, the most probable ones first; where there is none, one that stands still here.
fn sorted(modes: &[Mode], now: &AgentState) -> Vec<Mode> {
    let mut valid: Vec<Mode> = modes.iter().filter(|m| m.is_valid()).cloned().collect();
    valid.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    if valid.is_empty() {
        valid.push(Mode::of(vec![now.position(); STEPS]));
    }
    valid
}

/// How far a vehicle may get in the time that is planned, metres.
fn reach(now: &Moving, modes: &[Mode]) -> f64 {
    let from = now.pose.position;
    let far = modes.iter().map(|m| (m.centres(from)[STEPS - 1] - from).norm()).fold(0.0, f64::max);
    far.max(now.speed * now.speed / 8.0)
}

/// A vehicle that is not planned yet, as it would like to move.
fn wished(seen: &Observation<'_>, slot: usize, now: &AgentState, mode: &Mode) -> Obstacle {
    let centres = mode.centres(now.position());
    let mut heading = now.heading;
    let mut before = now.position();
    let poses: Vec<Pose> = centres
        .into_iter()
        .map(|position| {
            let step = position - before;
            if step.norm() > 0.1 {
                heading = math::atan2(step.y, step.x);
            }
            before = position;
            Pose { position, heading }
        })
        .collect();
    let agent = &seen.start().agents[slot];
    let mut obstacle = forecast::known(agent, now, |k| poses[k]);
    obstacle.leader_only = true;
    obstacle
}

/// Whether agents of a kind are planned by the stage. Metrics judge the motion of vehicles only; people on foot and on bicycles turn and
/// halt as no bicycle model of a car allows, and are taken as they are planned.
pub fn is_planned(kind: AgentKind) -> bool {
    kind == AgentKind::Vehicle
}
