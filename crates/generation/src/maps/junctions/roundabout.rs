//! Roundabouts. Traffic circulates counter-clockwise; entering vehicles yield to the circle.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use reactsim_geometry::{Vec2, direction, left, signed_angle_between, wrap};
use reactsim_rollout::Stream;
use reactsim_scene::{LaneClass, StopKind};

use super::corner::CROSSWALK_WIDTH;
use super::draw::{Kind, arm, arm_path, pavement, section};
use super::interior::lines_cross;
use super::street::{End, Port};
use crate::maps::build::{LaneRef, MARGIN, MapBuilder, Pose, Spec, connector, ribbon};
use crate::{Draw, Layout, RightOfWay};

/// Width of the ground next to the circulating lanes, metres.
const RIM_WIDTH: f64 = 0.6;
/// Distance from the give-way line to the circle, metres.
const LINE_SETBACK: f64 = 0.8;
/// Maximum distance between points on the circle, metres.
const POINT_SPACING: f64 = 0.6;
/// Angle from an arm to the entry behind it and to the exit before it, as a share of the angle between two
/// arms.
const SPREAD_SHARE: f64 = 0.42;

/// Draws a roundabout with one circulating lane and four arms (sometimes three).
pub(crate) fn roundabout_one_lane(rng: &mut Stream) -> Layout {
    let diameter = rng.uniform(38.0, 46.0);
    draw(rng, &[1], diameter)
}

/// Draws a roundabout with two circulating lanes; the arms of the major road have two lanes, those of the
/// minor road two or one.
pub(crate) fn roundabout_two_lanes(rng: &mut Stream) -> Layout {
    let diameter = rng.uniform(48.0, 58.0);
    let lanes: &[usize] = if rng.chance(0.5) { &[2, 2] } else { &[2, 1] };
    draw(rng, lanes, diameter)
}

/// A stretch of a circulating lane.
#[derive(Clone, Copy)]
struct Arc {
    lane: LaneRef,
    /// The arm at which it begins.
    arm: usize,
    /// Whether it is between the exit and the entry of that arm, rather than behind the entry.
    inside: bool,
}

/// A lane of a roundabout with its rank: circulating lanes go first, then exits, then entries.
struct RankedLane {
    lane: LaneRef,
    rank: u8,
    before: LaneRef,
    after: LaneRef,
}

/// Geometry of a roundabout.
struct Circle {
    /// Radii of the lane centres, from the outside, metres.
    radii: Vec<f64>,
    /// Width of the circulating lanes, metres.
    width: f64,
    /// Radius of the outer edge of the ground, metres.
    rim: f64,
    speed: f64,
    /// Angle from an arm to its entry and exit, radians.
    spread: f64,
}

fn draw(rng: &mut Stream, lanes: &[usize], diameter: f64) -> Layout {
    let mut b = MapBuilder::new();
    let around = lanes[0];
    let four = around == 2 || rng.chance(0.75);
    let first = rng.uniform(-PI, PI);
    let headings: Vec<f64> = if four {
        (0..4).map(|i| first + FRAC_PI_2 * f64::from(i) + rng.uniform(-4.0, 4.0).to_radians()).collect()
    } else {
        (0..3).map(|i| first + TAU / 3.0 * f64::from(i) + rng.uniform(-12.0, 12.0).to_radians()).collect()
    };
    let n = headings.len();
    let gap = |i: usize| wrap(headings[(i + 1) % n] - headings[i]);
    let narrowest = (0..n).map(gap).fold(PI, f64::min);
    let width = if around == 1 { rng.uniform(4.8, 5.5) } else { rng.uniform(4.3, 4.8) };
    let rim = 0.5 * diameter;
    let outer = rim - RIM_WIDTH - 0.5 * width;
    let limit = *rng.pick(&[25.0, 30.0, 35.0]);
    let paved = pavement(rng, 0.8);
    let circle = Circle {
        radii: (0..around).map(|i| outer - width * i as f64).collect(),
        width,
        rim,
        speed: 9.0,
        spread: SPREAD_SHARE * narrowest.min(FRAC_PI_2),
    };
    let setback = rim + LINE_SETBACK + 7.0;
    let flow = if around == 1 { rng.uniform(300.0, 450.0) } else { rng.uniform(250.0, 350.0) };
    let sections = [0, 1].map(|axis| {
        let lanes = lanes[axis % lanes.len()];
        let median = Some(rng.uniform(2.6, 3.4));
        let kind = Kind { lanes, limit, median, raised: false, bike: false, parking: false, flow };
        section(rng, &kind, paved)
    });
    let crossed = paved.is_some() && rng.chance(0.8);
    let mut ports: Vec<Port> = Vec::new();
    for (i, &heading) in headings.iter().enumerate() {
        let path = arm_path(rng, Vec2::zeros(), heading, true);
        let mut street = arm(format!("a{i}"), path, sections[i % 2], End::PLAIN, flow);
        street.from = setback;
        let length = rng.uniform(14.0, 24.0);
        splitter(&mut b, heading, 0.5 * street.road.section.median.width - 0.45, setback + 4.4, length);
        let [port, _] = street.lay(&mut b, rng);
        ports.extend(port);
    }
    circle.lay(&mut b, &headings, &ports);
    walks(&mut b, &circle, &headings, &ports, crossed);
    b.finish()
}

