//! Driving of a path at planned speeds within the limits of the vehicle, whatever the programs return.

use reactsim_geometry::direction;
use reactsim_scene::dynamics::VehicleMotion;
use reactsim_scene::{AgentState, DT};

use super::path::Path;
use super::settings::Settings;
use super::speed::STEPS;

/// Speed in m/s below which a vehicle stands still.
const STANDSTILL_SPEED: f64 = 0.05;
/// Largest sine of the slip angle, between the motion of the box centre and the heading.
const MAX_SLIP_SINE: f64 = 0.6;

/// Drives along a path with one acceleration per step. `now.speed` is not negative.
///
/// The changes of speed and the curvatures are clamped as the metrics measure them: the speed of a step
/// is the distance that the box centre moves divided by 0.1 s, and the curvature is the turn divided by
/// the mean distance of two steps.
pub(super) fn drive(
    now: VehicleMotion,
    rear: f64,
    path: &Path,
    accelerations: &[f64; STEPS],
    settings: &Settings,
) -> Vec<VehicleMotion> {
    let max_change = settings.acceleration * DT;
    let (mut moving, mut planned, mut arc) = (now, now.speed, 0.0);
    let mut moves = Vec::with_capacity(STEPS);
    for a in accelerations {
        planned = (planned + a * DT).max(0.0);
        let before = moving.speed;
        let desired = if planned < STANDSTILL_SPEED { 0.0 } else { planned };
        let next = desired.clamp((before - max_change).max(0.0), before + max_change);
        let length = next * DT;
        let curvature = path.curvature(arc + 0.5 * length);
        let slip = rear * curvature;
        let mut turn = curvature * length / (1.0 + slip * slip).sqrt();
        let mut largest = settings.curvature * DT * next.min(0.5 * (before + next));
        if rear > 0.0 {
            largest = largest.min(MAX_SLIP_SINE * length / rear);
        }
        turn = turn.clamp(-largest, largest);
        moving = moving.moved(next, turn, rear);
        arc += length;
        moves.push(moving);
    }
    moves
}

/// Deceleration after the last planned step, m/s².
const HALT_DECELERATION: f64 = 3.0;

/// Extends a plan to `steps` states: the agent goes straight on and brakes to a halt. `now` is the
/// state before the first.
pub(super) fn halt(now: &AgentState, states: &mut Vec<AgentState>, steps: usize) {
    let (Some(&last), before) = (states.last(), states.len().checked_sub(2).map_or(*now, |i| states[i]))
    else {
        return;
    };
    let axis = direction(last.heading);
    let mut speed = (last.position() - before.position()).dot(&axis) / DT;
    let mut at = last.position();
    while states.len() < steps {
        speed = speed.signum() * (speed.abs() - HALT_DECELERATION * DT).max(0.0);
        let from = at;
        at += axis * (speed * DT);
        let v = (at - from) / DT;
        states.push(AgentState { x: at.x, y: at.y, vx: v.x, vy: v.y, ..last });
    }
}
