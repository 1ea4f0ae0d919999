//! Candidate paths of an agent: its own course, and the paths along its lane.

use reactsim_geometry::{Bounds, Vec2, into_frame, math};

use super::class::Class;
use super::features::put;
use super::place::Role;
use super::places::Places;
use super::widths::{FEATURE_POINTS, LANE_PATHS, OFFSET_FEATURES};

/// Largest distance from an agent to the middle of a lane piece that is considered its lane, metres.
const MAX_PIECE_DISTANCE: f64 = 6.0;
/// Largest lateral offset of an agent from its lane, metres.
const MAX_LATERAL_OFFSET: f64 = 4.0;
/// Weight of the heading difference between agent and lane, in metres of lateral offset per radian.
const HEADING_COST: f64 = 3.0;
/// Largest number of pieces that a path follows.
const MAX_PIECES: usize = 60;

/// Motion of an agent for which candidate paths are searched.
#[derive(Clone, Copy, Debug)]
pub(crate) struct VehicleMotion {
    /// Box centre, metres.
    pub position: Vec2,
    /// Unit vector of the heading.
    pub ahead: Vec2,
    /// Forward speed, m/s.
    pub speed: f64,
    /// Class of the agent.
    pub class: Class,
    /// Unit vector of the direction of motion; of the heading at standstill.
    pub course: Vec2,
    /// Curvature of the most recent motion, 1/m; positive to the left.
    pub curvature: f64,
}

/// A path that an agent may take: points every [`SPACING`] metres, with directions.
#[derive(Clone, Debug, PartialEq)]
pub struct CandidatePath {
    /// Position and unit vector of the direction of each point.
    pub points: Vec<(Vec2, Vec2)>,
    /// Bounding box of the points.
    pub bounds: Bounds,
}

impl CandidatePath {
    fn new(points: Vec<(Vec2, Vec2)>) -> Self {
        let bounds = Bounds::of(points.iter().map(|p| p.0));
        Self { points, bounds }
    }
}

/// Spacing of the points of a path, metres.
pub const SPACING: f64 = 2.5;
/// Minimum length of a path, metres.
const MIN_LENGTH: f64 = 12.0;
/// Maximum length of a path, metres.
const MAX_LENGTH: f64 = 70.0;
/// Time at the present speed by which a path exceeds its minimum length, seconds.
const FORESIGHT: f64 = 4.0;
/// Largest turn along an extrapolated course, radians.
const MAX_COURSE_TURN: f64 = 1.6;

/// Returns the length of the candidate paths at this speed, in points.
fn points_ahead(speed: f64) -> usize {
    ((MIN_LENGTH + FORESIGHT * speed).min(MAX_LENGTH) / SPACING) as usize
}

/// Returns the path of an agent that keeps its course and curvature. Agents on it matter wherever lanes
/// lead.
pub(crate) fn course_path(me: &VehicleMotion) -> CandidatePath {
    let turn = |s: f64| (me.curvature * s).clamp(-MAX_COURSE_TURN, MAX_COURSE_TURN);
    let mut at = me.position;
    let mut points = Vec::new();
    for i in 0..=points_ahead(me.speed) {
        let s = i as f64 * SPACING;
        points.push((at, rotated(me.course, turn(s))));
        at += rotated(me.course, turn(s + 0.5 * SPACING)) * SPACING;
    }
    CandidatePath::new(points)
}

/// Rotates `v` to the left by `angle` radians.
fn rotated(v: Vec2, angle: f64) -> Vec2 {
    let (sin, cos) = math::sin_cos(angle);
    Vec2::new(v.x * cos - v.y * sin, v.x * sin + v.y * cos)
}

/// Fills in the lateral offset from the agent's lane, the heading difference, the speed relative to the
/// limit, and points of the paths along the lane in the agent's frame, about 0.5, 1 and 2 s ahead.
/// Returns the paths. For pedestrians and without a lane, the features stay 0 and there are no paths.
pub(crate) fn describe(me: &VehicleMotion, places: &Places, out: &mut [f32]) -> Vec<CandidatePath> {
    if me.class == Class::Pedestrian {
        return Vec::new();
    }
    let Some((piece, point, along)) = own_lane(me.position, me.ahead, places) else { return Vec::new() };
    let local = into_frame(me.ahead, along);
    let aside = into_frame(along, me.position - point).y;
    let offset =
        [1.0, aside.clamp(-3.0, 3.0), (aside / 3.0).clamp(-2.0, 2.0), (local.y * 5.0).clamp(-3.0, 3.0)];
    put(out, offset);
    if let Some(limit) = places.all[piece].speed_limit.filter(|l| *l > 1.0) {
        put(&mut out[offset.len()..], [1.0, (me.speed / limit).min(2.0)]);
    }
    let v = me.speed;
    let distances = [3.0 + 0.5 * v, 6.0 + v, 10.0 + 2.0 * v];
    let scales = [1.0, 3.0, 10.0];
    for (path, cost) in TURN_COSTS.iter().enumerate() {
        let mut walk = Walk::begin(places, piece, point, along);
        for (k, (d, scale)) in distances.iter().zip(scales).enumerate() {
            let (at, heading) = walk.to(*d, me.ahead, cost);
            let at = into_frame(me.ahead, at - me.position);
            let heading = into_frame(me.ahead, heading);
            let slot = &mut out[OFFSET_FEATURES + (path * FEATURE_POINTS + k) * 3..][..3];
            let x = ((at.x - d) / scale).clamp(-5.0, 5.0);
            let y = (at.y / scale).clamp(-5.0, 5.0);
            put(slot, [x, y, heading.y * 3.0]);
        }
    }
    let walk = Walk::begin(places, piece, point, along);
    walk.paths(me.ahead, points_ahead(v)).into()
}

