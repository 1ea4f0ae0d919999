//! ScenarioNet pickles.

use std::f64::consts::PI;
use std::fs;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

use reactsim::formats::{CurrentFrames, FutureChoice, Input, find_inputs, open, survey};
use reactsim::geometry::Vec2;
use reactsim::scene::{AgentKind, Lane, LaneArea, LaneClass, LaneKind, LightState, Scenario};
use reactsim_test_support::pickle::{Py, pickle};
use serde_json::{Value, json};

use super::{
    Case, check_cases, check_made, first, good, logs_agree, maps_agree, moving, read_at, read_length, refusal,
};

/// Returns rows of numbers that become a numpy array.
fn array(rows: Vec<Vec<f64>>) -> Value {
    json!({ "__array__": rows })
}

fn numbers(frames: usize, of: impl Fn(usize) -> f64) -> Value {
    array((0..frames).map(|f| vec![of(f)]).collect())
}

/// Returns the value of Python.
fn python(value: &Value) -> Py {
    match value {
        Value::Null => Py::None,
        Value::Bool(b) => Py::Bool(*b),
        Value::Number(n) => n.as_i64().map_or_else(|| Py::Num(n.as_f64().unwrap()), Py::Int),
        Value::String(text) => Py::Text(text.clone()),
        Value::Array(items) => Py::List(items.iter().map(python).collect()),
        Value::Object(fields) => match fields.get("__array__").and_then(Value::as_array) {
            Some(rows) => {
                let rows: Vec<_> = rows.iter().map(|row| row.as_array().unwrap()).collect();
                let shape = vec![rows.len(), rows.first().map_or(1, |row| row.len())];
                Py::Array(shape, rows.into_iter().flatten().map(|v| v.as_f64().unwrap_or(f64::NAN)).collect())
            }
            None => {
                // The fields that identify the format are at the beginning.
                let first = ["id", "version", "length"];
                let (begin, rest): (Vec<_>, Vec<_>) =
                    fields.iter().partition(|(k, _)| first.contains(&k.as_str()));
                Py::Dict(begin.into_iter().chain(rest).map(|(k, v)| (k.clone(), python(v))).collect())
            }
        },
    }
}

/// Returns a track along the x axis at 10 m/s, absent before frame `from`.
fn track(frames: usize, kind: &str, x: f64, y: f64, from: usize) -> Value {
    let there = move |f: usize, v: f64| if f < from { 0.0 } else { v };
    json!({"type": kind, "metadata": {"type": kind}, "state": {
        "position": array((0..frames).map(|f| vec![there(f, x + f as f64), there(f, y), 1.0]).collect()),
        "heading": numbers(frames, |f| there(f, 0.01)),
        "velocity": array((0..frames).map(|f| vec![there(f, 10.0), there(f, 0.1)]).collect()),
        "valid": numbers(frames, |f| there(f, 1.0)),
        "length": numbers(frames, |f| there(f, 4.5)), "width": numbers(frames, |f| there(f, 1.9)), "height": numbers(frames, |_| 1.5)
    }})
}

fn line(points: &[(f64, f64)]) -> Value {
    array(points.iter().map(|p| vec![p.0, p.1, 0.0]).collect())
}

fn lane(kind: &str, points: &[(f64, f64)], before: Value, after: Value) -> Value {
    json!({"type": kind, "polyline": line(points), "speed_limit_mph": 25.0, "speed_limit_kmh": 40.0, "entry_lanes": before, "exit_lanes": after,
        "left_neighbor": [], "right_neighbor": []})
}

