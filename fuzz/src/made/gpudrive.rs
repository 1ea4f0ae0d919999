use serde_json::{Value, json};

/// Frames of an object that goes along the x axis at 10 m/s, absent before frame `from`.
fn object(id: Option<u64>, kind: &str, x: f64, from: usize, unit: f64) -> Value {
    let frames = |of: &dyn Fn(usize) -> Value| (0..91).map(of).collect::<Vec<_>>();
    let mut made = json!({
        "position": frames(&|f| if f < from { json!({"x": -1e4, "y": -1e4}) } else { json!({"x": x + f as f64, "y": 5}) }),
        "width": 1.9, "length": 4.5, "heading": frames(&|_| json!(unit)),
        "velocity": frames(&|_| json!({"x": 10, "y": 0})), "valid": frames(&|f| json!(f >= from)), "type": kind,
    });
    if let Some(id) = id {
        made["id"] = json!(id);
    }
    made
}

fn line(points: &[(f64, f64)]) -> Value {
    points.iter().map(|p| json!({"x": p.0, "y": p.1})).collect()
}

fn scenario(objects: Value) -> Value {
    let road = |id: u64, kind: &str, code: i64, points: &[(f64, f64)]| json!({"geometry": line(points), "type": kind, "map_element_id": code, "id": id});
    json!({
        "name": "tfrecord-00001-of-00150_7.json", "objects": objects,
        "roads": [
            road(100, "lane", 2, &[(900.0, 0.0), (1050.0, 0.0)]), road(101, "lane", 1, &[(1050.0, 0.02), (1200.0, 0.0)]),
            road(103, "lane", 2, &[(1050.0, 0.0)]), road(104, "road_edge", 15, &[(900.0, -2.0), (1200.0, -2.0)]),
            road(106, "road_line", 11, &[(900.0, 2.0), (1200.0, 2.0)]), road(107, "crosswalk", 18, &[(1040.0, 0.0), (1045.0, 0.0), (1045.0, 8.0)]),
            road(108, "speed_bump", 19, &[(1040.0, 0.0), (1045.0, 0.0), (1045.0, 8.0)]), road(110, "stop_sign", 17, &[(1049.0, -3.0)]),
        ],
        "tl_states": {"100": {"state": ["stop", "arrow_go"], "x": [1049, 1049], "y": [0, 0], "time_index": [0, 90]}},
    })
}

/// A GPUDrive file.
pub fn new() -> Vec<u8> {
    let mut made = scenario(json!([
        object(Some(7), "vehicle", 1000.0, 3, 0.1),
        object(Some(8), "pedestrian", 1010.0, 0, 0.1)
    ]));
    made["scenario_id"] = json!("made");
    made["metadata"] = json!({"sdc_track_index": 1, "objects_of_interest": [7], "tracks_to_predict": [{"track_index": 0, "difficulty": 0}]});
    made.to_string().into_bytes()
}

/// A Nocturne file: degrees, no ids.
pub fn old() -> Vec<u8> {
    scenario(json!([object(None, "cyclist", 1000.0, 3, 90.0), object(None, "vehicle", 1010.0, 0, 90.0)]))
        .to_string()
        .into_bytes()
}
