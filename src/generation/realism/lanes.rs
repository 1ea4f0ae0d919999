//! Lanes as geometry: recorded maps lack neighbours, and their lanes overlap at junctions.

use crate::geometry::{Polyline, Vec2, direction};
use crate::scene::{AgentState, LANE_HALF_WIDTH, LaneClass, LaneHit, Road};

/// A lane is followed by who heads along it within this angle: its cosine (30°).
const ALONG: f64 = 0.866;
/// Lanes whose centres are closer than this here are one lane to all appearances, metres.
const SAME: f64 = 0.3;
/// Lanes whose centres are farther apart than this are beside each other, metres.
pub(super) const BESIDE: f64 = 2.3;

/// The lanes for motor vehicles that run along a pose, within `radius` metres, and that do not begin or end before it.
pub(super) fn lanes_along(road: &Road<'_>, state: &AgentState, radius: f64, hits: &mut Vec<LaneHit>) {
    road.lanes_near(state.position(), radius, hits);
    let axis = direction(state.heading);
    hits.retain(|hit| {
        let lane = road.lane(hit.lane);
        let (a, b) = lane.baseline.segment(hit.projection.segment);
        let beyond = (hit.projection.t >= 1.0 && hit.projection.segment + 1 == lane.baseline.segments())
            || (hit.projection.t <= 0.0 && hit.projection.segment == 0);
        lane.class != LaneClass::Bike && !beyond && (b - a).dot(&axis) > ALONG * (b - a).norm()
    });
}

/// The lane that a vehicle is in: of those along it the one whose centre is nearest, within half a lane.
pub(super) fn lane_of(road: &Road<'_>, state: &AgentState, hits: &mut Vec<LaneHit>) -> Option<LaneHit> {
    lanes_along(road, state, LANE_HALF_WIDTH, hits);
    hits.iter().min_by(|a, b| a.projection.distance.total_cmp(&b.projection.distance)).copied()
}

/// The lane that a vehicle is in and its offset there, metres, left positive, where no other lane overlaps it.
pub(super) fn clear_offset(road: &Road<'_>, state: &AgentState, hits: &mut Vec<LaneHit>) -> Option<f64> {
    lanes_along(road, state, LANE_HALF_WIDTH + BESIDE, hits);
    let nearest = hits.iter().min_by(|a, b| a.projection.distance.total_cmp(&b.projection.distance))?;
    let offset = nearest.projection.offset;
    let unclear = |hit: &LaneHit| {
        let apart = (hit.projection.offset - offset).abs();
        SAME < apart && apart < BESIDE
    };
    (nearest.projection.distance < LANE_HALF_WIDTH && !hits.iter().any(unclear)).then_some(offset)
}

/// The way on from a pose over the lanes, `length` metres of it, straight on where lanes part: points beyond the pose. Empty off lanes.
pub(super) fn way_on(road: &Road<'_>, state: &AgentState, length: f64, hits: &mut Vec<LaneHit>) -> Vec<Vec2> {
    let mut points = Vec::new();
    let Some(hit) = lane_of(road, state, hits) else { return points };
    let (mut lane, mut from, mut left) = (hit.lane, hit.projection.segment + 1, length);
    // A loop of very short lanes would never end.
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

/// How far a lane bends away from the end of the one before: 0 straight on, 2 backwards.
fn bend(before: &Polyline, lane: &Polyline) -> f64 {
    let (a, b) = before.segment(before.segments() - 1);
    let (points, n) = (lane.points(), lane.points().len());
    let (u, v) = (b - a, points[n - 1] - points[n - 2]);
    1.0 - u.dot(&v) / (u.norm() * v.norm())
}
