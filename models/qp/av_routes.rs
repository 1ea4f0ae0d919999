//! Lanes that the AV may follow.

use reactsim_geometry::{Polyline, Vec2, direction, left, math};
use reactsim_scene::dynamics::Pose;
use reactsim_scene::{AgentState, LaneHit, Road};

/// Cosine of the largest difference between the heading of the AV and that of a lane that it may follow: 60
/// degrees.
const ALONG_COSINE: f64 = 0.5;
/// Length of a route, metres: what the AV can cover in the planned time.
const LENGTH: f64 = 80.0;
/// Largest number of lanes in a route: a bound for lanes that are very short, or linked in a circle.
const MAX_LANES: usize = 8;
/// Largest number of routes.
const MAX_ROUTES: usize = 6;
/// Distance in metres in which the AV comes closer to the lane centre by a factor of e.
const APPROACH_DISTANCE: f64 = 12.0;
/// Smallest distance between two points of a route, metres.
const MIN_SPACING: f64 = 0.05;

/// A route of the AV along lanes.
pub(super) struct Route {
    line: Polyline,
    /// Arc length of the AV on the line, metres.
    from: f64,
    /// Offset of the AV from the line, metres, left positive.
    offset: f64,
}

impl Route {
    fn of(road: &Road<'_>, lanes: &[usize], at: Vec2) -> Option<Self> {
        let mut points: Vec<Vec2> = Vec::new();
        for &lane in lanes {
            for &p in road.lane(lane).baseline.points() {
                // Lanes share the points at which they meet.
                if points.last().is_none_or(|last| (p - last).norm() > MIN_SPACING) {
                    points.push(p);
                }
            }
        }
        let line = Polyline::new(&points).ok()?;
        let first = line.project_between(at, 0, road.lane(lanes[0]).baseline.segments());
        Some(Self { from: first.s, offset: first.offset, line })
    }

    /// Returns the pose after a distance, metres: the AV approaches the lane centre.
    pub(super) fn pose(&self, distance: f64) -> Pose {
        let arc = self.from + distance;
        let heading = self.line.heading_at(arc);
        let beyond = (arc - self.line.length()).max(0.0);
        let centre = self.line.at(arc) + direction(heading) * beyond;
        let offset = self.offset * math::exp(-distance / APPROACH_DISTANCE);
        let position = centre + left(direction(heading)) * offset;
        Pose { position, heading: heading - math::atan2(offset, APPROACH_DISTANCE) }
    }
}

/// Returns the routes along the lanes that contain the AV and have about its heading.
pub(super) fn routes(road: &Road<'_>, av: &AgentState) -> Vec<Route> {
    let (mut hits, mut found) = (Vec::new(), Vec::new());
    road.lanes_at(av.position(), &mut hits);
    let ahead = direction(av.heading);
    let is_along = |hit: &LaneHit| {
        direction(road.lane(hit.lane).baseline.heading(hit.projection.segment)).dot(&ahead) > ALONG_COSINE
    };
    for hit in hits.iter().filter(|hit| is_along(hit)) {
        extend(road, &mut vec![hit.lane], LENGTH + hit.projection.s, &mut found);
    }
    found.truncate(MAX_ROUTES);
    found.iter().filter_map(|lanes| Route::of(road, lanes, av.position())).collect()
}

/// Appends to `found` all continuations of a sequence of lanes up to a length, metres.
fn extend(road: &Road<'_>, lanes: &mut Vec<usize>, length: f64, found: &mut Vec<Vec<usize>>) {
    let Some(&last) = lanes.last() else { return };
    let lane = road.lane(last);
    let left = length - lane.baseline.length();
    if left <= 0.0 || lane.successors.is_empty() || lanes.len() >= MAX_LANES {
        found.push(lanes.clone());
        return;
    }
    for &next in &lane.successors {
        if found.len() >= MAX_ROUTES {
            return;
        }
        lanes.push(next);
        extend(road, lanes, left, found);
        lanes.pop();
    }
}