/// Returns a Waymo scenario with this number of frames.
fn made(frames: usize) -> Value {
    let corners = line(&[(1040.0, 0.0), (1045.0, 0.0), (1045.0, 8.0)]);
    let mut shown = vec![json!("LANE_STATE_STOP"), Value::Null];
    shown.resize(frames, json!("LANE_STATE_ARROW_GO"));
    let mut beside = lane("LANE_BIKE_LANE", &[(900.0, -4.0), (1050.0, -4.0)], json!([]), json!([]));
    beside["left_neighbor"] = json!([{"feature_id": "100", "self_start_index": "0", "self_end_index": "1", "neighbor_start_index": "0",
        "neighbor_end_index": "1", "boundaries": []}]);
    json!({
        "id": "made", "version": "MetaDrive v0.3.0.1", "length": frames,
        "metadata": {"dataset": "waymo", "sdc_id": "8", "scenario_id": "made", "ts": numbers(frames, |f| f as f64 * 0.1), "current_time_index": 10,
            "tracks_to_predict": {"7": {"track_index": 0, "track_id": "7", "difficulty": 0}}, "objects_of_interest": ["9"]},
        "tracks": {"7": track(frames, "VEHICLE", 1000.0, 5.0, 3), "8": track(frames, "VEHICLE", 1010.0, 0.0, 0), "9": track(frames, "PEDESTRIAN", 1020.0, 5.0, 0),
            "barrier": track(frames, "TRAFFIC_BARRIER", 1020.0, 9.0, 0)},
        "map_features": {
            "100": lane("LANE_SURFACE_STREET", &[(900.0, 0.0), (1050.0, 0.0)], json!([]), json!([101, 999])),
            "101": lane("LANE_FREEWAY", &[(1050.0, 0.0), (1200.0, 0.0)], json!([100]), json!([])),
            "102": beside,
            "104": {"type": "ROAD_EDGE_BOUNDARY", "polyline": line(&[(900.0, -6.0), (1200.0, -6.0)])},
            "105": {"type": "ROAD_EDGE_MEDIAN", "polyline": line(&[(1200.0, 8.0), (900.0, 8.0)])},
            "106": {"type": "ROAD_LINE_SOLID_SINGLE_YELLOW", "polyline": line(&[(900.0, 2.0), (1200.0, 2.0)])},
            "107": {"type": "CROSSWALK", "polygon": corners.clone()},
            "108": {"type": "SPEED_BUMP", "polyline": corners.clone()},
            "109": {"type": "DRIVEWAY", "polygon": corners.clone()},
            "110": {"type": "STOP_SIGN", "lane": [101], "position": array(vec![vec![1060.0], vec![-3.0], vec![1.0]])},
            "111": {"type": "CROSS_WALK", "polyline": corners.clone()},
            "112": {"type": "ROAD_EDGE_SIDEWALK", "polygon": corners}
        },
        "dynamic_map_states": {"100": {"type": "TRAFFIC_LIGHT", "lane": 100, "stop_point": array(vec![vec![1049.0], vec![0.0], vec![1.0]]),
            "state": {"object_state": shown}}}
    })
}

fn write(folder: &Path, value: &Value) -> PathBuf {
    let path = folder.join("f.pkl");
    fs::write(&path, pickle(&python(value), 4, 1)).unwrap();
    path
}

pub(super) fn small(folder: &Path) -> Vec<PathBuf> {
    vec![write(folder, &made(91))]
}

fn read_of(mut value: Value, change: impl FnOnce(&mut Value)) -> Result<Scenario, String> {
    let folder = tempfile::tempdir().unwrap();
    change(&mut value);
    first(&write(folder.path(), &value))
}

fn read(change: impl FnOnce(&mut Value)) -> Result<Scenario, String> {
    read_of(made(91), change)
}

#[test]
fn fields_mean_what_they_say() {
    let s = read(|_| ()).unwrap();
    check_made(&s);
    assert_eq!((s.source.as_str(), s.start.obstacles.len()), ("scenarionet", 1));
    assert_eq!((s.start.agents[1].length, s.start.agents[1].width), (4.5, 1.9));
    assert_eq!((s.timestamps.len(), s.timestamps[90]), (91, 9.0));
    let map = &s.start.map;
    assert_eq!(map.lanes[2].class, LaneClass::Bike);
    assert_eq!((map.lanes[2].left[0].lane, map.lanes[2].left[0].self_end), (0, 1));
    assert!((map.lanes[0].speed_limit.unwrap() - 25.0 * 0.44704).abs() < 1e-12);
    assert!(map.drivable_area.is_none());
    assert_eq!((map.crosswalks.len(), map.speed_bumps.len(), map.driveways.len()), (2, 1, 1));
    assert_eq!(map.stop_lines.len(), 2, "the sign's and the light's");
    let repairs: Vec<(&str, u32)> = s.repairs.iter().map(|(k, v)| (k.as_str(), *v)).collect();
    assert_eq!(repairs, [("links to missing lanes", 1), ("map features of other types", 1)]);
}

