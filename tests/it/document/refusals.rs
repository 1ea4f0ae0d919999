//! Documents that are refused, and their messages.

use reactsim::evaluation::document::score_document;
use reactsim::formats::document::Document;
use serde_json::{Value, json};

use super::document;

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
    let (option, words) =
        (json!({ "fault_order": "any" }), ["`fault_order`", "`any`", "`paper` or `nuplan`"]);
    refused(|d| d["options"] = option, &words);
    let scenario = |d: &mut Value, key: &str, value: Value| d["scenarios"][0][key] = value;
    let refused_scenario = |key: &str, value: Value, words: &[&str]| {
        refused(|d| scenario(d, key, value), &[&["scenario `s1`"], words].concat());
    };
    refused_scenario("av_index", 2.into(), &["av_index", "2 of 2 agents"]);
    refused_scenario("num_future", 79.into(), &["(`av`).x", "91 entries", "90 entries"]);
    refused_scenario("num_future", 0.into(), &["num_future"]);
    refused_scenario("log", json!([]), &["log", "2 entries"]);
    for (lane, words) in [
        (
            json!({ "id": "l", "kind": "path", "polygon": [], "baseline": [] }),
            ["map.lanes[0] (`l`).kind", "`path`"],
        ),
        (
            json!({ "id": "l", "kind": "lane", "polygon": [], "baseline": [[0, 0], [0, 0]] }),
            ["(`l`).baseline", "two distinct points"],
        ),
    ] {
        refused_scenario("map", json!({ "lanes": [lane] }), &words);
    }
    for (key, value, words) in [
        ("id", json!("av"), ["agents[1].id", "av"]),
        ("type", json!("bus"), ["(`b7`).type", "`bus`"]),
        ("length", json!(-1.0), ["(`b7`).length", "-1"]),
        ("length", json!(1e300), ["(`b7`).length", "less than 1000 m"]),
        ("vx", json!([1.0]), ["(`b7`).vx", "1 entries"]),
        ("x", json!(["one"]), ["`b7`", "one"]),
    ] {
        let words = [&["scenario `s1`"], &words[..]].concat();
        refused(|d| d["scenarios"][0]["agents"][1][key] = value, &words);
    }
    refused(
        |d| _ = d["scenarios"][0]["agents"][1].as_object_mut().unwrap().remove("width"),
        &["scenario `s1`", "agents[1] (`b7`)", "missing field `width`"],
    );
}

/// Such values once took time and memory, or gave a number.
#[test]
fn far_values_are_refused_by_place() {
    for (name, value) in [("y", 1e10), ("x", -1e300), ("y", 1e8), ("heading", 1e9), ("vx", 1e5)] {
        let mut far = document();
        let agent = &mut far["scenarios"][0]["agents"][1];
        if name == "vx" {
            (agent["vx"], agent["vy"]) = (json!(vec![5.0; 91]), json!(vec![0.0; 91]));
        }
        (21..91).for_each(|f| agent[name][f] = json!(value));
        let message = refusal(&far.to_string());
        assert!(message.contains(&format!("`b7`).{name}[21]")) && message.len() < 400, "{message}");
    }
    let edges = json!([[[-50.0, -6.0], [1e12, 0.0]]]);
    refused(|d| d["scenarios"][0]["map"]["road_edges"] = edges, &["within 100 km of the AV"]);
}

#[test]
fn what_a_document_lacks_or_repeats_is_said() {
    let with = |change: &dyn Fn(&mut Value)| {
        let mut changed = document();
        change(&mut changed);
        changed
    };
    let twice = with(&|d| {
        let first = d["scenarios"][0].clone();
        d["scenarios"].as_array_mut().unwrap().push(first);
    });
    let crowded = with(&|d| {
        let agents = d["scenarios"][0]["agents"].as_array_mut().unwrap();
        for i in 0..2500 {
            let mut agent = agents[1].clone();
            agent["id"] = json!(format!("copy-{i}"));
            agents.push(agent);
        }
    });
    for (document, part) in [
        (with(&|d| d["scenarios"] = json!([])), "at least one scenario"),
        (twice, "an id that no other scenario has"),
        (with(&|d| d["option"] = json!({ "fault_order": "nuplan" })), "unknown field `option`"),
        (crowded, "at most 2000 agents"),
        (json!([]), "expected an object"),
    ] {
        let message = refusal(&document.to_string());
        assert!(message.contains(part) && !message.contains("struct"), "{part}: {message}");
    }
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
