//! Comparison of the sample logs and maps with the output of another program.

use reactsim_test_support::shared;
use std::collections::BTreeSet;
use std::path::Path;

use reactsim_geometry::{Polygon, Vec2, math};
use reactsim_scene::{AgentKind, LightState, Scenario};
use serde_json::{Value, json};

use super::super::library;
use super::super::log::{Category, Log};
use super::super::map::{Area, Map, MapLane};
use super::super::parts;
use super::super::window;
use crate::LengthChoice;

struct Sample {
    log: Log,
    map: std::sync::Arc<Map>,
    expected: Value,
    anchor: usize,
}

fn each_sample(check: impl Fn(&Sample)) {
    let Some(samples) = shared("data/nuplan") else { return };
    let mut seen = 0;
    for entry in std::fs::read_dir(samples.join("nuplan-v1.1/splits/mini")).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_stem().unwrap().to_string_lossy().into_owned();
        let text = std::fs::read_to_string(samples.join(format!("expected/{name}.json"))).unwrap();
        let expected: Value = serde_json::from_str(&text).unwrap();
        let log = Log::read(&path).unwrap();
        let folder = library::folder_for(&path).unwrap();
        let map = library::map(&folder, &log.map_name).unwrap();
        let token = expected["anchor_token"].as_str().unwrap();
        let anchor = log.frames.iter().position(|f| f.token.to_string() == token).unwrap();
        check(&Sample { log, map, expected, anchor });
        seen += 1;
    }
    assert_eq!(seen, 4);
}

#[track_caller]
fn close(found: f64, expected: &Value, tolerance: f64, what: &str) {
    let expected = expected.as_f64().unwrap_or_else(|| panic!("{what}: expected {expected}, found {found}"));
    assert!((found - expected).abs() <= tolerance, "{what}: {found}, expected {expected}");
}

#[track_caller]
fn near(found: Vec2, expected: &Value, tolerance: f64, what: &str) {
    close(found.x, &expected[0], tolerance, what);
    close(found.y, &expected[1], tolerance, what);
}

fn texts(fids: &[i64]) -> Value {
    json!(fids.iter().map(i64::to_string).collect::<Vec<_>>())
}

#[test]
fn windows_and_ego() {
    each_sample(|s| {
        let rows = window::rows(&s.log, s.anchor, LengthChoice::default()).unwrap().0;
        let times: Vec<i64> = rows.iter().map(|&r| s.log.frames[r].timestamp).collect();
        assert_eq!(json!(times), s.expected["frame_timestamps_us"]);
        assert_eq!(json!(s.log.frames.len()), s.expected["n_lidar_pc"]);
        assert_eq!(json!(s.log.map_name), s.expected["map_name"]);
        assert_eq!(json!(s.log.starts().len()), s.expected["n_valid_start_tokens"]);
        let mut tags = Vec::new();
        for (&frame, all) in &s.log.tags {
            tags.extend(all.iter().map(|(tag, _)| json!([tag, s.log.frames[frame].token.to_string()])));
        }
        tags.sort_by_key(Value::to_string);
        assert_eq!(json!(tags), s.expected["scenario_tags"]);
        for (k, &row) in rows.iter().enumerate() {
            let state = parts::av_state(&s.log.frames[row].ego, &s.map).unwrap();
            let expected = &s.expected["ego_centers_all_frames"][k];
            near(state.position(), expected, 1e-4, "ego centre");
            close(state.heading, &expected[2], 1e-6, "ego heading");
            assert_eq!(json!(s.log.boxes_at(row).len()), s.expected["object_counts_all_frames"][k]);
            let Some(frame) = s.expected["frames"].get(k.to_string()) else { continue };
            assert_eq!(json!(s.log.frames[row].token.to_string()), frame["lidar_pc_token"]);
            let ego = &s.log.frames[row].ego;
            near(Vec2::new(ego.x, ego.y), &frame["ego"]["rear_axle"], 1e-6, "rear axle");
            near(state.position(), &frame["ego"]["center"], 1e-6, "centre");
            near(Vec2::new(ego.longitudinal, ego.lateral), &frame["ego"]["velocity_body"], 1e-6, "velocity");
            assert!((state.speed() - math::hypot(ego.longitudinal, ego.lateral)).abs() < 1e-12);
        }
    });
}

