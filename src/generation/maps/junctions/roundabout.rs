//! Roundabouts. Traffic goes round counter-clockwise; who enters gives way to the circle.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use super::corner::CROSSWALK;
use super::draw::{Kind, arm, arm_path, pavement, section};
use super::interior::lines_cross;
use super::street::{End, Port};
use crate::generation::maps::build::{LaneRef, MARGIN, MapBuilder, Pose, Spec, connector, ribbon};
use crate::generation::{Draw, Layout, RightOfWay};
use crate::geometry::{Vec2, direction, left, signed_angle_between, wrap};
use crate::rollout::Stream;
use crate::scene::{LaneClass, StopKind};

/// Ground beside the circle's lanes, metres.
const RIM: f64 = 0.6;
/// From the give-way line to the circle, metres.
const LINE: f64 = 0.8;
/// Points on the circle are no farther apart, metres.
const STEP: f64 = 0.6;
/// Share of the angle between two arms at which vehicles enter behind the one and leave before the other.
const SPREAD: f64 = 0.42;

/// One lane around, four arms (sometimes three).
pub(crate) fn roundabout_one_lane(rng: &mut Stream) -> Layout {
    let diameter = rng.uniform(38.0, 46.0);
    draw(rng, &[1], diameter, "roundabout-1")
}

/// Two lanes around; the arms of the major road have two lanes, those of the other one two or one.
pub(crate) fn roundabout_two_lanes(rng: &mut Stream) -> Layout {
    let diameter = rng.uniform(48.0, 58.0);
    let lanes: &[usize] = if rng.chance(0.5) { &[2, 2] } else { &[2, 1] };
    draw(rng, lanes, diameter, "roundabout-2")
}

/// A lane of the circle at a place.
#[derive(Clone, Copy)]
struct Arc {
    lane: LaneRef,
    /// The arm where vehicles enter behind it, and whether it lies before that arm's entry (between its exit and its entry).
    arm: usize,
    inside: bool,
}

/// What meets what: lanes of the circle go first, then those who leave, then those who enter.
struct Way {
    lane: LaneRef,
    rank: u8,
    before: LaneRef,
    behind: LaneRef,
}

/// The plan of a roundabout.
struct Circle {
    /// Radii of the lanes' middles, from the outside.
    radii: Vec<f64>,
    /// Width of the lanes around.
    width: f64,
    /// Radius of the outer edge of the ground.
    rim: f64,
    speed: f64,
    /// Angle from an arm to where vehicles enter and leave.
    spread: f64,
}

fn draw(rng: &mut Stream, lanes: &[usize], diameter: f64, name: &str) -> Layout {
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
    let outer = rim - RIM - 0.5 * width;
    let limit = *rng.pick(&[25.0, 30.0, 35.0]);
    let paved = pavement(rng, 0.8);
    let circle = Circle {
        radii: (0..around).map(|i| outer - width * i as f64).collect(),
        width,
        rim,
        speed: 9.0,
        spread: SPREAD * narrowest.min(FRAC_PI_2),
    };
    let setback = rim + LINE + 7.0;
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
    b.finish(name)
}

