//! Common drawing functions of junction types: streets, their cross-sections, the junction where they meet.

use std::f64::consts::{FRAC_PI_2, PI};

use reactsim_geometry::Vec2;
use reactsim_rollout::Stream;
use reactsim_scene::LaneClass;

use super::corner::Corner;
use super::interior::{Junction, Movement};
use super::street::{ArmShape, End, Street};
use crate::Draw;
use crate::maps::build::{MapBuilder, Median, Path, Pavement, Piece, Road, Section, Side, mph};

/// Properties of a road through a junction, the same for both arms.
#[derive(Clone, Copy, Debug)]
pub(super) struct Kind {
    pub(super) lanes: usize,
    /// Speed limit, mph.
    pub(super) limit: f64,
    /// Width of the median for a turn pocket, metres, if there is one.
    pub(super) median: Option<f64>,
    pub(super) raised: bool,
    pub(super) bike: bool,
    pub(super) parking: bool,
    /// Vehicles per hour and lane.
    pub(super) flow: f64,
}

/// Draws the pavement of all streets of a map; `None` for a map without pavements.
pub(super) fn pavement(rng: &mut Stream, chance: f64) -> Option<Pavement> {
    let drawn = Pavement { verge: rng.uniform(0.4, 2.2), width: rng.uniform(1.6, 2.6) };
    rng.chance(chance).then_some(drawn)
}

pub(super) fn section(rng: &mut Stream, kind: &Kind, pavement: Option<Pavement>) -> Section {
    let side = Side {
        lanes: kind.lanes,
        lane_width: rng.uniform(3.0, 3.6),
        bike: kind.bike.then(|| rng.uniform(1.5, 1.8)),
        parking: kind.parking.then(|| rng.uniform(2.4, 2.6)),
        shoulder: rng.uniform(0.55, 0.8),
        pavement,
    };
    let median = Median { width: kind.median.unwrap_or(0.2), shoulder: 0.5, raised: kind.raised };
    Section {
        class: LaneClass::SurfaceStreet,
        speed: mph(kind.limit),
        forward: side,
        backward: Some(side),
        median,
    }
}

/// Draws a path from the middle of the junction outwards: straight near it, then perhaps with a bend.
pub(super) fn arm_path(rng: &mut Stream, centre: Vec2, heading: f64, bends: bool) -> Path {
    let length = rng.uniform(200.0, 270.0);
    let (angle, radius) = (rng.uniform(0.12, 0.5), rng.uniform(110.0, 260.0));
    let (side, bent) = (rng.chance(0.5), rng.chance(0.45));
    let straight = 100.0;
    let path = if bends && bent {
        let angle = (length - straight).max(40.0).min(angle * radius) / radius;
        let bend = Piece::bend(if side { angle } else { -angle }, radius, 0.6);
        let rest = Piece::straight((length - straight - angle * radius * 1.6).max(15.0));
        Path::new(&[&[Piece::straight(straight)], &bend[..], &[rest]].concat())
    } else {
        Path::straight(length)
    };
    path.placed(0.0, centre, heading)
}

/// Creates an arm before it is laid: a street that begins at the junction and ends at the border.
pub(super) fn arm(name: String, path: Path, section: Section, end: End, flow: f64) -> Street {
    let to = path.length();
    Street { name, road: Road::new(path, section), from: 0.0, to, ends: [end, End::Border], flow }
}

/// Draws the directions of the arms: the roads cross at up to 20 degrees from a right angle.
pub(super) fn headings(rng: &mut Stream) -> [f64; 4] {
    let first = rng.uniform(-PI, PI);
    let skew = rng.uniform(-20.0, 20.0).to_radians() * if rng.chance(0.5) { 1.0 } else { 0.3 };
    let second = first + FRAC_PI_2 + skew;
    [first, second, first + PI, second + PI]
}

/// Draws the corners between arms, and the setbacks of the lanes of each arm.
pub(super) fn corners(
    rng: &mut Stream,
    centre: Vec2,
    shapes: &[Option<ArmShape>; 4],
    radii: (f64, f64),
) -> ([Option<Corner>; 4], [f64; 4]) {
    let mut setbacks = [8.0_f64; 4];
    let corners = [0, 1, 2, 3].map(|slot| {
        let next = (slot + 1) % 4;
        let radius = rng.uniform(radii.0, radii.1);
        let (Some(a), Some(b)) = (&shapes[slot], &shapes[next]) else { return None };
        let corner = Corner::new(centre, a, b, radius)?;
        let [here, there] = corner.setbacks();
        setbacks[slot] = setbacks[slot].max(here);
        setbacks[next] = setbacks[next].max(there);
        Some(corner)
    });
    (corners, setbacks)
}

/// Lays arms that end at the border, and the interior of their junction.
pub(super) fn lay(
    b: &mut MapBuilder,
    rng: &mut Stream,
    mut streets: [Option<Street>; 4],
    radii: (f64, f64),
    crosswalks: [bool; 4],
) -> (Junction, Vec<Movement>) {
    let shapes = [0, 1, 2, 3].map(|i| streets[i].as_ref().map(|s| s.shape(0)));
    let (corners, setbacks) = corners(rng, Vec2::zeros(), &shapes, radii);
    let ports = [0, 1, 2, 3].map(|i| {
        let street = streets[i].as_mut()?;
        street.from = setbacks[i];
        let [port, _] = street.lay(b, rng);
        port
    });
    let junction = Junction { name: "j".to_owned(), centre: Vec2::zeros(), ports, corners, crosswalks };
    let movements = junction.lay(b);
    (junction, movements)
}
