//! Scenarios of small logs, and errors of damaged ones.

use std::fs;
use std::path::Path;

use reactsim_scene::{AgentKind, LaneKind, Scenario, StopKind};

use super::{all, refusal};
use reactsim_test_support::nuplan::Fixture;

fn good(path: &Path) -> Vec<Scenario> {
    all(path).into_iter().map(|s| s.unwrap()).collect()
}

#[test]
fn a_small_log_gives_a_scenario() {
    let fixture = Fixture::write();
    let scenarios = good(&fixture.log);
    assert_eq!(scenarios.len(), 1, "one in ten seconds");
    let s = &scenarios[0];
    assert_eq!((s.id.as_str(), s.source.as_str()), ("7000000000000014", "nuplan"));
    assert_eq!(s.objects_of_interest, ["7400000000000000"]);
    assert!(s.repairs.is_empty(), "{:?}", s.repairs);
    assert_eq!(s.start.agents.len(), 2);
    assert_eq!(s.unselected[0].agent.kind, AgentKind::Other);
    assert!(s.unselected[0].track[10].unwrap().vx.is_nan(), "static objects have no velocity");
    let av = s.start.now(0);
    assert_eq!((av.x, av.y, av.vx, av.heading), (0.0, 0.0, 5.0, 0.0));
    // 15 m from axle to centre, 1.461 m from the axle to the AV's own.
    assert!((s.start.now(1).x - (15.0 - 1.461)).abs() < 1e-9);
    let map = &s.start.map;
    let kinds: Vec<_> = map.lanes.iter().map(|l| (l.id.as_str(), l.kind)).collect();
    let (lane, connector) = (LaneKind::Lane, LaneKind::Connector);
    assert_eq!(kinds, [("1", lane), ("2", lane), ("3", connector), ("4", lane)]);
    assert_eq!((&map.lanes[0].successors, &map.lanes[2].successors), (&vec![2], &vec![1]));
    assert_eq!((&map.lanes[1].predecessors, &map.lanes[2].predecessors), (&vec![2], &vec![0]));
    assert_eq!((map.lanes[0].left[0].lane, map.lanes[3].right[0].lane), (3, 0));
    assert_eq!((map.lanes[0].speed_limit, map.lanes[2].speed_limit), (None, Some(11.0)));
    assert_eq!(
        map.stop_lines.iter().map(|l| (l.kind, l.lane)).collect::<Vec<_>>(),
        [(StopKind::Light, 2), (StopKind::Sign, 3)]
    );
    assert!(map.stop_lines[0].s < 1e-9 && (map.stop_lines[1].s - 168.0).abs() < 0.1);
    assert_eq!((map.road_lines.len(), map.crosswalks.len(), map.intersections.len()), (1, 1, 1));
    assert_eq!(map.drivable_area.as_ref().unwrap().len(), 3);
    assert_eq!(s.start.lights[0].lane, 2);
}

