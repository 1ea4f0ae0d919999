//! The inside of a junction: ways through it, ground, corners, pavements and crosswalks.

use super::corner::{CROSSWALK, Corner, STOP_GAP};
use super::street::Port;
use crate::generation::maps::build::{LaneRef, MARGIN, MapBuilder, Pose, Spec, Station, ribbon};
use crate::generation::maps::validate::crossing::cross;
use crate::geometry::{Bounds, Vec2, direction, left};
use crate::scene::LaneClass;

/// A junction of up to four streets. Arms are numbered counter-clockwise; opposite ones differ by two, and some may be missing.
pub(super) struct Junction {
    pub(super) name: String,
    pub(super) centre: Vec2,
    pub(super) ports: [Option<Port>; 4],
    /// The corner between an arm and the next one.
    pub(super) corners: [Option<Corner>; 4],
    /// The arms that people cross.
    pub(super) crosswalks: [bool; 4],
}

/// Where a way through a junction leads.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Turn {
    Through,
    Right,
    Left,
}

/// A way through a junction.
#[derive(Clone, Debug)]
pub(super) struct Movement {
    pub(super) lane: LaneRef,
    /// Arms.
    pub(super) from: usize,
    pub(super) to: usize,
    pub(super) turn: Turn,
    pub(super) bike: bool,
    /// Lanes before and behind it.
    pub(super) before: LaneRef,
    pub(super) behind: LaneRef,
}

impl Junction {
    /// Lays ways and ground.
    pub(super) fn lay(&self, b: &mut MapBuilder) -> Vec<Movement> {
        let mut movements = Vec::new();
        for slot in 0..4 {
            self.approach(b, slot, &mut movements);
        }
        for port in self.ports.iter().flatten() {
            let shape = &port.shape;
            let s = self.setback(port);
            b.ground(self.ring(port, -1.0, s + 0.3, (-shape.kerb_out, shape.kerb_in)));
        }
        for corner in self.corners.iter().flatten() {
            b.ground(corner.surface.clone());
        }
        b.intersection(self.outline());
        movements
    }

    /// How far from the middle of the junction the lanes of an arm end.
    fn setback(&self, port: &Port) -> f64 {
        (port.pose.position - self.centre).dot(&direction(port.shape.heading))
    }

    /// A point so far along an arm, so far to the left of its middle.
    fn at(&self, port: &Port, s: f64, offset: f64) -> Vec2 {
        let u = direction(port.shape.heading);
        self.centre + u * s + left(u) * offset
    }

    fn ring(&self, port: &Port, from: f64, to: f64, (right, left): (f64, f64)) -> Vec<Vec2> {
        vec![
            self.at(port, from, right),
            self.at(port, to, right),
            self.at(port, to, left),
            self.at(port, from, left),
        ]
    }

    /// The ways of those who arrive on an arm.
    fn approach(&self, b: &mut MapBuilder, slot: usize, movements: &mut Vec<Movement>) {
        let Some(port) = &self.ports[slot] else { return };
        let arm = |turn: usize| (slot + turn) % 4;
        let [right, through, left] = [1, 2, 3].map(|turn| self.ports[arm(turn)].as_ref());
        let lanes = &port.approach;
        let n = lanes.len();
        let mut add = |b: &mut MapBuilder, k: usize, turn: Turn, to: usize, behind: LaneRef| {
            let letter = match turn {
                Turn::Through => "s",
                Turn::Right => "r",
                Turn::Left => "l",
            };
            let id = format!("{}-{slot}{letter}{k}", self.name);
            let spec = Spec::connector(id, LaneClass::SurfaceStreet, port.speed);
            let lane = match (turn, &self.corners[slot]) {
                (Turn::Right, Some(corner)) => {
                    self.right_turn(b, spec, corner, (lanes[k], behind), (slot, to))
                }
                (Turn::Through, _) => straight(b, spec, lanes[k], behind),
                _ => b.connect(spec, lanes[k], behind).0,
            };
            movements.push(Movement { lane, from: slot, to, turn, bike: false, before: lanes[k], behind });
        };
        let straight_on: Vec<usize> = (0..n)
            .filter(|&k| !(k == 0 && left.is_some() && port.left_pocket && n > 1))
            .filter(|&k| !(k + 1 == n && right.is_some() && port.right_pocket && n > 1))
            .collect();
        if let Some(opposite) = through {
            // Where fewer lanes go on, the inner ones end here.
            let kept = straight_on.len().min(opposite.exits.len());
            let ending = straight_on.len() - kept;
            for (&k, &exit) in straight_on[ending..].iter().zip(&opposite.exits) {
                add(b, k, Turn::Through, arm(2), exit);
            }
        }
        if let Some(port) = left {
            add(b, 0, Turn::Left, arm(3), port.exits[0]);
        }
        if let Some(port) = right {
            add(b, n - 1, Turn::Right, arm(1), port.exits[port.exits.len() - 1]);
        }
        let bike_out = through.and_then(|p| p.bike_out);
        if let (Some(before), Some(behind)) = (port.bike_in, bike_out) {
            let spec = Spec::connector(format!("{}-{slot}bike", self.name), LaneClass::Bike, 7.0);
            let lane = straight(b, spec, before, behind);
            let turn = Turn::Through;
            movements.push(Movement { lane, from: slot, to: arm(2), turn, bike: true, before, behind });
        }
    }

