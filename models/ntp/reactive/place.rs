//! A place of the map, and its relations to other places and to agents.

use reactsim::geometry::{Vec2, into_frame, point_segment};
use reactsim::scene::LightState;

use super::super::tokens::{MapPiece, PIECE_POINTS, PieceKind};
use super::body::Body;
use super::known_map::Stop;
use super::links::put;

/// Number of features of a place.
pub(crate) const PLACE_FEATURES: usize = HAS_LIGHT + 1;
/// Number of features of the relation between two places.
pub(crate) const PLACE_PAIR_FEATURES: usize = 7;
/// Number of features of the relation of a place to an agent.
pub(crate) const TO_PLACE_FEATURES: usize = 27;
/// Number of kinds of places: those of pieces, and stops at lights, stop signs and give-way lines.
const KINDS: usize = PieceKind::COUNT + 3;

/// Offset of the kind in the features of a place; before it are x and y of ten points.
const KIND: usize = 2 * (PIECE_POINTS - 1);
/// Offset of the length.
const LENGTH: usize = KIND + KINDS;
/// Offset of the speed limit.
const SPEED_LIMIT: usize = LENGTH + 1;
/// Offset of the flag that the speed limit is known.
const HAS_SPEED_LIMIT: usize = SPEED_LIMIT + 1;
/// Offset of the flag that a light controls the lane.
const HAS_LIGHT: usize = HAS_SPEED_LIMIT + 1;

/// A place of the map.
#[derive(Clone, Debug)]
pub(crate) struct Place {
    /// Start, metres, scenario frame.
    pub start: Vec2,
    /// Unit vector of its first chord; for a stop, of the lane direction.
    pub ahead: Vec2,
    /// Middle point.
    pub middle: Vec2,
    /// Role for agents.
    pub role: Role,
    /// Light that controls its lane.
    pub light: Option<usize>,
    /// Speed limit, m/s, if known.
    pub speed_limit: Option<f64>,
    /// Points along the piece; a single point for a stop.
    points: Vec<Vec2>,
    /// Features of the place alone.
    pub features: [f32; PLACE_FEATURES],
}

/// Role of a place for agents.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Role {
    /// A piece of a lane's centre line.
    Lane,
    /// A piece of an edge or a crosswalk.
    Border,
    /// A stop.
    Stop,
}

impl Place {
    pub(crate) fn of_piece(piece: &MapPiece, light: Option<usize>) -> Self {
        let points = piece.points.to_vec();
        let start = points[0];
        let chord = points.iter().map(|p| p - start).find(|d| d.norm() > 1e-6).unwrap_or(Vec2::x());
        let ahead = chord.normalize();
        let mut features = [0.0; PLACE_FEATURES];
        for (i, p) in points.iter().skip(1).enumerate() {
            let local = into_frame(ahead, p - start);
            features[2 * i] = (local.x / 5.0) as f32;
            features[2 * i + 1] = (local.y / 2.0) as f32;
        }
        features[KIND + piece.kind.code()] = 1.0;
        features[LENGTH] = (piece.length / 5.0) as f32;
        features[SPEED_LIMIT] = piece.speed_limit.map_or(0.0, |v| (v / 15.0) as f32);
        features[HAS_SPEED_LIMIT] = f32::from(u8::from(piece.speed_limit.is_some()));
        features[HAS_LIGHT] = f32::from(u8::from(light.is_some()));
        let role = if piece.kind.is_lane() { Role::Lane } else { Role::Border };
        let (middle, speed_limit) = (points[5], piece.speed_limit);
        Self { start, ahead, middle, role, light, speed_limit, points, features }
    }

    pub(crate) fn of_stop(stop: &Stop) -> Self {
        let &Stop { at, ahead, light, kind } = stop;
        let mut features = [0.0; PLACE_FEATURES];
        features[KIND + PieceKind::COUNT + kind] = 1.0;
        features[HAS_LIGHT] = f32::from(u8::from(light.is_some()));
        let points = vec![at];
        Self { start: at, ahead, middle: at, role: Role::Stop, light, speed_limit: None, points, features }
    }

