//! Time to collision (nuPlan devkit 1.2.2, `time_to_collision_within_bound`).

use reactsim_geometry::OrientedBox;

use crate::contact::{Side, in_contact, moved, side_of};
use crate::map::Intersections;
use crate::{ObjectId, TrackedObject};

use super::collisions::Collisions;
use super::context::Context;
use super::{MetricValue, UndefinedReason};

/// Step of the projection, seconds (devkit 1.2.2).
const PROJECTION_STEP: f64 = 0.1;
/// Number of projected steps, up to 2.9 s; the horizon of 3 s is not tested (devkit 1.2.2).
const PROJECTION_STEPS: usize = 29;
/// Horizon of the projection, seconds (devkit 1.2.2).
pub(super) const PROJECTION_HORIZON: f64 = 3.0;
/// Time to collision in seconds above which ego is compliant (devkit 1.2.2).
const MIN_TTC: f64 = 0.95;
/// Speed of ego in m/s up to which it has no time to collision (devkit 1.2.2).
const STOPPED_SPEED: f64 = 0.005;

/// A time to collision within the bound.
#[derive(Clone, Debug, PartialEq)]
pub struct ShortTtc {
    /// Sample.
    pub step: usize,
    /// Time to collision, seconds; 0 for a collision at this sample that is the fault of ego.
    pub ttc: f64,
    /// Id of the object.
    pub object: ObjectId,
}

/// Result of the metric of the time to collision.
#[derive(Clone, Debug, PartialEq)]
pub struct TimeToCollision {
    /// 1 if the time to collision is above its bound at all samples, else 0.
    pub value: MetricValue,
    /// Time to collision per sample, seconds; infinite if there is none.
    pub ttc: Vec<f64>,
    /// Samples within the bound.
    pub short: Vec<ShortTtc>,
}

/// Judges the time to collision if ego and objects move along their headings at their speeds.
pub(super) fn time_to_collision(context: &Context<'_>, collisions: &Collisions) -> TimeToCollision {
    let mut ttc = Vec::with_capacity(context.samples());
    let mut short = Vec::new();
    for step in 0..context.samples() {
        let nearest = at_fault(collisions, step).or_else(|| projected(context, collisions, step));
        ttc.push(nearest.as_ref().map_or(f64::INFINITY, |(seconds, _)| *seconds));
        if let Some((ttc, object)) = nearest.filter(|(seconds, _)| *seconds <= MIN_TTC) {
            short.push(ShortTtc { step, ttc, object });
        }
    }
    let undecided = collisions.contacts.iter().any(|contact| contact.at_fault.is_none());
    let value = if short.is_empty() && undecided {
        MetricValue::Undefined(UndefinedReason::LateralContactWithoutLanes)
    } else {
        MetricValue::pass(short.is_empty())
    };
    TimeToCollision { value, ttc, short }
}

/// Returns time 0 and the object if a collision at `step` is the fault of ego.
fn at_fault(collisions: &Collisions, step: usize) -> Option<(f64, ObjectId)> {
    let contact = collisions.contacts.iter().find(|c| c.step == step && c.at_fault == Some(true))?;
    Some((0.0, contact.object.clone()))
}

/// Returns the time to the first projected contact at `step`, seconds, and the object.
fn projected(context: &Context<'_>, collisions: &Collisions, step: usize) -> Option<(f64, ObjectId)> {
    let ego = &context.history.ego[step];
    if ego.speed() <= STOPPED_SPEED {
        return None;
    }
    let footprint = &context.footprints[step];
    let swept = sweep(footprint, ego.speed());
    let has_collided = |object: &TrackedObject| {
        collisions.contacts.iter().any(|contact| contact.step <= step && contact.object == object.id)
    };
    // Whether objects at the side count takes most work, and few of them come near.
    let others: Vec<(OrientedBox, f64, &TrackedObject)> = context.history.objects[step]
        .iter()
        .filter(|object| !has_collided(object) && side_of(ego, object.center) != Side::Behind)
        .map(|object| (object.footprint(), object.speed(), object))
        .filter(|(other, speed, _)| in_contact(&swept, &sweep(other, *speed)))
        .filter(|(_, _, object)| is_candidate(context, step, object))
        .collect();
    let speed_of_ego = ego.speed();
    (1..=PROJECTION_STEPS).find_map(|m| {
        let time = m as f64 * PROJECTION_STEP;
        let here = moved(footprint, speed_of_ego * time);
        let hit = others.iter().find(|(other, speed, _)| in_contact(&here, &moved(other, speed * time)));
        hit.map(|(_, _, object)| (time, object.id.clone()))
    })
}

/// Returns the box that contains a box throughout the horizon.
fn sweep(footprint: &OrientedBox, speed: f64) -> OrientedBox {
    let half_travel = 0.5 * speed * PROJECTION_HORIZON;
    let middle = moved(footprint, half_travel);
    OrientedBox { half_length: footprint.half_length + half_travel, ..middle }
}

/// Returns whether an object counts: ahead of ego, or at its side while ego is across lanes or in an
/// intersection.
fn is_candidate(context: &Context<'_>, step: usize, object: &TrackedObject) -> bool {
    match side_of(&context.history.ego[step], object.center) {
        Side::Ahead => true,
        Side::Behind => false,
        Side::Lateral => context
            .in_common_lane(step)
            .is_some_and(|is_common| !is_common || is_in_intersection(context, step)),
    }
}

/// Returns whether the rear axle of ego is in an intersection. Without outlines, it is while a lane of the
/// centre is a connector.
fn is_in_intersection(context: &Context<'_>, step: usize) -> bool {
    let map = context.history.map;
    match map.intersections() {
        Intersections::Areas(areas) => areas.contains(context.history.ego[step].rear_axle()),
        Intersections::Connectors => {
            context.lanes().center[step].iter().any(|&lane| map.lane(lane).is_connector())
        }
        Intersections::Unknown => false,
    }
}
