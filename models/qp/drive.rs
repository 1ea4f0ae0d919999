//! Driving a path at planned speeds within what a vehicle is able to do: whatever was planned, this is what comes out.

use reactsim::dynamics::Moving;
use reactsim::geometry::direction;
use reactsim::scene::{AgentState, DT};

use super::settings::Settings;
use super::speed::STEPS;
use super::way::Way;

/// Slower vehicles stand, m/s.
const STANDING: f64 = 0.05;
/// Largest sine of the angle between the way of the box centre and the heading.
const LARGEST_SLIP: f64 = 0.6;

/// Drives along a path with the accelerations of the steps. `now.speed` is not negative.
///
/// Change of speed and curvature of every step are cut to the bounds in the metrics' own terms: the speed is the way of the box centre over
/// 0.1 s, the curvature the turn over the mean way of two steps.
pub(super) fn drive(
    now: Moving,
    rear: f64,
    way: &Way,
    accelerations: &[f64; STEPS],
    settings: &Settings,
) -> Vec<Moving> {
    let most = settings.acceleration * DT;
    let (mut moving, mut planned, mut arc) = (now, now.speed, 0.0);
    let mut moves = Vec::with_capacity(STEPS);
    for a in accelerations {
        planned = (planned + a * DT).max(0.0);
        let before = moving.speed;
        let wanted = if planned < STANDING { 0.0 } else { planned };
        let next = wanted.clamp((before - most).max(0.0), before + most);
        let length = next * DT;
        let curvature = way.curvature(arc + 0.5 * length);
        let slip = rear * curvature;
        let mut turn = curvature * length / (1.0 + slip * slip).sqrt();
        let mut largest = settings.curvature * DT * next.min(0.5 * (before + next));
        if rear > 0.0 {
            largest = largest.min(LARGEST_SLIP * length / rear);
        }
        turn = turn.clamp(-largest, largest);
        moving = moving.moved(next, turn, rear);
        arc += length;
        moves.push(moving);
    }
    moves
}

/// Braking after the last planned step, m/s².
const HALTS: f64 = 3.0;

/// Makes a plan longer, to so many states: what comes after it goes straight on and brakes to a halt. `now` is the state before the first.
pub(super) fn halt(now: &AgentState, states: &mut Vec<AgentState>, steps: usize) {
    let (Some(&last), before) = (states.last(), states.len().checked_sub(2).map_or(*now, |i| states[i]))
    else {
        return;
    };
    let axis = direction(last.heading);
    let mut speed = (last.position() - before.position()).dot(&axis) / DT;
    let mut at = last.position();
    while states.len() < steps {
        speed = speed.signum() * (speed.abs() - HALTS * DT).max(0.0);
        let from = at;
        at += axis * (speed * DT);
        let v = (at - from) / DT;
        states.push(AgentState { x: at.x, y: at.y, vx: v.x, vy: v.y, ..last });
    }
}