#[test]
fn objects_and_lights() {
    each_sample(|s| {
        let rows = window::rows(&s.log, s.anchor, LengthChoice::default()).unwrap().0;
        for k in [0, 10, 50, 90] {
            let frame = &s.expected["frames"][k.to_string()];
            let found = s.log.boxes_at(rows[k]);
            let expected = frame["objects"].as_array().unwrap();
            assert_eq!(found.len(), expected.len());
            for (object, expected) in found.iter().zip(expected) {
                assert_eq!(json!(object.track.to_string()), expected["track_token"]);
                let category = s.log.tracks[&object.track];
                let name = match category {
                    Category::Vehicle => "VEHICLE",
                    Category::Bicycle => "BICYCLE",
                    Category::Pedestrian => "PEDESTRIAN",
                    Category::TrafficCone => "TRAFFIC_CONE",
                    Category::Barrier => "BARRIER",
                    Category::CzoneSign => "CZONE_SIGN",
                    Category::GenericObject => "GENERIC_OBJECT",
                };
                assert_eq!(json!(name), expected["type"]);
                for (i, key) in ["x", "y", "heading", "length", "width", "vx", "vy"].iter().enumerate() {
                    if expected[key].is_null() {
                        assert!(i >= 5 && category.kind() == AgentKind::Other);
                    } else {
                        close(object.values[i], &expected[key], 1e-6, key);
                    }
                }
            }
        }
        let strings = s.expected["traffic_light_strings"].as_object().unwrap();
        let seen: BTreeSet<String> = rows
            .iter()
            .filter_map(|r| s.log.lights.get(r))
            .flat_map(|l| l.keys().map(i64::to_string))
            .collect();
        assert_eq!(seen, strings.keys().cloned().collect());
        for (connector, letters) in strings {
            let connector: i64 = connector.parse().unwrap();
            let letter = |row: &usize| match s.log.lights.get(row).and_then(|l| l.get(&connector)) {
                None => '-',
                Some(LightState::Go) => 'G',
                Some(LightState::Caution) => 'Y',
                Some(LightState::Stop) => 'R',
                Some(_) => 'U',
            };
            assert_eq!(rows.iter().map(letter).collect::<String>(), letters.as_str().unwrap());
        }
    });
}

fn line(points: &[Vec2], expected: &Value, what: &str) {
    assert_eq!(json!(points.len()), expected["n"], "{what}");
    near(points[0], &expected["first"], 1e-4, what);
    near(points[points.len() - 1], &expected["last"], 1e-4, what);
    let length: f64 = points.windows(2).map(|w| (w[1] - w[0]).norm()).sum();
    close(length, &expected["length"], 1e-4, what);
}

/// Returns twice the area of a ring and six times its first moment, with the sign of a positive area.
fn moments(ring: &[Vec2], origin: Vec2) -> (f64, Vec2) {
    let mut sums = (0.0, Vec2::zeros());
    for w in ring.windows(2) {
        let (a, b) = (w[0] - origin, w[1] - origin);
        sums.0 += a.perp(&b);
        sums.1 += (a + b) * a.perp(&b);
    }
    if sums.0 < 0.0 { (-sums.0, -sums.1) } else { sums }
}

fn polygon(exterior: &[Vec2], holes: &[Vec<Vec2>], expected: &Value, what: &str) {
    assert_eq!(json!(exterior.len()), expected["n_exterior"], "{what}");
    assert_eq!(json!(holes.len()), expected["n_holes"], "{what}");
    let origin = exterior[0];
    let (mut area, mut moment) = moments(exterior, origin);
    for hole in holes {
        let (less, there) = moments(hole, origin);
        (area, moment) = (area - less, moment - there);
    }
    close(area / 2.0, &expected["area"], 1e-3, what);
    near(origin + moment / (3.0 * area), &expected["centroid"], 1e-3, what);
}