/// Returns the paths along the lane of an agent at `position` with direction `ahead`, with `points`
/// points after the first; none if there is no lane. Beyond the end of the map they continue straight
/// on.
pub fn lane_paths(position: Vec2, ahead: Vec2, places: &Places, points: usize) -> Vec<CandidatePath> {
    let found = own_lane(position, ahead, places);
    found.map_or_else(Vec::new, |(piece, point, along)| {
        Walk::begin(places, piece, point, along).paths(ahead, points).into()
    })
}

/// Returns the lane piece that an agent follows, which is near and not across its heading, with the
/// nearest point on it and the direction there.
fn own_lane(position: Vec2, ahead: Vec2, places: &Places) -> Option<(usize, Vec2, Vec2)> {
    let mut best: Option<(f64, usize, Vec2, Vec2)> = None;
    for i in places.middles().around(position, MAX_PIECE_DISTANCE) {
        let place = &places.all[i];
        if place.role != Role::Lane
            || (place.middle - position).norm_squared() > MAX_PIECE_DISTANCE * MAX_PIECE_DISTANCE
        {
            continue;
        }
        let (point, along) = place.nearest(position);
        let aside = (point - position).norm();
        let turned = 1.0 - along.dot(&ahead);
        if aside > MAX_LATERAL_OFFSET || turned > 0.6 {
            continue;
        }
        let cost = aside + HEADING_COST * (2.0 * turned).sqrt();
        // Adjacent pieces share a point: the earlier one wins if costs are equal.
        if best.is_none_or(|b| cost < b.0 - 1e-6) {
            best = Some((cost, i, point, along));
        }
    }
    best.map(|(_, i, point, along)| (i, point, along))
}

/// Costs of the turn of a path, of which the smallest wins: most to the left, straightest, most to the
/// right.
const TURN_COSTS: [fn(f64) -> f64; LANE_PATHS] = [|turn| -turn, f64::abs, |turn| turn];

/// Walk along successive pieces from a point.
#[derive(Clone)]
struct Walk<'a> {
    places: &'a Places,
    piece: usize,
    from: Vec2,
    heading: Vec2,
    /// Distance walked, metres.
    gone: f64,
    /// Number of pieces that may still be entered.
    left: usize,
}

impl<'a> Walk<'a> {
    fn begin(places: &'a Places, piece: usize, from: Vec2, heading: Vec2) -> Self {
        Self { places, piece, from, heading, gone: 0.0, left: MAX_PIECES }
    }

    /// Returns the three paths along the lane, with `points` points after the first.
    fn paths(&self, ahead: Vec2, points: usize) -> [CandidatePath; LANE_PATHS] {
        TURN_COSTS.map(|cost| {
            let mut walk = self.clone();
            CandidatePath::new((0..=points).map(|i| walk.to(i as f64 * SPACING, ahead, &cost)).collect())
        })
    }

    /// Advances to `distance` metres from the start and returns the point and direction there; beyond
    /// the end of the map the walk continues straight on. Among successors, it takes the one whose lane
    /// end has the smallest `cost` of its turn relative to `ahead`.
    fn to(&mut self, distance: f64, ahead: Vec2, cost: &fn(f64) -> f64) -> (Vec2, Vec2) {
        loop {
            let end = self.places.all[self.piece].end();
            let chord = end - self.from;
            let length = chord.norm();
            if self.gone + length >= distance {
                let heading = if length > 1e-6 { chord / length } else { self.heading };
                return (self.from + heading * (distance - self.gone), heading);
            }
            if length > 1e-6 {
                self.heading = chord / length;
            }
            let turn = |to: Vec2| {
                let local = into_frame(ahead, to);
                math::atan2(local.y, local.x)
            };
            let next = &self.places.graph.next[self.piece];
            let chosen = next.iter().min_by(|a, b| cost(turn(a.1)).total_cmp(&cost(turn(b.1))));
            let Some(&(piece, _)) = chosen.filter(|_| self.left > 0) else {
                return (end + self.heading * (distance - self.gone - length), self.heading);
            };
            self.left -= 1;
            self.gone += length;
            self.from = end;
            self.piece = piece;
        }
    }
}
