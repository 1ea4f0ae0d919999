//! A place of the map.

use reactsim_geometry::{Vec2, into_frame, point_segment};

use super::known_map::Stop;
use super::map_pieces::{MapPiece, PIECE_POINTS, PieceKind};

/// Number of features of a place.
pub const PLACE_FEATURES: usize = HAS_LIGHT + 1;
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
pub struct Place {
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
    pub points: Vec<Vec2>,
    /// Features of the place alone.
    pub features: [f32; PLACE_FEATURES],
}

/// Role of a place for agents.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
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

    /// Returns the end point.
    pub fn end(&self) -> Vec2 {
        self.points[self.points.len() - 1]
    }

    /// Returns the direction at the end.
    pub fn end_ahead(&self) -> Vec2 {
        match self.points.as_slice() {
            [.., a, b] if (b - a).norm() > 1e-6 => (b - a).normalize(),
            _ => self.ahead,
        }
    }

    /// Returns the point nearest to `p`, and the direction of the piece there.
    pub fn nearest(&self, p: Vec2) -> (Vec2, Vec2) {
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
}
