//! Forecast of the objects around ego: constant speed along their headings, and red connectors as obstacles
//! (tuplan_garage b51d5d0, `PDMObservation` and `PDMObjectManager`).

use std::collections::BTreeSet;
use std::f64::consts::FRAC_PI_2;

use reactsim_geometry::{Bounds, OrientedBox, Vec2, direction, heading_of, wrap};

use crate::path::{Corridor, Path};
use crate::planner::PlannerInput;
use crate::shapes::{SKIP_MARGIN, Shape, box_ring_distance, ring_centroid, ring_covers_box};
use crate::trajectory::STEP;
use crate::{ObjectId, ObjectKind, TrackedObject};

/// Distance in metres from the centre of ego up to which objects are considered (tuplan_garage b51d5d0,
/// `map_radius`).
const RADIUS: f64 = 50.0;
/// Largest numbers of vehicles, pedestrians and bicycles, the nearest of each kind (tuplan_garage b51d5d0,
/// `MAX_DYNAMIC_OBJECTS`).
const MAX_AGENTS: [(ObjectKind, usize); 3] =
    [(ObjectKind::Vehicle, 50), (ObjectKind::Pedestrian, 25), (ObjectKind::Bicycle, 10)];
/// Largest number of static objects, the nearest ones (tuplan_garage b51d5d0, `MAX_STATIC_OBJECTS`).
const MAX_STATIC: usize = 50;
/// Number of steps for which an object is at one place (tuplan_garage b51d5d0, `observation_sample_res`).
const STEPS_PER_SAMPLE: usize = 2;

/// Identity of an obstacle over iterations.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum ObstacleId {
    Object(ObjectId),
    /// Index of a connector.
    RedConnector(usize),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ObstacleKind {
    /// Vehicle, pedestrian or bicycle.
    Agent,
    /// Cone, barrier, sign or generic object.
    Static,
    /// Connector with a red light.
    RedConnector,
}

/// An obstacle with its motion.
#[derive(Clone, Debug)]
pub(super) struct Obstacle {
    pub(super) kind: ObstacleKind,
    /// Ground at present.
    pub(super) shape: Shape,
    /// Centroid at present, metres.
    pub(super) centroid: Vec2,
    /// Radius of the smallest circle around the centroid that contains the ground, metres.
    pub(super) radius: f64,
    /// Velocity of the forecast, m/s.
    pub(super) drift: Vec2,
    /// Observed heading, radians.
    pub(super) heading: f64,
    /// Observed speed, m/s; 0 except for agents.
    pub(super) speed: f64,
    /// Whether ego overlaps or overlapped it: it is ignored by proposals and scores.
    pub(super) ignored: bool,
}

impl Obstacle {
    fn of_object(object: &TrackedObject) -> Self {
        let is_agent = !object.kind.is_static();
        Self {
            kind: if is_agent { ObstacleKind::Agent } else { ObstacleKind::Static },
            shape: Shape::Box(object.footprint()),
            radius: object.footprint().radius(),
            centroid: object.center,
            drift: if is_agent { drift(object) } else { Vec2::zeros() },
            heading: object.heading,
            speed: object.speed(),
            ignored: false,
        }
    }

    fn of_red_connector(outline: Vec<Vec2>) -> Self {
        let centroid = ring_centroid(&outline);
        Self {
            kind: ObstacleKind::RedConnector,
            centroid,
            radius: outline.iter().map(|p| (p - centroid).norm()).fold(0.0, f64::max),
            shape: Shape::Outline(outline),
            drift: Vec2::zeros(),
            heading: 0.0,
            speed: 0.0,
            ignored: false,
        }
    }

    pub(super) fn is_standing(&self) -> bool {
        self.drift == Vec2::zeros()
    }

    /// Returns the displacement at a step of the forecast, metres.
    fn displacement(&self, step: usize) -> Vec2 {
        self.drift * (STEP * (step / STEPS_PER_SAMPLE * STEPS_PER_SAMPLE) as f64)
    }

    /// Returns the centroid at a step of the forecast, metres.
    pub(super) fn centroid_at(&self, step: usize) -> Vec2 {
        self.centroid + self.displacement(step)
    }