fn areas(found: &[Area], expected: &Value, what: &str) {
    for expected in expected.as_array().unwrap() {
        let area = found.iter().find(|a| json!(a.fid.to_string()) == expected["id"]).unwrap();
        let Polygon { exterior, holes } = &area.polygons[0];
        polygon(exterior, holes, &expected["polygon"], what);
    }
}

fn lane(map: &Map, lane: &MapLane, expected: &Value) {
    let what = expected["id"].to_string();
    assert_eq!(json!(lane.roadblock.unwrap().to_string()), expected["roadblock"], "{what}");
    match expected["speed_limit_mps"].as_f64() {
        None => assert!(lane.speed_limit.is_nan(), "{what}"),
        Some(_) => close(lane.speed_limit, &expected["speed_limit_mps"], 1e-6, &what),
    }
    line(&lane.baseline, &expected["baseline"], &what);
    for (side, key) in lane.sides.iter().zip(["left_boundary", "right_boundary"]) {
        line(&map.boundaries[&side.unwrap()].points, &expected[key], &what);
    }
    polygon(&lane.outline.exterior, &lane.outline.holes, &expected["polygon"], &what);
    assert_eq!(texts(&lane.incoming), expected["incoming"], "{what}");
    assert_eq!(texts(&lane.outgoing), expected["outgoing"], "{what}");
}

#[test]
fn maps() {
    each_sample(|s| {
        let expected = &s.expected["map"];
        let by_id = |value: &Value| &s.map.lanes[&value["id"].as_str().unwrap().parse().unwrap()];
        for expected in expected["lanes"].as_array().unwrap() {
            let found = by_id(expected);
            assert!(!found.is_connector);
            lane(&s.map, found, expected);
            assert_eq!(json!(found.index), expected["index"]);
            for (neighbor, key) in found.neighbors.iter().zip(["left", "right"]) {
                assert_eq!(json!(neighbor.map(|fid| fid.to_string())), expected[key]);
            }
        }
        for expected in expected["lane_connectors"].as_array().unwrap() {
            let found = by_id(expected);
            assert!(found.is_connector);
            lane(&s.map, found, expected);
            assert_eq!(json!(!found.stop_fids.is_empty()), expected["has_traffic_lights"]);
            let mut stops = s.map.stop_lines(found);
            stops.sort();
            let mut selected: Vec<i64> = expected["stop_lines"]
                .as_array()
                .unwrap()
                .iter()
                .map(|id| id.as_str().unwrap().parse().unwrap())
                .collect();
            selected.sort();
            assert_eq!(stops, selected, "{}", expected["id"]);
        }
        for expected in expected["stop_lines"].as_array().unwrap() {
            let stop = &s.map.stops[&expected["id"].as_str().unwrap().parse().unwrap()];
            assert_eq!(json!(stop.kind), expected["type"]);
            polygon(&stop.polygons[0].exterior, &stop.polygons[0].holes, &expected["polygon"], "stop line");
        }
        areas(&s.map.crosswalks, &expected["crosswalks"], "crosswalk");
        areas(&s.map.intersections, &expected["intersections"], "junction");
        areas(&s.map.drivable, &expected["carpark_areas"], "car park");
        assert_eq!(json!(s.map.drivable.len()), s.expected["drivable_area_rows"]);
    });
}

