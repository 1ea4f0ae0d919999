//! Tests of all road maps over many seeds.

use std::collections::BTreeMap;

use reactsim_geometry::{Bounds, Polygon, point_segment, ring_distance, signed_angle_between};
use reactsim_rollout::{Purpose, stream};
use reactsim_scene::{LaneArea, LaneParts};

use super::build::{MARGIN, on_grid};
use super::validate::validate;
use super::{Layout, MAP_TYPES, MapType, all};

/// Returns the map types with junctions.
pub(super) fn junctions() -> impl Iterator<Item = &'static MapType> {
    MAP_TYPES.iter().skip_while(|kind| kind.id != "signalised-protected")
}

fn roads() -> impl Iterator<Item = &'static MapType> {
    all().filter(|kind| junctions().all(|other| other.id != kind.id))
}

pub(super) fn draw(kind: &MapType, seed: u64) -> Layout {
    (kind.draw)(&mut stream(seed, kind.id, 0, Purpose::Map))
}

/// Requires `check` to pass for every type and seed; reports the number of failures per type, and the first
/// one in full.
fn each(
    types: impl Iterator<Item = &'static MapType>,
    seeds: u64,
    check: impl Fn(&Layout) -> Result<(), String>,
) {
    let mut failed: BTreeMap<&str, (u64, String)> = BTreeMap::new();
    for kind in types {
        for seed in 0..seeds {
            if let Err(found) = check(&draw(kind, seed)) {
                failed.entry(kind.id).or_insert((0, format!("seed {seed}: {found}"))).0 += 1;
            }
        }
    }
    assert!(failed.is_empty(), "{failed:#?}");
}

#[test]
fn maps_are_sound() {
    each(all(), 200, |layout| {
        let flaws = validate(layout);
        if flaws.is_empty() { Ok(()) } else { Err(format!("{flaws:#?}")) }
    });
}

#[test]
fn a_seed_is_a_map() {
    for kind in all() {
        let layout = draw(kind, 3);
        assert_eq!(layout.map, draw(kind, 3).map);
        assert_ne!(layout.map.lanes, draw(kind, 4).map.lanes);
    }
}

#[test]
fn roads_are_long() {
    for kind in roads() {
        let long = if kind.id.contains("ramp") || kind.id == "weaving" { 590.0 } else { 345.0 };
        for seed in 0..30 {
            let layout = draw(kind, seed);
            let bounds = Bounds::of(layout.map.lanes.iter().flat_map(|l| l.points.iter().copied()));
            let reach = (bounds.max - bounds.min).norm();
            assert!(reach >= long, "{} {seed}: {reach} m from corner to corner", kind.id);
        }
    }
}

#[test]
fn linked_lanes_share_points_and_directions() {
    each(roads(), 60, |layout| {
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
    each(roads(), 12, |layout| {
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
    each(roads(), 30, |layout| {
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
