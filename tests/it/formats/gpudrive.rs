//! GPUDrive and Nocturne files.

use std::fs;
use std::path::{Path, PathBuf};

use reactsim::formats::{FutureChoice, find_inputs, open};
use reactsim::scene::{LaneClass, RoadEdgeKind, Scenario};
use serde_json::{Value, json};

use super::{
    Case, check_cases, check_made, first, good, logs_agree, maps_agree, moving, read_length, refusal,
};

/// Returns an object that moves along the x axis at 10 m/s and is absent before frame `from`.
fn object(id: u64, kind: &str, x: f64, y: f64, from: usize) -> Value {
    let at = |f: usize| match f < from {
        true => json!({"x": -10000.0, "y": -10000.0, "z": -10000.0}),
        // Along the heading at the current frame.
        false => json!({"x": x + f as f64, "y": y + 0.01 * (f as f64 - 10.0), "z": 3.0}),
    };
    let frames = |of: &dyn Fn(usize) -> Value| (0..91).map(of).collect::<Vec<_>>();
    json!({
        "position": frames(&at), "width": 1.9, "length": 4.5, "height": 1.5,
        "heading": frames(&|f| if f < from { json!(-10000.0) } else { json!(0.01) }),
        "velocity": frames(&|f| if f < from { json!({"x": -10000.0, "y": -10000.0}) } else { json!({"x": 10.0, "y": 0.1}) }),
        "valid": frames(&|f| json!(f >= from)), "goalPosition": {"x": 0, "y": 0, "z": 0}, "type": kind, "id": id,
        "mark_as_expert": false
    })
}

fn line(points: &[(f64, f64)]) -> Value {
    points.iter().map(|p| json!({"x": p.0, "y": p.1, "z": 0.0})).collect()
}

fn made() -> Value {
    let road = |id: u64, kind: &str, code: i64, points: &[(f64, f64)]| json!({"geometry": line(points), "type": kind, "map_element_id": code, "id": id});
    json!({
        "name": "tfrecord-00001-of-00150_7.json", "scenario_id": "made",
        "objects": [object(7, "vehicle", 1000.0, 5.0, 3), object(9, "pedestrian", 1020.0, 5.0, 0), object(8, "vehicle", 1010.0, 0.0, 0)],
        "roads": [
            road(100, "lane", 2, &[(900.0, 0.0), (1050.0, 0.0)]),
            road(101, "lane", 1, &[(1050.0, 0.02), (1200.0, 0.0)]),
            road(102, "lane", 3, &[(1050.0, 0.2), (1200.0, 9.0)]),
            road(103, "lane", 2, &[(1050.0, 0.0)]),
            road(104, "road_edge", 15, &[(900.0, -2.0), (1200.0, -2.0)]),
            road(105, "road_edge", 16, &[(1200.0, 8.0), (900.0, 8.0)]),
            road(106, "road_line", 11, &[(900.0, 2.0), (1200.0, 2.0)]),
            road(107, "crosswalk", 18, &[(1040.0, 0.0), (1045.0, 0.0), (1045.0, 8.0)]),
            road(108, "speed_bump", 19, &[(1040.0, 0.0), (1045.0, 0.0), (1045.0, 8.0)]),
            road(109, "driveway", 20, &[(1040.0, 0.0), (1045.0, 0.0), (1045.0, 8.0)]),
            road(110, "stop_sign", 17, &[(1049.0, -3.0)]),
        ],
        "tl_states": {
            "100": {"state": ["stop", "arrow_go"], "x": [1049.0, 1049.0], "y": [0.0, 0.0], "z": [0.0, 0.0], "time_index": [0, 90]},
            "999": {"state": ["go"], "x": [0.0], "y": [0.0], "z": [0.0], "time_index": [4]}
        },
        "metadata": {"sdc_track_index": 2, "objects_of_interest": [9], "tracks_to_predict": [{"track_index": 0, "difficulty": 0}]}
    })
}

