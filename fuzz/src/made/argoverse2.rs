use std::sync::Arc;

use arrow_array::{ArrayRef, Float64Array, Int64Array, RecordBatch, StringArray};
use serde_json::{Value, json};

/// The table of a scenario whose id is `made-1`, not compressed.
pub fn tracks() -> Vec<u8> {
    let (mut ids, mut steps, mut x) = (Vec::new(), Vec::new(), Vec::new());
    for step in 0..110_i64 {
        for (id, ahead) in [("AV", 0.0), ("9", -30.0)] {
            if id == "AV" || step > 44 {
                ids.push(id);
                steps.push(step);
                x.push(500.0 + ahead + step as f64);
            }
        }
    }
    let n = ids.len();
    let texts = |text: &str| Arc::new(StringArray::from(vec![text; n])) as ArrayRef;
    let numbers = |v: f64| Arc::new(Float64Array::from(vec![v; n])) as ArrayRef;
    let whole = |v: i64| Arc::new(Int64Array::from(vec![v; n])) as ArrayRef;
    let batch = RecordBatch::try_from_iter([
        ("track_id", Arc::new(StringArray::from(ids)) as ArrayRef),
        ("object_type", texts("vehicle")),
        ("object_category", whole(2)),
        ("timestep", Arc::new(Int64Array::from(steps))),
        ("position_x", Arc::new(Float64Array::from(x))),
        ("position_y", numbers(0.0)),
        ("heading", numbers(0.1)),
        ("velocity_x", numbers(10.0)),
        ("velocity_y", numbers(0.0)),
        ("scenario_id", texts("made-1")),
        ("start_timestamp", numbers(3.15e17)),
        ("end_timestamp", numbers(3.15e17 + 10.9e9)),
        ("num_timestamps", whole(110)),
        ("focal_track_id", texts("9")),
    ]);
    super::native::table(&batch.expect("columns of one length"), None)
}

fn line(points: &[(f64, f64)]) -> Value {
    points.iter().map(|p| json!({"x": p.0, "y": p.1, "z": 1})).collect()
}

/// The map of that scenario.
pub fn map() -> Vec<u8> {
    let lane = |id: u64, x: f64, y: f64, successors: Value| {
        json!({
            "id": id, "is_intersection": id == 2, "lane_type": "VEHICLE", "centerline": line(&[(x, y), (x + 100.0, y)]),
            "left_lane_boundary": line(&[(x, y + 2.0), (x + 100.0, y + 2.0)]),
            "right_lane_boundary": line(&[(x, y - 2.0), (x + 100.0, y - 2.0)]),
            "left_lane_mark_type": "DOUBLE_SOLID_YELLOW", "right_lane_mark_type": "NONE",
            "left_neighbor_id": null, "right_neighbor_id": 4, "predecessors": [], "successors": successors
        })
    };
    json!({
        "drivable_areas": {"5": {"id": 5, "area_boundary": line(&[(400.0, -2.0), (700.0, -2.0), (700.0, 6.0)])}},
        "lane_segments": {"1": lane(1, 450.0, 0.0, json!([2, 77])), "2": lane(2, 550.0, 0.0, json!([])), "4": lane(4, 450.0, -4.0, json!([]))},
        "pedestrian_crossings": {"6": {"id": 6, "edge1": line(&[(540.0, -2.0), (540.0, 6.0)]), "edge2": line(&[(544.0, -2.0), (544.0, 6.0)])}}
    })
    .to_string()
    .into_bytes()
}
