//! The map as the network reads it: pieces of lanes between their boundaries, and boxes that stand on it.

use reactsim_geometry::{OrientedBox, Vec2, direction, left};
use reactsim_nn::learning::LearningMap;
use reactsim_scene::{LANE_HALF_WIDTH, Lane, LaneArea, LaneClass, Start};

/// Distance from a centre line beyond which a boundary is not searched, metres.
const MAX_HALF_WIDTH: f64 = 10.0;

/// Lanes and boxes of a scenario.
#[derive(Clone, Debug)]
pub(crate) struct PlannerMap {
    /// Pieces of lanes.
    pub(super) lanes: Vec<LanePiece>,
    /// Boxes of the static context.
    pub(super) boxes: Vec<OrientedBox>,
}

/// A piece of a lane.
#[derive(Clone, Debug)]
pub(super) struct LanePiece {
    /// Points of the centre line at equal distances, both ends included.
    pub(super) points: Vec<Vec2>,
    /// Points of the left and of the right boundary beside them.
    pub(super) sides: [Vec<Vec2>; 2],
    /// Speed limit, m/s, if known.
    pub(super) limit: Option<f64>,
    /// Light that controls the lane.
    pub(super) light: Option<usize>,
}

impl PlannerMap {
    /// Returns the map of a scenario within `radius` metres of the AV's position at the current frame. Lanes are cut
    /// into equal pieces of at most `length` metres with this number of points, 2 or more. Lanes for bicycles are left
    /// out.
    pub(super) fn of(start: &Start, radius: f64, length: f64, points: usize) -> Self {
        let center = start.now(0).position();
        let mut lanes = Vec::new();
        for (number, lane) in start.map.lanes.iter().enumerate() {
            if lane.class == LaneClass::Bike {
                continue;
            }
            let light = start.lights.iter().position(|light| light.lane == number);
            let count = (lane.baseline.length() / length).ceil().max(1.0);
            let each = lane.baseline.length() / count;
            let pieces = (0..count as usize).map(|k| (k as f64 * each, (k + 1) as f64 * each));
            let pieces = pieces.map(|(from, to)| LanePiece::of(lane, from, to, points, light));
            lanes.extend(pieces.filter(|piece| piece.distance(center) < radius));
        }
        Self { lanes, boxes: start.obstacles.clone() }
    }
}

impl LanePiece {
    fn of(lane: &Lane, from: f64, to: f64, points: usize, light: Option<usize>) -> Self {
        let at = |k: usize| from + (to - from) * k as f64 / (points - 1) as f64;
        let boundary = |side: f64| {
            let of_point = |k: usize| {
                let across = left(direction(lane.baseline.heading_at(at(k)))) * side;
                let p = lane.baseline.at(at(k));
                p + across * half_width(lane, p, across)
            };
            (0..points).map(of_point).collect()
        };
        Self {
            points: (0..points).map(|k| lane.baseline.at(at(k))).collect(),
            sides: [boundary(1.0), boundary(-1.0)],
            limit: lane.speed_limit,
            light,
        }
    }

    /// Returns the distance of the nearest point, metres.
    pub(super) fn distance(&self, p: Vec2) -> f64 {
        self.points.iter().map(|at| (at - p).norm()).fold(f64::INFINITY, f64::min)
    }
}

/// Returns the distance from a point of a lane's centre line to its boundary in a direction, metres.
fn half_width(lane: &Lane, p: Vec2, across: Vec2) -> f64 {
    let ring = match &lane.area {
        LaneArea::Corridor { half_width } => return *half_width,
        LaneArea::Polygon(ring) => ring,
    };
    let ends = ring.iter().zip(ring.iter().cycle().skip(1));
    let crossing = |(a, b): (&Vec2, &Vec2)| {
        // p + t across = a + u (b - a)
        let (edge, to) = (b - a, a - p);
        let turn = across.perp(&edge);
        let (t, u) = (to.perp(&edge) / turn, to.perp(&across) / turn);
        (t > 0.0 && (0.0..=1.0).contains(&u)).then_some(t)
    };
    let nearest = ends.filter_map(crossing).fold(f64::INFINITY, f64::min);
    if nearest < MAX_HALF_WIDTH { nearest } else { LANE_HALF_WIDTH }
}