fn write(folder: &Path, value: &Value) -> PathBuf {
    // As in real files, the fields that identify the format are at the beginning.
    let path = folder.join("f.json");
    let Value::Object(fields) = value else { panic!() };
    let order = ["name", "scenario_id", "objects", "roads", "tl_states", "metadata"];
    let body: Vec<String> =
        order.iter().filter_map(|k| Some(format!("\"{k}\": {}", fields.get(*k)?))).collect();
    fs::write(&path, format!("{{{}}}", body.join(", "))).unwrap();
    path
}

pub(super) fn small(folder: &Path) -> Vec<PathBuf> {
    vec![write(folder, &made())]
}

fn read(change: impl FnOnce(&mut Value)) -> Result<Scenario, String> {
    let folder = tempfile::tempdir().unwrap();
    let mut value = made();
    change(&mut value);
    first(&write(folder.path(), &value))
}

#[test]
fn fields_mean_what_they_say() {
    let s = read(|_| ()).unwrap();
    check_made(&s);
    assert_eq!(s.source, "gpudrive");
    let map = &s.start.map;
    assert!(map.lanes[2].predecessors.is_empty(), "20 cm beside the end");
    assert_eq!((map.crosswalks.len(), map.speed_bumps.len(), map.driveways.len()), (1, 1, 1));
    assert_eq!(map.stop_lines.len(), 1, "the light's");
    for what in ["lanes without extent", "stop signs of unknown lanes", "lights on missing lanes"] {
        assert_eq!(s.repairs[what], 1, "{what}");
    }
}

#[test]
fn old_files_hold_degrees_and_no_ids() {
    let old = |value: &mut Value| {
        let top = value.as_object_mut().unwrap();
        top.remove("metadata");
        top.remove("scenario_id");
        for object in value["objects"].as_array_mut().unwrap() {
            object.as_object_mut().unwrap().remove("id");
            let degrees = |h: &Value| json!(h.as_f64().unwrap().to_degrees());
            object["heading"] = object["heading"].as_array().unwrap().iter().map(degrees).collect();
        }
        for road in value["roads"].as_array_mut().unwrap() {
            road.as_object_mut().unwrap().remove("id");
            road.as_object_mut().unwrap().remove("map_element_id");
        }
    };
    let s = read(old).unwrap();
    assert_eq!((s.id.as_str(), s.start.agents[0].id.as_str()), ("tfrecord-00001-of-00150_7", "2"));
    let unmarked = s.repairs.keys().find(|what| what.contains("`metadata.sdc_track_index`"));
    assert!(unmarked.is_some_and(|what| what.ends_with("the last object is taken")), "{:?}", s.repairs);
    assert!((s.start.now(0).heading - 0.01).abs() < 1e-12, "{}", s.start.now(0).heading);
    assert_eq!(s.start.map.lanes[0].successors, [1]);
    assert_eq!(
        (s.start.map.lanes[0].class, s.start.map.road_edges[0].kind),
        (LaneClass::Undefined, RoadEdgeKind::Unknown)
    );
    // If nothing moves, only the age of the file decides the unit of headings.
    let halt = |value: &mut Value| {
        for object in value["objects"].as_array_mut().unwrap() {
            object["velocity"] = (0..91).map(|_| json!({"x": 0.0, "y": 0.0})).collect();
        }
    };
    assert!((read(halt).unwrap().start.now(0).heading - 0.01).abs() < 1e-12);
    let both = read(|value| {
        old(value);
        halt(value);
    });
    assert!((both.unwrap().start.now(0).heading - 0.01).abs() < 1e-12);
}

#[test]
fn numbers_that_python_writes_are_unknown_or_refused_by_place() {
    let folder = tempfile::tempdir().unwrap();
    let read = |field: &str, value: &str| {
        let mut marked = made();
        marked["objects"][0][field][20] =
            if field == "heading" { json!("here") } else { json!({"x": "here", "y": 0.0}) };
        let path = write(folder.path(), &marked);
        let text = fs::read_to_string(&path).unwrap().replace("\"here\"", value);
        fs::write(&path, text).unwrap();
        open(&path).and_then(|mut scenarios| scenarios.next().unwrap()).map_err(|e| e.to_string())
    };
    for unknown in ["NaN", "null"] {
        let s = read("velocity", unknown).unwrap();
        let track = s.logged(s.start.agents.iter().position(|a| a.id == "7").unwrap());
        // Estimated from the positions.
        assert!((track[20].unwrap().vx - 10.0).abs() < 1e-9);
        assert_eq!(track[21].unwrap().vx, 10.0);
    }
    // A heading is that of the motion.
    let s = read("heading", "NaN").unwrap();
    let track = s.logged(s.start.agents.iter().position(|a| a.id == "7").unwrap());
    assert!((track[20].unwrap().heading - 0.01).abs() < 0.02, "{:?}", track[20]);
    let error = read("position", "NaN").unwrap_err();
    assert!(error.contains("agents[0].track[20].x is NaN, expected a finite coordinate"), "{error}");
}

