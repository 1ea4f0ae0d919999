use serde_json::{Value, json};

/// Rows of numbers that become a numpy array.
fn array(rows: Vec<Vec<f64>>) -> Value {
    json!({ "__array__": rows })
}

fn line(points: &[(f64, f64)]) -> Value {
    array(points.iter().map(|p| vec![p.0, p.1]).collect())
}

fn text(text: &str, out: &mut Vec<u8>) {
    out.extend([0x8c, text.len() as u8]);
    out.extend(text.as_bytes());
}

/// The value as Python's pickle writes it.
fn pickle(value: &Value, out: &mut Vec<u8>) {
    match value {
        Value::Null => out.push(b'N'),
        Value::Bool(b) => out.push(if *b { 0x88 } else { 0x89 }),
        Value::Number(n) => match n.as_i64().and_then(|n| u8::try_from(n).ok()) {
            Some(small) => out.extend([b'K', small]),
            None => {
                out.push(b'G');
                out.extend(n.as_f64().expect("a number").to_be_bytes());
            }
        },
        Value::String(t) => text(t, out),
        Value::Array(items) => {
            out.extend(b"](");
            items.iter().for_each(|item| pickle(item, out));
            out.push(b'e');
        }
        Value::Object(fields) => match fields.get("__array__").and_then(Value::as_array) {
            Some(rows) => numpy(rows, out),
            None => {
                out.extend(b"}(");
                for (key, value) in fields {
                    text(key, out);
                    pickle(value, out);
                }
                out.push(b'u');
            }
        },
    }
}

fn numpy(rows: &[Value], out: &mut Vec<u8>) {
    let columns = rows.first().and_then(Value::as_array).map_or(1, Vec::len);
    out.extend(b"cnumpy.core.multiarray\n_reconstruct\ncnumpy\nndarray\nK\x00\x85C\x01b\x87R(K\x01");
    out.extend([b'K', rows.len() as u8, b'K', columns as u8]);
    out.extend(b"\x86cnumpy\ndtype\n\x8c\x02f4\x89\x88\x87R(K\x03\x8c\x01<NNNJ\xff\xff\xff\xffJ\xff\xff\xff\xffK\x00tb\x89B");
    let all = rows.iter().filter_map(Value::as_array).flatten().filter_map(Value::as_f64);
    let bytes: Vec<u8> = all.flat_map(|v| (v as f32).to_le_bytes()).collect();
    out.extend((bytes.len() as u32).to_le_bytes());
    out.extend(bytes);
    out.extend(b"tb");
}

/// A track along the x axis at 10 m/s, absent before frame `from`.
fn track(kind: &str, x: f64, from: usize) -> Value {
    let frames = |of: &dyn Fn(f64) -> Vec<f64>| array((0..91).map(|f| of(f as f64)).collect());
    json!({"type": kind, "state": {
        "position": frames(&|f| vec![x + f, 5.0]), "heading": frames(&|_| vec![0.01]), "velocity": frames(&|_| vec![10.0, 0.1]),
        "valid": frames(&|f| vec![f64::from(u8::from(f >= from as f64))]), "size": frames(&|_| vec![4.5, 1.9, 1.5])
    }})
}

/// A ScenarioNet file.
pub fn made() -> Vec<u8> {
    let lane = |kind: &str, x: f64, after: Value| {
        json!({"type": kind, "polyline": line(&[(x, 0.0), (x + 150.0, 0.0)]), "speed_limit_mph": 25, "entry_lanes": [], "exit_lanes": after,
            "left_neighbor": [{"feature_id": "100", "self_start_index": 0, "self_end_index": 1, "neighbor_start_index": 0, "neighbor_end_index": 1}],
            "right_neighbor": ["101"], "polygon": line(&[(x, 2.0), (x + 150.0, 2.0), (x, -2.0)])})
    };
    let ring = line(&[(0.0, 0.0), (9.0, 0.0), (9.0, 9.0), (0.0, 0.0)]);
    let mut shown = vec![json!("LANE_STATE_STOP"), Value::Null];
    shown.resize(91, json!("TRAFFIC_LIGHT_GREEN"));
    let value = json!({
        "id": "made", "version": "v1", "length": 91,
        "metadata": {"dataset": "waymo", "sdc_id": "8", "ts": array((0..91).map(|f| vec![f64::from(f) * 0.1]).collect()), "current_time_index": 10,
            "tracks_to_predict": {"7": {"track_id": "7"}}, "objects_of_interest": ["7"]},
        "tracks": {"7": track("VEHICLE", 1000.0, 3), "8": track("VEHICLE", 1010.0, 0)},
        "map_features": {
            "100": lane("LANE_SURFACE_STREET", 900.0, json!([101, "999"])), "101": lane("LANE_SURFACE_UNSTRUCTURE", 1050.0, json!([])),
            "104": {"type": "ROAD_EDGE_BOUNDARY", "polyline": line(&[(900.0, -6.0), (1200.0, -6.0)])},
            "106": {"type": "ROAD_LINE_SOLID_SINGLE_YELLOW", "polyline": line(&[(900.0, 2.0), (1200.0, 2.0)])},
            "107": {"type": "CROSSWALK", "polygon": ring.clone()}, "boundary_1": {"type": "ROAD_LINE_BROKEN_SINGLE_WHITE", "polyline": ring},
            "110": {"type": "STOP_SIGN", "lane": [101], "position": array(vec![vec![1060.0], vec![-3.0]])}
        },
        "dynamic_map_states": {"100": {"lane": "100", "stop_point": array(vec![vec![1049.0, 0.0]]), "state": {"object_state": shown}}}
    });
    let mut file = vec![0x80, 4];
    pickle(&value, &mut file);
    file.push(b'.');
    file
}