impl LearningMap for PlannerMap {
    fn mirror(&mut self, flip: fn(Vec2) -> Vec2) {
        for piece in &mut self.lanes {
            let lines = piece.sides.iter_mut().chain([&mut piece.points]);
            lines.flatten().for_each(|p| *p = flip(*p));
            piece.sides.swap(0, 1);
        }
        for standing in &mut self.boxes {
            let ahead = flip(standing.center + standing.axis);
            standing.center = flip(standing.center);
            standing.axis = ahead - standing.center;
        }
    }

    fn stretch(&mut self, factor: f64) {
        for piece in &mut self.lanes {
            let lines = piece.sides.iter_mut().chain([&mut piece.points]);
            lines.flatten().for_each(|p| *p *= factor);
            piece.limit = piece.limit.map(|limit| limit * factor);
        }
        self.boxes.iter_mut().for_each(|standing| standing.center *= factor);
    }
}

#[cfg(test)]
mod tests {
    use reactsim_geometry::Polyline;
    use reactsim_scene::LaneKind;

    use super::*;

    fn lane(area: LaneArea) -> Lane {
        Lane {
            id: String::new(),
            kind: LaneKind::Lane,
            class: LaneClass::SurfaceStreet,
            speed_limit: Some(10.0),
            baseline: Polyline::new(&[Vec2::new(0.0, 0.0), Vec2::new(30.0, 0.0)]).unwrap(),
            area,
            successors: Vec::new(),
            predecessors: Vec::new(),
            left: Vec::new(),
            right: Vec::new(),
        }
    }

    #[test]
    fn boundaries_are_those_of_the_outline() {
        let ring = [(-1.0, -2.0), (31.0, -2.0), (31.0, 1.5), (-1.0, 1.5)].map(|(x, y)| Vec2::new(x, y));
        let mut piece = LanePiece::of(&lane(LaneArea::Polygon(ring.to_vec())), 10.0, 20.0, 3, None);
        assert_eq!(piece.points, [10.0, 15.0, 20.0].map(|x| Vec2::new(x, 0.0)));
        assert_eq!(piece.sides[0][1], Vec2::new(15.0, 1.5));
        assert_eq!(piece.sides[1][2], Vec2::new(20.0, -2.0));
        // A ring that does not enclose the line says nothing.
        let far = ring.map(|p| p + Vec2::new(0.0, 100.0));
        piece = LanePiece::of(&lane(LaneArea::Polygon(far.to_vec())), 10.0, 20.0, 3, None);
        assert_eq!(piece.sides[0][0], Vec2::new(10.0, LANE_HALF_WIDTH));
        let corridor = LanePiece::of(&lane(LaneArea::Corridor { half_width: 1.0 }), 0.0, 30.0, 2, None);
        assert_eq!(corridor.sides[1], [Vec2::new(0.0, -1.0), Vec2::new(30.0, -1.0)]);
    }

    #[test]
    fn mirrored_maps_have_their_boundaries_on_the_right_sides() {
        let ring = [(-1.0, -2.0), (31.0, -2.0), (31.0, 1.5), (-1.0, 1.5)].map(|(x, y)| Vec2::new(x, y));
        let piece = LanePiece::of(&lane(LaneArea::Polygon(ring.to_vec())), 10.0, 20.0, 3, None);
        let standing = OrientedBox::new(Vec2::new(3.0, 4.0), 0.5, 2.0, 1.0);
        let mut map = PlannerMap { lanes: vec![piece], boxes: vec![standing] };
        map.mirror(|p| Vec2::new(p.x, -p.y));
        assert_eq!(map.lanes[0].sides[0][0], Vec2::new(10.0, 2.0));
        assert_eq!(map.lanes[0].sides[1][0], Vec2::new(10.0, -1.5));
        assert!((map.boxes[0].center - Vec2::new(3.0, -4.0)).norm() < 1e-12);
        assert!((map.boxes[0].axis - direction(-0.5)).norm() < 1e-12);
    }
}
