//! Targets of the tracker: the planned poses with the steps that lead to them, and the
//! extrapolation of the plan.

use reactsim_geometry::{Vec2, direction, left, wrap};

use super::{MotionLimits, PREVIEW_POSES, STANDSTILL_SPEED};
use crate::DT;
use crate::dynamics::Pose;

/// Number of steps at the end of a plan from which it is extrapolated.
const TAIL_STEPS: usize = 5;

/// A planned pose with the step that leads to it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Aim {
    pub(super) centre: Vec2,
    pub(super) axle: Vec2,
    pub(super) heading: f64,
    /// Distance of the centre from the previous aim divided by 0.1 s, m/s; negative backwards.
    pub(super) speed: f64,
    /// Direction of that step, reversed if it goes backwards.
    pub(super) ahead: Vec2,
}

impl Aim {
    /// Returns the aim at `pose`, 0.1 s after the centre was at `before`.
    fn new(pose: &Pose, before: Vec2, rear: f64) -> Self {
        let facing = direction(pose.heading);
        let step = pose.position - before;
        let (length, along) = (step.norm(), step.dot(&facing));
        let sign = if along < 0.0 { -1.0 } else { 1.0 };
        // A vehicle cannot drive a step that is mostly sideways.
        let drivable = length > 1e-3 && along.abs() > 0.7 * length;
        let (distance, ahead) =
            if drivable { (sign * length, step * (sign / length)) } else { (along, facing) };
        Self {
            centre: pose.position,
            axle: pose.position - facing * rear,
            heading: pose.heading,
            speed: distance / DT,
            ahead,
        }
    }

    /// Returns the aim at which the rear axle has the pose `axle`, with this slip and speed of the
    /// centre on an arc.
    fn on_arc(axle: &Pose, rear: f64, slip: f64, speed: f64) -> Self {
        let facing = direction(axle.heading);
        let ahead = (facing + left(facing) * slip) / (1.0 + slip * slip).sqrt();
        Self {
            centre: axle.position + facing * rear,
            axle: axle.position,
            heading: axle.heading,
            speed,
            ahead,
        }
    }
}

/// Replaces `aims` by those of a plan that starts at `now`, followed by [`PREVIEW_POSES`]
/// extrapolated ones: at the plan's last speed and with the curvature of its last half second. An
/// empty plan has no aims.
pub(super) fn aim(limits: &MotionLimits, now: Pose, poses: &[Pose], aims: &mut Vec<Aim>) {
    let rear = limits.rear;
    aims.clear();
    let mut before = now.position;
    for pose in poses {
        aims.push(Aim::new(pose, before, rear));
        before = pose.position;
    }
    let Some(&last) = aims.last() else { return };
    let tail = aims.len().saturating_sub(TAIL_STEPS);
    let (mut axle, heading) = match tail.checked_sub(1) {
        Some(i) => (aims[i].axle, aims[i].heading),
        None => (now.position - direction(now.heading) * rear, now.heading),
    };
    let mut arc = 0.0;
    for aim in &aims[tail..] {
        arc += (aim.axle - axle).norm();
        axle = aim.axle;
    }
    let stationary = last.speed.abs() <= STANDSTILL_SPEED;
    let turn = wrap(last.heading - heading);
    // The displacements of a stationary plan are noise.
    let curved = arc > 0.05 && !stationary;
    let curvature = if curved { (turn / arc).clamp(-limits.curvature, limits.curvature) } else { 0.0 };
    let sign = if last.speed < 0.0 { -1.0 } else { 1.0 };
    let slip = rear * curvature * sign;
    let step = if stationary { 0.0 } else { last.speed * DT / (1.0 + slip * slip).sqrt() };
    let mut pose = Pose { position: last.axle, heading: last.heading };
    for _ in 0..PREVIEW_POSES {
        pose = pose.advance(step, sign * curvature);
        aims.push(Aim::on_arc(&pose, rear, slip, last.speed));
    }
}
