//! JSON documents of rollouts: the worked cases, and refusals.

mod cases;
mod refusals;

use serde_json::{Value, json};

/// Returns a document of one scenario in which the AV and another vehicle stand side by side.
pub(crate) fn document() -> Value {
    let agent = |id: &str, y: f64| {
        json!({
            "id": id, "type": "vehicle", "length": 4.5, "width": 2.0,
            "x": vec![0.0; 91], "y": vec![y; 91], "heading": vec![0.0; 91],
            "vx": Value::Null, "vy": Value::Null, "valid": vec![true; 91],
        })
    };
    json!({
        "format": "reactsim-rollouts-v1", "dt": 0.1,
        "scenarios": [{
            "id": "s1", "current_index": 10, "num_future": 80, "av_index": 0,
            "map": { "drivable_area": [], "lanes": [], "intersections": [] },
            "agents": [agent("av", 0.0), agent("b7", 9.0)],
        }],
    })
}