#[test]
fn unknown_types_are_noted() {
    let s = read(|v| {
        v["tracks"]["7"]["type"] = json!("TRUCK");
        v["tracks"]["9"]["type"] = json!("PED");
    });
    let note = s.unwrap().notes()["unknown-types"].clone();
    assert_eq!((note.count, note.detail.as_deref()), (2, Some("`PED`")));
    let cone = read(|v| v["tracks"]["7"]["type"] = json!("TRAFFIC_CONE"));
    assert!(!cone.unwrap().notes().contains_key("unknown-types"));
}

#[test]
fn recordings_of_other_lengths() {
    // Longer, and the current frame is not stated.
    let s = read_of(made(198), |v| {
        v["metadata"].as_object_mut().unwrap().remove("current_time_index");
    });
    let s = s.unwrap();
    assert_eq!((s.origin.x, s.timestamps[90]), (1020.0, 9.0));
    assert_eq!(s.repairs["recorded frames before and after those that are read"], 107);
    // As from Argoverse 2: 60 steps after the current frame.
    let s = read_of(made(110), |v| v["metadata"]["current_time_index"] = json!(49)).unwrap();
    assert_eq!((s.origin.x, s.repairs["frames at the end that are not recorded"]), (1059.0, 20));
    assert!(s.logged(0)[70].is_some() && s.logged(0)[71].is_none());
    assert!(s.light_states(0)[70].is_some() && s.light_states(0)[71].is_none());
    assert!((s.timestamps[90] - 12.9).abs() < 1e-9, "{}", s.timestamps[90]);
    // Another frame than the one in the file.
    let folder = tempfile::tempdir().unwrap();
    let path = write(folder.path(), &made(198));
    assert_eq!(read_at(&path, 100).unwrap().origin.x, 1110.0);
    let error = read_at(&path, 9).unwrap_err().to_string();
    assert!(
        error.contains("the current frame is 9, expected a frame with 10 before it, 10 to 197"),
        "{error}"
    );
    let two_hertz = read_of(made(20), |v| v["metadata"]["ts"] = numbers(20, |f| f as f64 * 0.5));
    let error = two_hertz.unwrap_err();
    assert!(error.contains("timestamps is a step of 0.5 s, expected steps of 0.1 s"), "{error}");
}

