//! Documents that are refused, and their messages.

use reactsim::evaluation::document::score_document;
use reactsim::formats::document::Document;
use serde_json::{Value, json};

fn document() -> Value {
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

fn refusal(text: &str) -> String {
    match Document::from_json(text) {
        Err(error) => error.to_string(),
        Ok(document) => score_document(&document).unwrap_err().to_string(),
    }
}

#[track_caller]
fn refused(change: impl FnOnce(&mut Value), words: &[&str]) {
    let mut value = document();
    change(&mut value);
    let message = refusal(&value.to_string());
    for word in words {
        assert!(message.contains(word), "`{word}` is not in: {message}");
    }
}

#[test]
fn a_plain_document_is_scored() {
    let result = score_document(&Document::from_json(&document().to_string()).unwrap()).unwrap();
    assert_eq!(result["scenarios"][0]["offroad_rate"], Value::Null);
    assert_eq!(result["scenarios"][0]["accel_rate"], json!(0.0));
    assert_eq!(result["valid_scenarios"]["a_av_collision_count"], json!(1));
}

#[test]
fn padding_far_from_the_scenario_is_absent() {
    let expected = score_document(&Document::from_json(&document().to_string()).unwrap()).unwrap();
    let mut padded = document();
    // World coordinates, next to which an unused slot is filled with zeros.
    for agent in padded["scenarios"][0]["agents"].as_array_mut().unwrap() {
        agent["x"] = json!(vec![331_000.0; 91]);
    }
    let mut padding = padded["scenarios"][0]["agents"][1].clone();
    for (field, value) in [("id", json!("0")), ("length", json!(0.0)), ("width", json!(0.0))] {
        padding[field] = value;
    }
    for field in ["x", "y"] {
        padding[field] = json!(vec![0.0; 91]);
    }
    padded["scenarios"][0]["agents"].as_array_mut().unwrap().push(padding.clone());
    let mut scored = score_document(&Document::from_json(&padded.to_string()).unwrap()).unwrap();
    let unused = scored["scenarios"][0]["agents"].as_array_mut().unwrap().pop().unwrap();
    assert_eq!((&unused["id"], &unused["present"]), (&json!("0"), &json!(false)));
    assert_eq!(scored, expected);
    // With an extent it is an object that is too far away.
    padding["length"] = json!(4.0);
    padding["width"] = json!(2.0);
    padded["scenarios"][0]["agents"][2] = padding;
    let message = refusal(&padded.to_string());
    assert!(message.contains("x[0] is 0, expected a position within 100 km of the AV"), "{message}");
}

#[test]
fn refusals_name_what_is_wrong() {
    refused(|d| d["format"] = "other".into(), &["`other`", "reactsim-rollouts-v1"]);
    refused(|d| d["dt"] = 0.2.into(), &["0.2", "10 Hz"]);
    refused(|d| d["options"] = json!({ "fault_ordr": "paper" }), &["`fault_ordr`", "fault_order"]);
    refused(
        |d| d["options"] = json!({ "fault_order": "any" }),
        &["`fault_order`", "`any`", "`paper` or `nuplan`"],
    );
    let scenario = |d: &mut Value, key: &str, value: Value| d["scenarios"][0][key] = value;
    refused(|d| scenario(d, "av_index", 2.into()), &["scenario `s1`", "av_index", "2 of 2 agents"]);
    refused(
        |d| scenario(d, "num_future", 79.into()),
        &["scenario `s1`", "(`av`).x", "91 entries", "90 entries"],
    );
    refused(|d| scenario(d, "num_future", 0.into()), &["scenario `s1`", "num_future"]);
    refused(|d| scenario(d, "log", json!([])), &["scenario `s1`", "log", "2 entries"]);
    let agent = |d: &mut Value, key: &str, value: Value| d["scenarios"][0]["agents"][1][key] = value;
    refused(|d| agent(d, "id", "av".into()), &["scenario `s1`", "agents[1].id", "av"]);
    refused(|d| agent(d, "type", "bus".into()), &["scenario `s1`", "(`b7`).type", "`bus`"]);
    refused(|d| agent(d, "length", (-1.0).into()), &["scenario `s1`", "(`b7`).length", "-1"]);
    refused(|d| agent(d, "vx", json!([1.0])), &["scenario `s1`", "(`b7`).vx", "1 entries"]);
    refused(|d| agent(d, "x", json!(["one"])), &["scenario `s1`", "`b7`", "one"]);
    refused(
        |d| {
            d["scenarios"][0]["agents"][1].as_object_mut().unwrap().remove("width");
        },
        &["scenario `s1`", "agents[1] (`b7`)", "missing field `width`"],
    );
    refused(
        |d| {
            scenario(
                d,
                "map",
                json!({ "lanes": [{ "id": "l", "kind": "path", "polygon": [], "baseline": [] }] }),
            )
        },
        &["scenario `s1`", "map.lanes[0] (`l`).kind", "`path`"],
    );
    refused(
        |d| {
            let lane = json!({ "id": "l", "kind": "lane", "polygon": [], "baseline": [[0, 0], [0, 0]] });
            scenario(d, "map", json!({ "lanes": [lane] }));
        },
        &["scenario `s1`", "(`l`).baseline", "two distinct points"],
    );
}

#[test]
fn numbers_that_are_not_finite_are_refused_by_field() {
    let text = document().to_string().replacen("\"y\":[9.0,9.0", "\"y\":[9.0,NaN", 1);
    let message = refusal(&text);
    assert!(message.contains("scenario `s1`: agents[1] (`b7`).y[1] is NaN"), "{message}");
    let message = refusal("{\"format\": ");
    assert!(message.contains("rollout document"), "{message}");
}

#[test]
fn any_time_axis_and_any_number_of_agents() {
    let mut value = document();
    let scenario = &mut value["scenarios"][0];
    let mut agents = Vec::new();
    for i in 0..70 {
        let mut agent = scenario["agents"][0].clone();
        agent["id"] = format!("n{i}").into();
        for key in ["x", "heading"] {
            agent[key] = json!(vec![0.0; 6]);
        }
        agent["y"] = json!(vec![9.0 * f64::from(i); 6]);
        agent["valid"] = json!(vec![true; 6]);
        agents.push(agent);
    }
    scenario["agents"] = agents.into();
    scenario["current_index"] = 2.into();
    scenario["num_future"] = 3.into();
    let result = score_document(&Document::from_json(&value.to_string()).unwrap()).unwrap();
    assert_eq!(result["scenarios"][0]["fractions"]["accel"], json!([0, 69 * 3]));
}