/// Adds the splitter island of an arm, from `s` metres on; it tapers off.
fn splitter(b: &mut MapBuilder, heading: f64, half: f64, s: f64, length: f64) {
    let (u, side) = (direction(heading), left(direction(heading)));
    let at = |s: f64, offset: f64| u * s + side * offset;
    b.island(vec![at(s, -half), at(s + length, -0.2), at(s + length, 0.2), at(s, half)]);
}

impl Circle {
    fn at(&self, ring: usize, angle: f64) -> Pose {
        Pose::new(direction(angle) * self.radii[ring], angle + FRAC_PI_2)
    }

    fn lay(&self, b: &mut MapBuilder, headings: &[f64], ports: &[Port]) {
        let mut ranked_lanes: Vec<RankedLane> = Vec::new();
        for ring in 0..self.radii.len() {
            // Arms whose lanes reach this ring.
            let arms: Vec<usize> = (0..ports.len()).filter(|&i| ports[i].approach.len() > ring).collect();
            let arcs = self.arcs(b, ring, headings, &arms);
            let find = |arm: usize, inside: bool| arcs.iter().find(|a| a.arm == arm && a.inside == inside);
            for (k, &arm) in arms.iter().enumerate() {
                let previous = arms[(k + arms.len() - 1) % arms.len()];
                let (Some(inside), Some(after), Some(before)) =
                    (find(arm, true), find(arm, false), find(previous, false))
                else {
                    continue;
                };
                let (inside, after, before) = (inside.lane, after.lane, before.lane);
                b.link(before, inside);
                b.link(inside, after);
                ranked_lanes.push(RankedLane { lane: inside, rank: 0, before, after });
                // The outer ring serves the outermost lane of an arm.
                let lane = ports[arm].approach.len() - 1 - ring;
                let exit = ports[arm].exits[lane];
                let spec = |what: &str| {
                    Spec::connector(format!("r-{arm}{what}{ring}"), LaneClass::SurfaceStreet, self.speed)
                };
                let (leaving, _) = b.connect(spec("x"), before, exit);
                ranked_lanes.push(RankedLane { lane: leaving, rank: 1, before, after: exit });
                let from = ports[arm].approach[lane];
                let (entry, merge) = self.entry(b, from, after, spec("e"), spec("m"));
                ranked_lanes.push(RankedLane { lane: merge, rank: 2, before: entry, after });
            }
        }
        let circle = |radius: f64| (0..96).map(|i| direction(TAU / 96.0 * f64::from(i)) * radius).collect();
        b.ground(circle(self.rim));
        let inner = self.radii[self.radii.len() - 1] - 0.5 * self.width - RIM_WIDTH;
        b.island(circle(inner));
        b.intersection(circle(self.rim));
        decide(b, &ranked_lanes);
    }

    /// Lays the lanes of a ring, from one diverge or merge point to the next.
    fn arcs(&self, b: &mut MapBuilder, ring: usize, headings: &[f64], arms: &[usize]) -> Vec<Arc> {
        let mut arcs = Vec::new();
        for (k, &arm) in arms.iter().enumerate() {
            let next = arms[(k + 1) % arms.len()];
            let (out, enter) = (headings[arm] - self.spread, headings[arm] + self.spread);
            // On a ring that only two arms reach, the next arm may be half a circle away.
            let ahead = (headings[next] - headings[arm]).rem_euclid(TAU);
            let leave = headings[arm] + ahead - self.spread;
            for (from, to, inside) in [(out, enter, true), (enter, leave, false)] {
                let id = format!("r-{arm}{}{ring}", if inside { "i" } else { "o" });
                let spec = if inside {
                    Spec::connector(id, LaneClass::SurfaceStreet, self.speed)
                } else {
                    Spec::lane(id, LaneClass::SurfaceStreet, self.speed)
                };
                let count = ((to - from) * self.radii[ring] / POINT_SPACING).ceil().max(2.0);
                let points = (0..=count as usize)
                    .map(|i| self.at(ring, from + (to - from) * (i as f64 / count)).position)
                    .collect();
                let (start, end) = (self.at(ring, from).heading, self.at(ring, to).heading);
                let lane = b.lane(spec, points, 0.5 * self.width, start, end);
                arcs.push(Arc { lane, arm, inside });
            }
        }
        arcs
    }

