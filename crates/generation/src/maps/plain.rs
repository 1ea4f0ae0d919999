//! Straight and winding roads of several lanes, and narrow streets between parked cars.

use reactsim_rollout::Stream;
use reactsim_scene::LaneClass;

use super::build::{Direction, MapBuilder, Median, Path, Pavement, Road, RoadLanes, Section, Side, mph};
use super::ranges::{centred, flows, motorway, street, winding};
use crate::{Draw, Layout};

pub(super) fn straight(rng: &mut Stream) -> Layout {
    let (section, _) = any_section(rng);
    let freeway = section.class == LaneClass::Freeway;
    let length = if freeway { rng.uniform(850.0, 1000.0) } else { rng.uniform(500.0, 620.0) };
    let path = centred(Path::straight(length), 0.5 * length, rng);
    whole(rng, &Road::new(path, section), "road").finish()
}

pub(super) fn curved(rng: &mut Stream) -> Layout {
    let (section, speed) = any_section(rng);
    let length = if section.class == LaneClass::Freeway { 620.0 } else { 360.0 };
    let path = winding(rng, length, speed);
    let middle = path.length() * rng.uniform(0.4, 0.6);
    let path = centred(path, middle, rng);
    whole(rng, &Road::new(path, section), "road").finish()
}

/// Draws a narrow street of one lane per direction, with parked cars on both sides.
pub(super) fn narrow(rng: &mut Stream) -> Layout {
    let side = Side {
        parking: Some(rng.uniform(2.5, 2.65)),
        shoulder: 0.5,
        pavement: Some(Pavement { verge: rng.uniform(0.3, 1.6), width: rng.uniform(1.5, 2.2) }),
        ..Side::plain(1, rng.uniform(3.0, 3.1))
    };
    let section = Section {
        class: LaneClass::SurfaceStreet,
        speed: mph(25.0),
        forward: side,
        backward: Some(side),
        median: Median { width: 0.0, shoulder: 0.5, raised: false },
    };
    let path =
        if rng.chance(0.5) { Path::straight(rng.uniform(460.0, 540.0)) } else { winding(rng, 460.0, 25.0) };
    let middle = 0.5 * path.length();
    let road = Road::new(centred(path, middle, rng), section);
    let mut b = MapBuilder::new();
    let end = road.path.length();
    let lanes = road.lanes(&mut b, "street", 0.0, end);
    road.surface(&mut b, 0.0, end, (true, true));
    // Few such streets have a centre line.
    if rng.chance(0.3) {
        road.lines(&mut b, 0.0, end);
    }
    for direction in road.directions() {
        road.pavement(&mut b, direction, 0.0, end);
        road.parking(&mut b, rng, direction, 3.0, end - 3.0);
    }
    for &lane in lanes.forward.iter().chain(&lanes.backward) {
        b.entry(lane, rng.uniform(150.0, 400.0));
    }
    b.finish()
}

/// Draws a cross-section: mostly of a street, sometimes of a motorway.
pub(super) fn any_section(rng: &mut Stream) -> (Section, f64) {
    if rng.chance(0.25) { motorway(rng, (2, 4)) } else { street(rng, (1, 3)) }
}

/// Lays a single stretch from border to border. Lane ids begin with `name`.
pub(super) fn whole(rng: &mut Stream, road: &Road, name: &str) -> MapBuilder {
    let mut b = MapBuilder::new();
    let end = road.path.length();
    let lanes = road.lay(&mut b, name, 0.0, end, (true, true));
    for direction in road.directions() {
        road.parking(&mut b, rng, direction, 3.0, end - 3.0);
        enter(&mut b, rng, road, &lanes, direction);
    }
    b
}

/// Adds the entries of a direction: vehicles on its lanes, cyclists on its bicycle lane.
pub(super) fn enter(
    b: &mut MapBuilder,
    rng: &mut Stream,
    road: &Road,
    lanes: &RoadLanes,
    direction: Direction,
) {
    for &lane in lanes.of(direction) {
        let freeway = road.section.class == LaneClass::Freeway;
        b.entry(lane, if freeway { flows::motorway(rng) } else { flows::street(rng) });
    }
    if let Some(bike) = lanes.bike_of(direction) {
        b.entry(bike, flows::bicycles(rng));
    }
}