#[test]
fn older_and_other_flavours() {
    // One array for the box; codes and a stop point per frame for the lights.
    let s = read(|v| {
        let state = v["tracks"]["8"]["state"].as_object_mut().unwrap();
        state.remove("length");
        state.insert("size".into(), array((0..91).map(|_| vec![5.5, 2.1, 1.6]).collect()));
        v["dynamic_map_states"]["100"] = json!({"type": "TRAFFIC_LIGHT", "state": {
            "object_state": numbers(91, |f| if f < 20 { 4.0 } else { 6.0 }),
            "lane": numbers(91, |_| 100.0),
            "stop_point": array((0..91).map(|f| if f < 2 { vec![0.0; 3] } else { vec![1048.0, 0.0, 1.0] }).collect())}});
    });
    let s = s.unwrap();
    assert_eq!((s.start.agents[0].length, s.start.agents[0].width), (5.5, 2.1));
    let shown = s.light_states(0);
    assert_eq!((shown[0], shown[20]), (Some(LightState::Stop), Some(LightState::Go)));
    assert_eq!(s.start.map.stop_lines.len(), 2);
    // nuScenes: no links, outlines of lanes, the drivable area as rings, an AV that is wider than long,
    // limits that are filled in.
    let nuscenes = |v: &mut Value| {
        v["metadata"]["dataset"] = json!("nuscenes");
        v["tracks"]["8"]["state"]["length"] = numbers(91, |_| 1.73);
        v["tracks"]["8"]["state"]["width"] = numbers(91, |_| 4.08);
        for lane in ["100", "101", "102"] {
            v["map_features"][lane]["entry_lanes"] = Value::Null;
            v["map_features"][lane].as_object_mut().unwrap().remove("exit_lanes");
        }
        let ring = |a: f64, b: f64| {
            array([(a, a), (b, a), (b, b), (a, b), (a, a)].map(|p| vec![p.0 + 1000.0, p.1]).to_vec())
        };
        v["map_features"]["boundary_0"] =
            json!({"type": "ROAD_LINE_SOLID_SINGLE_WHITE", "polyline": ring(-100.0, 150.0)});
        v["map_features"]["boundary_1"] =
            json!({"type": "ROAD_LINE_SOLID_SINGLE_WHITE", "polyline": ring(60.0, 70.0)});
        v["map_features"]["100"]["polygon"] =
            array(vec![vec![900.0, -2.0], vec![1050.0, -2.0], vec![1050.0, 2.0], vec![900.0, 2.0]]);
    };
    let s = read(nuscenes).unwrap();
    assert_eq!((s.start.agents[0].length, s.start.agents[0].width), (4.08, 1.73));
    assert_eq!(s.repairs["length and width of the AV that were exchanged"], 1);
    let map = &s.start.map;
    assert_eq!((map.lanes[0].kind, map.lanes[1].kind), (LaneKind::Lane, LaneKind::Connector));
    assert!(matches!(map.lanes[0].area, LaneArea::Polygon(_)) && map.lanes[0].speed_limit.is_none());
    assert_eq!(map.lanes[0].successors, [1], "where they touch");
    let ground = map.drivable_area.as_ref().unwrap();
    assert_eq!((ground.len(), ground[0].holes.len(), map.road_lines.len()), (1, 1, 1));
    assert!(ground[0].contains(Vec2::new(0.0, 1.0)) && !ground[0].contains(Vec2::new(45.0, 65.0)));
    // nuPlan: colours, lists of ids for neighbours, paths through junctions with a type of their own.
    let s = read(|v| {
        v["metadata"]["dataset"] = json!("nuplan");
        v["map_features"]["101"]["type"] = json!("LANE_SURFACE_UNSTRUCTURE");
        for (lane, y) in [("100", 0.0), ("101", 0.0), ("102", -4.0)] {
            v["map_features"][lane]["polygon"] =
                json!([[900.0, y - 2.0], [1050.0, y - 2.0], [1050.0, y + 2.0]]);
        }
        v["map_features"]["103"] =
            lane("LANE_SURFACE_STREET", &[(900.0, -8.0), (1050.0, -8.0)], json!([]), json!([]));
        v["map_features"]["103"]["left_neighbor"] = json!(["100", "102"]);
        let colours = ["TRAFFIC_LIGHT_RED", "TRAFFIC_LIGHT_UNKNOWN", "TRAFFIC_LIGHT_GREEN"];
        let shown: Vec<&str> = (0..91).map(|f| colours[f % 3]).collect();
        v["dynamic_map_states"] =
            json!({"100": {"lane": "100", "stop_point": null, "state": {"object_state": shown}}});
    });
    let s = s.unwrap();
    let map = &s.start.map;
    assert_eq!(
        map.lanes.iter().map(|l| l.kind == LaneKind::Lane).collect::<Vec<_>>(),
        [true, false, true, false]
    );
    assert_eq!(map.lanes[3].left.iter().map(|n| map.lanes[n.lane].id.as_str()).collect::<Vec<_>>(), ["102"]);
    let shown = s.light_states(0);
    assert_eq!((shown[0], shown[1], shown[2]), (Some(LightState::Stop), None, Some(LightState::Go)));
}