    fn right_turn(
        &self,
        b: &mut MapBuilder,
        spec: Spec,
        corner: &Corner,
        (before, behind): (LaneRef, LaneRef),
        (from, to): (usize, usize),
    ) -> LaneRef {
        let (start, end) = (b.end(before), b.start(behind));
        let s = |slot: usize| self.ports[slot].as_ref().map_or(0.0, |p| self.setback(p));
        let path = corner.right_turn(s(from), s(to));
        let length = path.length();
        let path = path.placed(0.0, start.position, start.heading);
        let mut points: Vec<Vec2> =
            path.stations(0.0, length, 5.0).iter().map(|p: &Station| Pose::from(*p).position).collect();
        let last = points.len() - 1;
        (points[0], points[last]) = (start.position, end.position);
        let half = b.half_width(before).min(b.half_width(behind));
        b.ground(ribbon(&points, half + MARGIN));
        let lane = b.lane(spec, points, half, start.heading, end.heading);
        b.link(before, lane);
        b.link(lane, behind);
        lane
    }

    /// The outline of the junction, between the stop lines.
    fn outline(&self) -> Vec<Vec2> {
        let mut ring = Vec::new();
        for (slot, port) in self.arms() {
            let s = self.setback(port);
            let before = self.corners[(slot + 3) % 4].as_ref().map_or(0.0, |c| c.flare(1, s));
            let after = self.corners[slot].as_ref().map_or(0.0, |c| c.flare(0, s));
            ring.push(self.at(port, s, -port.shape.kerb_out - before));
            ring.push(self.at(port, s, port.shape.kerb_in + after));
            let (Some(corner), Some(next)) = (&self.corners[slot], &self.ports[(slot + 1) % 4]) else {
                continue;
            };
            let beyond = |p: Vec2, port: &Port| {
                (p - self.centre).dot(&direction(port.shape.heading)) > self.setback(port) - 0.05
            };
            ring.extend(corner.arc.iter().copied().filter(|&p| !beyond(p, port) && !beyond(p, next)));
        }
        ring
    }

    fn arms(&self) -> impl Iterator<Item = (usize, &Port)> {
        self.ports.iter().enumerate().filter_map(|(i, p)| Some((i, p.as_ref()?)))
    }

    /// Pavements around the corners, and crosswalks. `waits` names the controlled lanes for which people wait before they cross an arm.
    pub(super) fn walks(&self, b: &mut MapBuilder, waits: impl Fn(usize) -> Vec<LaneRef>) {
        // Per arm, where its crosswalk would end: beside arriving vehicles, beside leaving ones.
        let mut nodes: Vec<[Vec2; 2]> = Vec::new();
        let arms: Vec<(usize, &Port)> = self.arms().filter(|(_, p)| p.pavements.is_some()).collect();
        for &(slot, port) in &arms {
            let s = self.setback(port) - STOP_GAP - 0.5 * CROSSWALK;
            let beyond = port.verge + 0.5 * port.pavement_width;
            // The ends of the crosswalk are as wide as it is: where the kerb flares most decides.
            let near = s - 0.5 * port.pavement_width;
            let flare = |corner: &Option<Corner>, arm| corner.as_ref().map_or(0.0, |c| c.flare(arm, near));
            let on_left = port.shape.kerb_in + flare(&self.corners[slot], 0) + beyond;
            let on_right = port.shape.kerb_out + flare(&self.corners[(slot + 3) % 4], 1) + beyond;
            nodes.push([self.at(port, s, on_left), self.at(port, s, -on_right)]);
        }
        for (k, &(slot, port)) in arms.iter().enumerate() {
            if let Some(ends) = port.pavements {
                for (end, node) in ends.into_iter().zip(nodes[k]) {
                    b.footway(vec![end, node], port.pavement_width);
                }
            }
            let next = (k + 1) % arms.len();
            if self.ports[(slot + 1) % 4].is_some() || self.corners[slot].is_none() && arms.len() > 1 {
                b.footway(vec![nodes[k][0], nodes[next][1]], port.pavement_width);
            }
            if self.crosswalks[slot] {
                let line = vec![nodes[k][1], nodes[k][0]];
                let crossed = b.lanes_across(&line, 0.0);
                b.crossing(line, CROSSWALK, &crossed, &waits(slot));
            }
        }
    }
}

/// The way straight on, where it is straight.
fn straight(b: &mut MapBuilder, spec: Spec, before: LaneRef, behind: LaneRef) -> LaneRef {
    /// Distance of its points, metres.
    const STEP: f64 = 5.0;
    let (start, end) = (b.end(before), b.start(behind));
    let way = end.position - start.position;
    if direction(start.heading).perp(&way).abs() > 0.001 || direction(end.heading).perp(&way).abs() > 0.001 {
        return b.connect(spec, before, behind).0;
    }
    let count = (way.norm() / STEP).ceil().max(1.0);
    let points = (0..=count as usize).map(|i| start.position + way * (i as f64 / count)).collect();
    let half = b.half_width(before).min(b.half_width(behind));
    let lane = b.lane(spec, points, half, start.heading, end.heading);
    b.link(before, lane);
    b.link(lane, behind);
    lane
}

/// Pairs of ways that cross or join, the lower index first; not those that part.
pub(super) fn conflicts(b: &MapBuilder, movements: &[Movement]) -> Vec<(usize, usize)> {
    let bounds: Vec<Bounds> =
        movements.iter().map(|m| Bounds::of(b.points(m.lane).iter().copied())).collect();
    let mut found = Vec::new();
    for (i, p) in movements.iter().enumerate() {
        for (j, q) in movements.iter().enumerate().skip(i + 1) {
            if p.before == q.before {
                continue;
            }
            let meet = p.behind == q.behind
                || bounds[i].intersects(&bounds[j]) && lines_cross(b.points(p.lane), b.points(q.lane));
            if meet {
                found.push((i, j));
            }
        }
    }
    found
}

pub(super) fn lines_cross(a: &[Vec2], b: &[Vec2]) -> bool {
    a.windows(2).any(|p| b.windows(2).any(|q| cross(p[0], p[1], q[0], q[1]).is_some()))
}
