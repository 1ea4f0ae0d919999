//! Streets with driveways, and the exit of a car park.

use std::f64::consts::{FRAC_PI_2, PI};

use reactsim_rollout::Stream;

use super::access::Access;
use super::build::{Direction, MapBuilder, Path, Piece, Road, RoadLanes};
use super::plain::enter;
use super::ranges::{centred, flows, smallest_radius, street};
use crate::{Draw, Layout, ParkingSpot};

/// Draws a street with several driveways on both sides.
pub(super) fn driveways(rng: &mut Stream) -> Layout {
    let road = block(rng);
    let end = road.path.length();
    let mut accesses: Vec<Access> = Vec::new();
    let count = rng.count(3, 6);
    let mut s = 0.5 * end - rng.uniform(15.0, 25.0) * count as f64;
    for _ in 0..count {
        let direction = if rng.chance(0.5) { Direction::Forward } else { Direction::Backward };
        let length = rng.uniform(45.0, 80.0);
        let bend =
            Path::new(&[Piece::straight(0.4 * length), Piece::arc(0.6 * length, rng.uniform(-0.004, 0.004))]);
        if let Some(access) = Access::draw(rng, &road, s, direction, bend) {
            s += 2.0 * access.reach;
            accesses.push(access);
        }
        s += rng.uniform(8.0, 30.0);
    }
    let mut b = MapBuilder::new();
    let doors = join(&mut b, rng, &road, &accesses);
    for (access, lanes) in accesses.iter().zip(&doors) {
        b.entry(lanes.backward[0], flows::driveway(rng));
        access.road.surface(&mut b, -access.setback, access.road.path.length(), (false, true));
    }
    b.finish()
}

/// Draws a street joined by the aisle of a car park, with cars parked on both sides of the aisle.
pub(super) fn car_park(rng: &mut Stream) -> Layout {
    let road = block(rng);
    let end = road.path.length();
    let direction = if rng.chance(0.5) { Direction::Forward } else { Direction::Backward };
    let throat = rng.uniform(10.0, 18.0);
    let pitch = rng.uniform(2.6, 2.8);
    let stalls = rng.count(9, 18) as f64 * pitch;
    let aisle = Path::straight(throat + stalls + rng.uniform(55.0, 85.0));
    let mut accesses = Vec::new();
    // The street is straight there, so the first skew angle usually works.
    while accesses.is_empty() {
        accesses.extend(Access::draw(rng, &road, 0.5 * end - 12.0, direction, aisle.clone()));
    }
    let mut b = MapBuilder::new();
    let doors = join(&mut b, rng, &road, &accesses);
    let access = &accesses[0];
    b.entry(doors[0].backward[0], rng.uniform(80.0, 200.0));
    access.road.surface(&mut b, -access.setback, access.road.path.length(), (false, true));
    let (length, clear) = (rng.uniform(5.2, 5.5), 0.4);
    for side in [-1.0, 1.0] {
        if rng.chance(0.1) {
            continue;
        }
        let edge = access.road.lanes_edge(Direction::Backward) + clear;
        let slab = (side * edge, side * (edge + length + 0.5));
        access.road.slab(
            &mut b,
            (slab.0.min(slab.1), slab.0.max(slab.1)),
            throat - 0.3,
            throat + stalls + 0.3,
            (false, false),
        );
        let mut s = throat + 0.5 * pitch;
        while s < throat + stalls {
            let at = access.road.path.at(s);
            // Most drivers park forwards.
            let out = at.heading + side * FRAC_PI_2 + if rng.chance(0.8) { 0.0 } else { PI };
            let position = at.aside(side * (edge + 0.5 * length));
            b.park(ParkingSpot { position, heading: out, length: length - 0.2, width: pitch - 0.5 });
            s += pitch;
        }
    }
    b.finish()
}

/// Draws a street that is straight in its middle.
fn block(rng: &mut Stream) -> Road {
    let (section, speed) = street(rng, (1, 2));
    let middle = rng.uniform(220.0, 260.0);
    let mut pieces = vec![Piece::straight(middle)];
    if rng.chance(0.4) {
        let bend = |rng: &mut Stream| {
            let angle = rng.uniform(0.15, 0.45) * if rng.chance(0.5) { 1.0 } else { -1.0 };
            Piece::bend(angle, smallest_radius(speed) * rng.uniform(1.05, 1.5), 0.5)
        };
        pieces = [&bend(rng)[..], &pieces, &bend(rng)[..]].concat();
    }
    let length: f64 = pieces.iter().map(|p| p.length).sum();
    let rest = Piece::straight((0.5 * (380.0 - length)).max(15.0));
    let path = Path::new(&[&[rest], &pieces[..], &[rest]].concat());
    let centre = 0.5 * path.length();
    Road::new(centred(path, centre, rng), section)
}

/// Lays the street in stretches, one per driveway, and joins the driveways to it. Returns the lanes of the
/// driveways in the same order.
fn join(b: &mut MapBuilder, rng: &mut Stream, road: &Road, accesses: &[Access]) -> Vec<RoadLanes> {
    let end = road.path.length();
    let mut cuts = vec![0.0];
    for access in accesses {
        // There is always a stretch between neighbouring driveways, even if it is short.
        cuts.extend([access.s - access.reach, access.s + access.reach]);
    }
    cuts.push(end);
    let stretches: Vec<RoadLanes> =
        (0..cuts.len() - 1).map(|i| road.lanes(b, &format!("s{i}"), cuts[i], cuts[i + 1])).collect();
    for pair in stretches.windows(2) {
        pair[0].link(b, &pair[1]);
    }
    road.surface(b, 0.0, end, (true, true));
    road.lines(b, 0.0, end);
    enter(b, rng, road, &stretches[0], Direction::Forward);
    enter(b, rng, road, &stretches[stretches.len() - 1], Direction::Backward);
    let doors = accesses
        .iter()
        .enumerate()
        .map(|(i, access)| {
            access.join(b, rng, road, i, [&stretches[2 * i], &stretches[2 * i + 1], &stretches[2 * i + 2]])
        })
        .collect();
    for direction in road.directions() {
        let (mut walked, mut parked) = (0.0, 3.0);
        for access in accesses.iter().filter(|a| a.direction == direction) {
            road.pavement(b, direction, walked, access.s - access.gap);
            road.parking(b, rng, direction, parked, access.s - access.reach);
            (walked, parked) = (access.s + access.gap, access.s + access.reach);
        }
        road.pavement(b, direction, walked, end);
        road.parking(b, rng, direction, parked, end - 3.0);
    }
    doors
}
