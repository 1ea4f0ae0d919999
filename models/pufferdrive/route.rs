//! Routes from which the policy's goals are taken: along the lane, never towards the log's destination.

use reactsim_geometry::{Polyline, Vec2, direction, wrap};
use reactsim_scene::{LaneClass, Road};

/// Length of a route, metres: 8 s at more than 35 m/s.
const ROUTE_LENGTH: f64 = 300.0;
/// Largest distance of a vehicle from the centre line of its lane, metres.
const MAX_OFFSET: f64 = 3.2;
/// Largest angle of a vehicle to its lane, rad.
const MAX_ANGLE: f64 = 1.0;
/// Cost of an angle in the choice of the lane, metres of offset per rad.
const ANGLE_COST: f64 = 2.0;
/// Distance beyond its beginning at which the direction of a branch is measured, metres.
const BRANCH_SAMPLE_DISTANCE: f64 = 20.0;
/// Largest number of lanes of a route.
const MAX_LANES: usize = 64;

/// Route of a vehicle.
#[derive(Clone, Debug)]
pub(super) struct Route {
    line: Polyline,
    /// Segment where the vehicle was observed last.
    segment: usize,
    /// Speed limit of its first lane, m/s.
    pub(super) limit: Option<f64>,
    /// Initial distance to the centre line, metres, and angle to it, rad; `None` off the lanes.
    pub(super) offset: Option<(f64, f64)>,
}

impl Route {
    /// Returns the route from a position: along the lane there, straight on at branches; straight ahead
    /// off the lanes.
    pub(super) fn from(road: &Road<'_>, position: Vec2, heading: f64) -> Self {
        let mut hits = Vec::new();
        road.lanes_near(position, MAX_OFFSET, &mut hits);
        let angle =
            |lane: usize, segment: usize| wrap(road.lane(lane).baseline.heading(segment) - heading).abs();
        let usable = hits.iter().filter(|h| road.lane(h.lane).class != LaneClass::Bike);
        let near = usable.filter_map(|h| {
            let angle = angle(h.lane, h.projection.segment);
            (angle < MAX_ANGLE).then_some((h.projection.distance + ANGLE_COST * angle, angle, h))
        });
        let Some((_, angle, hit)) = near.min_by(|a, b| a.0.total_cmp(&b.0)) else {
            return Self { line: ray(position, heading), segment: 0, limit: None, offset: None };
        };
        let mut chain = vec![hit.lane];
        let mut length = road.lane(hit.lane).baseline.length() - hit.projection.s;
        while length < ROUTE_LENGTH && chain.len() < MAX_LANES {
            let Some(next) = straight_on(road, chain[chain.len() - 1]) else { break };
            length += road.lane(next).baseline.length();
            chain.push(next);
        }
        let points: Vec<Vec2> =
            chain.iter().flat_map(|&l| road.lane(l).baseline.points().iter().copied()).collect();
        let line = Polyline::new(&points).unwrap_or_else(|_| ray(position, heading));
        let limit = road.lane(hit.lane).speed_limit;
        Self { line, segment: hit.projection.segment, limit, offset: Some((hit.projection.distance, angle)) }
    }

    /// Returns the point `distance` metres ahead; the route continues straight beyond its end.
    pub(super) fn ahead(&mut self, position: Vec2, distance: f64) -> Vec2 {
        let nearest = self.line.project_between(position, self.segment.saturating_sub(10), self.segment + 60);
        self.segment = nearest.segment;
        let end = self.line.length();
        let beyond = if nearest.s >= end {
            let last = direction(self.line.heading(self.line.segments() - 1));
            (position - self.line.at(end)).dot(&last).max(0.0)
        } else {
            0.0
        };
        self.line.at(nearest.s + beyond + distance)
    }
}

/// Returns the successor that turns least.
fn straight_on(road: &Road<'_>, lane: usize) -> Option<usize> {
    let line = &road.lane(lane).baseline;
    let heading = line.heading(line.segments() - 1);
    let usable = road.lane(lane).successors.iter().filter(|&&l| road.lane(l).class != LaneClass::Bike);
    let turn = |l: usize| wrap(road.lane(l).baseline.heading_at(BRANCH_SAMPLE_DISTANCE) - heading).abs();
    usable.copied().min_by(|&a, &b| turn(a).total_cmp(&turn(b)))
}

fn ray(position: Vec2, heading: f64) -> Polyline {
    let ahead = direction(heading) * ROUTE_LENGTH;
    // At coordinates so large that a few hundred metres are lost in rounding there is no route.
    let nowhere = |_| Polyline::new(&[Vec2::zeros(), Vec2::new(ROUTE_LENGTH, 0.0)]);
    Polyline::new(&[position, position + ahead]).or_else(nowhere).expect("two points that lie apart")
}
