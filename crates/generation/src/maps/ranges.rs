//! Engineering ranges from which map types are drawn.
//!
//! Sources, all from the United States, like the reference recordings:
//! - AASHTO, A Policy on Geometric Design of Highways and Streets (7th edition, 2018): lanes of 10 to 12
//!   ft; smallest radii `v² / (127 (e + f))` (km/h, m) with the side friction of its tables, without
//!   superelevation on streets and with 6 % on motorways; acceleration and deceleration lanes; tapers of
//!   ramps of about 300 ft; medians.
//! - FHWA, Manual on Uniform Traffic Control Devices (2009), section 3B.09: length of the taper of a lane
//!   reduction, `w v` at 45 mph or more, else `w v² / 60` (ft, mph).
//! - NACTO, Urban Street Design Guide (2013) and Urban Bikeway Design Guide (2014): bicycle lanes of 5 to 6
//!   ft, parking strips of 7 to 9 ft, pavements of 5 to 7 ft, 8 to 12 ft downtown, no parking within 20 ft
//!   of crossings, corner radii.
//! - TRB, Highway Capacity Manual (6th edition, 2016): a motorway lane carries up to 2250 to 2400 passenger
//!   cars an hour, depending on its speed; flows of streets, 400 to 900 vehicles an hour and lane, are
//!   chosen (about 1900 times the share of green).

use std::f64::consts::PI;

use reactsim_geometry::Vec2;
use reactsim_rollout::Stream;
use reactsim_scene::LaneClass;

use super::build::{Median, Path, Pavement, Piece, Section, Side, mph};
use crate::Draw;

/// Side friction of streets, by speed in mph.
const FRICTION: [(f64, f64); 6] =
    [(20.0, 0.27), (25.0, 0.23), (30.0, 0.20), (35.0, 0.18), (40.0, 0.16), (45.0, 0.15)];
/// Side friction of motorways, by speed in mph.
const FREEWAY_FRICTION: [(f64, f64); 3] = [(55.0, 0.13), (60.0, 0.12), (65.0, 0.11)];
/// Superelevation of motorways.
const SUPERELEVATION: f64 = 0.06;

/// Returns the smallest radius of a road's reference line for this speed (one of the tabulated ones, mph),
/// metres.
pub(super) fn smallest_radius(speed: f64) -> f64 {
    let kmh = speed * 1.609_344;
    let find = |table: &[(f64, f64)]| table.iter().find(|(v, _)| *v >= speed).map(|e| e.1);
    let grip = match find(&FRICTION) {
        Some(friction) => friction,
        None => find(&FREEWAY_FRICTION).unwrap_or(0.1) + SUPERELEVATION,
    };
    kmh * kmh / (127.0 * grip)
}

/// Returns the length of the taper in which a lane of this width (m) ends at this speed (mph), metres.
pub(super) fn merging_taper(width: f64, speed: f64) -> f64 {
    let feet = width / 0.3048;
    0.3048 * if speed >= 45.0 { feet * speed } else { feet * speed * speed / 60.0 }
}

/// Places a path so that the point at `s` is at (0, 0), with a random orientation.
pub(super) fn centred(path: Path, s: f64, rng: &mut Stream) -> Path {
    path.placed(s, Vec2::zeros(), rng.uniform(-PI, PI))
}

/// Draws alternating bends with straights between them, at least `length` metres long, for this speed
/// (mph).
pub(super) fn winding(rng: &mut Stream, length: f64, speed: f64) -> Path {
    let mut pieces = vec![Piece::straight(rng.uniform(20.0, 70.0))];
    let mut sign = if rng.chance(0.5) { 1.0 } else { -1.0 };
    let mut done = pieces[0].length;
    while done < length {
        let radius = smallest_radius(speed) * rng.uniform(1.05, 2.2);
        // Short arcs of large circles look like kinks, long ones turn back on themselves.
        let along = rng.uniform(60.0, 140.0_f64.max(length * 0.25));
        let angle = (along / radius).clamp(0.15, 1.2);
        let bend = Piece::bend(sign * angle, radius, rng.uniform(0.35, 0.7));
        let straight = Piece::straight(rng.uniform(15.0, 80.0));
        done += bend.iter().map(|p| p.length).sum::<f64>() + straight.length;
        pieces.extend(bend);
        pieces.push(straight);
        // Alternate bends, so that the road does not close into a ring.
        sign = -sign;
    }
    Path::new(&pieces)
}