#[test]
fn frames_around_the_current_one_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = write(folder.path(), &made());
    let usual = read_length(&path, None, None).unwrap();
    let lights = usual.light_states(0);
    for (history, future, expected) in [
        (None, Some(FutureChoice::Log), (11, 80)),
        (Some(2), Some(FutureChoice::Steps(60)), (2, 60)),
        (Some(5), None, (5, 80)),
    ] {
        let scenario = read_length(&path, history, future).unwrap();
        let length = scenario.length();
        assert_eq!((length.history, length.future), expected);
        let first = 11 - length.history;
        assert_eq!(scenario.logged(0)[..], usual.logged(0)[first..first + length.frames()]);
        assert_eq!(scenario.light_states(0)[..], lights[first..first + length.frames()]);
    }
    // A longer history has the first frame with as many before it as the current one.
    let later = read_length(&path, Some(21), Some(FutureChoice::Steps(60))).unwrap();
    assert_eq!(later.notes()["later-frame"].detail.as_deref(), Some("10 frames after it"));
    assert_eq!((later.light_states(0), later.start.history[0].len()), (lights[..81].to_vec(), 21));
    let now = usual.logged_at(0, 20).unwrap();
    assert!((later.origin - usual.origin - now.position()).norm() < 1e-9);
    let refused = |history, future| read_length(&path, history, future).unwrap_err();
    let error = refused(Some(12), None);
    let expected = "objects[0].position is 91 entries, expected 92 entries (9.2 s at 10 Hz)";
    assert!(error.ends_with(expected), "{error}");
    let error = refused(None, Some(FutureChoice::Steps(81)));
    assert!(error.ends_with(expected), "{error}");
}

#[test]
fn bad_input_is_refused_by_name() {
    let cases: &[Case<Value>] = &[
        ("metadata.sdc_track_index is 3, expected the index of one of 3 objects", |v| {
            v["metadata"]["sdc_track_index"] = json!(3);
        }),
        ("metadata.tracks_to_predict[0].track_index is -1", |v| {
            v["metadata"]["tracks_to_predict"][0]["track_index"] = json!(-1);
        }),
        ("`scenario_id` is missing", |v| {
            v["scenario_id"] = json!("");
            v["name"] = Value::Null;
        }),
        ("objects[1].heading is 90 entries, expected 91 entries", |v| {
            v["objects"][1]["heading"].as_array_mut().unwrap().pop();
        }),
        ("objects[0].position[0] is (-10000, -10000), expected a position where `valid` is true", |v| {
            v["objects"][0]["valid"][0] = json!(true);
        }),
        ("agents[1].id is 7, expected an id that no other agent has", |v| v["objects"][1]["id"] = json!(7)),
        ("agents[2].track[10] is absent", |v| v["objects"][2]["valid"][10] = json!(false)),
        ("agents[0].length is -4, expected a size", |v| v["objects"][0]["length"] = json!(-4)),
        ("agents[0].track[50] is (1000000000", |v| {
            v["objects"][0]["position"][50] = json!({"x": 1e300, "y": 0.0});
        }),
        ("agents[0].track[50].heading is 1000000000", |v| v["objects"][0]["heading"][50] = json!(1e9)),
        ("map.road_edges[0] is (1000000000", |v| {
            v["roads"][4]["geometry"][0] = json!({"x": 1e300, "y": 5.0});
        }),
        ("map.lanes[1].id is 100, expected an id that no other lane has", |v| {
            v["roads"][1]["id"] = json!(100)
        }),
        ("tl_states[\"100\"].state[0] is `blue`, expected unknown, arrow_stop,", |v| {
            v["tl_states"]["100"]["state"][0] = json!("blue");
        }),
        ("tl_states[\"100\"].time_index[1] is 91, expected the index of a frame, 0 to 90", |v| {
            v["tl_states"]["100"]["time_index"][1] = json!(91);
        }),
        ("tl_states[\"100\"].x is 1 entries, expected as many as `time_index` has: 2", |v| {
            v["tl_states"]["100"]["x"] = json!([1.0]);
        }),
        ("missing field `width`", |v| {
            v["objects"][0].as_object_mut().unwrap().remove("width");
        }),
        ("missing field `roads`", |v| {
            v.as_object_mut().unwrap().remove("roads");
        }),
        ("invalid type: string \"far\", expected a number or null", |v| {
            v["objects"][0]["position"][4]["x"] = json!("far")
        }),
        ("objects is empty", |v| {
            v["objects"] = json!([]);
            v["metadata"] = Value::Null;
        }),
    ];
    check_cases(cases, "f.json: record 0: ", |change| read(change));
    // Codes of elements that do not exist have a stated meaning.
    let s = read(|v| {
        v["roads"][0]["map_element_id"] = json!(i64::MIN);
        v["roads"][6]["map_element_id"] = json!(i64::MIN);
        v["roads"][7]["type"] = json!("runway");
    });
    let s = s.unwrap();
    assert_eq!((s.start.map.lanes[0].class, s.start.map.road_lines[0].paint), (LaneClass::Undefined, 0));
    assert_eq!(s.repairs["road elements of unknown type"], 1);
}

