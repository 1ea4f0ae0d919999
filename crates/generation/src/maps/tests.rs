//! Tests of all road maps over many seeds.

use std::collections::BTreeMap;

use reactsim_geometry::{Bounds, Polygon, point_segment, ring_distance, signed_angle_between};
use reactsim_rollout::{Purpose, stream};
use reactsim_scene::{LaneArea, LaneParts};

use super::build::{MARGIN, on_grid};
use super::validate::validate;
use super::{Layout, MapType, find};

/// Ids of the map types tested here: roads. Junctions have their own tests.
pub(super) const ROADS: [&str; 12] = [
    "straight-road",
    "curved-road",
    "narrow-street",
    "lane-drop",
    "lane-addition",
    "on-ramp",
    "off-ramp",
    "weaving",
    "mid-block-crosswalk",
    "driveways",
    "car-park-exit",
    "overpass",
];

fn draw(id: &str, seed: u64) -> Layout {
    let kind: &MapType = find(id).unwrap();
    (kind.draw)(&mut stream(seed, id, 0, Purpose::Map))
}

/// Requires `check` to pass for every type and seed; reports the number of failures per type, and the first
/// one in full.
fn all(seeds: u64, check: impl Fn(&Layout) -> Result<(), String>) {
    let mut failed: BTreeMap<&str, (u64, String)> = BTreeMap::new();
    for id in ROADS {
        for seed in 0..seeds {
            if let Err(found) = check(&draw(id, seed)) {
                failed.entry(id).or_insert((0, format!("seed {seed}: {found}"))).0 += 1;
            }
        }
    }
    assert!(failed.is_empty(), "{failed:#?}");
}

#[test]
fn road_maps_are_sound() {
    all(200, |layout| {
        let flaws = validate(layout);
        if flaws.is_empty() {
            return Ok(());
        }
        Err(flaws.iter().take(6).map(|f| format!("{f}\n")).collect())
    });
}

#[test]
fn road_maps_are_named_large_and_the_same_twice() {
    for id in ROADS {
        let layout = draw(id, 3);
        assert_eq!(layout.kind, id);
        assert_eq!(layout.map, draw(id, 3).map);
        let again = draw(id, 4);
        assert_ne!(layout.map.lanes, again.map.lanes);
    }
    all(30, |layout| {
        let bounds = Bounds::of(layout.map.lanes.iter().flat_map(|l| l.points.iter().copied()));
        let long = if layout.kind.contains("ramp") || layout.kind == "weaving" { 590.0 } else { 345.0 };
        let reach = (bounds.max - bounds.min).norm();
        if reach < long { Err(format!("{reach} m from corner to corner")) } else { Ok(()) }
    });
}

#[test]
fn linked_lanes_share_points_and_directions() {
    all(60, |layout| {
        let lanes: BTreeMap<&str, &LaneParts> = layout.map.lanes.iter().map(|l| (l.id.as_str(), l)).collect();
        for lane in &layout.map.lanes {
            let n = lane.points.len();
            for next in lane.successors.iter().map(|id| lanes[id.as_str()]) {
                if lane.points[n - 1] != next.points[0] {
                    return Err(format!("{} and {} do not meet", lane.id, next.id));
                }
                let (a, b) = (lane.points[n - 1] - lane.points[n - 2], next.points[1] - next.points[0]);
                let turn = signed_angle_between(a, b).to_degrees();
                if turn.abs() > 3.0 {
                    return Err(format!("{} turns by {turn} degrees into {}", lane.id, next.id));
                }
            }
            if let Some(p) = lane.points.iter().find(|p| **p != on_grid(**p)) {
                return Err(format!("{}: {p} is not on the grid", lane.id));
            }
        }
        Ok(())
    });
}

#[test]
fn lanes_have_ground_beside_them() {
    all(12, |layout| {
        let ground = layout.map.drivable_area.as_deref().unwrap_or(&[]);
        for lane in &layout.map.lanes {
            let LaneArea::Polygon(ring) = &lane.area else { return Err("no outline".into()) };
            for &p in ring.iter().step_by(3) {
                // On two levels, the ground of one of the roads.
                let border = |on: &Polygon| {
                    on.holes.iter().fold(ring_distance(p, &on.exterior), |d, h| d.min(ring_distance(p, h)))
                };
                let Some(border) = ground.iter().filter(|g| g.contains(p)).map(border).max_by(f64::total_cmp)
                else {
                    return Err(format!("{} leaves the ground at {p}", lane.id));
                };
                if border < MARGIN - 0.06 {
                    return Err(format!("{} is {border} m from the edge at {p}", lane.id));
                }
            }
        }
        Ok(())
    });
}

#[test]
fn points_are_dense_enough() {
    all(30, |layout| {
        for lane in &layout.map.lanes {
            for w in lane.points.windows(3) {
                let (a, b) = (w[1] - w[0], w[2] - w[1]);
                let step = a.norm().max(b.norm());
                // The arc deviates from the chord by less than the grid of a survey.
                let sagitta = point_segment(w[1], w[0], w[2]).0.sqrt();
                if step > 5.01 || sagitta > 0.12 {
                    return Err(format!(
                        "{}: {step} m between points, {sagitta} m aside at {}",
                        lane.id, w[1]
                    ));
                }
            }
        }
        Ok(())
    });
}
