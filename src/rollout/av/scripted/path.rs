//! The way that a scripted AV takes: the logged one made smooth, moved sideways, and gone on with beyond its end.

use std::f64::consts::PI;

use super::Log;
use crate::geometry::{OrientedBox, Polyline, Vec2, direction, left, smooth_step, wrap};
use crate::scene::{DT, LaneHit, Road, Scenario};

/// Recorded points closer than this are dropped, metres: they tell noise, not direction.
pub(super) const SPACING: f64 = 0.5;
/// Distance between two poses of the path, metres.
const STEP: f64 = 0.1;
/// Largest curvature of the rear axle's path, 1/m: about that of a car at full lock.
const CURVATURE: f64 = 0.26;
/// Largest change of the curvature along the path, 1/m per m.
const CURVATURE_RATE: f64 = 0.15;
/// Largest lateral acceleration, m/s².
const LATERAL: f64 = 3.8;
/// Braking for a curve ahead, m/s².
const BRAKE_FOR_CURVE: f64 = 4.0;
/// The rear axle lies this share of the length behind the box centre (nuPlan's vehicle: 1.461 m of 5.176 m).
const REAR_AXLE: f64 = 0.28;
/// Rolling back farther than this ends a path, metres: the AV changed gear.
const CUSP: f64 = 1.0;
/// Who has moved less than this in the history stood, metres.
const STOOD: f64 = 0.3;
/// Room that is kept to what stands beyond the end of the log, metres.
const ROOM: f64 = 0.5;
/// Time of a sideways shift, s.
const SHIFT_TIME: f64 = 3.0;
/// Largest distance and angle at which the end of the log counts as on a lane, metres and radians.
const ON_LANE: (f64, f64) = (2.0, PI / 6.0);

/// Poses of the box centre, 0.1 m apart along the path of the rear axle.
///
/// The path is driven by the rear axle because a vehicle's heading is the direction in which that moves; the box centre swings
/// out in curves, as it does in the log.
pub(super) struct Path {
    centers: Vec<Vec2>,
    headings: Vec<f64>,
    /// Way of the centre up to each pose, metres.
    arc: Vec<f64>,
    /// Curvature of the centre's way from each pose to the next, 1/m.
    curvatures: Vec<f64>,
    /// Where the AV must have stopped, if anywhere, metres: the log changes gear there, or something stands in the way beyond it.
    end: Option<f64>,
}

impl Path {
    /// The logged path, moved sideways by `offset` metres (left positive), for an AV that is to travel `travel` metres.
    pub(super) fn new(scenario: &Scenario, log: &Log, offset: f64, travel: f64) -> Self {
        let reach = travel + 10.0;
        let rear = REAR_AXLE * scenario.start.agents[0].length;
        let (guide, told, cusp) = guide(scenario, log, rear, offset, reach);
        let mut path = trace(&guide, log, rear, reach);
        // The guide is the rear axle's way; the end is wanted along the centre's, which is never shorter.
        let last = ((told / STEP) as usize).min(path.arc.len() - 1);
        path.end = if cusp {
            Some(path.arc[last])
        } else if travel > path.arc[last] + 1.0 {
            path.blocked_beyond(scenario, last)
        } else {
            None
        };
        path
    }

    /// Where the way beyond the pose `last`, at which the log ends, meets something that has stood since the start, metres. The log
    /// tells that its own way is free; what lies beyond is the script's guess, which does not drive into parked cars.
    fn blocked_beyond(&self, scenario: &Scenario, last: usize) -> Option<f64> {
        let start = &scenario.start;
        let stood = |&j: &usize| {
            let mut seen = start.history[j].iter().flatten();
            let first = seen.next().map(|s| s.position());
            first.is_some_and(|p| (start.now(j).position() - p).norm() < STOOD)
        };
        let others = (1..start.agents.len()).filter(stood).map(|j| start.now(j).footprint(&start.agents[j]));
        let standing: Vec<OrientedBox> = others.chain(start.obstacles.iter().copied()).collect();
        let av = &start.agents[0];
        let meets = |i: usize, o: &OrientedBox| {
            let own = OrientedBox::new(self.centers[i], self.headings[i], av.length, av.width);
            (o.center - own.center).norm() < 30.0 && o.separation(&own) < ROOM
        };
        // What the log leaves less room to at its end stands beside the AV, not in its way.
        let ahead: Vec<OrientedBox> = standing.into_iter().filter(|o| !meets(last, o)).collect();
        // The stop is a little short of the first contact.
        let first = (last..self.centers.len()).step_by(5).find(|i| ahead.iter().any(|o| meets(*i, o)))?;
        Some((self.arc[first] - ROOM).max(self.arc[last]))
    }

