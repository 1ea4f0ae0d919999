//! Parked vehicles: which spots are occupied, by which vehicles, and their exact poses.
//!
//! Nobody parks exactly in the middle: the jitter (0.1 m laterally, 1.5 degrees) is about what marked bays
//! leave room for. Occupied spots come in runs, as along real kerbs: a spot is more likely occupied if the
//! previous one is (a two-state Markov chain along the list of spots, whose share of occupied spots is
//! drawn per map).

use reactsim_geometry::{OrientedBox, direction, left, rounded_distance, wrap};
use reactsim_rollout::Stream;
use reactsim_scene::{Agent, AgentKind, AgentState};

use super::fleet::{Class, Size};
use crate::{Draw, ParkingSpot};

/// Correlation of the occupancy of neighbouring spots.
const SPOT_CORRELATION: f64 = 0.35;
/// Distance between spots, metres, below which they are neighbours.
const NEIGHBOUR_SPACING: f64 = 9.0;
/// Maximum overhang of a vehicle over the width of its spot, metres.
const MAX_OVERHANG: f64 = 0.15;
/// Minimum distance between two parked vehicles, metres.
const MIN_CLEARANCE: f64 = 0.15;
/// Share of vehicles parked in reverse in car parks; along kerbs there are none.
const REVERSED_SHARE: f64 = 0.12;

/// Draws the parked vehicles with their constant states. Ids are `parked-` and the index of the spot.
///
/// The share of occupied spots is drawn; no two vehicles touch, and each fits its spot.
pub fn park(spots: &[ParkingSpot], rng: &mut Stream) -> Vec<(Agent, AgentState)> {
    let share = rng.uniform(0.35, 0.9);
    let mut parked: Vec<(Agent, AgentState)> = Vec::new();
    let mut before: Option<(ParkingSpot, bool)> = None;
    for (i, &spot) in spots.iter().enumerate() {
        let beside = before.filter(|(s, _)| (s.position - spot.position).norm() < NEIGHBOUR_SPACING);
        let chance = beside.map_or(share, |(_, taken)| {
            share + SPOT_CORRELATION * (if taken { 1.0 - share } else { -share })
        });
        let taken = rng.chance(chance);
        before = Some((spot, taken));
        if taken && let Some((size, state)) = place(&spot, side_by_side(spots, i), rng) {
            let agent = Agent {
                id: format!("parked-{i}"),
                kind: AgentKind::Vehicle,
                length: size.length,
                width: size.width,
            };
            let own = state.footprint(&agent);
            let near = |b: &OrientedBox| (b.center - own.center).norm() < own.radius() + b.radius() + 1.0;
            let clear = parked.iter().all(|(other, s)| {
                let b = s.footprint(other);
                !near(&b) || rounded_distance(&own, &b, 0.0) >= MIN_CLEARANCE
            });
            if clear {
                parked.push((agent, state));
            }
        }
    }
    parked
}

/// Whether the nearest other spot is next to this one rather than in front of it or behind it: a car park,
/// not a kerb.
fn side_by_side(spots: &[ParkingSpot], i: usize) -> bool {
    let spot = spots[i];
    let others = spots.iter().enumerate().filter(|&(j, _)| j != i);
    let nearest =
        others.map(|(_, s)| s.position - spot.position).min_by(|a, b| a.norm().total_cmp(&b.norm()));
    nearest.is_some_and(|d| d.norm() < 4.5 && d.dot(&direction(spot.heading)).abs() < d.norm() * 0.7)
}

/// Draws a vehicle that fits the spot, with its pose; `None` if none of several drawn vehicles fits.
fn place(spot: &ParkingSpot, car_park: bool, rng: &mut Stream) -> Option<(Size, AgentState)> {
    let fits = |s: &Size| s.length <= spot.length - 0.3 && s.width <= spot.width + MAX_OVERHANG;
    let parks = |s: &Size| !matches!(s.class, Class::Bus | Class::Truck);
    let size = (0..12).map(|_| Size::draw(rng)).find(|s| fits(s) && parks(s))?;
    let along = direction(spot.heading);
    let room = 0.5 * (spot.length - size.length);
    let ahead = rng.normal_within(0.0, 0.3 * room + 0.05, -0.8 * room, 0.8 * room);
    let most = (0.5 * (spot.width - size.width) + MAX_OVERHANG).clamp(0.02, 0.25);
    let aside = rng.normal_within(0.0, 0.1_f64.min(0.6 * most), -most, most);
    let tilt = rng.normal_within(0.0, 1.5, -4.0, 4.0).to_radians();
    let turned = car_park && rng.chance(REVERSED_SHARE);
    let heading = wrap(spot.heading + tilt + if turned { std::f64::consts::PI } else { 0.0 });
    let p = spot.position + along * ahead + left(along) * aside;
    Some((size, AgentState { x: p.x, y: p.y, heading, vx: 0.0, vy: 0.0 }))
}

#[cfg(test)]
mod tests {
    use reactsim_geometry::Vec2;
    use reactsim_rollout::{Purpose, stream};

    use super::*;

    /// Returns a kerb with spots of 6 m, and a row of a car park.
    fn spots() -> Vec<ParkingSpot> {
        let kerb = (0..20).map(|i| ParkingSpot {
            position: Vec2::new(6.0 * f64::from(i), 0.0),
            heading: 0.0,
            length: 6.0,
            width: 2.2,
        });
        let bays = (0..20).map(|i| ParkingSpot {
            position: Vec2::new(2.7 * f64::from(i), 40.0),
            heading: 1.57,
            length: 5.3,
            width: 2.5,
        });
        kerb.chain(bays).collect()
    }

    #[test]
    fn parked_vehicles_neither_touch_nor_leave_their_spots() {
        let spots = spots();
        let (mut taken, mut turned) = (0, 0);
        for map in 0..100 {
            let parked = park(&spots, &mut stream(0, "parked", map, Purpose::Traffic));
            taken += parked.len();
            for (i, (agent, state)) in parked.iter().enumerate() {
                let own = state.footprint(agent);
                for (other, s) in &parked[..i] {
                    assert!(
                        rounded_distance(&own, &s.footprint(other), 0.0) > 0.1,
                        "{} and {}",
                        agent.id,
                        other.id
                    );
                }
                let spot = spots[agent.id["parked-".len()..].parse::<usize>().unwrap()];
                let bay = OrientedBox::new(spot.position, spot.heading, spot.length + 0.2, spot.width + 0.7);
                assert!(own.corners().iter().all(|&c| bay.contains(c)), "{} sticks out", agent.id);
                assert_eq!((state.vx, state.vy), (0.0, 0.0));
                if wrap(state.heading - spot.heading).abs() > 1.0 {
                    turned += 1;
                    assert!(spot.position.y > 20.0, "turned at the kerb");
                }
            }
        }
        assert!((1600..3200).contains(&taken), "{taken} of 4000");
        assert!(turned > 20, "{turned}");
    }

    #[test]
    fn the_stream_decides() {
        let spots = spots();
        let draw = |map| park(&spots, &mut stream(0, "parked", map, Purpose::Traffic));
        assert_eq!(draw(0), draw(0));
        assert_ne!(draw(0), draw(1));
        assert!(park(&[], &mut stream(0, "parked", 0, Purpose::Traffic)).is_empty());
    }
}
