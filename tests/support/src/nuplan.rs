//! A small nuPlan log with its map, written by the tests.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use reactsim_geometry::Vec2;
use rusqlite::{Connection, params};

/// Easting and northing, in metres, of 3° east and 45° north in UTM zone 31, where the map lies.
pub const ORIGIN: (f64, f64) = (500_000.0, 4_982_950.400_226_551);

/// Data folder with one log and one map.
pub struct Fixture {
    _folder: tempfile::TempDir,
    /// Path of the log.
    pub log: PathBuf,
    /// Path of the map.
    pub map: PathBuf,
    /// Path of the list of maps.
    pub list: PathBuf,
}

impl Fixture {
    /// Writes the log and the map.
    pub fn write() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let (logs, town) =
            (folder.path().join("nuplan-v1.1/splits/mini"), folder.path().join("maps/town/1.0"));
        fs::create_dir_all(&logs).unwrap();
        fs::create_dir_all(&town).unwrap();
        let list = folder.path().join("maps/nuplan-maps-v1.0.json");
        fs::write(&list, r#"{"town": {"version": "1.0", "layers": {}}}"#).unwrap();
        let (log, map) = (logs.join("made.db"), town.join("map.gpkg"));
        write_log(&log);
        write_map(&map);
        Self { _folder: folder, log, map, list }
    }

    /// Changes the log by SQL.
    pub fn log(self, sql: &str) -> Self {
        opened(&self.log).execute_batch(sql).unwrap();
        self
    }

    /// Moves the AV: x and y of its rear axle in metres from the origin of the map, and heading, by row.
    pub fn drive(self, pose: impl Fn(u32) -> [f64; 3]) -> Self {
        let mut connection = opened(&self.log);
        let db = connection.transaction().unwrap();
        for row in 0..221 {
            let [x, y, heading] = pose(row);
            let half = reactsim_geometry::direction(0.5 * heading);
            db.execute(
                "UPDATE ego_pose SET x = ?1, y = ?2, qw = ?3, qz = ?4 WHERE token = ?5",
                params![ORIGIN.0 + x, ORIGIN.1 + y, half.x, half.y, token(b'e', row)],
            )
            .unwrap();
        }
        db.commit().unwrap();
        self
    }

    /// Writes a copy of the log with tokens of its own, whose AV drives `10 * number` metres further north.
    pub fn copy_log(&self, number: u8) {
        let path = self.log.with_file_name(format!("made-{number}.db"));
        fs::copy(&self.log, &path).unwrap();
        let own = |table: &str, column: &str| {
            let digits = format!("substr(hex({column}), 1, 2) || '{number:02X}' || substr(hex({column}), 5)");
            format!("UPDATE {table} SET {column} = unhex({digits});")
        };
        let columns = [("lidar_pc", "token"), ("lidar_pc", "scene_token"), ("scene", "token")];
        let boxes = [("lidar_box", "lidar_pc_token"), ("scenario_tag", "lidar_pc_token")];
        let sql: String = columns.iter().chain(&boxes).map(|(table, column)| own(table, column)).collect();
        let sql = format!("{sql} UPDATE ego_pose SET y = y + {};", 10 * u32::from(number));
        opened(&path).execute_batch(&sql).unwrap();
    }

    /// Changes the map by SQL.
    pub fn map(self, sql: &str) -> Self {
        opened(&self.map).execute_batch(sql).unwrap();
        self
    }
}

/// Returns the token of a row: the letter of its table and its number.
pub fn token(table: u8, number: u32) -> [u8; 8] {
    let [a, b, c, d] = number.to_be_bytes();
    [table, 0, 0, 0, a, b, c, d]
}

/// Token as text.
pub fn hex(token: [u8; 8]) -> String {
    format!("{:016x}", u64::from_be_bytes(token))
}

/// Name of the file of ReactSim-Bench whose current frame is this row of the log, or of a copy of it.
pub fn bench_name(copy: u8, row: u32) -> String {
    let of_copy = |mut token: [u8; 8]| {
        token[1] = copy;
        hex(token)
    };
    format!("town_{}_{}.pkl", of_copy(token(b's', 2)), of_copy(token(b'p', row)))
}

/// Returns the names of the files of ReactSim-Bench by the token of the current frame, for all rows of a log.
pub fn bench_names(log: &Path) -> BTreeMap<String, String> {
    let connection = opened(log);
    let sql = "SELECT lower(hex(lidar_pc.token)), replace(map_version, '.gpkg', '') || '_' ||
               lower(hex(scene_token)) || '_' || lower(hex(lidar_pc.token)) || '.pkl' FROM lidar_pc, log";
    let mut rows = connection.prepare(sql).unwrap();
    let names = rows.query_map([], |row| Ok((row.get(0)?, row.get(1)?))).unwrap();
    names.map(Result::unwrap).collect()
}

