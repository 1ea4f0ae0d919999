//! Forecasts of other agents from what has been observed.

use reactsim_geometry::{OrientedBox, Vec2, direction, math, wrap};
use reactsim_rollout::Observation;
use reactsim_scene::dynamics::{Pose, STANDSTILL_SPEED};
use reactsim_scene::{Agent, AgentState, DT, Frame};

use super::av_routes::{Route, routes};
use super::obstacle::{Obstacle, TIMES, step_of};
use super::settings::Settings;
use super::speed::STEPS;

/// Frames over which the acceleration of the AV is measured.
const ACCELERATION_FRAMES: usize = 3;
/// Frames over which the curvature of the AV is measured.
const TURN_FRAMES: usize = 5;
/// Time constant, in seconds, with which a positive acceleration of the AV decays.
const ACCELERATION_DECAY_TIME: f64 = 1.0;
/// Duration of a deceleration of the AV, seconds.
const BRAKING_DURATION: f64 = 3.0;
/// Distance constant, in metres, with which the curvature of the AV decays.
const CURVATURE_DECAY_DISTANCE: f64 = 20.0;
/// Growth of the AV's box per second at the front and at the rear, m/s.
const LENGTH_GROWTH: f64 = 0.25;
/// Growth of the AV's box per second at each side, m/s.
const WIDTH_GROWTH: f64 = 0.08;
/// Largest growth of the AV's box at the front and at the rear, metres.
const MAX_LENGTH_GROWTH: f64 = 1.0;
/// Largest growth of the AV's box at each side, metres.
const MAX_WIDTH_GROWTH: f64 = 0.3;
/// Last index of [`TIMES`] at which a vehicle waits for a crossing AV; later forecasts are too
/// uncertain.
const AV_CROSSING_HORIZON: usize = 19;

/// Forecast behaviour of the AV.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum AvForecast {
    /// It goes on as observed: acceleration and curvature decay.
    GoesOn,
    /// It brakes from now on, with the deceleration of the settings.
    Brakes,
    /// It keeps its speed; its curvature decays.
    KeepsSpeed,
    /// It follows one of its lanes, with a speed as when it goes on.
    FollowsLane,
}

/// Forecasts that the AV goes on as observed, with a box that grows with time. `None` if the AV is absent.
pub(super) fn av(seen: &Observation<'_>, settings: &Settings) -> Option<(AvForecast, Obstacle)> {
    let goes_on = AvForecast::GoesOn;
    Some((goes_on, AvMotion::observed(seen)?.forecast(settings, goes_on, None)))
}

/// Returns all forecasts of an AV at this height, the first as [`av`]; empty if it is absent. An AV at
/// standstill has one: it stays.
pub(super) fn all_of_av(
    seen: &Observation<'_>,
    height: f64,
    settings: &Settings,
) -> Vec<(AvForecast, Obstacle)> {
    use AvForecast::{Brakes, FollowsLane, GoesOn, KeepsSpeed};
    let Some(motion) = AvMotion::observed(seen) else { return Vec::new() };
    if motion.stands() {
        return vec![(GoesOn, motion.forecast(settings, GoesOn, None))];
    }
    // Lanes lead ahead.
    let routes = match motion.reverses() {
        true => Vec::new(),
        false => routes(&seen.start().road().on_level(motion.now.position(), height), &motion.last),
    };
    let free = [GoesOn, Brakes, KeepsSpeed].map(|forecast| (forecast, None));
    let along = routes.iter().map(|route| (FollowsLane, Some(route)));
    let all = free.into_iter().chain(along);
    all.map(|(forecast, route)| (forecast, motion.forecast(settings, forecast, route))).collect()
}

/// Observed motion of the AV.
struct AvMotion<'a> {
    agent: &'a Agent,
    now: AgentState,
    /// Last known state: after one step if the protocol reveals it, else the present one.
    last: AgentState,
    /// Number of steps until the last known state.
    first: usize,
    /// Rate of change of the speed in the direction of motion, m/s².
    acceleration: f64,
    /// Curvature, 1/m: turn per metre ahead, so that it has the same sign in reverse.
    curvature: f64,
}

impl<'a> AvMotion<'a> {
    fn observed(seen: &Observation<'a>) -> Option<Self> {
        let track = seen.track(0);
        let mut known: Vec<Frame> = track[track.len().saturating_sub(TURN_FRAMES + 1)..].to_vec();
        known.extend(seen.av_next().map(Some));
        let (acceleration, curvature) = motion(&known);
        Some(Self {
            agent: &seen.start().agents[0],
            now: seen.state(0)?,
            last: known.last().copied().flatten()?,
            first: usize::from(seen.av_next().is_some()),
            acceleration,
            curvature,
        })
    }

    fn reverses(&self) -> bool {
        forward(&self.last) < 0.0
    }

    fn stands(&self) -> bool {
        forward(&self.last).abs() < STANDSTILL_SPEED && self.acceleration.abs() < 0.5
    }

