//! Argoverse 2 scenarios.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use arrow_array::{ArrayRef, Float64Array, Int64Array, StringArray};
use reactsim::evaluation::Registrar;
use reactsim::formats::{CurrentFrames, FutureChoice, Input, find_inputs, survey};
use reactsim::geometry::Polygon;
use reactsim::scene::{AgentKind, LaneArea, LaneClass, LaneKind, Scenario};
use serde_json::{Value, json};

use super::{Case, check_cases, first, good, read_at, read_length, refusal, write_table};
use crate::program::{said, text, words};

/// A row: track, class, time step, x, y, heading.
type Row = (Option<&'static str>, &'static str, i64, f64, f64, Option<f64>);

/// Returns the AV at 10 m/s, a bus behind it that is present at some steps only, and a static object.
fn rows(steps: i64) -> Vec<Row> {
    let mut rows: Vec<Row> = Vec::new();
    for step in 0..steps {
        let x = 500.0 + step as f64;
        rows.push((Some("7"), "construction", step, 520.0, 4.0, Some(0.0)));
        rows.push((Some("AV"), "vehicle", step, x, 0.0, Some(0.0)));
        if step > 44 && step != 60 {
            rows.push((Some("9"), "bus", step, x - 30.0, 0.5, Some(0.01)));
        }
    }
    rows
}

fn batch(rows: &[Row]) -> Vec<(&'static str, ArrayRef)> {
    let n = rows.len();
    let texts = |text: &str| Arc::new(StringArray::from(vec![text; n])) as ArrayRef;
    let numbers =
        |of: &dyn Fn(&Row) -> f64| Arc::new(Float64Array::from_iter_values(rows.iter().map(of))) as ArrayRef;
    let whole =
        |of: &dyn Fn(&Row) -> i64| Arc::new(Int64Array::from_iter_values(rows.iter().map(of))) as ArrayRef;
    vec![
        ("track_id", Arc::new(StringArray::from_iter(rows.iter().map(|r| r.0)))),
        ("object_type", Arc::new(StringArray::from_iter_values(rows.iter().map(|r| r.1)))),
        ("object_category", whole(&|r| if r.0 == Some("9") { 3 } else { 0 })),
        ("timestep", whole(&|r| r.2)),
        ("position_x", numbers(&|r| r.3)),
        ("position_y", numbers(&|r| r.4)),
        ("heading", Arc::new(Float64Array::from_iter(rows.iter().map(|r| r.5)))),
        ("velocity_x", numbers(&|r| if r.0 == Some("7") { 0.0 } else { 10.0 })),
        ("velocity_y", numbers(&|_| 0.0)),
        ("scenario_id", texts("made-1")),
        ("start_timestamp", numbers(&|_| 3.15e17)),
        ("end_timestamp", numbers(&|_| 3.15e17 + 10.9e9)),
        ("num_timestamps", whole(&|_| 110)),
        ("focal_track_id", texts("9")),
        ("city", texts("austin")),
    ]
}

fn line(points: &[(f64, f64)]) -> Value {
    points.iter().map(|p| json!({"x": p.0, "y": p.1, "z": 1.0})).collect()
}

/// Returns a lane along the x axis from `x` to `x` + 100 m, 4 m wide.
fn lane(id: u64, x: f64, y: f64, back: bool) -> Value {
    let (a, b, side) = if back { (x + 100.0, x, -2.0) } else { (x, x + 100.0, 2.0) };
    json!({
        "id": id, "is_intersection": false, "lane_type": "VEHICLE", "centerline": line(&[(a, y), (b, y)]),
        "left_lane_boundary": line(&[(a, y + side), (b, y + side)]),
        "right_lane_boundary": line(&[(a, y - side), (b, y - side)]),
        "left_lane_mark_type": "DOUBLE_SOLID_YELLOW", "right_lane_mark_type": "NONE",
        "left_neighbor_id": null, "right_neighbor_id": null, "predecessors": [], "successors": []
    })
}

