//! Vehicles parked off the drivable ground, next to the road: in front of homes and in the rows of car
//! parks.
//!
//! Recordings are full of them (43 % of the vehicles of the Waymo Open Motion Dataset's train split kept
//! outside this repository stand off lanes throughout). They matter because sensors see them and networks
//! must learn to ignore them.

use reactsim_geometry::{Polyline, Vec2, direction, into_frame, left, wrap};
use reactsim_rollout::Stream;
use reactsim_scene::{LaneClass, RoadEdge, RoadEdgeKind};

use crate::{Draw, Layout, ParkingSpot};

/// Length of a parking spot, metres.
const SPOT_LENGTH: f64 = 5.6;
/// Width of a parking spot, metres.
const SPOT_WIDTH: f64 = 2.5;
/// Distance between two vehicles side by side, metres: stalls of 9 ft.
const STALL_WIDTH: f64 = 2.75;
/// Minimum distance of the middle of a spot from any edge of the road, metres.
const EDGE_CLEARANCE: f64 = 4.2;
/// Minimum distance of the middle of a spot from the side of a footway, metres.
const FOOTWAY_CLEARANCE: f64 = 3.0;
/// Height, metres, above which an edge of a road is not on the ground.
const MAX_GROUND_HEIGHT: f64 = 0.5;
/// Maximum distance of a spot from the middle of the map, metres.
const MAX_DISTANCE: f64 = 130.0;

/// Land use next to a stretch of road.
enum LandUse {
    /// Unused.
    Open,
    /// Homes, with their spacing in metres.
    Homes(f64),
    /// A car park: the distance of its first row in metres, and the number of rows.
    Lot(f64, usize),
}

/// Adds yards and car parks along the outer edges of streets. Motorways have none.
pub(super) fn add(layout: &mut Layout, rng: &mut Stream) {
    let motorway = layout.map.lanes.iter().any(|l| l.class == LaneClass::Freeway);
    // Degree of development of the area.
    let built = rng.uniform(-0.7, 0.8);
    if motorway || built <= 0.0 {
        return;
    }
    // Nobody parks on a bridge or its ramps.
    let is_raised = |i: usize| {
        layout.map.heights.road_edges.get(i).is_some_and(|h| h.iter().any(|z| *z > MAX_GROUND_HEIGHT))
    };
    let line = |(i, e): (usize, &RoadEdge)| {
        let has_yards = e.kind == RoadEdgeKind::Boundary && !is_raised(i);
        Some((Polyline::new(&e.points).ok()?, has_yards))
    };
    let (edges, outer): (Vec<Polyline>, Vec<bool>) =
        layout.map.road_edges.iter().enumerate().filter_map(line).unzip();
    let mut yards: Vec<ParkingSpot> = Vec::new();
    for (edge, has_yards) in edges.iter().zip(outer) {
        if !has_yards || edge.length() < 30.0 {
            continue;
        }
        let mut s = 4.0;
        while s < edge.length() {
            let stretch = rng.uniform(25.0, 70.0);
            let land_use = match rng.weighted(&[1.3 - built, 0.6 * built, 0.5 * built]) {
                0 => LandUse::Open,
                1 => LandUse::Homes(rng.uniform(10.0, 22.0)),
                _ => LandUse::Lot(rng.uniform(6.5, 14.0), rng.count(1, 3)),
            };
            for (at, depth, heading) in spots(&land_use, s, (s + stretch).min(edge.length()), rng) {
                let along = edge.heading_at(at);
                // The ground is on the left of an edge, so the yard is on its right.
                let position = edge.at(at) - left(direction(along)) * depth;
                let heading = wrap(along + heading);
                let spot = ParkingSpot { position, heading, length: SPOT_LENGTH, width: SPOT_WIDTH };
                if is_free(&spot, layout, &edges, &yards) {
                    yards.push(spot);
                }
            }
            s += stretch;
        }
    }
    layout.yards = yards;
}

/// Returns the parking spots along a stretch: arc length, distance from the edge, heading relative to the
/// edge.
fn spots(kind: &LandUse, from: f64, to: f64, rng: &mut Stream) -> Vec<(f64, f64, f64)> {
    use std::f64::consts::FRAC_PI_2;
    let mut out = Vec::new();
    match *kind {
        LandUse::Open => {}
        LandUse::Homes(every) => {
            let mut s = from + rng.uniform(0.0, every);
            while s < to {
                let depth = rng.uniform(6.0, 11.0);
                for i in 0..rng.count(1, 2) {
                    let nose = if rng.chance(0.75) { -FRAC_PI_2 } else { FRAC_PI_2 };
                    out.push((s + i as f64 * STALL_WIDTH, depth + rng.uniform(0.0, 1.0), nose));
                }
                s += every * rng.uniform(0.7, 1.4);
            }
        }
        LandUse::Lot(depth, rows) => {
            for row in 0..rows {
                let mut s = from + 2.0;
                while s < to - 2.0 {
                    let nose = if rng.chance(0.7) { -FRAC_PI_2 } else { FRAC_PI_2 };
                    // An aisle, then two rows nose to nose.
                    let deep = depth + row.div_ceil(2) as f64 * 11.5 + (row / 2) as f64 * 5.8;
                    out.push((s, deep, nose));
                    s += STALL_WIDTH;
                }
            }
        }
    }
    out
}

/// Whether a spot is clear of roads, footways and other spots.
fn is_free(spot: &ParkingSpot, layout: &Layout, edges: &[Polyline], yards: &[ParkingSpot]) -> bool {
    let p: Vec2 = spot.position;
    let ground = layout.map.drivable_area.as_deref().unwrap_or_default();
    p.norm() < MAX_DISTANCE
        && yards.iter().all(|o| {
            let apart = into_frame(direction(spot.heading), p - o.position);
            apart.x.abs() > SPOT_LENGTH + 0.3 || apart.y.abs() > STALL_WIDTH - 0.05
        })
        && ground.iter().all(|g| !g.contains(p))
        && edges.iter().all(|e| e.project(p).distance > EDGE_CLEARANCE)
        && layout.footways.iter().all(|f| f.line.project(p).distance > 0.5 * f.width + FOOTWAY_CLEARANCE)
}
