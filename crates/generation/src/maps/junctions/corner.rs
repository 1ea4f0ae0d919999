//! Corners of junctions: kerb returns, right turns around them, and the setbacks that they require of
//! lanes.

use std::f64::consts::PI;

use reactsim_geometry::{Vec2, direction, left, wrap};

use super::street::ArmShape;
use crate::maps::build::{Path, Piece, fillet};

/// Width of crosswalks, metres (MUTCD 2009, 3B.18: at least 6 feet; usually 10).
pub(super) const CROSSWALK_WIDTH: f64 = 3.0;
/// Distance from a crosswalk back to the stop line, metres (MUTCD 2009, 3B.16: 4 feet).
pub(super) const STOP_LINE_GAP: f64 = 1.2;
/// Overlap of the ground of a corner with that of the arms, metres.
const GROUND_OVERLAP: f64 = 0.4;
/// Share of the angle of a right turn on clothoids.
const CLOTHOID_SHARE: f64 = 0.35;

/// The corner between an arm (with arriving vehicles next to it) and the next one counter-clockwise (with
/// leaving vehicles next to it).
#[derive(Clone, Debug)]
pub(super) struct Corner {
    /// Radius of the kerb return, metres.
    pub(super) radius: f64,
    /// Points where it touches the kerbs of both arms: distances from the middle of the junction along the
    /// arms, metres.
    pub(super) touches: [f64; 2],
    /// The kerb return, from the first arm to the second.
    pub(super) arc: Vec<Vec2>,
    /// Ground between the kerbs and the kerb return; it overlaps the ground of the arms.
    pub(super) surface: Vec<Vec2>,
    /// Intersection of the kerb lines: distances along the arms, metres.
    kerbs: [f64; 2],
    /// Beginning and end of the right turn: distances along the arms, metres.
    turn: [f64; 2],
    bend: [Piece; 3],
}

/// Returns the distances along two arms at which lines at these offsets from their middles (positive to the
/// left when looking outwards) intersect.
fn meet(a: f64, b: f64, offset_a: f64, offset_b: f64) -> [f64; 2] {
    let (ua, ub) = (direction(a), direction(b));
    let d = left(ub) * offset_b - left(ua) * offset_a;
    let det = ua.perp(&ub);
    [d.perp(&ub) / det, d.perp(&ua) / det]
}

impl Corner {
    /// Creates the corner of two arms around `centre`; `None` if they are nearly opposite.
    pub(super) fn new(centre: Vec2, a: &ArmShape, b: &ArmShape, radius: f64) -> Option<Self> {
        let angle = wrap(b.heading - a.heading);
        if !(0.6..2.6).contains(&angle) {
            return None;
        }
        let (ua, ub) = (direction(a.heading), direction(b.heading));
        let kerbs = meet(a.heading, b.heading, a.kerb_in, -b.kerb_out);
        let lanes = meet(a.heading, b.heading, a.lane_in, -b.lane_out);
        let corner = centre + ua * kerbs[0] + left(ua) * a.kerb_in;
        let arc = fillet(corner, ua, ub, radius).split_off(1);
        let onto = [left(ua) * -GROUND_OVERLAP, left(ub) * GROUND_OVERLAP];
        let cos = ua.dot(&ub);
        let touch = radius * ((1.0 + cos) / (1.0 - cos)).sqrt();
        // The lane keeps its distance from the middle of the kerb return.
        let room = (a.kerb_in - a.lane_in).min(b.kerb_out - b.lane_out);
        let bend =
            Piece::bend(angle - PI, radius + 0.75 + 0.6 * (room - 2.2).clamp(0.0, 3.0), CLOTHOID_SHARE);
        let path = Path::new(&bend);
        let end = path.at(path.length()).position;
        // The bend is symmetric: both ends are equally far from the intersection of the lanes.
        let sin_turn = -direction(angle - PI).y;
        let leg = (-end.y / sin_turn).abs();
        Some(Self {
            radius,
            touches: kerbs.map(|s| s + touch),
            surface: [corner + onto[0] + onto[1], arc[0] + onto[0]]
                .into_iter()
                .chain(arc.iter().copied())
                .chain([arc[arc.len() - 1] + onto[1]])
                .collect(),
            arc,
            kerbs,
            turn: lanes.map(|s| s + leg),
            bend,
        })
    }

    /// Returns the distances from the middle of the junction at which the lanes of the arms must end to
    /// leave room for turn and crosswalk.
    pub(super) fn setbacks(&self) -> [f64; 2] {
        [0, 1].map(|i| {
            let walk =
                self.kerbs[i] + 0.45 * (self.touches[i] - self.kerbs[i]) + CROSSWALK_WIDTH + STOP_LINE_GAP;
            (self.turn[i] + 0.3).max(walk)
        })
    }

    /// Returns how far the kerb is beyond its line at this distance along the first (0) or second arm,
    /// metres.
    pub(super) fn flare(&self, arm: usize, s: f64) -> f64 {
        let within = (self.touches[arm] - s).clamp(0.0, self.radius);
        self.radius - (self.radius * self.radius - within * within).sqrt()
    }

    /// Returns the right turn from a lane that ends at `from` metres along the first arm to one that begins
    /// at `to` along the second.
    pub(super) fn right_turn(&self, from: f64, to: f64) -> Path {
        let lead = Piece::straight((from - self.turn[0]).max(0.01));
        let tail = Piece::straight((to - self.turn[1]).max(0.01));
        let [a, b, c] = self.bend;
        Path::new(&[lead, a, b, c, tail])
    }
}