fn map() -> Value {
    let mut map = json!({
        "drivable_areas": {"5": {"id": 5, "area_boundary": line(&[(400.0, -2.0), (700.0, -2.0), (700.0, 6.0), (400.0, 6.0)])}},
        "lane_segments": {
            "1": lane(1, 450.0, 0.0, false), "2": lane(2, 550.0, 0.0, false), "3": lane(3, 450.0, 4.0, true), "4": lane(4, 450.0, -4.0, false)
        },
        "pedestrian_crossings": {"6": {"id": 6, "edge1": line(&[(540.0, -2.0), (540.0, 6.0)]), "edge2": line(&[(544.0, -2.0), (544.0, 6.0)])}}
    });
    let lanes = &mut map["lane_segments"];
    lanes["1"]["successors"] = json!([2, 77]);
    lanes["1"]["left_neighbor_id"] = json!(3);
    lanes["1"]["right_neighbor_id"] = json!(4);
    lanes["2"]["predecessors"] = json!([1]);
    lanes["2"]["is_intersection"] = json!(true);
    lanes["4"]["lane_type"] = json!("BIKE");
    lanes["4"]["right_lane_mark_type"] = json!("DASHED_YELLOW");
    map
}

fn write(folder: &Path, rows: &[Row], map: &Value) -> PathBuf {
    let path = folder.join("scenario_made-1.parquet");
    write_table(fs::File::create(&path).unwrap(), batch(rows));
    fs::write(folder.join("log_map_archive_made-1.json"), map.to_string()).unwrap();
    path
}

/// Writes a scenario and its map to a folder.
pub(super) fn small(folder: &Path) -> Vec<PathBuf> {
    vec![write(folder, &rows(110), &map()), folder.join("log_map_archive_made-1.json")]
}

fn read(rows: &[Row], map: &Value) -> Result<Scenario, String> {
    let folder = tempfile::tempdir().unwrap();
    first(&write(folder.path(), rows, map))
}

#[test]
fn fields_mean_what_they_say() {
    let folder = tempfile::tempdir().unwrap();
    let s = read_at(&write(folder.path(), &rows(110), &map()), 49).unwrap();
    assert_eq!((s.id.as_str(), s.source.as_str()), ("made-1", "argoverse2"));
    assert_eq!((s.origin.x, s.origin.y), (549.0, 0.0), "the AV at time step 49");
    let ids: Vec<&str> = s.start.agents.iter().map(|a| a.id.as_str()).collect();
    assert_eq!(ids, ["AV", "9"]);
    assert_eq!((s.start.agents[0].length, s.start.agents[1].length), (4.5, 12.0));
    assert_eq!(s.start.obstacles.len(), 1, "what marks a site");
    assert!(s.start.history[1][5].is_none() && s.start.history[1][6].is_some());
    assert!(s.log_future.tracks[1][10].is_none() && s.log_future.tracks[1][11].is_some());
    assert_eq!((s.tracks_to_predict[0].as_str(), s.objects_of_interest[0].as_str()), ("9", "9"));
    assert!((s.timestamps[90] - 9.0).abs() < 1e-6);
    // 60 of 80 steps are recorded.
    assert!(s.log_future.tracks[0][59].is_some() && s.log_future.tracks[0][60].is_none());
    assert_eq!(s.repairs["frames at the end that are not recorded"], 20);
    let map = &s.start.map;
    assert_eq!(map.lanes[0].successors, [1]);
    assert_eq!(s.repairs["links to missing lanes"], 1);
    assert!(map.lanes[0].left.is_empty(), "oncoming");
    assert_eq!(map.lanes[0].right[0].lane, 3);
    let kinds: Vec<LaneKind> = map.lanes.iter().map(|l| l.kind).collect();
    assert_eq!(kinds, [LaneKind::Lane, LaneKind::Connector, LaneKind::Lane, LaneKind::Connector]);
    assert_eq!((map.lanes[0].class, map.lanes[3].class), (LaneClass::SurfaceStreet, LaneClass::Bike));
    let LaneArea::Polygon(ring) = &map.lanes[0].area else { panic!() };
    assert_eq!(ring.len(), 4);
    let painted: Vec<u8> = map.road_lines.iter().map(|l| l.paint).collect();
    assert_eq!(painted, [7, 7, 7, 4], "the line between lanes 1 and 3 once, and the edge of lane 4");
    assert_eq!((map.crosswalks.len(), map.drivable_area.as_ref().unwrap().len()), (1, 1));
    let road = s.start.road();
    let inside = |x: f64, y: f64| road.drivable(reactsim::geometry::Vec2::new(x, y), &mut None);
    assert_eq!((inside(0.0, 5.0), inside(0.0, 7.0)), (Some(true), Some(false)));
}