/// Opens a database that does not wait for the disk.
fn opened(path: &Path) -> Connection {
    let connection = Connection::open(path).unwrap();
    connection.execute_batch("PRAGMA synchronous = OFF; PRAGMA journal_mode = MEMORY").unwrap();
    connection
}

fn write_log(path: &Path) {
    let mut connection = opened(path);
    let db = connection.transaction().unwrap();
    db.execute_batch(
        "CREATE TABLE log (token BLOB, map_version TEXT, location TEXT);
         CREATE TABLE lidar (token BLOB, channel TEXT);
         CREATE TABLE ego_pose (token BLOB, timestamp INTEGER, x FLOAT, y FLOAT, qw FLOAT, qx FLOAT, qy FLOAT, qz FLOAT,
             vx FLOAT, vy FLOAT, epsg INTEGER);
         CREATE TABLE lidar_pc (token BLOB, ego_pose_token BLOB, lidar_token BLOB, scene_token BLOB, timestamp INTEGER);
         CREATE TABLE lidar_box (token BLOB, lidar_pc_token BLOB, track_token BLOB, x FLOAT, y FLOAT, width FLOAT, length FLOAT,
             vx FLOAT, vy FLOAT, yaw FLOAT);
         CREATE TABLE track (token BLOB, category_token BLOB);
         CREATE TABLE category (token BLOB, name TEXT);
         CREATE TABLE scene (token BLOB, name TEXT, goal_ego_pose_token BLOB, roadblock_ids TEXT);
         CREATE TABLE scenario_tag (token BLOB, lidar_pc_token BLOB, type TEXT, agent_track_token BLOB);
         CREATE TABLE traffic_light_status (token BLOB, lidar_pc_token BLOB, lane_connector_id INTEGER, status TEXT);",
    )
    .unwrap();
    db.execute("INSERT INTO log VALUES (?1, 'town.gpkg', 'a town')", [token(b'g', 0)]).unwrap();
    db.execute("INSERT INTO lidar VALUES (?1, 'MergedPointCloud')", [token(b'l', 0)]).unwrap();
    for (i, name) in ["vehicle", "traffic_cone"].iter().enumerate() {
        db.execute("INSERT INTO category VALUES (?1, ?2)", params![token(b'c', i as u32), name]).unwrap();
        db.execute("INSERT INTO track VALUES (?1, ?2)", [token(b't', i as u32), token(b'c', i as u32)])
            .unwrap();
    }
    for i in 0..5_u32 {
        db.execute(
            "INSERT INTO scene VALUES (?1, ?2, NULL, '1 2')",
            params![token(b's', i), format!("s{i}")],
        )
        .unwrap();
    }
    let origin = Vec2::new(ORIGIN.0, ORIGIN.1);
    for k in 0..221_u32 {
        let time = 1_000_000_000 + 50_000 * i64::from(k);
        let x = origin.x - 40.0 + 0.25 * f64::from(k);
        let scene = token(b's', if k < 20 { k / 10 } else { (k / 201 * (k / 211 + 1)) + 2 });
        let (sweep, pose) = (token(b'p', k), token(b'e', k));
        db.execute(
            "INSERT INTO ego_pose VALUES (?1, ?2, ?3, ?4, 1, 0, 0, 0, 5, 0, 32631)",
            params![pose, time + 7, x, origin.y],
        )
        .unwrap();
        db.execute(
            "INSERT INTO lidar_pc VALUES (?1, ?2, ?3, ?4, ?5)",
            params![sweep, pose, token(b'l', 0), scene, time],
        )
        .unwrap();
        for (track, ahead, speed) in [(0, 0.0, 5.0), (1, 30.0, 0.0)] {
            let x = if track == 0 { x + 15.0 } else { origin.x + ahead };
            db.execute(
                "INSERT INTO lidar_box VALUES (?1, ?2, ?3, ?4, ?5, 2, 4.5, ?6, 0, 0)",
                params![
                    token(b'b', 2 * k + track),
                    sweep,
                    token(b't', track),
                    x,
                    origin.y + 2.0 * f64::from(track),
                    speed
                ],
            )
            .unwrap();
        }
        db.execute("INSERT INTO traffic_light_status VALUES (?1, ?2, 3, 'green')", [token(b'z', k), sweep])
            .unwrap();
    }
    let tag = "INSERT INTO scenario_tag VALUES (?1, ?2, ?3, ?4)";
    for (i, (frame, name)) in [(20, "edge"), (30, "inner"), (31, "inner"), (215, "inner")].iter().enumerate()
    {
        let agent = (i == 0).then(|| token(b't', 0));
        db.execute(tag, params![token(b'y', i as u32), token(b'p', *frame), name, agent]).unwrap();
    }
    db.commit().unwrap();
}

/// Converts metres from the origin to degrees, approximately.
fn degrees(p: (f64, f64)) -> Vec2 {
    Vec2::new(3.0 + p.0 / 78_847.0, 45.0 + p.1 / 111_132.0)
}