#[test]
fn text_that_is_not_json_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = write(folder.path(), &made());
    let text = fs::read_to_string(&path).unwrap();
    fs::write(&path, text.replacen("1020.0", "nan", 1)).unwrap();
    assert!(refusal(&path).contains("cannot be decoded"));
    fs::write(&path, format!("{{\"objects\": [{{\"position\": {}", "[".repeat(1_000_000))).unwrap();
    assert!(refusal(&path).contains("cannot be decoded"));
}

#[test]
fn kinds_of_json_are_told_apart() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path(), &made());
    fs::write(folder.path().join("hand.json"), super::HAND_WRITTEN).unwrap();
    fs::write(folder.path().join("other.json"), "{\"objects\": 3}").unwrap();
    let found = find_inputs(folder.path()).unwrap();
    let formats: Vec<&str> = found.iter().map(|i| i.format.id()).collect();
    assert_eq!(formats, ["gpudrive", "json"]);
}

#[test]
fn real_files() {
    let Some(folder) = crate::shared("data/gpudrive") else { return };
    let scenarios = good(&folder);
    assert_eq!(scenarios.len(), 4);
    for s in &scenarios {
        let av = &s.start.agents[0];
        assert!((av.length - 5.286).abs() < 1e-6 && (av.width - 2.332).abs() < 1e-6, "{}: {av:?}", s.id);
        let (seen, astray) = moving(s);
        assert!(seen > 20 && astray == 0, "{}: {astray} of {seen}", s.id);
        assert!(s.start.map.lanes.iter().any(|l| !l.successors.is_empty()));
    }
}

#[test]
fn the_same_scenario_agrees_with_the_waymo_record() {
    let Some(ours) = crate::shared("data/gpudrive/965472cb24cb397b.json") else { return };
    let Some(record) = crate::shared("data/womd/train/womd-train-00001-of-00011.tfrecord.zst") else {
        return;
    };
    let ours = good(&ours).remove(0);
    let theirs = open(&record).unwrap().map(|s| s.unwrap()).find(|s| s.id == ours.id).unwrap();
    logs_agree(&ours, &theirs);
    let ids = |s: &Scenario| s.start.agents.iter().map(|a| a.id.clone()).collect::<Vec<_>>();
    assert_eq!(ids(&ours), ids(&theirs), "in one order");
    let (m, n) = (&ours.start.map, &theirs.start.map);
    maps_agree(m, n);
    let edges = |map: &reactsim::scene::RoadMap| map.road_edges.iter().map(|e| e.points.len()).sum::<usize>();
    assert_eq!(edges(m), edges(n));
}
