//! Interior of a junction: movements, ground, corners, pavements and crosswalks.

use reactsim_geometry::{Bounds, Vec2, direction, left};
use reactsim_scene::LaneClass;

use super::corner::{CROSSWALK_WIDTH, Corner, STOP_LINE_GAP};
use super::street::Port;
use crate::maps::build::{LaneRef, MARGIN, MapBuilder, Spec, cross, ribbon};

/// A junction of up to four streets. Arms are numbered counter-clockwise; opposite arms differ by two, and
/// some may be missing.
pub(super) struct Junction {
    pub(super) name: String,
    pub(super) centre: Vec2,
    pub(super) ports: [Option<Port>; 4],
    /// The corner between an arm and the next one.
    pub(super) corners: [Option<Corner>; 4],
    /// Arms with a crosswalk.
    pub(super) crosswalks: [bool; 4],
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Turn {
    Through,
    Right,
    Left,
}

/// A lane through a junction.
#[derive(Clone, Debug)]
pub(super) struct Movement {
    pub(super) lane: LaneRef,
    /// Index of the arm from which it comes.
    pub(super) from: usize,
    /// Index of the arm to which it leads.
    pub(super) to: usize,
    pub(super) turn: Turn,
    pub(super) bike: bool,
    /// The preceding lane.
    pub(super) before: LaneRef,
    /// The following lane.
    pub(super) after: LaneRef,
}

impl Junction {
    /// Lays movements and ground.
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

    /// Returns the distance from the middle of the junction at which the lanes of an arm end, metres.
    fn setback(&self, port: &Port) -> f64 {
        (port.pose.position - self.centre).dot(&direction(port.shape.heading))
    }

    /// Returns the point `s` metres along an arm and `offset` metres to the left of its middle.
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

    /// Lays the movements of vehicles that arrive on an arm.
    fn approach(&self, b: &mut MapBuilder, slot: usize, movements: &mut Vec<Movement>) {
        let Some(port) = &self.ports[slot] else { return };
        let arm = |turn: usize| (slot + turn) % 4;
        let [right, through, left] = [1, 2, 3].map(|turn| self.ports[arm(turn)].as_ref());
        let lanes = &port.approach;
        let n = lanes.len();
        let mut add = |b: &mut MapBuilder, k: usize, turn: Turn, to: usize, after: LaneRef| {
            let letter = match turn {
                Turn::Through => "s",
                Turn::Right => "r",
                Turn::Left => "l",
            };
            let id = format!("{}-{slot}{letter}{k}", self.name);
            let spec = Spec::connector(id, LaneClass::SurfaceStreet, port.speed);
            let lane = match (turn, &self.corners[slot]) {
                (Turn::Right, Some(corner)) => {
                    self.right_turn(b, spec, corner, (lanes[k], after), (slot, to))
                }
                (Turn::Through, _) => straight(b, spec, lanes[k], after),
                _ => b.connect(spec, lanes[k], after).0,
            };
            movements.push(Movement { lane, from: slot, to, turn, bike: false, before: lanes[k], after });
        };
        let straight_on: Vec<usize> = (0..n)
            .filter(|&k| !(k == 0 && left.is_some() && port.left_pocket && n > 1))
            .filter(|&k| !(k + 1 == n && right.is_some() && port.right_pocket && n > 1))
            .collect();
        if let Some(opposite) = through {
            // If fewer lanes continue, the inner ones end here.
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
        if let (Some(before), Some(after)) = (port.bike_in, bike_out) {
            let spec = Spec::connector(format!("{}-{slot}bike", self.name), LaneClass::Bike, 7.0);
            let lane = straight(b, spec, before, after);
            let turn = Turn::Through;
            movements.push(Movement { lane, from: slot, to: arm(2), turn, bike: true, before, after });
        }
    }

    fn right_turn(
        &self,
        b: &mut MapBuilder,
        spec: Spec,
        corner: &Corner,
        (before, after): (LaneRef, LaneRef),
        (from, to): (usize, usize),
    ) -> LaneRef {
        let (start, end) = (b.end(before), b.start(after));
        let s = |slot: usize| self.ports[slot].as_ref().map_or(0.0, |p| self.setback(p));
        let path = corner.right_turn(s(from), s(to));
        let length = path.length();
        let path = path.placed(0.0, start.position, start.heading);
        let mut points: Vec<Vec2> = path.stations(0.0, length, 5.0).iter().map(|p| p.position).collect();
        let last = points.len() - 1;
        (points[0], points[last]) = (start.position, end.position);
        let half = b.half_width(before).min(b.half_width(after));
        b.ground(ribbon(&points, half + MARGIN));
        let lane = b.lane(spec, points, half, start.heading, end.heading);
        b.link(before, lane);
        b.link(lane, after);
        lane
    }

    /// Returns the outline of the junction, between the stop lines.
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

    /// Lays pavements around the corners, and crosswalks. `waits` returns the controlled lanes for which
    /// people wait before they cross an arm.
    pub(super) fn walks(&self, b: &mut MapBuilder, waits: impl Fn(usize) -> Vec<LaneRef>) {
        // Per arm, the ends of its crosswalk: next to arriving vehicles, next to leaving vehicles.
        let mut nodes: Vec<[Vec2; 2]> = Vec::new();
        let arms: Vec<(usize, &Port)> = self.arms().filter(|(_, p)| p.pavements.is_some()).collect();
        for &(slot, port) in &arms {
            let s = self.setback(port) - STOP_LINE_GAP - 0.5 * CROSSWALK_WIDTH;
            let beyond = port.verge + 0.5 * port.pavement_width;
            // The ends of the crosswalk are as wide as it is: the widest flare decides.
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
                let crossed = b.lanes_across(&line);
                b.crossing(line, CROSSWALK_WIDTH, &crossed, &waits(slot));
            }
        }
    }
}

/// Lays the connector straight on: a straight line if possible.
fn straight(b: &mut MapBuilder, spec: Spec, before: LaneRef, after: LaneRef) -> LaneRef {
    /// Distance between its points, metres.
    const POINT_SPACING: f64 = 5.0;
    let (start, end) = (b.end(before), b.start(after));
    let chord = end.position - start.position;
    if direction(start.heading).perp(&chord).abs() > 0.001
        || direction(end.heading).perp(&chord).abs() > 0.001
    {
        return b.connect(spec, before, after).0;
    }
    let count = (chord.norm() / POINT_SPACING).ceil().max(1.0);
    let points = (0..=count as usize).map(|i| start.position + chord * (i as f64 / count)).collect();
    let half = b.half_width(before).min(b.half_width(after));
    let lane = b.lane(spec, points, half, start.heading, end.heading);
    b.link(before, lane);
    b.link(lane, after);
    lane
}

/// Returns the pairs of movements that cross or join, the lower index first; diverging movements do not
/// count.
pub(super) fn conflicts(b: &MapBuilder, movements: &[Movement]) -> Vec<(usize, usize)> {
    let bounds: Vec<Bounds> =
        movements.iter().map(|m| Bounds::of(b.points(m.lane).iter().copied())).collect();
    let mut found = Vec::new();
    for (i, p) in movements.iter().enumerate() {
        for (j, q) in movements.iter().enumerate().skip(i + 1) {
            if p.before == q.before {
                continue;
            }
            let meet = p.after == q.after
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