#[test]
fn directions_of_lanes_are_no_heights() {
    let read_lanes = |dataset: &str, third: bool| {
        let change = |v: &mut Value| {
            v["metadata"]["dataset"] = json!(dataset);
            let points: Vec<(f64, f64)> = (0..31).map(|k| (1200.0 - 10.0 * f64::from(k), 3.5)).collect();
            v["map_features"]["103"] = lane("LANE_SURFACE_STREET", &points, json!([]), json!([]));
            for (id, direction) in [("100", 0.0), ("101", 0.0), ("102", 0.0), ("103", PI)] {
                let line = v["map_features"][id]["polyline"]["__array__"].as_array_mut().unwrap();
                for point in line.iter_mut().filter_map(Value::as_array_mut) {
                    point.truncate(2);
                    point.extend(third.then(|| json!(direction)));
                }
            }
        };
        read(change).unwrap()
    };
    for dataset in ["nuscenes", "of another converter"] {
        let (mut with, without) = (read_lanes(dataset, true), read_lanes(dataset, false));
        let dropped = with.repairs.remove("third coordinates that are directions, not heights");
        assert_eq!(dropped, (dataset != "nuscenes").then_some(4));
        assert!(!with.start.has_levels() && with.notes() == without.notes());
        assert_eq!(with.digest(), without.digest());
    }
}

#[test]
fn frames_around_the_current_one_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = small(folder.path()).remove(0);
    let usual = read_length(&path, None, None).unwrap();
    for (history, future, expected) in
        [(None, Some(FutureChoice::Log), (11, 80)), (Some(2), Some(FutureChoice::Steps(60)), (2, 60))]
    {
        let scenario = read_length(&path, history, future).unwrap();
        let length = scenario.length();
        assert_eq!((length.history, length.future), expected);
        assert_eq!(scenario.origin, usual.origin);
        assert_eq!(scenario.logged(0).len(), length.frames());
        assert_eq!(scenario.log_future.lights[0].len(), length.future);
        assert!(!scenario.repairs.contains_key("frames at the end that are not recorded"));
    }
    let later = read_length(&path, Some(21), Some(FutureChoice::Steps(60))).unwrap();
    assert_eq!(later.logged(0).len(), 81);
    assert_eq!(later.notes()["later-frame"].detail.as_deref(), Some("10 frames after it"));
    let error = read_length(&path, Some(31), Some(FutureChoice::Steps(61))).unwrap_err();
    assert!(
        error.ends_with("a frame with 30 before it, 30 to 90; choose it with `current-frame`"),
        "{error}"
    );
    let error = read_length(&path, None, Some(FutureChoice::Steps(81))).unwrap_err();
    assert!(error.ends_with("the number of frames after frame 10 is 80, expected 81 or more"), "{error}");
}

#[test]
fn long_recordings_have_windows() {
    let folder = tempfile::tempdir().unwrap();
    let path = write(folder.path(), &made(199));
    let frames = CurrentFrames::Every(NonZeroUsize::new(50).unwrap());
    let input = Input { frames, ..find_inputs(&path).unwrap().remove(0) };
    let windows: Vec<Scenario> = input.open().unwrap().map(Result::unwrap).collect();
    let ids: Vec<&str> = windows.iter().map(|scenario| scenario.id.as_str()).collect();
    assert_eq!(ids, ["made@10", "made@60", "made@110"]);
    let at = read_at(&path, 60).unwrap();
    assert_eq!((windows[1].origin, &windows[1].log_future), (at.origin, &at.log_future));
    fs::write(&path, &fs::read(&path).unwrap()[..2000]).unwrap();
    let error = input.open().unwrap().next().unwrap().unwrap_err().to_string();
    assert!(error.contains("f.pkl") && error.contains("as a pickle"), "{error}");
}