    fn locate(&self, s: f64) -> (usize, f64) {
        let i = self.arc.partition_point(|&a| a <= s).clamp(1, self.arc.len() - 1) - 1;
        (i, (s - self.arc[i]) / (self.arc[i + 1] - self.arc[i]))
    }

    /// The box centre after `s` metres.
    pub(super) fn position(&self, s: f64) -> Vec2 {
        let (i, t) = self.locate(s);
        self.centers[i] + (self.centers[i + 1] - self.centers[i]) * t
    }

    /// The heading of the AV after `s` metres, radians.
    pub(super) fn heading(&self, s: f64) -> f64 {
        let (i, t) = self.locate(s);
        wrap(self.headings[i] + wrap(self.headings[i + 1] - self.headings[i]) * t)
    }

    /// How far along the path the centre is exactly `distance` metres, as the crow flies, from `from`, where it was at `s`.
    pub(super) fn advance(&self, s: f64, from: Vec2, distance: f64) -> f64 {
        if distance == 0.0 {
            return s;
        }
        let (mut low, mut high) = (s, s + 1.5 * distance);
        for _ in 0..40 {
            let middle = 0.5 * (low + high);
            if (self.position(middle) - from).norm() < distance { low = middle } else { high = middle }
        }
        high
    }

    /// The speed that curves (and the end, where there is one) allow at each pose, braking for those ahead included.
    pub(super) fn allowed_speeds(&self) -> Allowed<'_> {
        let mut speeds: Vec<f64> = Vec::with_capacity(self.arc.len());
        for (i, &s) in self.arc.iter().enumerate() {
            let curvature = self.curvatures[i.min(self.curvatures.len() - 1)];
            let over = self.end.is_some_and(|end| s >= end);
            speeds.push(if over { 0.0 } else { (LATERAL / curvature.max(1e-6)).sqrt() });
        }
        for i in (0..speeds.len() - 1).rev() {
            let way = self.arc[i + 1] - self.arc[i];
            speeds[i] = speeds[i].min((speeds[i + 1].powi(2) + 2.0 * BRAKE_FOR_CURVE * way).sqrt());
        }
        Allowed { path: self, speeds }
    }
}

/// The speed allowed along a path.
pub(super) struct Allowed<'a> {
    path: &'a Path,
    speeds: Vec<f64>,
}

impl Allowed<'_> {
    /// The speed allowed after `s` metres, m/s.
    pub(super) fn at(&self, s: f64) -> f64 {
        let (i, t) = self.path.locate(s);
        self.speeds[i] + (self.speeds[i + 1] - self.speeds[i]) * t.min(1.0)
    }
}

