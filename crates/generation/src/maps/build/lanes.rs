//! Lanes of a map under construction.

use reactsim_geometry::Vec2;
use reactsim_scene::{LaneClass, LaneKind, NeighborParts};

use super::connector::Pose;
use super::ring::ribbon;
use super::{Direction, Profile, Station};

/// Reference to a lane of a map under construction.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct LaneRef(pub(super) usize);

/// Properties of a lane other than its geometry.
#[derive(Clone, Debug, PartialEq)]
pub struct Spec {
    /// Id, unique in the map.
    pub id: String,
    /// Lane proper or connector.
    pub kind: LaneKind,
    /// Lane class.
    pub class: LaneClass,
    /// Speed limit, m/s.
    pub speed: f64,
}

impl Spec {
    /// Describes a lane proper.
    pub fn lane(id: impl Into<String>, class: LaneClass, speed: f64) -> Self {
        Self { id: id.into(), kind: LaneKind::Lane, class, speed }
    }

    /// Describes a lane that may overlap others: a path through a junction, a taper.
    pub fn connector(id: impl Into<String>, class: LaneClass, speed: f64) -> Self {
        Self { kind: LaneKind::Connector, ..Self::lane(id, class, speed) }
    }
}

/// A lane with its geometry and links.
#[derive(Clone, Debug)]
pub(super) struct Draft {
    pub(super) spec: Spec,
    pub(super) points: Vec<Vec2>,
    pub(super) ring: Vec<Vec2>,
    pub(super) half: f64,
    pub(super) start: Pose,
    pub(super) end: Pose,
    pub(super) successors: Vec<usize>,
    pub(super) predecessors: Vec<usize>,
    pub(super) left: Vec<(usize, NeighborParts)>,
    pub(super) right: Vec<(usize, NeighborParts)>,
}

impl Draft {
    /// Creates a lane along stations of a path, with its centre and half its width given over the arc
    /// length.
    pub(super) fn along(
        spec: Spec,
        stations: &[Station],
        centre: &Profile,
        half: &Profile,
        direction: Direction,
    ) -> Self {
        let mut points: Vec<Vec2> = stations.iter().map(|p| p.aside(centre.at(p.s))).collect();
        let mut ring: Vec<Vec2> = stations.iter().map(|p| p.aside(centre.at(p.s) - half.at(p.s))).collect();
        ring.extend(stations.iter().rev().map(|p| p.aside(centre.at(p.s) + half.at(p.s))));
        let (first, last) = (stations[0], stations[stations.len() - 1]);
        let mut start = Pose::new(points[0], first.heading);
        let mut end = Pose::new(points[points.len() - 1], last.heading);
        if direction == Direction::Backward {
            points.reverse();
            (start, end) = (end.reversed(), start.reversed());
        }
        Self::new(spec, points, ring, half.at(first.s).min(half.at(last.s)), start, end)
    }

    /// Creates a lane along arbitrary points, with given poses at its ends.
    pub(super) fn free(spec: Spec, points: Vec<Vec2>, half: f64, start: Pose, end: Pose) -> Self {
        let ring = ribbon(&points, half);
        Self::new(spec, points, ring, half, start, end)
    }

    fn new(spec: Spec, points: Vec<Vec2>, ring: Vec<Vec2>, half: f64, start: Pose, end: Pose) -> Self {
        Self {
            spec,
            points,
            ring,
            half,
            start,
            end,
            successors: Vec::new(),
            predecessors: Vec::new(),
            left: Vec::new(),
            right: Vec::new(),
        }
    }
}
