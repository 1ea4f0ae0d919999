//! Where the policy is to go: along the lane, never to where the log went.

use reactsim::geometry::{Polyline, Vec2, direction, wrap};
use reactsim::scene::{LaneClass, Road};

/// How far the way is laid out, metres: 8 s at more than 35 m/s.
const REACH: f64 = 300.0;
/// Lanes whose centre line is farther away are not the vehicle's, metres.
const BESIDE: f64 = 3.2;
/// Lanes at a larger angle are not the vehicle's, rad.
const ANGLE: f64 = 1.0;
/// Metres of offset that an angle of 1 rad is worth in the choice of the lane.
const ANGLE_COST: f64 = 2.0;
/// Branches are told apart so far beyond their beginning, metres.
const TELLING: f64 = 20.0;
/// No way has more lanes.
const MOST_LANES: usize = 64;

/// The way of a vehicle.
#[derive(Clone, Debug)]
pub(super) struct Route {
    line: Polyline,
    /// The segment where the vehicle was seen last.
    segment: usize,
    /// The speed limit of its first lane, m/s.
    pub(super) limit: Option<f64>,
    /// How far the vehicle stands from the centre line, metres, and at which angle to it, rad; `None` off the lanes.
    pub(super) offset: Option<(f64, f64)>,
}

impl Route {
    /// The way from a place: along the lane there, straight on at branches; straight ahead off the lanes.
    pub(super) fn from(road: &Road<'_>, position: Vec2, heading: f64) -> Self {
        let mut hits = Vec::new();
        road.lanes_near(position, BESIDE, &mut hits);
        let angle =
            |lane: usize, segment: usize| wrap(road.lane(lane).baseline.heading(segment) - heading).abs();
        let usable = hits.iter().filter(|h| road.lane(h.lane).class != LaneClass::Bike);
        let near = usable.filter_map(|h| {
            let angle = angle(h.lane, h.projection.segment);
            (angle < ANGLE).then_some((h.projection.distance + ANGLE_COST * angle, angle, h))
        });
        let Some((_, angle, hit)) = near.min_by(|a, b| a.0.total_cmp(&b.0)) else {
            return Self { line: ray(position, heading), segment: 0, limit: None, offset: None };
        };
        let mut chain = vec![hit.lane];
        let mut length = road.lane(hit.lane).baseline.length() - hit.projection.s;
        while length < REACH && chain.len() < MOST_LANES {
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

    /// The point so many metres ahead; past its end the way goes on straight.
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

/// The successor that turns least.
fn straight_on(road: &Road<'_>, lane: usize) -> Option<usize> {
    let line = &road.lane(lane).baseline;
    let heading = line.heading(line.segments() - 1);
    let usable = road.lane(lane).successors.iter().filter(|&&l| road.lane(l).class != LaneClass::Bike);
    let turn = |l: usize| wrap(road.lane(l).baseline.heading_at(TELLING) - heading).abs();
    usable.copied().min_by(|&a, &b| turn(a).total_cmp(&turn(b)))
}

fn ray(position: Vec2, heading: f64) -> Polyline {
    let ahead = direction(heading) * REACH;
    // So far out that a few hundred metres are lost in rounding there is no way.
    let nowhere = |_| Polyline::new(&[Vec2::zeros(), Vec2::new(REACH, 0.0)]);
    Polyline::new(&[position, position + ahead]).or_else(nowhere).expect("two points that lie apart")
}