#[test]
fn bad_input_is_refused_by_name() {
    let cases: &[Case<Value>] = &[
        ("`tracks` is missing, expected a scenario as ScenarioNet writes it", |v| {
            v.as_object_mut().unwrap().remove("tracks");
        }),
        ("`map_features` is missing", |v| v["map_features"] = Value::Null),
        ("`metadata.sdc_id` is missing", |v| v["metadata"]["sdc_id"] = Value::Null),
        ("metadata.sdc_id is `77`, expected the id of a track", |v| v["metadata"]["sdc_id"] = json!("77")),
        ("id is ``, expected the name of the scenario", |v| v["id"] = json!("")),
        ("id is a list of 0, expected an id", |v| v["id"] = json!([])),
        ("length is -1, expected the number of frames", |v| v["length"] = json!(-1)),
        ("metadata.current_time_index is 91, expected a frame with 10 before it, 10 to 90", |v| {
            v["metadata"]["current_time_index"] = json!(91);
        }),
        ("metadata.current_time_index is 9, expected", |v| v["metadata"]["current_time_index"] = json!(9)),
        ("metadata.sample_rate is 0.5, expected 0.1", |v| v["metadata"]["sample_rate"] = json!(0.5)),
        ("metadata.ts is an array of shape (90, 1), expected one time for each of 91 frames", |v| {
            v["metadata"]["ts"] = numbers(90, |f| f as f64 * 0.1);
        }),
        ("tracks is a list of 0, expected a dictionary", |v| v["tracks"] = json!([])),
        ("`tracks[\"7\"].state.position` is missing", |v| {
            v["tracks"]["7"]["state"].as_object_mut().unwrap().remove("position");
        }),
        (
            "tracks[\"9\"].state.heading is an array of shape (90, 1), expected an angle for each of 91 frames",
            |v| {
                v["tracks"]["9"]["state"]["heading"] = numbers(90, |_| 0.0);
            },
        ),
        ("tracks[\"9\"].state.position[4] is NaN, expected a finite number where `valid` is true", |v| {
            v["tracks"]["9"]["state"]["position"]["__array__"][4][1] = Value::Null;
        }),
        ("agents[1].track[10] is absent", |v| {
            v["tracks"]["8"]["state"]["valid"]["__array__"][10] = json!([0.0])
        }),
        ("agents[0].length is NaN, expected a size", |v| {
            v["tracks"]["7"]["state"]["length"] = numbers(91, |_| f64::NAN);
        }),
        ("`map_features[\"100\"].type` is missing", |v| v["map_features"]["100"]["type"] = Value::Null),
        ("map_features[\"104\"].polyline[1] is (NaN, -6), expected a finite point", |v| {
            v["map_features"]["104"]["polyline"]["__array__"][1][0] = Value::Null;
        }),
        ("map_features[\"104\"].polyline is an array of shape (2, 1), expected points", |v| {
            v["map_features"]["104"]["polyline"] = numbers(2, |_| 0.0);
        }),
        ("map_features[\"100\"].exit_lanes[0] is a dictionary of 0, expected an id", |v| {
            v["map_features"]["100"]["exit_lanes"] = json!([{}]);
        }),
        ("map_features[\"100\"].speed_limit_mph is `fast`, expected a number", |v| {
            v["map_features"]["100"]["speed_limit_mph"] = json!("fast");
        }),
        ("dynamic_map_states[\"100\"].state.object_state[0] is `blue`, expected `LANE_STATE_`", |v| {
            v["dynamic_map_states"]["100"]["state"]["object_state"][0] = json!("blue");
        }),
        ("object_state is a list of 1, expected a state for each of 91 frames", |v| {
            v["dynamic_map_states"]["100"]["state"]["object_state"] = json!([null]);
        }),
        ("stop_point is an array of shape (1, 1), expected a point", |v| {
            v["dynamic_map_states"]["100"]["stop_point"] = numbers(1, |_| 0.0);
        }),
    ];
    check_cases(cases, "f.pkl: record 0: ", |change| read(change));
}