/// Draws a street: its cross-section and its speed limit in mph.
pub(super) fn street(rng: &mut Stream, lanes: (usize, usize)) -> (Section, f64) {
    let forward = rng.count(lanes.0, lanes.1);
    let backward = if rng.chance(0.8) { forward } else { rng.count(lanes.0, lanes.1) };
    let most = forward.max(backward);
    let speed = *rng.pick(match most {
        1 => &[25.0, 30.0, 35.0],
        2 => &[30.0, 35.0, 40.0],
        _ => &[35.0, 40.0, 45.0],
    });
    let lane_width = rng.uniform(3.0, 3.5) + if speed >= 40.0 { 0.2 } else { 0.0 };
    let bike = rng.chance(0.4).then(|| rng.uniform(1.5, 1.9));
    let parking = (speed <= 35.0 && rng.chance(0.65)).then(|| rng.uniform(2.55, 2.75));
    let pavement = rng.chance(0.85).then(|| Pavement {
        verge: if rng.chance(0.5) { rng.uniform(0.3, 0.6) } else { rng.uniform(1.0, 2.0) },
        width: rng.uniform(1.6, 2.6),
    });
    let side = |lanes| Side { lanes, lane_width, bike, parking, shoulder: shoulder_width(parking), pavement };
    let median = if most >= 2 && rng.chance(0.3) {
        Median { width: rng.uniform(3.0, 5.0), shoulder: 0.6, raised: true }
    } else {
        Median { width: rng.uniform(0.1, 0.4), shoulder: 0.6, raised: false }
    };
    let section = Section {
        class: LaneClass::SurfaceStreet,
        speed: mph(speed),
        forward: side(forward),
        backward: Some(side(backward)),
        median,
    };
    (section, speed)
}

/// Returns the width of the shoulder, metres. Gutters are part of parking strips, but some ground beyond
/// them allows for rounding to the grid.
const fn shoulder_width(parking: Option<f64>) -> f64 {
    if parking.is_some() { 0.5 } else { 0.6 }
}

/// Draws a motorway: its cross-section and its speed limit in mph. The opposite carriageway may be missing.
pub(super) fn motorway(rng: &mut Stream, lanes: (usize, usize)) -> (Section, f64) {
    let speed = *rng.pick(&[55.0, 60.0, 65.0]);
    let count = rng.count(lanes.0, lanes.1);
    let side = Side { shoulder: rng.uniform(2.4, 3.3), ..Side::plain(count, rng.uniform(3.5, 3.7)) };
    let section = Section {
        class: LaneClass::Freeway,
        speed: mph(speed),
        forward: side,
        backward: rng.chance(0.6).then_some(side),
        median: Median { width: rng.uniform(6.0, 14.0), shoulder: rng.uniform(1.2, 2.4), raised: true },
    };
    (section, speed)
}

/// Vehicles per hour and lane at density 1: on streets, motorways, ramps, bicycle lanes and driveways.
pub(super) mod flows {
    use super::{Draw, Stream};

    pub(in super::super) fn street(rng: &mut Stream) -> f64 {
        rng.uniform(400.0, 900.0)
    }

    pub(in super::super) fn motorway(rng: &mut Stream) -> f64 {
        rng.uniform(1200.0, 1700.0)
    }

    pub(in super::super) fn ramp(rng: &mut Stream) -> f64 {
        rng.uniform(250.0, 600.0)
    }

    pub(in super::super) fn bicycles(rng: &mut Stream) -> f64 {
        rng.uniform(30.0, 60.0)
    }

    pub(in super::super) fn driveway(rng: &mut Stream) -> f64 {
        rng.uniform(30.0, 90.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn radii_and_tapers_are_those_of_the_manuals() {
        assert!((smallest_radius(30.0) - 91.8).abs() < 0.5, "{}", smallest_radius(30.0));
        assert!((smallest_radius(60.0) - 408.0).abs() < 2.0, "{}", smallest_radius(60.0));
        assert!((merging_taper(3.6576, 60.0) - 219.5).abs() < 0.5);
        assert!((merging_taper(3.6576, 30.0) - 54.9).abs() < 0.5);
    }
}