#[test]
fn the_recorded_current_frame_has_sixty_steps() {
    let folder = tempfile::tempdir().unwrap();
    let path = write(folder.path(), &rows(110), &map());
    let steps = |steps| Some(FutureChoice::Steps(steps));
    for (history, future, expected, x) in [
        (None, steps(60), (11, 60), 549.0),
        (None, Some(FutureChoice::Log), (11, 60), 549.0),
        (Some(50), Some(FutureChoice::Log), (50, 60), 549.0),
        (Some(2), steps(100), (2, 100), 509.0),
        (None, None, (11, 80), 529.0),
    ] {
        let scenario = read_length(&path, history, future).unwrap();
        let length = scenario.length();
        assert_eq!(((length.history, length.future), scenario.origin.x), (expected, x));
        assert!(scenario.logged_at(0, length.frames() - 1).is_some());
        assert!(!scenario.repairs.contains_key("frames at the end that are not recorded"));
    }
    let later = read_length(&path, Some(61), steps(40)).unwrap();
    assert_eq!((later.length().history, later.origin.x), (61, 560.0));
    assert_eq!(later.notes()["later-frame"].detail.as_deref(), Some("11 frames after it"));
    let error = read_length(&path, None, steps(100)).unwrap_err();
    let expected = "the number of frames after time step 49 is 60, expected 100 or more; choose an earlier \
                    current frame";
    assert!(error.ends_with(expected), "{error}");
}

#[test]
fn maps_and_current_frames_count_in_the_record_of_a_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = write(folder.path(), &rows(110), &map());
    let input = find_inputs(&path).unwrap().remove(0);
    let at = Input { frames: CurrentFrames::At(28), ..input.clone() };
    let record = |input: &Input| Registrar::default().record(input).unwrap();
    let usual = record(&input);
    assert_eq!(usual.companions[0].name, "log_map_archive_made-1.json");
    assert_eq!((record(&at).current_frame, record(&at).blake3), (Some(28), usual.blake3.clone()));
    assert_ne!(record(&at).digest(), usual.digest());
    let mut other = map();
    other["drivable_areas"] = json!({});
    write(folder.path(), &rows(110), &other);
    assert_eq!(record(&input).blake3, usual.blake3);
    assert_ne!(record(&input).digest(), usual.digest());
    // If the map is missing, reading reports it; the record does not.
    fs::remove_file(folder.path().join("log_map_archive_made-1.json")).unwrap();
    assert!(record(&input).companions.is_empty());
    assert_eq!(record(&input).digest(), usual.blake3);
}

#[test]
fn runs_and_pages_remember_the_current_frame() {
    let folder = tempfile::tempdir().unwrap();
    let path = write(folder.path(), &rows(110), &map());
    let out = folder.path().join("run");
    let call = |line: &str, code| {
        let line = line.replace("PATH", text(&path)).replace("OUT", text(&out));
        let (printed, told) = said(&words(&line), code);
        printed + &told
    };
    let run = "run PATH --av log --models stop --out OUT";
    let short = call(&format!("{run} --current-frame 49"), 2);
    assert!(short.contains("absent at step 61"), "{short}");
    fs::remove_dir_all(&out).unwrap();
    let run = format!("{run} --keep-rollouts");
    // By default the latest frame after which the AV is recorded for 8 s.
    let usual = call(&run, 0);
    assert!(usual.contains("(first: `made-1`, 20 frames before it)"), "{usual}");
    fs::remove_dir_all(&out).unwrap();
    call(&format!("{run} --current-frame 29"), 0);
    let other = call(&format!("{run} --resume --current-frame 28"), 2);
    assert!(other.contains("current_frame"), "{other}");
    let (page, native) = (folder.path().join("page.html"), folder.path().join("made.parquet"));
    let shown = call(&format!("report OUT --format html --scenarios PATH --out {}", text(&page)), 0);
    assert!(!shown.contains("scenes cannot be drawn"), "{shown}");
    assert!(call("inspect PATH --current-frame 29", 0).contains("made-1"));
    call(&format!("convert PATH --out {} --current-frame 29", text(&native)), 0);
    assert_eq!(good(&native)[0].digest(), read_at(&path, 29).unwrap().digest());
    // Other formats fix the current frame.
    let fixed = call(&format!("inspect {} --current-frame 29", text(&native)), 2);
    assert!(fixed.contains("the current frame is 29, expected none: the format native fixes"), "{fixed}");
}