    /// Lays the entry from an arm into the circle: the lane to the give-way line, and the one from there.
    fn entry(
        &self,
        b: &mut MapBuilder,
        from: LaneRef,
        after: LaneRef,
        entry: Spec,
        merge: Spec,
    ) -> (LaneRef, LaneRef) {
        let (start, end) = (b.end(from), b.start(after));
        let points = refined(&connector(start, end).0);
        let last = points.len() - 1;
        let line =
            points.iter().position(|p| p.norm() < self.rim + LINE_SETBACK).unwrap_or(1).clamp(2, last - 2);
        let half = b.half_width(from);
        b.ground(ribbon(&points, half + MARGIN + 0.1));
        let there = points[line + 1] - points[line - 1];
        let heading = signed_angle_between(Vec2::new(1.0, 0.0), there);
        let entry = b.lane(
            Spec { kind: reactsim_scene::LaneKind::Lane, ..entry },
            points[..=line].to_vec(),
            half,
            start.heading,
            heading,
        );
        let merge = b.lane(merge, points[line..].to_vec(), half, heading, end.heading);
        b.link(from, entry);
        b.link(entry, merge);
        b.link(merge, after);
        (entry, merge)
    }
}

/// Doubles the number of points, on a cubic through each pair of points and their neighbours.
fn refined(points: &[Vec2]) -> Vec<Vec2> {
    let last = points.len() - 1;
    let mut out = Vec::with_capacity(2 * points.len());
    for i in 0..last {
        let (a, b) = (points[i], points[i + 1]);
        out.push(a);
        // At the ends the curve is straight.
        let middle = (a + b) * 0.5;
        let bulge = if i > 0 && i + 1 < last {
            (a + b - points[i - 1] - points[i + 2]) / 16.0
        } else {
            Vec2::zeros()
        };
        out.push(middle + bulge);
    }
    out.push(points[last]);
    out
}

/// Adds give-way lines and priorities.
fn decide(b: &mut MapBuilder, ranked_lanes: &[RankedLane]) {
    for ranked in ranked_lanes {
        let meets = |other: &RankedLane| {
            ranked.before != other.before
                && (ranked.after == other.after || lines_cross(b.points(ranked.lane), b.points(other.lane)))
        };
        let to: Vec<LaneRef> = ranked_lanes
            .iter()
            .filter(|other| other.rank < ranked.rank && meets(other))
            .map(|o| o.lane)
            .collect();
        if ranked.rank == 2 {
            b.stop(StopKind::Yield, ranked.lane);
        }
        if !to.is_empty() {
            b.priority(ranked.lane, &to, RightOfWay::Yield);
        }
    }
}

/// Lays pavements around the circle, and crosswalks.
fn walks(b: &mut MapBuilder, circle: &Circle, headings: &[f64], ports: &[Port], crossed: bool) {
    let n = ports.len();
    for (i, port) in ports.iter().enumerate() {
        let next = (i + 1) % n;
        let (Some(own), Some(other)) = (port.pavements, ports[next].pavements) else { return };
        let gap = (headings[next] - headings[i]).rem_euclid(TAU);
        let radius = circle.rim + port.verge + 0.5 * port.pavement_width + 1.5;
        let count = 6;
        let mut line = vec![own[0]];
        line.extend((0..=count).map(|k| {
            let share = 0.42 + 0.16 * f64::from(k) / f64::from(count);
            direction(headings[i] + gap * share) * radius
        }));
        line.push(other[1]);
        b.footway(line, port.pavement_width);
        if crossed {
            let u = direction(headings[i]) * 0.8;
            let line = vec![own[1] + u, own[0] + u];
            let lanes = b.lanes_across(&line);
            b.crossing(line, CROSSWALK_WIDTH, &lanes, &[]);
        }
    }
}
