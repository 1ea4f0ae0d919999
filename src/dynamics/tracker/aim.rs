//! What a tracker steers for: the planned poses with the steps that lead to them, and how the plan would go on.

use super::{Ability, PREVIEW, STANDING};
use crate::dynamics::Pose;
use crate::geometry::{Vec2, direction, left, wrap};
use crate::scene::DT;

/// Steps at the end of a plan that tell how it would go on.
const TAIL: usize = 5;

/// A planned pose with the step that leads there.
#[derive(Clone, Copy, Debug)]
pub(super) struct Aim {
    pub(super) centre: Vec2,
    pub(super) axle: Vec2,
    pub(super) heading: f64,
    /// Way of the centre from the aim before over 0.1 s, negative backwards, m/s.
    pub(super) speed: f64,
    /// Direction of that way, turned ahead.
    pub(super) ahead: Vec2,
}

impl Aim {
    /// The aim at `pose`, 0.1 s after the centre was at `before`.
    fn new(pose: &Pose, before: Vec2, rear: f64) -> Self {
        let facing = direction(pose.heading);
        let way = pose.position - before;
        let (length, along) = (way.norm(), way.dot(&facing));
        let sign = if along < 0.0 { -1.0 } else { 1.0 };
        // Way that goes aside is none that a vehicle could drive.
        let drivable = length > 1e-3 && along.abs() > 0.7 * length;
        let (way, ahead) = if drivable { (sign * length, way * (sign / length)) } else { (along, facing) };
        Self {
            centre: pose.position,
            axle: pose.position - facing * rear,
            heading: pose.heading,
            speed: way / DT,
            ahead,
        }
    }

    /// The aim where the rear axle has this pose, at this speed of the centre on an arc.
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

/// Replaces `aims` by those of a plan that starts at `now`, and [`PREVIEW`] more, for which the plan goes on as it ended: at its last
/// speed, with the curvature of its last half second. Empty plans have no aims.
pub(super) fn aim(ability: &Ability, now: Pose, poses: &[Pose], aims: &mut Vec<Aim>) {
    let rear = ability.rear;
    aims.clear();
    let mut before = now.position;
    for pose in poses {
        aims.push(Aim::new(pose, before, rear));
        before = pose.position;
    }
    let Some(&last) = aims.last() else { return };
    let tail = aims.len().saturating_sub(TAIL);
    let (mut axle, heading) = match tail.checked_sub(1) {
        Some(i) => (aims[i].axle, aims[i].heading),
        None => (now.position - direction(now.heading) * rear, now.heading),
    };
    let mut way = 0.0;
    for aim in &aims[tail..] {
        way += (aim.axle - axle).norm();
        axle = aim.axle;
    }
    let stands = last.speed.abs() <= STANDING;
    let turn = wrap(last.heading - heading);
    // The way of poses that stand is noise.
    let bent = way > 0.05 && !stands;
    let curvature = if bent { (turn / way).clamp(-ability.curvature, ability.curvature) } else { 0.0 };
    let sign = if last.speed < 0.0 { -1.0 } else { 1.0 };
    let slip = rear * curvature * sign;
    let step = if stands { 0.0 } else { last.speed * DT / (1.0 + slip * slip).sqrt() };
    let mut pose = Pose { position: last.axle, heading: last.heading };
    for _ in 0..PREVIEW {
        pose = pose.advance(step, sign * curvature);
        aims.push(Aim::on_arc(&pose, rear, slip, last.speed));
    }
}