    /// Returns the bounds of the obstacle, which is a box, from one step of the forecast to another.
    pub(super) fn swept(&self, first: usize, last: usize) -> Bounds {
        let ends = [first, last].map(|step| self.centroid_at(step));
        Bounds::of(ends).inflated(self.radius + SKIP_MARGIN)
    }

    /// Returns the distance in metres to a box at a step of the forecast, 0 if they touch or overlap;
    /// `None` if it is not below `bound`.
    pub(super) fn distance_below(&self, step: usize, other: &OrientedBox, bound: f64) -> Option<f64> {
        let centroid = self.centroid_at(step);
        // The sum of the half sides exceeds the radius by more than rounding errors.
        let reach = self.radius + other.half_length + other.half_width;
        if (centroid - other.center).norm() - reach >= bound {
            return None;
        }
        let distance = match &self.shape {
            Shape::Box(own) => OrientedBox { center: centroid, ..*own }.signed_distance(other).max(0.0),
            Shape::Outline(ring) => box_ring_distance(other, ring),
        };
        (distance < bound).then_some(distance)
    }

    /// Returns the box at a step of the forecast; `None` for red connectors.
    pub(super) fn box_at(&self, step: usize) -> Option<OrientedBox> {
        match &self.shape {
            Shape::Box(own) => Some(OrientedBox { center: self.centroid_at(step), ..*own }),
            Shape::Outline(_) => None,
        }
    }
}

/// Returns the velocity of an agent's forecast, m/s: its speed along its heading, backwards if it moves
/// more than 90° away from its heading.
fn drift(agent: &TrackedObject) -> Vec2 {
    let deviation = wrap(agent.heading - heading_of(agent.velocity)).abs();
    let forward = direction(agent.heading) * agent.speed();
    if deviation < FRAC_PI_2 { forward } else { -forward }
}

/// The obstacles around ego.
#[derive(Clone, Debug)]
pub(super) struct Forecast {
    pub(super) obstacles: Vec<Obstacle>,
}

impl Forecast {
    /// Observes the obstacles of an iteration. Obstacles that ego overlaps are added to `ignored`;
    /// objects in `ignored` from earlier iterations are left out. `on_route` are the lanes of the route.
    pub(super) fn observe(
        input: &PlannerInput<'_>,
        on_route: &BTreeSet<usize>,
        ignored: &mut BTreeSet<ObstacleId>,
    ) -> Self {
        let center = input.ego().center(input.shape);
        let objects = nearest_objects(input.objects(), center, ignored);
        let mut obstacles: Vec<(ObstacleId, Obstacle)> = objects
            .into_iter()
            .map(|object| (ObstacleId::Object(object.id.clone()), Obstacle::of_object(object)))
            .collect();
        for lane in input.red_connectors().filter(|lane| on_route.contains(lane)) {
            let outline = input.map.lane_area(lane).outline().to_vec();
            obstacles.push((ObstacleId::RedConnector(lane), Obstacle::of_red_connector(outline)));
        }
        let ego = input.ego().footprint(input.shape);
        for (id, obstacle) in &mut obstacles {
            let overlaps = match &obstacle.shape {
                Shape::Box(other) => ego.separation(other) <= 0.0,
                Shape::Outline(ring) => ring_covers_box(ring, &ego),
            };
            if overlaps {
                ignored.insert(id.clone());
            }
            obstacle.ignored = ignored.contains(id);
        }
        Self { obstacles: obstacles.into_iter().map(|(_, obstacle)| obstacle).collect() }
    }

    /// Returns the obstacles that may be in a corridor of a path.
    pub(super) fn along<'a>(&'a self, path: &'a Path, corridor: &'a Corridor) -> CorridorTraffic<'a> {
        let relevant = self.obstacles.iter().filter(|obstacle| !obstacle.ignored);
        let (standing, moving): (Vec<_>, Vec<_>) = relevant.partition(|obstacle| obstacle.is_standing());
        let inside = standing.into_iter().filter(|obstacle| corridor.touches(&obstacle.shape));
        let standing = inside.map(|obstacle| (path.project(obstacle.centroid), obstacle)).collect();
        CorridorTraffic { path, corridor, standing, moving }
    }
}