#[test]
fn another_frame_can_be_the_current_one() {
    let folder = tempfile::tempdir().unwrap();
    let path = write(folder.path(), &rows(110), &map());
    let s = read_at(&path, 29).unwrap();
    assert!(s.log_future.tracks[0].iter().all(Option::is_some));
    assert!(!s.repairs.contains_key("frames at the end that are not recorded"));
    assert_eq!((s.origin.x, s.start.agents.len()), (529.0, 1), "the bus is not there yet");
    let early = read_at(&path, 9).unwrap_err().to_string();
    assert!(early.contains("the current frame is 9, expected at least 10"), "{early}");
    let late = read_at(&path, 110).unwrap_err().to_string();
    assert!(late.contains("the track `AV` is absent at time step 110"), "{late}");
    // The test split has the first 50 frames only.
    let s = read(&rows(50), &map()).unwrap();
    assert_eq!(s.repairs["frames at the end that are not recorded"], 80);
}

#[test]
fn the_default_frame_is_the_latest_one_that_can_be_used() {
    let whole = read(&rows(110), &map()).unwrap();
    assert_eq!((whole.origin.x, whole.notes()["earlier-frame"].count), (529.0, 1));
    assert_eq!(whole.notes()["earlier-frame"].detail.as_deref(), Some("20 frames before it"));
    assert_eq!(whole.log_future.tracks[0].iter().flatten().count(), 80);
    assert_eq!(read(&rows(130), &map()).unwrap().notes().get("earlier-frame"), None);
    let before = |last: i64| {
        let mut rows = rows(110);
        rows.retain(|row| row.0 != Some("AV") || !(last + 1..60).contains(&row.2));
        read(&rows, &map())
    };
    // Nowhere 80 frames follow: the latest one at which the AV is present.
    let s = before(41).unwrap();
    assert_eq!(
        (s.origin.x, s.notes()["earlier-frame"].detail.as_deref()),
        (541.0, Some("8 frames before it"))
    );
    // The history needs ten frames.
    assert!(before(9).unwrap_err().contains("absent at time step 49"));
}

#[test]
fn unknown_types_are_noted() {
    let mut rows = rows(110);
    rows.iter_mut().filter(|row| row.0 == Some("7")).for_each(|row| row.1 = "robotaxi");
    let s = read(&rows, &map()).unwrap();
    assert_eq!(s.notes()["unknown-types"].detail.as_deref(), Some("`robotaxi`"));
}

