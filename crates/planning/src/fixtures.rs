//! Small maps, objects and scenarios for tests.

pub(crate) mod scenes;

use reactsim_geometry::{Polyline, Vec2};

use crate::map::{
    Area, Areas, DrivableArea, Intersections, LaneKind, PlanningLane, PlanningMapParts, Roadblock,
};
use crate::{ObjectKind, PlanningMap, TrackedObject};

/// Width of the lanes, metres.
const WIDTH: f64 = 3.5;

/// A lane along the x axis that [`map`] makes.
pub(crate) struct LanePart {
    pub(crate) id: &'static str,
    pub(crate) kind: LaneKind,
    /// First and last x, metres; a lane against the x axis has a smaller last x.
    pub(crate) x: [f64; 2],
    /// Left border, if the lane is along the x axis, metres.
    pub(crate) bottom: f64,
    pub(crate) roadblock: &'static str,
    pub(crate) successors: &'static [&'static str],
    pub(crate) limit: Option<f64>,
}

impl LanePart {
    /// Returns a lane from 0 to 200 m at the x axis, in the roadblock `block`.
    pub(crate) fn new(id: &'static str) -> Self {
        Self {
            id,
            kind: LaneKind::Lane,
            x: [0.0, 200.0],
            bottom: 0.0,
            roadblock: "block",
            successors: &[],
            limit: None,
        }
    }
}

/// Returns a road of one lane along the x axis from 0 to 200 m, its centre line at y = 1.75 m.
pub(crate) fn straight_road(limit: Option<f64>) -> PlanningMap {
    map(&[LanePart { limit, ..LanePart::new("lane") }])
}

/// Returns a map of lanes, without intersections.
pub(crate) fn map(parts: &[LanePart]) -> PlanningMap {
    let mut blocks: Vec<&str> = Vec::new();
    for part in parts {
        if !blocks.contains(&part.roadblock) {
            blocks.push(part.roadblock);
        }
    }
    let position = |id: &str| parts.iter().position(|part| part.id == id).unwrap();
    let leads_to = |from: &LanePart, to: &LanePart| from.successors.contains(&to.id);
    let lane = |part: &LanePart| {
        let ([first, last], [bottom, top]) = (part.x, [part.bottom, part.bottom + WIDTH]);
        let ring = [(first, bottom), (last, bottom), (last, top), (first, top)];
        let middle = 0.5 * (bottom + top);
        let lane = PlanningLane {
            id: part.id.to_owned(),
            kind: part.kind,
            baseline: Polyline::new(&[Vec2::new(first, middle), Vec2::new(last, middle)]).unwrap(),
            speed_limit: part.limit,
            roadblock: blocks.iter().position(|&block| block == part.roadblock).unwrap(),
            predecessors: parts.iter().filter(|p| leads_to(p, part)).map(|p| position(p.id)).collect(),
            successors: part.successors.iter().map(|id| position(id)).collect(),
        };
        (lane, Area::ring(ring.map(|(x, y)| Vec2::new(x, y)).to_vec()).unwrap())
    };
    PlanningMap::new(PlanningMapParts {
        lanes: parts.iter().map(lane).collect(),
        roadblocks: blocks.iter().map(|id| Roadblock { id: (*id).to_owned(), area: None }).collect(),
        intersections: Intersections::Areas(Areas::new(Vec::new())),
        drivable: DrivableArea::Unknown,
    })
    .unwrap()
}

/// Returns a car of 4.5 m × 2 m along the x axis with a speed along it, m/s.
pub(crate) fn car(id: &str, x: f64, y: f64, speed: f64) -> TrackedObject {
    TrackedObject {
        id: id.into(),
        kind: ObjectKind::Vehicle,
        center: Vec2::new(x, y),
        heading: 0.0,
        length: 4.5,
        width: 2.0,
        velocity: Vec2::new(speed, 0.0),
    }
}