/// Where the rear axle is to go, how long the way is that the log tells, and whether it ends there by a change of gear.
fn guide(scenario: &Scenario, log: &Log, rear: f64, offset: f64, reach: f64) -> (Polyline, f64, bool) {
    let axle = |k: usize| log.states[k].position() - direction(log.states[k].heading) * rear;
    let ahead = |k: usize| direction(log.states[k].heading) * log.gear;
    let (mut kept, mut arc, mut cusp) = (vec![0], vec![0.0], false);
    for k in 1..log.states.len() {
        let last = kept[kept.len() - 1];
        let step = axle(k) - axle(last);
        let forward = step.dot(&ahead(k));
        if forward < -CUSP {
            cusp = true;
            break;
        }
        if forward > 0.0 && step.norm() >= SPACING {
            kept.push(k);
            arc.push(arc[arc.len() - 1] + step.norm());
        }
    }
    let told = arc[arc.len() - 1];
    let last = kept[kept.len() - 1];
    let mut points: Vec<Vec2> = kept.iter().map(|&k| axle(k)).collect();
    let mut normals: Vec<Vec2> = kept.iter().map(|&k| left(ahead(k)) * log.gear).collect();
    let beyond = if cusp { Vec::new() } else { beyond(scenario, axle(last), ahead(last), log.gear, reach) };
    if beyond.is_empty() {
        // One more point gives the direction in which the polyline goes on.
        points.push(axle(last) + ahead(last));
        normals.push(normals[normals.len() - 1]);
        arc.push(told + 1.0);
    }
    for (p, heading) in beyond {
        arc.push(arc[arc.len() - 1] + (p - points[points.len() - 1]).norm());
        points.push(p);
        normals.push(left(direction(heading)));
    }
    if offset != 0.0 {
        // Quick enough to be done after 3 s, but not quicker than the steering allows: the fifth-order ramp of length d and
        // height h has a curvature of up to 5.8 h / d².
        let early: f64 = log.speeds.iter().take((SHIFT_TIME / DT) as usize).sum();
        let way = (early * DT).max((5.8 * offset.abs() / 0.15).sqrt());
        // A straight guide has too few points to bend.
        (points, normals, arc) = refine(&points, &normals, &arc, reach);
        for ((p, normal), s) in points.iter_mut().zip(&normals).zip(&arc) {
            *p += normal * (offset * smooth_step(s / way));
        }
    }
    let guide = Polyline::new(&points).unwrap_or_else(|_| {
        let start = axle(0);
        Polyline::new(&[start, start + ahead(0)]).expect("two points a metre apart")
    });
    (guide, told, cusp)
}

/// The same guide with a point at least every metre, and on to `reach`.
fn refine(points: &[Vec2], normals: &[Vec2], arc: &[f64], reach: f64) -> (Vec<Vec2>, Vec<Vec2>, Vec<f64>) {
    let (mut p, mut n, mut a) = (vec![points[0]], vec![normals[0]], vec![arc[0]]);
    for i in 1..points.len() {
        let way = arc[i] - arc[i - 1];
        let last = if i + 1 == points.len() { (reach - arc[i - 1]).max(way) } else { way };
        let pieces = last.ceil().max(1.0) as usize;
        for k in 1..=pieces {
            let s = last * k as f64 / pieces as f64;
            p.push(points[i - 1] + (points[i] - points[i - 1]) * (s / way));
            let normal = normals[i - 1] + (normals[i] - normals[i - 1]) * (s / way).min(1.0);
            n.push(if normal.norm() > 0.1 { normal.normalize() } else { normals[i] });
            a.push(arc[i - 1] + s);
        }
    }
    (p, n, a)
}

/// Points (with directions) of the lane that goes on from the end of the log, or none where the AV is on no lane or reverses.
/// They leave the logged direction smoothly and keep the distance from the centre line: there may be parked cars beside the AV.
fn beyond(scenario: &Scenario, at: Vec2, ahead: Vec2, gear: f64, reach: f64) -> Vec<(Vec2, f64)> {
    let road = scenario.start.road();
    let heading = ahead.y.atan2(ahead.x);
    let mut hits: Vec<LaneHit> = Vec::new();
    if gear > 0.0 {
        road.lanes_near(at, ON_LANE.0, &mut hits);
    }
    let off = |h: &LaneHit| {
        let turn = wrap(road.lane(h.lane).baseline.heading(h.projection.segment) - heading).abs();
        (turn, turn * 4.0 + h.projection.distance)
    };
    hits.retain(|h| off(h).0 < ON_LANE.1 && h.projection.t < 1.0);
    let Some(hit) = hits.iter().min_by(|a, b| off(a).1.total_cmp(&off(b).1)) else { return Vec::new() };
    let (mut lane, mut s) = (hit.lane, hit.projection.s);
    let join = 20.0;
    let (mut points, mut way) = (Vec::new(), 0.0);
    while way < reach {
        let line = &road.lane(lane).baseline;
        while s < line.length() && way < reach {
            (s, way) = (s + 1.0, way + 1.0);
            let turn = line.heading_at(s);
            let on_lane = line.at(s.min(line.length())) + left(direction(turn)) * hit.projection.offset;
            let straight = at + ahead * way;
            points.push((straight + (on_lane - straight) * smooth_step(way / join), turn));
        }
        match straightest(&road, lane) {
            Some(next) => (lane, s) = (next, 0.0),
            None => break,
        }
    }
    points
}

