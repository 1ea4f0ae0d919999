//! Collisions that are the fault of ego (nuPlan devkit 1.2.2, `no_ego_at_fault_collisions`).

use std::collections::BTreeSet;

use reactsim_geometry::math;
use reactsim_scene::named_enum;

use crate::contact::{STOPPED_SPEED, classify, in_contact};
use crate::{EgoState, ObjectGroup, ObjectId, ObjectKind, TrackedObject};

use super::context::Context;
use super::{MetricValue, UndefinedReason};

/// Number of collisions with objects, such as cones, that do not give 0 (devkit 1.2.2).
const TOLERATED_OBJECTS: usize = 1;

named_enum! {
    id;

    /// The kind of a contact, by motion and position of both.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
    pub enum ContactClass {
        /// Ego is stopped: never its fault.
        StoppedEgo = "stopped-ego",
        /// The object is stopped: the fault of ego.
        StoppedTrack = "stopped-track",
        /// The object is behind ego: not its fault.
        ActiveRear = "active-rear",
        /// The front of ego meets the object: the fault of ego.
        ActiveFront = "active-front",
        /// Any other contact: the fault of ego if it is not in a common lane.
        ActiveLateral = "active-lateral",
    }
}

/// The first contact of ego with an object.
#[derive(Clone, Debug, PartialEq)]
pub struct FirstContact {
    /// Sample.
    pub step: usize,
    /// Id of the object.
    pub object: ObjectId,
    /// Class of the object.
    pub kind: ObjectKind,
    /// Class of the contact.
    pub class: ContactClass,
    /// Whether it is the fault of ego; `None` for a lateral contact in a map without lanes.
    pub at_fault: Option<bool>,
    /// Change of the velocity of each of two equal masses in an inelastic collision, m/s. It does not affect
    /// the value.
    pub delta_v: f64,
}

/// Numbers of contacts that are the fault of ego.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct AtFaultCounts {
    /// With pedestrians and bicycles.
    pub vulnerable: usize,
    /// With vehicles.
    pub vehicles: usize,
    /// With static objects.
    pub objects: usize,
}

/// Result of the collision metric.
#[derive(Clone, Debug, PartialEq)]
pub struct Collisions {
    /// 1, 0.5 for one static object, or 0.
    pub value: MetricValue,
    /// The first contact with each object, by sample and then in the order of the objects.
    pub contacts: Vec<FirstContact>,
    /// Numbers of contacts that are the fault of ego.
    pub at_fault: AtFaultCounts,
}

/// Judges the collisions. An object counts at its first contact only, whoever is at fault.
pub(super) fn collisions(context: &Context<'_>) -> Collisions {
    let contacts = first_contacts(context);
    let at_fault = count(&contacts);
    let undecided = contacts.iter().any(|contact| contact.at_fault.is_none());
    let value = if undecided {
        MetricValue::Undefined(UndefinedReason::LateralContactWithoutLanes)
    } else {
        MetricValue::Defined(score(at_fault))
    };
    Collisions { value, contacts, at_fault }
}

fn first_contacts(context: &Context<'_>) -> Vec<FirstContact> {
    let mut contacts = Vec::new();
    let mut collided: BTreeSet<ObjectId> = BTreeSet::new();
    for (step, objects) in context.history.objects.iter().enumerate() {
        for object in objects {
            let ego = &context.footprints[step];
            // Most objects are too far away, and their boxes need not be made.
            let is_near = (object.center - ego.center).norm() < ego.radius() + object.radius();
            let touches = || is_near && in_contact(ego, &object.footprint());
            if !collided.contains(&object.id) && touches() {
                collided.insert(object.id.clone());
                contacts.push(contact(context, step, object));
            }
        }
    }
    contacts
}

fn contact(context: &Context<'_>, step: usize, object: &TrackedObject) -> FirstContact {
    let ego = &context.history.ego[step];
    let is_stopped = object.kind.is_static() || object.speed() <= STOPPED_SPEED;
    let class = classify(ego, &context.footprints[step], &object.footprint(), is_stopped);
    let at_fault = match class {
        ContactClass::StoppedEgo | ContactClass::ActiveRear => Some(false),
        ContactClass::StoppedTrack | ContactClass::ActiveFront => Some(true),
        ContactClass::ActiveLateral => context.in_common_lane(step).map(|is_common| !is_common),
    };
    let (object_id, kind) = (object.id.clone(), object.kind);
    FirstContact { step, object: object_id, kind, class, at_fault, delta_v: delta_v(ego, object) }
}

/// Returns half of the magnitude of the relative velocity, m/s, if both move along their headings.
fn delta_v(ego: &EgoState, object: &TrackedObject) -> f64 {
    let (v, u) = (ego.speed(), object.speed());
    let cos = math::cos(ego.heading - object.heading);
    0.5 * (v * v + u * u - 2.0 * v * u * cos).max(0.0).sqrt()
}

fn count(contacts: &[FirstContact]) -> AtFaultCounts {
    let of = |group: ObjectGroup| {
        contacts.iter().filter(|c| c.at_fault == Some(true) && c.kind.group() == group).count()
    };
    AtFaultCounts {
        vulnerable: of(ObjectGroup::VulnerableRoadUser),
        vehicles: of(ObjectGroup::Vehicle),
        objects: of(ObjectGroup::Object),
    }
}

fn score(counts: AtFaultCounts) -> f64 {
    factor(counts.vulnerable, 0) * factor(counts.vehicles, 0) * factor(counts.objects, TOLERATED_OBJECTS)
}

/// Returns 1 for no collision, falling to 0 for one more than is tolerated.
fn factor(collisions: usize, tolerated: usize) -> f64 {
    (1.0 - collisions as f64 / (tolerated + 1) as f64).max(0.0)
}
