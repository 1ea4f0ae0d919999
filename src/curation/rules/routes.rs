//! Other ways over the lane graph than the logged one.

use crate::dynamics::REAR_AXLE;
use crate::geometry::{Polyline, Vec2, direction, left, smooth_step, wrap};
use crate::scene::{LaneClass, LaneHit, Road, Scenario};

/// A lane counts as the AV's own up to this distance (metres) and angle (radians).
const OWN_LANE: (f64, f64) = (2.2, 0.6);
/// Ways that are looked at.
const MOST: usize = 48;
/// Two ways leave one another where they are this far apart, metres.
const APART: f64 = 2.5;
/// Angle between them, there or at the end, radians.
const TURNED: f64 = 0.26;
/// Two ways whose ends are closer than this are one, metres.
const SAME_END: f64 = 4.0;

/// Another way.
pub(super) struct Branch {
    /// The way of the rear axle.
    pub(super) guide: Polyline,
    /// Its length from the AV on, metres.
    pub(super) length: f64,
    /// How much it turns, radians, left positive.
    pub(super) turn: f64,
}

impl Branch {
    pub(super) fn name(&self) -> &'static str {
        match self.turn.to_degrees() {
            t if t > 120.0 => "sharp left",
            t if t > 35.0 => "turn left",
            t if t > 10.0 => "bear left",
            t if t < -120.0 => "sharp right",
            t if t < -35.0 => "turn right",
            t if t < -10.0 => "bear right",
            _ => "straight on",
        }
    }
}

/// The ways from the AV's lane that leave the logged way (`logged`: of the box centre) within `reach` metres.
pub(super) fn branches(scenario: &Scenario, logged: &Polyline, reach: f64) -> Vec<Branch> {
    let road = scenario.start.road();
    let now = scenario.start.now(0);
    let axle = now.position() - direction(now.heading) * (REAR_AXLE * scenario.start.agents[0].length);
    let mut found: Vec<Branch> = Vec::new();
    let mut hits: Vec<LaneHit> = Vec::new();
    road.lanes_near(axle, OWN_LANE.0, &mut hits);
    let off =
        |h: &LaneHit| wrap(road.lane(h.lane).baseline.heading(h.projection.segment) - now.heading).abs();
    hits.retain(|h| off(h) < OWN_LANE.1 && road.lane(h.lane).class != LaneClass::Bike);
    hits.sort_by(|a, b| a.projection.distance.total_cmp(&b.projection.distance));
    let mut looked = 0;
    for hit in &hits {
        let mut open = vec![vec![hit.lane]];
        while let Some(chain) = open.pop() {
            let length: f64 = chain.iter().map(|&l| road.lane(l).baseline.length()).sum();
            let last = road.lane(chain[chain.len() - 1]);
            let on = last
                .successors
                .iter()
                .filter(|&&l| road.lane(l).class != LaneClass::Bike && !chain.contains(&l));
            let before = open.len();
            if length - hit.projection.s < reach {
                open.extend(on.map(|&l| chain.iter().copied().chain([l]).collect()));
            }
            if open.len() > before {
                continue;
            }
            looked += 1;
            if looked > MOST {
                return found;
            }
            if let Some(branch) = branch(&road, &chain, hit, axle, reach)
                && leaves(&branch.guide, logged)
                && found.iter().all(|other| (end(other) - end(&branch)).norm() > SAME_END)
            {
                found.push(branch);
            }
        }
    }
    found
}

fn end(branch: &Branch) -> Vec2 {
    branch.guide.at(branch.guide.length())
}

/// The way along a chain of lanes from where the rear axle is, leading onto the centre line smoothly.
fn branch(road: &Road<'_>, chain: &[usize], hit: &LaneHit, axle: Vec2, reach: f64) -> Option<Branch> {
    let offset = hit.projection.offset;
    let (mut points, mut way) = (vec![axle], 0.0);
    let mut s = hit.projection.s;
    let (mut first, mut last) = (None, 0.0);
    for &lane in chain {
        let line = &road.lane(lane).baseline;
        while s < line.length() && way < reach {
            (s, way) = (s + 1.0, way + 1.0);
            let at = s.min(line.length());
            let heading = line.heading_at(at);
            first.get_or_insert(heading);
            last = heading;
            points.push(line.at(at) + left(direction(heading)) * (offset * (1.0 - smooth_step(way / 20.0))));
        }
        s = (s - line.length()).max(0.0);
    }
    let guide = Polyline::new(&points).ok()?;
    Some(Branch { length: guide.length(), guide, turn: wrap(last - first?) })
}

/// Whether a way leaves the logged one for another direction: somewhere it is aside of it and turned against it.
fn leaves(guide: &Polyline, logged: &Polyline) -> bool {
    let mut s = 0.0;
    while s < guide.length() {
        let p = guide.at(s);
        let near = logged.project(p);
        let beyond = near.t >= 1.0 && near.segment + 1 == logged.segments();
        let turned = wrap(guide.heading_at(s) - logged.heading(near.segment)).abs();
        if !beyond && near.distance > APART && turned > TURNED {
            return true;
        }
        s += 2.0;
    }
    false
}

/// Offsets of lanes beside the logged way that lead the same way, metres, left positive: at most one on either side.
pub(super) fn beside(road: &Road<'_>, logged: &Polyline) -> Vec<f64> {
    let mut found = Vec::new();
    for side in [1.0, -1.0] {
        let mut offsets: Vec<f64> = Vec::new();
        for s in [5.0, 15.0, 25.0, 35.0] {
            let (p, heading) = (logged.at(s), logged.heading_at(s));
            let normal = left(direction(heading));
            let mut hits = Vec::new();
            road.lanes_near(p + normal * (3.5 * side), 1.2, &mut hits);
            let same = |h: &&LaneHit| {
                let lane = road.lane(h.lane);
                lane.class != LaneClass::Bike
                    && wrap(lane.baseline.heading(h.projection.segment) - heading).abs() < 0.4
            };
            let nearest = hits
                .iter()
                .filter(same)
                .min_by(|a, b| a.projection.distance.total_cmp(&b.projection.distance));
            if let Some(hit) = nearest {
                // The offset of the lane from the way, not of the probe from the lane.
                let at = road.lane(hit.lane).baseline.at(hit.projection.s);
                offsets.push((at - p).dot(&normal));
            }
        }
        if offsets.len() >= 2 {
            offsets.sort_by(f64::total_cmp);
            found.push(offsets[offsets.len() / 2]);
        }
    }
    found
}