/// Obstacles that are in a corridor, or may drive into it.
#[derive(Debug)]
pub(super) struct CorridorTraffic<'a> {
    path: &'a Path,
    corridor: &'a Corridor,
    /// Standing obstacles in the corridor, with their progress on the path.
    standing: Vec<(f64, &'a Obstacle)>,
    moving: Vec<&'a Obstacle>,
}

impl<'a> CorridorTraffic<'a> {
    /// Returns the obstacles that touch the corridor at a step of the forecast, with the progress of
    /// their centroids on the path, metres.
    pub(super) fn at(&self, step: usize) -> Vec<(f64, &'a Obstacle)> {
        let inside = |obstacle: &Obstacle| {
            obstacle.box_at(step).is_some_and(|other| self.corridor.touches_box(&other, obstacle.radius))
        };
        let moving = self.moving.iter().copied().filter(|obstacle| inside(obstacle));
        let moving = moving.map(|obstacle| (self.path.project(obstacle.centroid_at(step)), obstacle));
        self.standing.iter().copied().chain(moving).collect()
    }
}

/// Returns the nearest objects within [`RADIUS`] of `center` that are not ignored: static ones, then each
/// kind of agents, nearest first.
fn nearest_objects<'a>(
    objects: &'a [TrackedObject],
    center: Vec2,
    ignored: &BTreeSet<ObstacleId>,
) -> Vec<&'a TrackedObject> {
    let mut near: Vec<(f64, &TrackedObject)> = objects
        .iter()
        .map(|object| ((object.center - center).norm(), object))
        .filter(|(distance, object)| {
            *distance <= RADIUS
                && object.is_finite()
                && !ignored.contains(&ObstacleId::Object(object.id.clone()))
        })
        .collect();
    near.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut nearest: Vec<&TrackedObject> = near
        .iter()
        .filter(|(_, object)| object.kind.is_static())
        .map(|near| near.1)
        .take(MAX_STATIC)
        .collect();
    for (kind, count) in MAX_AGENTS {
        nearest.extend(near.iter().filter(|near| near.1.kind == kind).map(|near| near.1).take(count));
    }
    nearest
}

#[cfg(test)]
mod tests {
    use super::*;

    fn object(id: &str, kind: ObjectKind, x: f64, velocity: Vec2) -> TrackedObject {
        TrackedObject {
            id: id.into(),
            kind,
            center: Vec2::new(x, 0.0),
            heading: 0.0,
            length: 4.0,
            width: 2.0,
            velocity,
        }
    }

    #[test]
    fn forecasts_go_along_the_heading_in_steps_of_two() {
        let sliding = object("a", ObjectKind::Vehicle, 1.0, Vec2::new(3.0, 4.0));
        let obstacle = Obstacle::of_object(&sliding);
        assert!((obstacle.centroid_at(4) - Vec2::new(3.0, 0.0)).norm() < 1e-12);
        assert_eq!(obstacle.centroid_at(5), obstacle.centroid_at(4));
        let reversing = object("a", ObjectKind::Vehicle, 1.0, Vec2::new(-3.0, 4.0));
        assert!((Obstacle::of_object(&reversing).drift - Vec2::new(-5.0, 0.0)).norm() < 1e-12);
        let cone = object("a", ObjectKind::TrafficCone, 1.0, Vec2::new(-3.0, 4.0));
        assert!(Obstacle::of_object(&cone).is_standing());
    }

    #[test]
    fn the_nearest_of_each_kind_are_kept() {
        let mut objects: Vec<TrackedObject> = (0..12)
            .map(|i| object(&format!("b{i}"), ObjectKind::Bicycle, f64::from(12 - i), Vec2::zeros()))
            .collect();
        objects.push(object("far", ObjectKind::Vehicle, 50.1, Vec2::zeros()));
        objects.push(object("near", ObjectKind::Vehicle, 49.9, Vec2::zeros()));
        let ignored = BTreeSet::from([ObstacleId::Object("b11".into())]);
        let nearest = nearest_objects(&objects, Vec2::zeros(), &ignored);
        let ids: Vec<&str> = nearest.iter().map(|object| &*object.id).collect();
        assert_eq!(ids, ["near", "b10", "b9", "b8", "b7", "b6", "b5", "b4", "b3", "b2", "b1"]);
    }
}