#[test]
fn calls_of_other_programs_are_not_run() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("f.pkl");
    let trace = folder.path().join("trace");
    let mut hostile = b"\x80\x04}(X\x06\0\0\0lengthKZX\x07\0\0\0versioncos\nsystem\n".to_vec();
    let command = format!("touch {}", trace.display());
    hostile.push(b'X');
    hostile.extend((command.len() as u32).to_le_bytes());
    hostile.extend(command.as_bytes());
    hostile.extend(b"\x85Ru.");
    fs::write(&path, hostile).unwrap();
    let error = refusal(&path);
    assert!(error.contains("it names `os.system`, which is not run"), "{error}");
    assert!(!trace.exists());
}

#[test]
fn files_are_told_by_content() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path(), &made(91));
    // Files next to scenarios, and pickles of other programs.
    fs::write(folder.path().join("dataset_summary.pkl"), b"\x80\x04}.").unwrap();
    fs::write(folder.path().join("other.pkl"), b"\x80\x04}.").unwrap();
    fs::write(folder.path().join("hand.json"), super::HAND_WRITTEN).unwrap();
    let found = find_inputs(folder.path()).unwrap();
    let formats: Vec<&str> = found.iter().map(|i| i.format.id()).collect();
    assert_eq!(formats, ["scenarionet", "json"]);
    let passed = survey(folder.path()).unwrap().passed_over;
    assert_eq!(passed, [(folder.path().join("other.pkl"), "it is not a scenario file".to_owned())]);
}

#[test]
fn real_files() {
    let Some(folder) = crate::shared("data/scenarionet") else { return };
    let scenarios = good(&folder);
    assert_eq!(scenarios.len(), 8);
    for s in &scenarios {
        for agent in s.start.agents.iter().filter(|a| a.kind == AgentKind::Vehicle) {
            assert!(agent.length > agent.width, "{}: {agent:?}", s.id);
        }
        // In a few frames of recordings, vehicles do not move in the direction of their heading.
        let (seen, astray) = moving(s);
        assert!(astray * 50 <= seen, "{}: {astray} of {seen}", s.id);
        let still = s.start.now(0).speed() < 1.0;
        assert!(seen > 20 || still, "{}: {seen}", s.id);
        assert!(s.start.map.lanes.iter().any(|l| !l.successors.is_empty()), "{}", s.id);
        let nuscenes = s.id.starts_with("scene-");
        assert_eq!(s.start.map.drivable_area.is_some(), nuscenes, "{}", s.id);
        assert_eq!(s.timestamps.len(), 91);
    }
}

#[test]
fn the_same_scenarios_agree_with_the_waymo_records() {
    let pairs = [("2a1e44d405a6833f", "00002"), ("womd_106", "00003"), ("womd_333", "00000")];
    for (file, shard) in pairs {
        let Some(ours) = crate::shared(&format!("data/scenarionet/{file}.pkl")) else { return };
        let record = format!("data/womd/train/womd-train-{shard}-of-00011.tfrecord.zst");
        let Some(record) = crate::shared(&record) else { return };
        let ours = good(&ours).remove(0);
        let theirs = open(&record).unwrap().map(|s| s.unwrap()).find(|s| s.id == ours.id).unwrap();
        agree(&ours, &theirs);
    }
}

fn agree(ours: &Scenario, theirs: &Scenario) {
    logs_agree(ours, theirs);
    let (m, n) = (&ours.start.map, &theirs.start.map);
    maps_agree(m, n);
    for lane in &m.lanes {
        let other = n.lanes.iter().find(|l| l.id == lane.id).unwrap();
        let neighbours = |lane: &Lane| (lane.kind, lane.left.len(), lane.right.len());
        assert_eq!(neighbours(lane), neighbours(other), "{}: {}", ours.id, lane.id);
    }
    assert_eq!(m.stop_lines.len(), n.stop_lines.len(), "{}", ours.id);
    assert_eq!(ours.start.lights.len(), theirs.start.lights.len(), "{}", ours.id);
    for (i, light) in ours.start.lights.iter().enumerate() {
        let name = &m.lanes[light.lane].id;
        let j = theirs.start.lights.iter().position(|l| n.lanes[l.lane].id == *name).unwrap();
        assert_eq!(ours.light_states(i), theirs.light_states(j), "{}: {name}", ours.id);
    }
}
