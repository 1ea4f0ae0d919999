//! Where vehicles start: on the centre lines of their lanes.

use reactsim_geometry::{OrientedBox, Polyline, Vec2, heading_of};

use crate::TrackedObject;
use crate::path::{Path, kept_states};

use super::AgentRoads;

/// Distance in metres over which the heading of a centre line is taken (nuPlan devkit 1.2.2,
/// `NuPlanPolylineMapObject`).
const HEADING_DISTANCE: f64 = 0.5;

/// The place of a vehicle on the centre line of a lane.
#[derive(Clone, Debug)]
pub(super) struct Place {
    pub(super) lane: usize,
    /// Its box there.
    pub(super) footprint: OrientedBox,
    pub(super) path: Path,
    /// Arc length along the centre line, metres.
    pub(super) progress: f64,
}

/// Returns the place of a vehicle: in the lane that contains its centre, in an intersection in the connector;
/// of several that whose heading differs least, the first one on ties. The difference is not wrapped, as in
/// the devkit. `None` if there is no such lane, or if it is too short for a path.
pub(super) fn place(roads: &AgentRoads, object: &TrackedObject) -> Option<Place> {
    if !has_box(object) {
        return None;
    }
    let (map, center) = (roads.map(), object.center);
    let at = map.lanes_at(center);
    let (connectors, lanes): (Vec<usize>, Vec<usize>) =
        at.into_iter().partition(|&lane| map.lane(lane).is_connector());
    let candidates = if lanes.is_empty() {
        // A map without outlines of intersections has connectors in them only.
        let is_inside = map.in_intersection(center).unwrap_or(true);
        if is_inside { connectors } else { Vec::new() }
    } else {
        lanes
    };
    let turn = |lane: usize| (pose_near(roads.baseline(lane), center).2 - object.heading).abs();
    let turns = candidates.into_iter().map(|lane| (turn(lane), lane));
    let (_, lane) = turns.reduce(|best, other| if other.0 < best.0 { other } else { best })?;
    let (progress, position, heading) = pose_near(roads.baseline(lane), center);
    Some(Place {
        lane,
        footprint: OrientedBox::new(position, heading, object.length, object.width),
        path: Path::new(kept_states(&roads.states(lane)))?,
        progress,
    })
}

/// Returns whether the box of an object is finite and has an extent; its velocity may be unknown.
fn has_box(object: &TrackedObject) -> bool {
    let TrackedObject { center, heading, length, width, .. } = object;
    [center.x, center.y, *heading, *length, *width].into_iter().all(f64::is_finite)
        && *length > 0.0
        && *width > 0.0
}

/// Returns arc length, point and heading of a line at its point nearest to `p`.
fn pose_near(line: &Polyline, p: Vec2) -> (f64, Vec2, f64) {
    let s = line.project(p).s;
    let (at, ahead) = (line.at(s), line.at((s + HEADING_DISTANCE).min(line.length())));
    let direction = if ahead == at { at - line.at((s - HEADING_DISTANCE).max(0.0)) } else { ahead - at };
    (s, at, heading_of(direction))
}