    /// Returns the AV as an obstacle, on a route or along its curvature.
    fn forecast(&self, settings: &Settings, forecast: AvForecast, route: Option<&Route>) -> Obstacle {
        let Self { agent, now, last, first, curvature, .. } = *self;
        if self.stands() {
            let mut standing = Obstacle::standing(last.footprint(agent));
            standing.is_av = true;
            standing.side = settings.av_side;
            return standing;
        }
        let acceleration = match forecast {
            AvForecast::GoesOn | AvForecast::FollowsLane => self.acceleration,
            AvForecast::Brakes => -settings.av_brake,
            AvForecast::KeepsSpeed => 0.0,
        };
        let direction_of_motion = if self.reverses() { -1.0 } else { 1.0 };
        let mut speed = forward(&last).abs();
        let mut poses = [Pose::from(now); STEPS + 1];
        let mut speeds = [forward(&now); STEPS + 1];
        let mut pose = Pose::from(last);
        let mut distance = 0.0;
        for k in first..=STEPS {
            if k == 0 {
                continue;
            }
            if k > first {
                let t = (k - first) as f64 * DT;
                let a = match acceleration {
                    a if a > 0.0 => a * math::exp(-t / ACCELERATION_DECAY_TIME),
                    a if t <= BRAKING_DURATION => a,
                    _ => 0.0,
                };
                speed = (speed + a * DT).max(0.0);
                let decayed = curvature * math::exp(-distance / CURVATURE_DECAY_DISTANCE);
                pose = pose.advance(direction_of_motion * speed * DT, decayed);
                distance += speed * DT;
                if let Some(route) = route {
                    pose = route.pose(distance);
                }
            }
            (poses[k], speeds[k]) = (pose, direction_of_motion * speed);
        }
        let boxes = std::array::from_fn(|time| {
            let k = step_of(time);
            let t = k as f64 * DT;
            let length = agent.length + 2.0 * (LENGTH_GROWTH * t).min(MAX_LENGTH_GROWTH);
            let width = agent.width + 2.0 * (WIDTH_GROWTH * t).min(MAX_WIDTH_GROWTH);
            OrientedBox::new(poses[k].position, poses[k].heading, length, width)
        });
        let velocities = std::array::from_fn(|time| {
            let k = step_of(time);
            direction(poses[k].heading) * speeds[k]
        });
        let mut obstacle = Obstacle::new(boxes, velocities);
        obstacle.is_av = true;
        obstacle.crossing_horizon = AV_CROSSING_HORIZON;
        obstacle.side = settings.av_side;
        obstacle
    }
}

fn forward(state: &AgentState) -> f64 {
    let along = state.forward_speed();
    let speed = state.velocity().map_or(0.0, |v| v.norm());
    if along < -STANDSTILL_SPEED { -speed } else { speed }
}

/// Returns the acceleration in the direction of motion, m/s², and the curvature, 1/m, of observed motion.
fn motion(known: &[Frame]) -> (f64, f64) {
    let at = |back: usize| known.len().checked_sub(back + 1).and_then(|i| known[i]);
    let Some(last) = at(0) else { return (0.0, 0.0) };
    let sign = if forward(&last) < 0.0 { -1.0 } else { 1.0 };
    let acceleration = match at(ACCELERATION_FRAMES) {
        Some(before) => sign * (forward(&last) - forward(&before)) / (DT * ACCELERATION_FRAMES as f64),
        None => 0.0,
    };
    let acceleration = if acceleration.is_finite() { acceleration.clamp(-6.0, 3.0) } else { 0.0 };
    let curvature = sign * curvature(known, TURN_FRAMES, 1.0).unwrap_or(0.0);
    (acceleration, curvature.clamp(-0.25, 0.25))
}

/// Returns the curvature of the motion over the last `frames` frames, 1/m; `None` if the distance is
/// shorter than `least` metres or frames are missing.
pub(super) fn curvature(track: &[Frame], frames: usize, least: f64) -> Option<f64> {
    let from = track.len().checked_sub(frames + 1)?;
    let (mut distance, mut turn) = (0.0, 0.0);
    for pair in track[from..].windows(2) {
        let (a, b) = (pair[0]?, pair[1]?);
        distance += (b.position() - a.position()).norm();
        turn += wrap(b.heading - a.heading);
    }
    let curvature = turn / distance;
    (distance >= least && curvature.is_finite()).then_some(curvature)
}

/// Returns the obstacle of an agent whose poses after every step are known.
pub(super) fn known_obstacle(agent: &Agent, now: &AgentState, poses: impl Fn(usize) -> Pose) -> Obstacle {
    let at = |k: usize| if k == 0 { Pose::from(*now) } else { poses(k - 1) };
    let boxes = std::array::from_fn(|time| {
        let pose = at(step_of(time));
        OrientedBox::new(pose.position, pose.heading, agent.length, agent.width)
    });
    let velocities: [Vec2; TIMES] = std::array::from_fn(|time| {
        let k = step_of(time).max(1);
        (at(k).position - at(k - 1).position) / DT
    });
    Obstacle::new(boxes, velocities)
}

/// Returns the poses of an agent that follows its own plan and then keeps its last velocity.
pub(super) fn continued_poses(now: &AgentState, planned: &[AgentState]) -> [Pose; STEPS] {
    let last = planned.last().copied().unwrap_or(*now);
    let velocity = match planned.len() {
        0 => now.velocity().unwrap_or_default(),
        n => (last.position() - now.position()) / (DT * n as f64),
    };
    std::array::from_fn(|k| match planned.get(k) {
        Some(state) => Pose::from(*state),
        None => Pose {
            position: last.position() + velocity * (DT * (k + 1 - planned.len()) as f64),
            heading: last.heading,
        },
    })
}