fn line(points: &[(f64, f64)]) -> Vec<u8> {
    let mut blob = b"GP\0\x01\xe6\x10\0\0\x01\x02\0\0\0".to_vec();
    put(&mut blob, points);
    blob
}

fn area(x: (f64, f64), y: (f64, f64)) -> Vec<u8> {
    let mut blob = b"GP\0\x01\xe6\x10\0\0\x01\x03\0\0\0\x01\0\0\0".to_vec();
    put(&mut blob, &[(x.0, y.0), (x.1, y.0), (x.1, y.1), (x.0, y.1), (x.0, y.0)]);
    blob
}

fn put(blob: &mut Vec<u8>, points: &[(f64, f64)]) {
    blob.extend((points.len() as u32).to_le_bytes());
    for p in points {
        let p = degrees(*p);
        blob.extend(p.x.to_le_bytes());
        blob.extend(p.y.to_le_bytes());
    }
}

fn write_map(path: &Path) {
    let db = opened(path);
    db.execute_batch(
        "CREATE TABLE gpkg_geometry_columns (table_name TEXT, column_name TEXT, geometry_type_name TEXT, srs_id INTEGER);
         CREATE TABLE meta (key TEXT, value TEXT);
         INSERT INTO meta VALUES ('geographicCoordSystem', 'epsg:4326'), ('projectedCoordSystem', 'epsg:32631');",
    )
    .unwrap();
    let layers = [
        ("lanes_polygons", "lane_fid, lane_group_fid, lane_index, speed_limit_mps"),
        (
            "lane_connectors",
            "exit_lane_fid, entry_lane_fid, lane_group_connector_fid, traffic_light_stop_line_fids, speed_limit_mps",
        ),
        ("gen_lane_connectors_scaled_width_polygons", "lane_connector_fid"),
        ("baseline_paths", "lane_fid, lane_connector_fid"),
        ("boundaries", "boundary_type_fid"),
        ("stop_polygons", "stop_polygon_type_fid, lane_fids, lane_connector_fids"),
        ("crosswalks", "creator_id"),
        ("road_segments", "lane_group_fids"),
        ("intersections", "creator_id"),
        ("generic_drivable_areas", "creator_id"),
        ("carpark_areas", "creator_id"),
    ];
    for (layer, columns) in layers {
        db.execute_batch(&format!(
            "CREATE TABLE {layer} (fid INTEGER PRIMARY KEY, geom BLOB, {columns});
             INSERT INTO gpkg_geometry_columns VALUES ('{layer}', 'geom', 'GEOMETRY', 4326);"
        ))
        .unwrap();
    }
    let (before, after, between) = ((-150.0, 20.0), (30.0, 300.0), (20.0, 30.0));
    let insert =
        |sql: &str, blob: Vec<u8>| assert_eq!(db.execute(&format!("INSERT INTO {sql}"), [blob]).unwrap(), 1);
    for (fid, x, y) in [(1, before, 0.0), (2, after, 0.0), (4, before, 3.5)] {
        let group = if fid == 2 { 20 } else { 10 };
        let index = if fid == 4 { 0 } else { 1 };
        insert(
            &format!("lanes_polygons VALUES ({fid}, ?1, {fid}.0, {group}, {index}, NULL)"),
            area(x, (y - 1.75, y + 1.75)),
        );
        insert(&format!("baseline_paths VALUES ({fid}, ?1, {fid}, NULL)"), line(&[(x.0, y), (x.1, y)]));
    }
    insert("lane_connectors VALUES (3, ?1, 1, 2, 30, '7, 8', 11.0)", line(&[(20.0, 0.0), (30.0, 0.0)]));
    insert("baseline_paths VALUES (3, ?1, NULL, 3)", line(&[(20.0, 0.0), (30.0, 0.0)]));
    insert("gen_lane_connectors_scaled_width_polygons VALUES (1, ?1, 3)", area(between, (-1.75, 1.75)));
    insert("boundaries VALUES (1, ?1, 0)", line(&[(20.0, 1.75), (-150.0, 1.75)]));
    insert("boundaries VALUES (2, ?1, 3)", line(&[(20.0, -1.75), (-150.0, -1.75)]));
    insert("stop_polygons VALUES (7, ?1, 2, '', '3')", area((17.0, 19.0), (-1.0, 1.0)));
    insert("stop_polygons VALUES (8, ?1, 2, '', '3')", area((10.0, 12.0), (-1.0, 1.0)));
    insert("stop_polygons VALUES (9, ?1, 1, '4', '')", area((17.0, 19.0), (2.5, 4.5)));
    insert("crosswalks VALUES (1, ?1, '')", area((22.0, 25.0), (-5.0, 5.0)));
    insert("road_segments VALUES (1, ?1, '')", area(before, (-2.0, 6.0)));
    insert("road_segments VALUES (2, ?1, '')", area(after, (-2.0, 2.0)));
    insert("intersections VALUES (1, ?1, '')", area(between, (-10.0, 10.0)));
}