    /// Writes the relation of another place to this one, in the frame of this one.
    pub(crate) fn relate_place(&self, other: &Self, out: &mut [f32]) {
        let apart = into_frame(self.ahead, other.start - self.start);
        let toward = into_frame(self.ahead, other.ahead);
        let distance = apart.norm();
        put(
            out,
            [
                apart.x / 10.0,
                apart.y / 10.0,
                distance / 10.0,
                toward.x,
                toward.y,
                1.0 / (1.0 + distance),
                1.0,
            ],
        );
    }

    /// Returns the end point.
    pub(crate) fn end(&self) -> Vec2 {
        self.points[self.points.len() - 1]
    }

    /// Returns the direction at the end.
    pub(crate) fn end_ahead(&self) -> Vec2 {
        match self.points.as_slice() {
            [.., a, b] if (b - a).norm() > 1e-6 => (b - a).normalize(),
            _ => self.ahead,
        }
    }

    /// Returns the point nearest to `p`, and the direction of the piece there.
    pub(crate) fn nearest(&self, p: Vec2) -> (Vec2, Vec2) {
        let mut best = (f64::INFINITY, self.start, self.ahead);
        for pair in self.points.windows(2) {
            let (d2, t) = point_segment(p, pair[0], pair[1]);
            if d2 < best.0 {
                let along = pair[1] - pair[0];
                let length = along.norm();
                let ahead = if length > 1e-6 { along / length } else { self.ahead };
                best = (d2, pair[0] + along * t, ahead);
            }
        }
        (best.1, best.2)
    }

    /// Writes the relation of this place to an agent, in the agent's frame, with the present state of
    /// its light.
    pub(crate) fn relate(&self, me: &Body, light: Option<LightState>, out: &mut [f32]) {
        let local = |p: Vec2| into_frame(me.ahead, p - me.position);
        let (nearest, along) = self.nearest(me.position);
        let toward = into_frame(me.ahead, along);
        let at = local(nearest);
        let first = local(self.start);
        let last = local(self.end());
        let end_ahead = if self.points.len() > 1 { into_frame(me.ahead, self.end_ahead()) } else { toward };
        // Positive to the left of the piece.
        let aside = into_frame(along, me.position - nearest).y;
        let distance = at.norm();
        let speed = me.velocity.dot(&me.ahead).max(0.0);
        let shown = |f: fn(LightState) -> bool| f64::from(u8::from(light.is_some_and(f)));
        let (mut brake, mut arrival) = (0.0, 0.0);
        if self.role == Role::Stop && at.x > 0.0 {
            let room = (at.x - me.half.x).max(0.1);
            brake = (speed * speed / (2.0 * room) / 4.0).min(3.0);
            arrival = (room / speed.max(0.5) / 5.0).min(2.0);
        }
        put(
            out,
            [
                at.x / 10.0,
                at.y / 5.0,
                1.0 / (1.0 + distance),
                distance / 30.0,
                aside.clamp(-2.0, 2.0),
                (aside / 3.0).clamp(-3.0, 3.0),
                toward.x,
                (toward.y * 3.0).clamp(-3.0, 3.0),
                first.x / 30.0,
                first.y / 30.0,
                last.x / 30.0,
                last.y / 30.0,
                end_ahead.x,
                (end_ahead.y * 3.0).clamp(-3.0, 3.0),
                shown(LightState::is_red),
                shown(LightState::is_yellow),
                shown(|l| matches!(l, LightState::Go | LightState::ArrowGo)),
                shown(|l| matches!(l, LightState::Unknown)),
                shown(|l| matches!(l, LightState::FlashingStop | LightState::FlashingCaution)),
                brake,
                arrival,
                f64::from(u8::from(self.role == Role::Lane)),
                f64::from(u8::from(self.role == Role::Border)),
                f64::from(u8::from(self.role == Role::Stop)),
                // Clearance between the agent's box and the line.
                ((aside.abs() - me.half.y) / 2.0).clamp(-1.0, 3.0),
                f64::from(u8::from(at.x > 0.0)),
                1.0,
            ],
        );
    }
}