#[test]
fn bad_tables_are_refused_by_column_and_row() {
    let cases: &[Case<Vec<Row>>] = &[
        ("`heading` in row 3 is null, expected a finite number", |r| r[3].5 = None),
        ("`position_x` in row 5 is NaN, expected a finite number", |r| r[5].3 = f64::NAN),
        ("`position_y` in row 5 is inf, expected a finite number", |r| r[5].4 = f64::INFINITY),
        ("`track_id` in row 2 is null, expected a text", |r| r[2].0 = None),
        ("`timestep` in row 200 is 4000000000, expected an index", |r| r[200].2 = 4_000_000_000),
        ("column `timestep` is Int64, expected uint32", |r| r[1].2 = -1),
        ("`timestep` in row 3 is 0 a second time, expected one row per time step of track `AV`", |r| {
            r[3] = r[1];
        }),
        ("`track_id` is `AV` in no row", |r| r.retain(|r| r.0 != Some("AV"))),
        ("the track `AV` is absent at time step 49", |r| r.retain(|r| r.0 != Some("AV") || r.2 > 60)),
        ("the table is empty", Vec::clear),
        ("expected a point within 100 km of the AV", |r| r[180].3 = 1e300),
        ("expected a finite heading", |r| r[151].5 = Some(1e300)),
    ];
    check_cases(cases, "scenario_made-1.parquet: record 0", |change| {
        let mut rows = rows(110);
        change(&mut rows);
        read(&rows, &map())
    });
    let folder = tempfile::tempdir().unwrap();
    let path = write(folder.path(), &rows(110), &map());
    type Columns = Vec<(&'static str, ArrayRef)>;
    let with = |change: &dyn Fn(&mut Columns)| {
        let mut columns = batch(&rows(110));
        change(&mut columns);
        write_table(fs::File::create(&path).unwrap(), columns);
    };
    let n = rows(110).len();
    for name in ["object_type", "position_x", "heading", "scenario_id"] {
        with(&|columns| columns.retain(|c| c.0 != name));
        assert!(refusal(&path).contains(&format!("column `{name}` is missing")), "{}", refusal(&path));
        let wrong: ArrayRef = Arc::new(arrow_array::BooleanArray::from(vec![true; n]));
        with(&|columns| columns.iter_mut().find(|c| c.0 == name).unwrap().1 = Arc::clone(&wrong));
        let text = refusal(&path);
        assert!(text.contains(&format!("column `{name}` is Boolean, expected")), "{text}");
    }
    // Two scenarios in one file, another rate, no velocities.
    let mut names = vec!["made-1"; n];
    names[70] = "made-2";
    with(&|columns| columns[9].1 = Arc::new(StringArray::from(names.clone())));
    assert!(refusal(&path).contains("`scenario_id` in row 70 is `made-2`, expected `made-1` as in row 0"));
    with(&|columns| columns[12].1 = Arc::new(Int64Array::from(vec![55; n])));
    assert!(refusal(&path).contains("expected 0.1 s (10 Hz)"), "{}", refusal(&path));
    with(&|columns| columns.retain(|c| !c.0.starts_with("velocity") && !c.0.ends_with("timestamp")));
    let s = good(&path).remove(0);
    assert!(s.timestamps.is_empty());
    for agent in 0..s.start.agents.len() {
        let (before, now) = (s.start.history[agent][9], s.start.now(agent));
        let estimated = before.map(|before| (now.position() - before.position()) / 0.1);
        assert_eq!(now.velocity(), estimated, "agent {agent}");
    }
}

#[test]
fn bad_maps_are_refused_by_key() {
    let cases: &[Case<Value>] = &[
        ("missing field `drivable_areas`", |m| {
            m.as_object_mut().unwrap().remove("drivable_areas");
        }),
        ("missing field `centerline`", |m| {
            m["lane_segments"]["2"].as_object_mut().unwrap().remove("centerline");
        }),
        ("invalid type: string \"north\", expected f64", |m| {
            m["lane_segments"]["2"]["centerline"][0]["x"] = json!("north");
        }),
        ("drivable_areas[\"5\"].area_boundary is 2 points, expected at least 3 points", |m| {
            m["drivable_areas"]["5"]["area_boundary"] = line(&[(0.0, 0.0), (1.0, 1.0)]);
        }),
        ("map.lanes[1].id is 1, expected an id that no other lane has", |m| {
            m["lane_segments"]["2"]["id"] = json!(1)
        }),
        ("map.lanes[1].points is (1000000000", |m| {
            m["lane_segments"]["2"]["centerline"][0]["x"] = json!(1e300);
        }),
    ];
    check_cases(cases, "log_map_archive_made-1.json: ", |change| {
        let mut map = map();
        change(&mut map);
        read(&rows(110), &map)
    });
    let mut many = map();
    let lanes = many["lane_segments"].as_object_mut().unwrap();
    (10..10_010).for_each(|id| drop(lanes.insert(id.to_string(), lane(id, 450.0, 0.0, false))));
    let error = read(&rows(110), &many).unwrap_err();
    assert!(error.contains("the number of `lane_segments` is 10004, expected at most 10000"), "{error}");
    let s = read(&rows(110), &json!({"drivable_areas": {}, "lane_segments": {}, "pedestrian_crossings": {}}))
        .unwrap();
    assert!(s.start.map.drivable_area.is_none() && !s.start.road().has_drivable_area());
}

#[test]
fn the_map_lies_beside_the_scenario() {
    let folder = tempfile::tempdir().unwrap();
    let path = write(folder.path(), &rows(110), &map());
    let found = survey(folder.path()).unwrap();
    assert_eq!((found.inputs.len(), found.passed_over.len()), (1, 0), "a map is no scenario");
    assert_eq!(found.inputs[0].format.id(), "argoverse2");
    let at = |name: &str| folder.path().join(name);
    let map = at("log_map_archive_made-1.json");
    let told = find_inputs(&map).err().unwrap().to_string();
    assert!(told.contains("is an Argoverse 2 map"), "{told}");
    // A single map is taken, whatever its name; of several, only that of the scenario.
    fs::rename(&map, at("log_map_archive_other.json")).unwrap();
    assert_eq!(good(&path).len(), 1);
    fs::write(at("log_map_archive_third.json"), "{}").unwrap();
    assert!(
        refusal(&path).contains("`log_map_archive_made-1.json` is not among several maps"),
        "{}",
        refusal(&path)
    );
    fs::remove_file(at("log_map_archive_other.json")).unwrap();
    assert!(
        refusal(&path).contains("log_map_archive_third.json: cannot be decoded: as a map: missing field")
    );
    fs::write(at("log_map_archive_third.json"), "").unwrap();
    assert!(refusal(&path).contains("log_map_archive_third.json: cannot be decoded"));
    fs::remove_file(at("log_map_archive_third.json")).unwrap();
    assert!(refusal(&path).contains("`log_map_archive_made-1.json` is missing"), "{}", refusal(&path));
    // No id leads out of the folder.
    let mut columns = batch(&rows(110));
    columns[9].1 = Arc::new(StringArray::from(vec!["../../etc/passwd"; columns[0].1.len()]));
    write_table(fs::File::create(&path).unwrap(), columns);
    assert!(refusal(&path).contains("is missing, expected the map"));
}

#[test]
fn real_files() {
    let Some(folder) = crate::shared("data/av2") else { return };
    let found = survey(&folder).unwrap();
    assert_eq!((found.inputs.len(), found.passed_over.len()), (4, 0));
    let scenarios = good(&folder);
    assert_eq!(scenarios.len(), 4);
    for s in &scenarios {
        // The test split has no frames after the default one.
        let is_test = s.id.starts_with("0a0af725");
        let short = s.repairs.get("frames at the end that are not recorded").copied();
        assert_eq!(short, is_test.then_some(80), "{}", s.id);
        assert_eq!(s.notes().contains_key("earlier-frame"), !is_test, "{}", s.id);
        let recorded = s.log_future.tracks[0].iter().flatten().count();
        assert_eq!(recorded, if is_test { 0 } else { 80 });
        let road = s.start.road();
        // Vehicles of the log stay on the road. Some go on beyond the end of the map.
        let area = s.start.map.drivable_area.as_ref().unwrap();
        let mapped = area.iter().map(Polygon::bounds).reduce(|a, b| a.union(&b)).unwrap();
        let (mut on, mut ahead, mut all) = (0, 0, 0);
        for (a, _) in s.start.agents.iter().enumerate().filter(|(_, a)| a.kind == AgentKind::Vehicle) {
            for state in
                s.logged(a).iter().flatten().filter(|s| s.speed() > 1.0 && mapped.contains(s.position()))
            {
                all += 1;
                on += usize::from(road.drivable(state.position(), &mut None) == Some(true));
                ahead += usize::from(state.forward_speed() > 0.8 * state.speed() || state.speed() < 3.0);
            }
        }
        assert!(on * 100 >= all * 99 && ahead * 100 >= all * 99, "{}: {on}, {ahead} of {all}", s.id);
        assert!(road.drivable(s.start.now(0).position(), &mut None).unwrap());
        let lanes = &s.start.map.lanes;
        assert!(
            lanes.iter().all(|l| l.successors.iter().all(|&n| {
                let (end, start) = (l.baseline.points().last().unwrap(), lanes[n].baseline.points()[0]);
                (end - start).norm() < 2.0
            })),
            "{}: links lead on",
            s.id
        );
    }
}