#[test]
fn windows_are_chosen_by_tag_time_and_token() {
    let fixture = Fixture::write();
    let pick = fixture.list.with_file_name("pick.json");
    let ids = |keys: &str| -> Vec<String> {
        let text =
            format!(r#"{{"format": "reactsim-nuplan-v1", "logs": ["../nuplan-v1.1/splits/mini"] {keys}}}"#);
        fs::write(&pick, text).unwrap();
        all(&pick).into_iter().map(|s| s.map_or_else(|e| e.to_string(), |s| s.id[14..].to_owned())).collect()
    };
    assert_eq!(ids(""), ["14"]);
    assert_eq!(ids(r#", "every_seconds": 1"#), ["14", "28", "3c"]);
    assert_eq!(ids(r#", "tags": ["inner"]"#), ["1e", "1f"], "the last one has too few frames after it");
    assert_eq!(ids(r#", "tags": ["inner", "edge"], "every_seconds": 0.5, "maps": ".""#), ["14", "1e"]);
    assert_eq!(ids(r#", "tokens": ["700000000000001F", "7000000000000014"]"#), ["14", "1f"]);
    let refuses = |keys: &str, expected: &str| {
        let found = ids(keys);
        assert!(found.len() == 1 && found[0].contains(expected), "{keys}: {found:?}");
    };
    refuses(
        r#", "tokens": ["00000000000000aa"]"#,
        "tokens is `00000000000000aa`, expected the token of a row",
    );
    refuses(
        r#", "tokens": ["7000000000000013"]"#,
        "is 19 rows before and 201 after it, expected at least 20",
    );
    refuses(r#", "tokens": ["14"]"#, "tokens is `14`, expected 16 hexadecimal digits");
    refuses(r#", "tokens": ["7000000000000013"], "tags": ["inner"]"#, "one of the two");
    refuses(r#", "tokens": []"#, "tokens is empty");
    refuses(r#", "tags": ["none"]"#, "tags is `none`, expected one of those in the logs: `");
    refuses(r#", "every_seconds": -1"#, "every_seconds is -1");
    refuses(r#", "evry": 1"#, "unknown field `evry`");
    refuses(r#", "maps": "nowhere""#, "maps is `nowhere`, expected a folder with `nuplan-maps-v1.0.json`");
    fs::write(&pick, r#"{"format": "reactsim-nuplan-v1", "logs": []}"#).unwrap();
    assert!(refusal(&pick).contains("logs is without any log"));
    fs::write(&pick, r#"{"format": "reactsim-nuplan-v1", "logs": ["nowhere.db"]}"#).unwrap();
    assert!(refusal(&pick).contains("logs is `nowhere.db` (could not read"));
    fs::write(&pick, r#"{"format": "reactsim-nuplan-v2", "logs": []}"#).unwrap();
    assert!(refusal(&pick).contains("format is `reactsim-nuplan-v2`, expected `reactsim-nuplan-v1`"));
}

#[test]
fn damaged_logs_are_refused() {
    for (sql, expected) in [
        ("DROP TABLE lidar_box", "table `lidar_box` is missing"),
        ("ALTER TABLE lidar_box RENAME yaw TO heading", "column `lidar_box.yaw` is missing"),
        ("DROP TABLE track; CREATE VIEW track AS SELECT 1 AS token", "table `track` is missing"),
        ("DELETE FROM log", "table `log` is empty"),
        ("UPDATE log SET map_version = 'city'", "is `city`, expected one of town"),
        ("UPDATE log SET map_version = '../town'", "expected one of town"),
        ("UPDATE lidar SET channel = 'other'", "a row `MergedPointCloud`"),
        ("DELETE FROM lidar_pc", "the choice of windows is empty"),
        ("DELETE FROM scene WHERE name > 's2'", "two scenes before it and two after"),
        ("DELETE FROM ego_pose WHERE x = (SELECT min(x) FROM ego_pose)", "the token of a row of `ego_pose`"),
        ("DELETE FROM track", "`lidar_box.track_token` of row 6200000000000000 is 7400000000000000"),
        ("DELETE FROM category", "the token of a row of `category`"),
        ("UPDATE category SET name = 'ufo'", "`category.name` is `ufo`"),
        (
            "UPDATE lidar_pc SET timestamp = NULL WHERE rowid = 4",
            "`lidar_pc.timestamp` of row 7000000000000003 is NULL",
        ),
        ("UPDATE lidar_pc SET token = 'abc' WHERE rowid = 4", "expected a token of 8 bytes"),
        (
            "UPDATE lidar_box SET x = 'far'",
            "`lidar_box.x` of row 6200000000000000 is `far`, expected a number",
        ),
        ("UPDATE lidar_box SET x = NULL", "`lidar_box.x` of row 6200000000000000 is NaN"),
        ("UPDATE lidar_box SET length = 9e999", "`lidar_box.length` of row 6200000000000000 is inf"),
        ("UPDATE lidar_box SET length = -1", "is -1, expected a size"),
        ("UPDATE lidar_box SET vx = 1e5", "expected a velocity below 1000"),
        (
            "UPDATE lidar_box SET track_token = (SELECT min(token) FROM track)",
            "one box of a track in a frame",
        ),
        ("UPDATE ego_pose SET x = 1e12", "expected a point within 100 km"),
        ("UPDATE ego_pose SET qw = 0", "is NaN, expected a finite number"),
        ("UPDATE ego_pose SET epsg = 32632", "is 32632, expected 32631"),
        ("UPDATE lidar_pc SET timestamp = timestamp + 9000000 WHERE rowid > 100", "rows are missing here"),
    ] {
        let fixture = Fixture::write().log(sql);
        let error = refusal(&fixture.log);
        assert!(error.contains(expected), "{sql}: {error}");
    }
}

#[test]
fn odd_logs_are_read() {
    // Lights of unknown connectors and links to unknown lanes are dropped and counted.
    let fixture = Fixture::write().log("UPDATE traffic_light_status SET lane_connector_id = 99");
    let fixture = fixture
        .map("UPDATE lane_connectors SET entry_lane_fid = 98.0; DELETE FROM baseline_paths WHERE fid = 4");
    let repairs = &good(&fixture.log)[0].repairs;
    let counted: Vec<(&str, u32)> = repairs.iter().map(|(what, n)| (what.as_str(), *n)).collect();
    assert_eq!(
        counted,
        [
            ("lanes without extent", 1),
            ("lights on missing lanes", 1),
            ("links to missing lanes", 1),
            ("stop lines on missing lanes", 1)
        ]
    );
    // Missing velocities are estimated from positions and recorded times.
    let fixture = Fixture::write().log("UPDATE lidar_box SET vx = NULL; UPDATE ego_pose SET vy = NULL");
    let s = &good(&fixture.log)[0];
    let step = s.timestamps[10] - s.timestamps[9];
    for agent in [0, 1] {
        let (before, now) = (s.start.history[agent][9].unwrap(), s.start.now(agent));
        let estimated = (now.position() - before.position()) / step;
        assert_eq!(now.velocity(), Some(estimated));
    }
    assert!(s.unselected[0].track[10].unwrap().vx.is_nan(), "an object that stays needs no velocity");
}

#[test]
fn damaged_maps_are_refused() {
    for (sql, expected) in [
        ("DROP TABLE crosswalks", "table `crosswalks` is missing"),
        ("DROP TABLE meta", "table `meta` is missing"),
        ("DELETE FROM meta", "`meta.projectedCoordSystem` is missing"),
        ("UPDATE meta SET value = 'epsg:3857'", "is `epsg:3857`, expected a northern UTM zone"),
        ("UPDATE meta SET value = 'epsg:32632'", "outside of the map's zone"),
        (
            "DELETE FROM gpkg_geometry_columns WHERE table_name = 'boundaries'",
            "layer `boundaries` is missing",
        ),
        (
            "UPDATE gpkg_geometry_columns SET srs_id = 3857",
            "is 3857, expected 4326 (longitude and latitude) or 32631",
        ),
        ("UPDATE gpkg_geometry_columns SET column_name = 'g'", "`lanes_polygons.g` is missing"),
        ("UPDATE lanes_polygons SET geom = NULL", "`lanes_polygons.geom` of row 1 is NULL"),
        ("UPDATE lanes_polygons SET geom = x'475000110000000001'", "is a blob that is empty"),
        (
            "UPDATE lanes_polygons SET geom = substr(geom, 1, 40)",
            "`lanes_polygons.geom` of row 1 is a blob that",
        ),
        ("UPDATE baseline_paths SET geom = (SELECT geom FROM crosswalks)", "expected a line"),
        ("UPDATE crosswalks SET geom = (SELECT geom FROM boundaries)", "expected a polygon"),
        (
            "ALTER TABLE lane_connectors DROP COLUMN exit_lane_fid",
            "column `lane_connectors.exit_lane_fid` is missing",
        ),
        ("UPDATE lane_connectors SET exit_lane_fid = 1.5", "is 1.5, expected a whole number"),
        (
            "UPDATE lane_connectors SET traffic_light_stop_line_fids = '7; 8'",
            "expected fids separated by commas",
        ),
        ("UPDATE lane_connectors SET fid = 1", "a fid that no other lane or connector has"),
    ] {
        let fixture = Fixture::write().map(sql);
        let error = refusal(&fixture.log);
        assert!(error.contains("map.gpkg: ") && error.contains(expected), "{sql}: {error}");
    }
}

#[test]
fn missing_maps() {
    let fixture = Fixture::write();
    fs::remove_file(&fixture.map).unwrap();
    assert!(refusal(&fixture.log).contains("map.gpkg: could not read"));
    fs::write(&fixture.list, r#"{"town": {"version": "../1.0"}}"#).unwrap();
    assert!(refusal(&fixture.log).contains("is `../1.0`, expected the name of a folder"));
    fs::write(&fixture.list, r#"{"town": {}}"#).unwrap();
    assert!(refusal(&fixture.log).contains("missing field `version`"));
    fs::remove_file(&fixture.list).unwrap();
    assert!(
        refusal(&fixture.log).contains("the folder of the maps is missing, expected `nuplan-maps-v1.0.json`")
    );
}

#[test]
fn files_that_are_not_a_whole_database() {
    let fixture = Fixture::write();
    let whole = fs::read(&fixture.log).unwrap();
    fs::write(&fixture.log, []).unwrap();
    assert!(refusal(&fixture.log).contains("is truncated: the header of the database has 0 of 100 bytes"));
    fs::write(&fixture.log, &whole[..60]).unwrap();
    assert!(refusal(&fixture.log).contains("has 60 of 100 bytes"));
    fs::write(&fixture.log, &whole[..whole.len() / 2]).unwrap();
    assert!(refusal(&fixture.log).contains("is truncated: the database has"));
    // Like an encrypted file.
    let scrambled: Vec<u8> = whole.iter().enumerate().map(|(i, b)| b ^ (i * 31 + 7) as u8).collect();
    fs::write(&fixture.log, scrambled).unwrap();
    let error = refusal(&fixture.log);
    assert!(error.contains("`SQLite format 3`; decrypt the file or fetch it again"), "{error}");
    // Half of the pages are overwritten.
    let mut damaged = whole.clone();
    damaged[4096..whole.len() / 2].fill(0xa5);
    fs::write(&fixture.log, damaged).unwrap();
    let error = refusal(&fixture.log);
    assert!(error.contains("damaged") || error.contains("missing") || error.contains("expected"), "{error}");
    // As left by a program that is still writing.
    fs::write(&fixture.log, &whole).unwrap();
    fs::write(fixture.log.with_file_name("made.db-wal"), b"frames").unwrap();
    assert!(refusal(&fixture.log).contains("locked or left with unfinished changes"));
}

#[test]
fn locks_of_other_programs_are_ignored() {
    let fixture = Fixture::write();
    let holder = rusqlite::Connection::open(&fixture.log).unwrap();
    holder.execute_batch("BEGIN EXCLUSIVE").unwrap();
    assert_eq!(good(&fixture.log).len(), 1);
}

#[test]
fn a_flipped_byte_is_refused_or_read_but_never_worse() {
    let fixture = Fixture::write();
    let whole = fs::read(&fixture.log).unwrap();
    for i in 0..60 {
        let mut damaged = whole.clone();
        let at = (i * 7919 + 100) % whole.len();
        damaged[at] ^= 1 << (i % 8);
        // The headers of the root page and other pages, which describe the tree.
        damaged[(i * 4096) % whole.len() + 5] ^= 0x11;
        fs::write(&fixture.log, damaged).unwrap();
        all(&fixture.log).into_iter().for_each(drop);
    }
}

#[test]
fn detection_is_by_content() {
    let fixture = Fixture::write();
    let other = fixture.log.with_file_name("renamed");
    fs::rename(&fixture.log, &other).unwrap();
    assert_eq!(crate::find_inputs(&other).unwrap()[0].format.id(), "nuplan");
    assert!(crate::find_inputs(&fixture.map).is_err(), "a map alone is no log");
    assert_eq!(crate::find_inputs(fixture.list.parent().unwrap().parent().unwrap()).unwrap().len(), 1);
}

#[test]
fn companions_are_listed() {
    let fixture = Fixture::write();
    let companions = |path: &Path| crate::find_inputs(path).unwrap()[0].companions();
    assert_eq!(companions(&fixture.log), [fixture.map.canonicalize().unwrap()]);
    let selection = fixture.log.with_file_name("selection.json");
    let content = r#"{"format": "reactsim-nuplan-v1", "logs": ["made.db"]}"#;
    fs::write(&selection, content).unwrap();
    let found: Vec<_> = companions(&selection).iter().map(|p| p.canonicalize().unwrap()).collect();
    assert_eq!(found, [fixture.log.canonicalize().unwrap(), fixture.map.canonicalize().unwrap()]);
    // Missing files are reported when the log is read.
    fs::remove_file(&fixture.list).unwrap();
    assert_eq!(companions(&fixture.log), Vec::<std::path::PathBuf>::new());
}
