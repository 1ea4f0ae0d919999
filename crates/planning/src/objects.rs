//! The objects around ego at one sample.

use std::sync::Arc;

use reactsim_geometry::{OrientedBox, Vec2, math};
use reactsim_scene::named_enum;

/// The name of an object; the same at every sample.
pub type ObjectId = Arc<str>;

named_enum! {
    name, from_name;

    /// The class of an object (nuPlan's `TrackedObjectType`).
    #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
    pub enum ObjectKind {
        /// Cars, trucks, buses, motorcycles.
        Vehicle = "vehicle",
        /// People on foot.
        Pedestrian = "pedestrian",
        /// People on bicycles.
        Bicycle = "bicycle",
        /// Cones.
        TrafficCone = "traffic_cone",
        /// Barriers.
        Barrier = "barrier",
        /// Signs of construction zones.
        ConstructionSign = "czone_sign",
        /// Anything else that does not move.
        GenericObject = "generic_object",
    }
}

/// The groups of objects that the collision metric distinguishes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum ObjectGroup {
    /// Pedestrians and bicycles.
    VulnerableRoadUser,
    /// Vehicles.
    Vehicle,
    /// Static objects.
    Object,
}

impl ObjectKind {
    /// Returns the group of the collision metric.
    pub const fn group(self) -> ObjectGroup {
        match self {
            Self::Pedestrian | Self::Bicycle => ObjectGroup::VulnerableRoadUser,
            Self::Vehicle => ObjectGroup::Vehicle,
            Self::TrafficCone | Self::Barrier | Self::ConstructionSign | Self::GenericObject => {
                ObjectGroup::Object
            }
        }
    }

    /// Returns whether objects of this kind have speed 0 whatever their recorded velocity.
    pub const fn is_static(self) -> bool {
        matches!(self.group(), ObjectGroup::Object)
    }
}

/// An object at one sample.
#[derive(Clone, Debug, PartialEq)]
pub struct TrackedObject {
    /// Name.
    pub id: ObjectId,
    /// Class.
    pub kind: ObjectKind,
    /// Centre of the box, metres, frame of the map.
    pub center: Vec2,
    /// Heading, radians counter-clockwise from the x axis of the map.
    pub heading: f64,
    /// Extent along the heading, metres.
    pub length: f64,
    /// Extent across the heading, metres.
    pub width: f64,
    /// Velocity, m/s, axes of the map.
    pub velocity: Vec2,
}

impl TrackedObject {
    /// Returns the box.
    pub fn footprint(&self) -> OrientedBox {
        OrientedBox::new(self.center, self.heading, self.length, self.width)
    }

    /// Returns the radius of the circle around the box, metres.
    pub fn radius(&self) -> f64 {
        math::hypot(0.5 * self.length, 0.5 * self.width)
    }

    /// Returns the magnitude of the velocity, m/s; 0 for static kinds.
    pub fn speed(&self) -> f64 {
        if self.kind.is_static() { 0.0 } else { math::hypot(self.velocity.x, self.velocity.y) }
    }

    /// Returns whether all numbers are finite.
    pub fn is_finite(&self) -> bool {
        let numbers = [self.center.x, self.center.y, self.heading, self.length, self.width];
        numbers.into_iter().chain([self.velocity.x, self.velocity.y]).all(f64::is_finite)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn static_kinds_have_no_speed() {
        let moved = |kind| TrackedObject {
            id: "a".into(),
            kind,
            center: Vec2::zeros(),
            heading: 0.0,
            length: 1.0,
            width: 1.0,
            velocity: Vec2::new(3.0, 4.0),
        };
        assert_eq!(moved(ObjectKind::Pedestrian).speed(), 5.0);
        assert_eq!(moved(ObjectKind::Barrier).speed(), 0.0);
    }

    #[test]
    fn names_are_unique() {
        for kind in ObjectKind::ALL {
            assert_eq!(ObjectKind::from_name(kind.name()), Some(kind));
        }
    }
}