/// The successor that turns least over its first 20 m.
fn straightest(road: &Road<'_>, lane: usize) -> Option<usize> {
    let line = &road.lane(lane).baseline;
    let end = line.heading(line.segments() - 1);
    let turn = |&next: &usize| {
        let next = &road.lane(next).baseline;
        wrap(next.heading_at(next.length().min(20.0)) - end).abs() + 0.1 * wrap(next.heading(0) - end).abs()
    };
    road.lane(lane).successors.iter().copied().min_by(|a, b| turn(a).total_cmp(&turn(b)))
}

/// Drives the rear axle along the guide from the exact current pose: pure pursuit (Coulter, 1992) with bounded curvature, whose
/// look-ahead grows with the speed, so that the recorder's noise does not become lateral acceleration.
fn trace(guide: &Polyline, log: &Log, rear: f64, reach: f64) -> Path {
    let now = log.states[0];
    let flip = if log.gear > 0.0 { 0.0 } else { PI };
    let mut course = now.heading + flip;
    let mut axle = now.position() - direction(now.heading) * rear;
    let paces = paces(log);
    let count = (reach / STEP) as usize + 2;
    let mut path = Path {
        centers: vec![now.position()],
        headings: vec![now.heading],
        arc: vec![0.0],
        curvatures: Vec::with_capacity(count),
        end: None,
    };
    let (mut curvature, mut segment) = (None::<f64>, 0);
    for _ in 0..count {
        let nearest = guide.project_between(axle, segment, segment + 12);
        segment = nearest.segment;
        // Beyond the last segment the projection stops; the way beyond it goes on straight.
        let s = nearest.s + if nearest.t >= 1.0 { past_end(guide, axle) } else { 0.0 };
        let driven = path.arc[path.arc.len() - 1];
        let pace = paces[paces.partition_point(|p| p.0 <= driven).clamp(1, paces.len()) - 1].1;
        let target = guide.at(s + (0.5 * pace).clamp(2.2, 10.0)) - axle;
        let bend = 2.0 * direction(course).perp(&target) / target.norm_squared().max(1.0);
        let change = CURVATURE_RATE * STEP;
        let bend =
            curvature.map_or(bend, |c| bend.clamp(c - change, c + change)).clamp(-CURVATURE, CURVATURE);
        curvature = Some(bend);
        axle += direction(course + 0.5 * bend * STEP) * STEP;
        course += bend * STEP;
        let heading = course - flip;
        let center = axle + direction(heading) * rear;
        let way = (center - path.centers[path.centers.len() - 1]).norm();
        let turn = wrap(heading - path.headings[path.headings.len() - 1]).abs();
        path.curvatures.push(turn / way.max(0.5 * STEP));
        path.arc.push(path.arc[path.arc.len() - 1] + way.max(1e-9));
        path.centers.push(center);
        path.headings.push(wrap(heading));
    }
    path
}

/// The speeds of the log by the way driven: metres, and m/s from there on.
fn paces(log: &Log) -> Vec<(f64, f64)> {
    let mut driven = 0.0;
    let step = |&speed: &f64| {
        let from = driven;
        driven += speed * DT;
        (from, speed)
    };
    log.speeds.iter().map(step).collect()
}

/// How far `p` lies beyond the end of a polyline, along its last segment, metres.
fn past_end(line: &Polyline, p: Vec2) -> f64 {
    let end = line.points()[line.segments()];
    (p - end).dot(&direction(line.heading(line.segments() - 1))).max(0.0)
}
