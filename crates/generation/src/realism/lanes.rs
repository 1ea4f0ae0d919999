//! Lanes by geometry alone, since recorded maps lack neighbours and their lanes overlap at junctions.

use reactsim_geometry::{Polyline, Vec2, direction};
use reactsim_scene::{AgentState, LANE_HALF_WIDTH, LaneClass, LaneHit, Road};

/// Cosine of the maximum angle (30°) between a vehicle and the lane that it follows.
const MIN_ALIGNMENT: f64 = 0.866;
/// Distance between lane centres, metres, below which two lanes are effectively the same lane here.
const SAME_LANE_SPACING: f64 = 0.3;
/// Distance between lane centres, metres, above which two lanes are next to each other.
pub(super) const MIN_ADJACENT_SPACING: f64 = 2.3;

/// Finds the lanes for motor vehicles that run along a pose, within `radius` metres, and that neither begin
/// nor end before it.
pub(super) fn lanes_along(road: &Road<'_>, state: &AgentState, radius: f64, hits: &mut Vec<LaneHit>) {
    road.lanes_near(state.position(), radius, hits);
    let axis = direction(state.heading);
    hits.retain(|hit| {
        let lane = road.lane(hit.lane);
        let (a, b) = lane.baseline.segment(hit.projection.segment);
        let beyond = (hit.projection.t >= 1.0 && hit.projection.segment + 1 == lane.baseline.segments())
            || (hit.projection.t <= 0.0 && hit.projection.segment == 0);
        lane.class != LaneClass::Bike && !beyond && (b - a).dot(&axis) > MIN_ALIGNMENT * (b - a).norm()
    });
}

/// Returns the lane of a vehicle: of the lanes along it, the one with the nearest centre, within half a
/// lane width.
pub(super) fn lane_of(road: &Road<'_>, state: &AgentState, hits: &mut Vec<LaneHit>) -> Option<LaneHit> {
    lanes_along(road, state, LANE_HALF_WIDTH, hits);
    hits.iter().min_by(|a, b| a.projection.distance.total_cmp(&b.projection.distance)).copied()
}

/// Returns the offset of a vehicle in its lane, metres, left positive; `None` if another lane overlaps it.
pub(super) fn clear_offset(road: &Road<'_>, state: &AgentState, hits: &mut Vec<LaneHit>) -> Option<f64> {
    lanes_along(road, state, LANE_HALF_WIDTH + MIN_ADJACENT_SPACING, hits);
    let nearest = hits.iter().min_by(|a, b| a.projection.distance.total_cmp(&b.projection.distance))?;
    let offset = nearest.projection.offset;
    let unclear = |hit: &LaneHit| {
        let apart = (hit.projection.offset - offset).abs();
        SAME_LANE_SPACING < apart && apart < MIN_ADJACENT_SPACING
    };
    (nearest.projection.distance < LANE_HALF_WIDTH && !hits.iter().any(unclear)).then_some(offset)
}

/// Returns points of the route ahead of a pose along the lanes, `length` metres long, straight on where
/// lanes diverge. Empty off lanes.
pub(super) fn route_ahead(
    road: &Road<'_>,
    state: &AgentState,
    length: f64,
    hits: &mut Vec<LaneHit>,
) -> Vec<Vec2> {
    let mut points = Vec::new();
    let Some(hit) = lane_of(road, state, hits) else { return points };
    let (mut lane, mut from, mut left) = (hit.lane, hit.projection.segment + 1, length);
    // Guards against endless loops of very short lanes.
    for _ in 0..64 {
        let line = &road.lane(lane).baseline;
        for &point in &line.points()[from.min(line.segments())..] {
            let last = points.last().copied().unwrap_or(state.position());
            points.push(point);
            left -= (point - last).norm();
        }
        let straight = |&&next: &&usize| road.lane(next).class != LaneClass::Bike;
        let bend = |next: usize| bend(line, &road.lane(next).baseline);
        let next = road.lane(lane).successors.iter().filter(straight);
        match next.min_by(|&&a, &&b| bend(a).total_cmp(&bend(b))) {
            Some(&next) if left > 0.0 => (lane, from) = (next, 1),
            _ => break,
        }
    }
    points
}

/// Returns how far a lane bends away from the end of the previous one: 0 for straight on, 2 for backwards.
fn bend(before: &Polyline, lane: &Polyline) -> f64 {
    let (a, b) = before.segment(before.segments() - 1);
    let (points, n) = (lane.points(), lane.points().len());
    let (u, v) = (b - a, points[n - 1] - points[n - 2]);
    1.0 - u.dot(&v) / (u.norm() * v.norm())
}
