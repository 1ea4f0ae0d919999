//! Where others will be, as far as can be seen now.

use reactsim::dynamics::Pose;
use reactsim::geometry::{OrientedBox, Vec2, direction, math, wrap};
use reactsim::rollout::Observation;
use reactsim::scene::{Agent, AgentState, DT, Frame};

use super::obstacle::{Obstacle, TIMES, step_of};
use super::settings::Settings;
use super::speed::STEPS;

/// Frames over which the acceleration and the turn rate of the AV are taken.
const ACCELERATION_FRAMES: usize = 3;
const TURN_FRAMES: usize = 5;
/// How long an acceleration lasts, s: that of who speeds up fades, that of who brakes goes on.
const SPEEDING_UP_FADES: f64 = 1.0;
const BRAKING_LASTS: f64 = 3.0;
/// Way over which a bend fades, metres.
const BEND_FADES: f64 = 20.0;
/// How an uncertain box grows per second and how far at most, metres: ahead and behind, and at the sides.
const GROWTH: (f64, f64) = (0.25, 0.08);
const MOST_GROWTH: (f64, f64) = (1.0, 0.3);
/// Times up to which the AV's forecast is waited for where it crosses.
const AV_SIGHT: usize = 19;
/// Slower ones stand, m/s.
const STANDING: f64 = 0.1;

/// The AV: constant turn rate and acceleration from what was seen of it, which fade; its box grows with time. `None` where it is absent.
pub(super) fn av(seen: &Observation<'_>, settings: &Settings) -> Option<Obstacle> {
    let agent = &seen.start().agents[0];
    let now = seen.state(0)?;
    let mut known: Vec<Frame> = seen.track(0).to_vec();
    known.extend(seen.av_next().map(Some));
    let last = known.last().copied().flatten()?;
    let first = known.len() - seen.track(0).len();
    let (acceleration, curvature) = motion(&known);
    let mut speed = forward(&last);
    if speed.abs() < STANDING && acceleration.abs() < 0.5 {
        let mut standing = Obstacle::standing(last.footprint(agent));
        standing.is_av = true;
        standing.side = settings.av_side;
        return Some(standing);
    }
    let mut poses = [Pose { position: now.position(), heading: now.heading }; STEPS + 1];
    let mut speeds = [forward(&now); STEPS + 1];
    let mut pose = Pose { position: last.position(), heading: last.heading };
    let mut way = 0.0;
    for k in first..=STEPS {
        if k == 0 {
            continue;
        }
        if k > first {
            let t = (k - first) as f64 * DT;
            let a = match acceleration {
                a if a > 0.0 => a * math::exp(-t / SPEEDING_UP_FADES),
                a if t <= BRAKING_LASTS => a,
                _ => 0.0,
            };
            speed = if speed >= 0.0 { (speed + a * DT).max(0.0) } else { speed };
            pose = pose.advance(speed * DT, curvature * math::exp(-way / BEND_FADES));
            way += speed.abs() * DT;
        }
        (poses[k], speeds[k]) = (pose, speed);
    }
    let boxes = std::array::from_fn(|time| {
        let k = step_of(time);
        let t = k as f64 * DT;
        let length = agent.length + 2.0 * (GROWTH.0 * t).min(MOST_GROWTH.0);
        let width = agent.width + 2.0 * (GROWTH.1 * t).min(MOST_GROWTH.1);
        OrientedBox::new(poses[k].position, poses[k].heading, length, width)
    });
    let velocities = std::array::from_fn(|time| {
        let k = step_of(time);
        direction(poses[k].heading) * speeds[k]
    });
    let mut obstacle = Obstacle::new(boxes, velocities);
    obstacle.is_av = true;
    obstacle.sight = AV_SIGHT;
    obstacle.side = settings.av_side;
    Some(obstacle)
}

fn forward(state: &AgentState) -> f64 {
    let along = state.forward_speed();
    let speed = state.velocity().map_or(0.0, |v| v.norm());
    if along < -STANDING { -speed } else { speed }
}

/// Acceleration, m/s², and curvature, 1/m, of who moved like this.
fn motion(known: &[Frame]) -> (f64, f64) {
    let at = |back: usize| known.len().checked_sub(back + 1).and_then(|i| known[i]);
    let Some(last) = at(0) else { return (0.0, 0.0) };
    let acceleration = match at(ACCELERATION_FRAMES) {
        Some(before) => (forward(&last) - forward(&before)) / (DT * ACCELERATION_FRAMES as f64),
        None => 0.0,
    };
    let acceleration = if acceleration.is_finite() { acceleration.clamp(-6.0, 3.0) } else { 0.0 };
    let curvature = curvature(known, TURN_FRAMES, 1.0).unwrap_or(0.0);
    (acceleration, curvature.clamp(-0.25, 0.25))
}

/// Curvature of the last frames' way, 1/m; `None` where that is shorter than `least` metres or has gaps.
pub(super) fn curvature(track: &[Frame], frames: usize, least: f64) -> Option<f64> {
    let from = track.len().checked_sub(frames + 1)?;
    let (mut way, mut turn) = (0.0, 0.0);
    for pair in track[from..].windows(2) {
        let (a, b) = (pair[0]?, pair[1]?);
        way += (b.position() - a.position()).norm();
        turn += wrap(b.heading - a.heading);
    }
    let curvature = turn / way;
    (way >= least && curvature.is_finite()).then_some(curvature)
}

/// Who moves as it is known: the centre and heading after every step.
pub(super) fn known(agent: &Agent, now: &AgentState, poses: impl Fn(usize) -> Pose) -> Obstacle {
    let at = |k: usize| {
        if k == 0 { Pose { position: now.position(), heading: now.heading } } else { poses(k - 1) }
    };
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

/// The states that somebody will have by its own plan, which goes on as it ended.
pub(super) fn going_on(now: &AgentState, planned: &[AgentState]) -> [Pose; STEPS] {
    let last = planned.last().copied().unwrap_or(*now);
    let velocity = match planned.len() {
        0 => now.velocity().unwrap_or_default(),
        n => (last.position() - now.position()) / (DT * n as f64),
    };
    std::array::from_fn(|k| match planned.get(k) {
        Some(s) => Pose { position: s.position(), heading: s.heading },
        None => Pose {
            position: last.position() + velocity * (DT * (k + 1 - planned.len()) as f64),
            heading: last.heading,
        },
    })
}