/// Compares probes of the whole map and of the clipped map of the scenario.
#[test]
fn probes() {
    each_sample(|s| {
        let parts = parts::parts(&s.log, &s.map, s.anchor, LengthChoice::default()).unwrap();
        let scenario = Scenario::assemble(parts).unwrap();
        let (cut, mut cut_off) = (&scenario.start.map, 0);
        for probe in s.expected["probes"].as_array().unwrap() {
            let p = Vec2::new(probe["x"].as_f64().unwrap(), probe["y"].as_f64().unwrap());
            let q = p - scenario.origin;
            let inside = |areas: &[Area]| areas.iter().any(|a| a.polygons.iter().any(|a| a.contains(p)));
            assert_eq!(json!(inside(&s.map.drivable)), probe["drivable"], "{probe}");
            assert_eq!(json!(inside(&s.map.intersections)), probe["intersection"], "{probe}");
            assert_eq!(json!(inside(&s.map.crosswalks)), probe["crosswalk"], "{probe}");
            let holding = |connector: bool| -> BTreeSet<String> {
                let all = s.map.lanes.iter().filter(|(_, l)| l.is_connector == connector);
                all.filter(|(_, l)| l.outline.contains(p)).map(|(fid, _)| fid.to_string()).collect()
            };
            let ids = |key: &str| -> BTreeSet<String> { serde_json::from_value(probe[key].clone()).unwrap() };
            assert_eq!(holding(false), ids("lanes"), "{probe}");
            assert_eq!(holding(true), ids("lane_connectors"), "{probe}");
            assert_eq!(json!(!holding(false).is_empty()), probe["lane"], "{probe}");
            // The clipped map must keep the areas that contain the point, near the scenario.
            let area = cut.drivable_area.as_ref().unwrap();
            if json!(area.iter().any(|a| a.contains(q))) != probe["drivable"] {
                cut_off += 1;
            }
        }
        assert!(cut_off < 10, "{cut_off} of 200 points");
    });
}

#[test]
fn scenarios_by_token() {
    let Some(samples) = shared("data/nuplan") else { return };
    let folder = tempfile::tempdir().unwrap();
    let mut tokens = Vec::new();
    each_sample(|s| {
        let parts = parts::parts(&s.log, &s.map, s.anchor, LengthChoice::default()).unwrap();
        let scenario = Scenario::assemble(parts).unwrap();
        assert!(scenario.repairs.is_empty(), "{:?}", scenario.repairs);
        let now = s.expected["frames"]["10"]["objects"].as_array().unwrap();
        let moving = |o: &&Value| ["VEHICLE", "PEDESTRIAN", "BICYCLE"].iter().any(|t| o["type"] == *t);
        assert_eq!(scenario.start.agents.len(), (now.iter().filter(moving).count() + 1).min(64));
        assert_eq!(scenario.start.obstacles.len(), now.iter().filter(|o| !moving(o)).count());
        // The AV is on the road all the time.
        let area = scenario.start.map.drivable_area.as_ref().unwrap();
        for state in scenario.logged(0).iter().flatten() {
            assert!(area.iter().any(|a| a.contains(state.position())));
        }
    });
    let logs = samples.join("nuplan-v1.1/splits/mini");
    each_sample_token(&samples, &mut tokens);
    let path = folder.path().join("pick.json");
    let maps = samples.join("maps");
    std::fs::write(
        &path,
        json!({"format": "reactsim-nuplan-v1", "logs": [logs], "maps": maps, "tokens": tokens}).to_string(),
    )
    .unwrap();
    let found: Vec<String> = crate::open(&path).unwrap().map(|s| s.unwrap().id).collect();
    assert_eq!(found, tokens);
    let tagged = json!({"format": "reactsim-nuplan-v1", "logs": [logs], "maps": maps, "tags": ["near_multiple_vehicles"]});
    std::fs::write(&path, tagged.to_string()).unwrap();
    let found: Vec<String> = crate::open(&path).unwrap().map(|s| s.unwrap().id).collect();
    assert_eq!(found, tokens);
    // A folder of logs gives one scenario per log: they are 11 s long.
    assert_eq!(crate::open(&logs).unwrap().filter(Result::is_ok).count(), 4);
}

fn each_sample_token(samples: &Path, tokens: &mut Vec<String>) {
    let mut files: Vec<_> =
        std::fs::read_dir(samples.join("expected")).unwrap().map(|e| e.unwrap().path()).collect();
    files.sort();
    for file in files.iter().filter(|f| !f.ends_with("projection.json")) {
        let expected: Value = serde_json::from_str(&std::fs::read_to_string(file).unwrap()).unwrap();
        tokens.push(expected["anchor_token"].as_str().unwrap().to_owned());
    }
}
