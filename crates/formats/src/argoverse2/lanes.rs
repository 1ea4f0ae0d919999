//! Lanes of a map and their painted boundaries.

use std::collections::{BTreeMap, BTreeSet};

use reactsim_geometry::Vec2;
use reactsim_scene::{LANE_HALF_WIDTH, LaneArea, LaneClass, LaneKind, LaneParts, NeighborParts, RoadLine};
use serde::Deserialize;

use super::point::{self, Point, between, points};

#[derive(Deserialize)]
#[serde(expecting = "an object")]
pub(super) struct RawLane {
    id: i64,
    is_intersection: bool,
    lane_type: String,
    centerline: Vec<Point>,
    left_lane_boundary: Vec<Point>,
    right_lane_boundary: Vec<Point>,
    left_lane_mark_type: String,
    right_lane_mark_type: String,
    left_neighbor_id: Option<i64>,
    right_neighbor_id: Option<i64>,
    predecessors: Vec<i64>,
    successors: Vec<i64>,
}

impl RawLane {
    /// Returns [`LaneKind::Lane`] between junctions for lanes of one direction, else [`LaneKind::Connector`].
    /// A lane with yellow paint on the right has oncoming traffic there: it is a central turn lane, which is
    /// recorded once per direction.
    fn kind(&self) -> LaneKind {
        let two_way = self.right_lane_mark_type.ends_with("YELLOW");
        if self.is_intersection || two_way { LaneKind::Connector } else { LaneKind::Lane }
    }

    /// Returns the vector from the first to the last point.
    fn direction(&self) -> Option<Vec2> {
        let line = points(&self.centerline);
        Some(line.last()? - line.first()?)
    }
}

/// Converts the lanes, in the order of their keys.
pub(super) fn lanes(raw: &BTreeMap<String, RawLane>) -> Vec<LaneParts> {
    let by_id: BTreeMap<i64, &RawLane> = raw.values().map(|lane| (lane.id, lane)).collect();
    // Neighbours in the map have either direction; only those with the same direction are kept.
    let neighbors = |lane: &RawLane, id: Option<i64>| -> Vec<NeighborParts> {
        let Some(id) = id else { return Vec::new() };
        let other = by_id.get(&id);
        let along = lane.direction().zip(other.and_then(|o| o.direction())).map(|(a, b)| a.dot(&b));
        if along.is_some_and(|d| d <= 0.0) {
            return Vec::new();
        }
        let other_points = other.map_or(0, |o| o.centerline.len());
        vec![NeighborParts::whole(id.to_string(), lane.centerline.len(), other_points)]
    };
    let names = |ids: &[i64]| ids.iter().map(i64::to_string).collect();
    raw.values()
        .map(|lane| LaneParts {
            id: lane.id.to_string(),
            kind: lane.kind(),
            class: if lane.lane_type == "BIKE" { LaneClass::Bike } else { LaneClass::SurfaceStreet },
            speed_limit: None,
            points: points(&lane.centerline),
            area: area(lane),
            successors: names(&lane.successors),
            predecessors: names(&lane.predecessors),
            left: neighbors(lane, lane.left_neighbor_id),
            right: neighbors(lane, lane.right_neighbor_id),
        })
        .collect()
}

/// Returns the heights of the centre lines, in the order of [`lanes`], metres.
pub(super) fn heights(raw: &BTreeMap<String, RawLane>) -> Vec<Vec<f64>> {
    raw.values().map(|lane| point::heights(&lane.centerline)).collect()
}

/// Returns the area between the boundaries, or a corridor if a boundary is missing.
fn area(lane: &RawLane) -> LaneArea {
    if lane.left_lane_boundary.len() < 2 || lane.right_lane_boundary.len() < 2 {
        return LaneArea::Corridor { half_width: LANE_HALF_WIDTH };
    }
    LaneArea::Polygon(between(&lane.left_lane_boundary, &lane.right_lane_boundary))
}

/// Returns the painted boundaries and their heights, metres; a boundary shared by two lanes appears once.
pub(super) fn paint(raw: &BTreeMap<String, RawLane>) -> (Vec<RoadLine>, Vec<Vec<f64>>) {
    let mut seen = BTreeSet::new();
    let (mut lines, mut heights) = (Vec::new(), Vec::new());
    for lane in raw.values() {
        let left = (&lane.left_lane_mark_type, &lane.left_lane_boundary);
        let right = (&lane.right_lane_mark_type, &lane.right_lane_boundary);
        for (mark, line) in [left, right] {
            if mark == "NONE" {
                continue;
            }
            let points = points(line);
            let mut key: Vec<[u64; 2]> = points.iter().map(|p| [p.x.to_bits(), p.y.to_bits()]).collect();
            if key.last() < key.first() {
                key.reverse();
            }
            if seen.insert(key) {
                lines.push(RoadLine { paint: code(mark), points });
                heights.push(point::heights(line));
            }
        }
    }
    (lines, heights)
}

/// Returns the paint code of a mark type; 0 (unknown) if there is none.
fn code(mark: &str) -> u8 {
    match mark {
        "DASHED_WHITE" => 1,
        "SOLID_WHITE" => 2,
        "DOUBLE_SOLID_WHITE" => 3,
        "DASHED_YELLOW" => 4,
        "DOUBLE_DASH_YELLOW" => 5,
        "SOLID_YELLOW" => 6,
        "DOUBLE_SOLID_YELLOW" => 7,
        "SOLID_DASH_YELLOW" | "DASH_SOLID_YELLOW" => 8,
        _ => 0,
    }
}