/// The island between the directions of an arm, from `s` metres on; it tapers off.
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
        let mut ways: Vec<Way> = Vec::new();
        for ring in 0..self.radii.len() {
            // Arms whose lanes reach this ring.
            let arms: Vec<usize> = (0..ports.len()).filter(|&i| ports[i].approach.len() > ring).collect();
            let arcs = self.arcs(b, ring, headings, &arms);
            let find = |arm: usize, inside: bool| arcs.iter().find(|a| a.arm == arm && a.inside == inside);
            for (k, &arm) in arms.iter().enumerate() {
                let previous = arms[(k + arms.len() - 1) % arms.len()];
                let (Some(inside), Some(behind), Some(before)) =
                    (find(arm, true), find(arm, false), find(previous, false))
                else {
                    continue;
                };
                let (inside, behind, before) = (inside.lane, behind.lane, before.lane);
                b.link(before, inside);
                b.link(inside, behind);
                ways.push(Way { lane: inside, rank: 0, before, behind });
                // The outer ring serves the outermost lane of an arm.
                let lane = ports[arm].approach.len() - 1 - ring;
                let exit = ports[arm].exits[lane];
                let spec = |what: &str| {
                    Spec::connector(format!("r-{arm}{what}{ring}"), LaneClass::SurfaceStreet, self.speed)
                };
                let (leaving, _) = b.connect(spec("x"), before, exit);
                ways.push(Way { lane: leaving, rank: 1, before, behind: exit });
                let from = ports[arm].approach[lane];
                let (entry, merge) = self.entry(b, from, behind, spec("e"), spec("m"));
                ways.push(Way { lane: merge, rank: 2, before: entry, behind });
            }
        }
        let circle = |radius: f64| (0..96).map(|i| direction(TAU / 96.0 * f64::from(i)) * radius).collect();
        b.ground(circle(self.rim));
        let inner = self.radii[self.radii.len() - 1] - 0.5 * self.width - RIM;
        b.island(circle(inner));
        b.intersection(circle(self.rim));
        decide(b, &ways);
    }

    /// The lanes of a ring, from split to split.
    fn arcs(&self, b: &mut MapBuilder, ring: usize, headings: &[f64], arms: &[usize]) -> Vec<Arc> {
        let mut arcs = Vec::new();
        for (k, &arm) in arms.iter().enumerate() {
            let next = arms[(k + 1) % arms.len()];
            let (out, enter) = (headings[arm] - self.spread, headings[arm] + self.spread);
            // Of the arms of a ring with two, the next one may lie half a circle away.
            let ahead = (headings[next] - headings[arm]).rem_euclid(TAU);
            let leave = headings[arm] + ahead - self.spread;
            for (from, to, inside) in [(out, enter, true), (enter, leave, false)] {
                let id = format!("r-{arm}{}{ring}", if inside { "i" } else { "o" });
                let spec = if inside {
                    Spec::connector(id, LaneClass::SurfaceStreet, self.speed)
                } else {
                    Spec::lane(id, LaneClass::SurfaceStreet, self.speed)
                };
                let count = ((to - from) * self.radii[ring] / STEP).ceil().max(2.0);
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

    /// The way from an arm into the circle: to the give-way line, and from there.
    fn entry(
        &self,
        b: &mut MapBuilder,
        from: LaneRef,
        behind: LaneRef,
        entry: Spec,
        merge: Spec,
    ) -> (LaneRef, LaneRef) {
        let (start, end) = (b.end(from), b.start(behind));
        let points = refined(&connector(start, end).0);
        let last = points.len() - 1;
        let line = points.iter().position(|p| p.norm() < self.rim + LINE).unwrap_or(1).clamp(2, last - 2);
        let half = b.half_width(from);
        b.ground(ribbon(&points, half + MARGIN + 0.1));
        let there = points[line + 1] - points[line - 1];
        let heading = signed_angle_between(Vec2::new(1.0, 0.0), there);
        let entry = b.lane(
            Spec { kind: crate::scene::LaneKind::Lane, ..entry },
            points[..=line].to_vec(),
            half,
            start.heading,
            heading,
        );
        let merge = b.lane(merge, points[line..].to_vec(), half, heading, end.heading);
        b.link(from, entry);
        b.link(entry, merge);
        b.link(merge, behind);
        (entry, merge)
    }
}

/// Twice as many points: between two of them the cubic through them and their neighbours.
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

/// Give-way lines, and who gives way to whom.
fn decide(b: &mut MapBuilder, ways: &[Way]) {
    for way in ways {
        let meets = |other: &Way| {
            way.before != other.before
                && (way.behind == other.behind || lines_cross(b.points(way.lane), b.points(other.lane)))
        };
        let to: Vec<LaneRef> =
            ways.iter().filter(|other| other.rank < way.rank && meets(other)).map(|o| o.lane).collect();
        if way.rank == 2 {
            b.stop(StopKind::Yield, way.lane);
        }
        if !to.is_empty() {
            b.priority(way.lane, &to, RightOfWay::Yield);
        }
    }
}

/// Pavements around the circle, and crosswalks.
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
            let lanes = b.lanes_across(&line, 0.0);
            b.crossing(line, CROSSWALK, &lanes, &[]);
        }
    }
}
