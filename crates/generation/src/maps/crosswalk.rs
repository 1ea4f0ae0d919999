//! A mid-block crosswalk, with or without lights.

use reactsim_geometry::Vec2;
use reactsim_rollout::Stream;
use reactsim_scene::{LightState, StopKind};

use super::build::{Direction, MapBuilder, Path, Pavement, Piece, Road};
use super::plain::enter;
use super::ranges::{centred, smallest_radius, street};
use crate::{Draw, Layout};

/// Distance from the edge of a crosswalk without parking, metres (20 ft).
const DAYLIGHTING_DISTANCE: f64 = 6.1;

/// Draws a street with a crosswalk away from junctions.
pub(super) fn mid_block(rng: &mut Stream) -> Layout {
    let (mut section, speed) = street(rng, (1, 2));
    let pavement = section
        .forward
        .pavement
        .unwrap_or(Pavement { verge: rng.uniform(0.4, 1.5), width: rng.uniform(1.8, 2.6) });
    section.forward.pavement = Some(pavement);
    if let Some(side) = &mut section.backward {
        side.pavement = Some(pavement);
    }
    let path = approach(rng, speed);
    let end = path.length();
    let at = 0.5 * end;
    let road = Road::new(centred(path, at, rng), section);

    let mut b = MapBuilder::new();
    let width = rng.uniform(3.0, 4.5);
    // Vehicles wait at least 4 ft before the crosswalk.
    let reach = 0.5 * width + rng.uniform(1.3, 4.0);
    let cuts = [0.0, at - reach, at + reach, end];
    let before = road.lanes(&mut b, "a", cuts[0], cuts[1]);
    let on = road.lanes(&mut b, "x", cuts[1], cuts[2]);
    let after = road.lanes(&mut b, "c", cuts[2], cuts[3]);
    before.link(&mut b, &on);
    on.link(&mut b, &after);
    road.surface(&mut b, 0.0, end, (true, true));
    road.lines(&mut b, 0.0, at - reach);
    road.lines(&mut b, at + reach, end);
    for direction in road.directions() {
        road.pavement(&mut b, direction, 0.0, at);
        road.pavement(&mut b, direction, at, end);
        road.parking(&mut b, rng, direction, 3.0, at - 0.5 * width - DAYLIGHTING_DISTANCE);
        road.parking(&mut b, rng, direction, at + 0.5 * width + DAYLIGHTING_DISTANCE, end - 3.0);
    }
    enter(&mut b, rng, &road, &before, Direction::Forward);
    enter(&mut b, rng, &road, &after, Direction::Backward);

    let across: Vec<Vec2> = [Direction::Forward, Direction::Backward]
        .map(|direction| road.path.at(at).aside(road.pavement_offset(direction)))
        .into();
    let crossed = b.lanes_across(&across);
    let lights = if rng.chance(0.4) { crossed.clone() } else { Vec::new() };
    b.crossing(across, width, &crossed, &lights);
    let phases = phases(rng, road.kerb(Direction::Backward) - road.kerb(Direction::Forward));
    for &lane in &lights {
        b.stop(StopKind::Light, lane);
        b.signal(lane, phases.clone());
    }
    b.finish()
}

/// Draws a straight path, or one with a bend somewhere before the crosswalk.
fn approach(rng: &mut Stream, speed: f64) -> Path {
    let length = rng.uniform(500.0, 600.0);
    if rng.chance(0.6) {
        return Path::straight(length);
    }
    let angle = rng.uniform(0.2, 0.6) * if rng.chance(0.5) { 1.0 } else { -1.0 };
    let bend = Piece::bend(angle, smallest_radius(speed) * rng.uniform(1.05, 1.6), 0.5);
    let rest = (length - bend.iter().map(|p| p.length).sum::<f64>()).max(200.0);
    Path::new(&[&[Piece::straight(0.25 * rest)], &bend[..], &[Piece::straight(0.75 * rest)]].concat())
}

/// Draws the phases: green for vehicles, then yellow, then red for as long as people need at 1.07 m/s (3.5
/// ft/s) after 7 s of walk. The cycle begins at some time within green.
fn phases(rng: &mut Stream, width: f64) -> Vec<(LightState, f64)> {
    let green = rng.uniform(25.0, 45.0);
    let (first, red) = (green * rng.uniform(0.05, 0.95), 7.0 + width / 1.07);
    vec![
        (LightState::Go, first),
        (LightState::Caution, rng.uniform(3.2, 4.2)),
        (LightState::Stop, red),
        (LightState::Go, green - first),
    ]
}
