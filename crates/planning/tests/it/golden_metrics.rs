//! All metrics of every golden document: verdicts exactly, reals to a tolerance.

use reactsim_planning::metrics::{
    ComfortQuantity, ContactClass, History, MetricValue, MissingInputs, PlannerMetric, PlannerScores, judge,
};
use serde_json::Value;

use crate::document::{Document, number, numbers};
use crate::part::documents;

/// Tolerance of reals. The golden values have 1e-8 where the devkit rounds.
const TOLERANCE: f64 = 1e-6;

/// Differences between the results and a golden document.
struct Differences {
    document: String,
    found: Vec<String>,
}

impl Differences {
    fn verdict<T: PartialEq + std::fmt::Debug>(&mut self, what: &str, found: T, expected: T) {
        if found != expected {
            self.add(what, &format!("{found:?}"), &format!("{expected:?}"));
        }
    }

    fn real(&mut self, what: &str, found: f64, expected: f64) {
        if !is_close(found, expected) {
            self.add(what, &found.to_string(), &expected.to_string());
        }
    }

    fn series(&mut self, what: &str, found: &[f64], expected: &Value) {
        let expected = numbers(expected);
        self.verdict(&format!("{what}, length"), found.len(), expected.len());
        let differing = found.iter().zip(&expected).position(|(&a, &b)| !is_close(a, b));
        if let Some(k) = differing {
            self.add(&format!("{what}, sample {k}"), &found[k].to_string(), &expected[k].to_string());
        }
    }

    fn add(&mut self, what: &str, found: &str, expected: &str) {
        self.found.push(format!("{}: {what}: {found}, expected {expected}", self.document));
    }
}

fn is_close(a: f64, b: f64) -> bool {
    a == b || (a - b).abs() <= TOLERANCE
}

#[test]
fn the_metrics_equal_those_of_the_devkit() {
    let (mut differences, mut documents_read) = (Vec::new(), 0);
    for document in documents("metrics") {
        differences.extend(compare(&document.document()));
        documents_read += 1;
    }
    assert!(
        differences.is_empty(),
        "{} differences in {documents_read} documents:\n{}",
        differences.len(),
        differences.join("\n")
    );
}

/// Returns the differences between the metrics of a document and those expected.
pub(crate) fn compare(document: &Document) -> Vec<String> {
    let history = History {
        map: &document.map,
        shape: document.shape,
        ego: &document.ego,
        expert: Some(&document.expert),
        objects: &document.objects,
        missing: MissingInputs::AsDevkit,
    };
    let scores = judge(&history).unwrap();
    let mut differences = Differences { document: document.name.clone(), found: Vec::new() };
    compare_lanes(document, &scores, &mut differences);
    compare_values(&document.expected, &scores, &mut differences);
    compare_collisions(&document.expected["no_ego_at_fault_collisions"], &scores, &mut differences);
    compare_series(&document.expected, &scores, &mut differences);
    compare_comfort(&document.expected["ego_is_comfortable"], &scores, &mut differences);
    differences.found
}

fn compare_lanes(document: &Document, scores: &PlannerScores, differences: &mut Differences) {
    let expected = &document.expected;
    let ids = |list: &Value| -> Vec<String> {
        list.as_array().unwrap().iter().map(|id| id.as_str().unwrap().to_owned()).collect()
    };
    for (k, lanes) in expected["lanes"].as_array().unwrap().iter().enumerate() {
        let found = document.ids(&scores.center_lanes[k]);
        differences.verdict(&format!("centre lanes, sample {k}"), found, ids(lanes));
    }
    // The order of the lanes of a corner has no effect.
    let sorted = |mut lanes: Vec<String>| {
        lanes.sort();
        lanes
    };
    for (k, corners) in expected["corner_lanes"].as_array().unwrap().iter().enumerate() {
        for (corner, lanes) in corners.as_array().unwrap().iter().enumerate() {
            let found = document.ids(&scores.corner_lanes[k][corner]);
            let what = format!("lanes of corner {corner}, sample {k}");
            differences.verdict(&what, sorted(found), sorted(ids(lanes)));
        }
    }
    let common = bools(&expected["in_common_or_connected"]);
    differences.verdict("in common lane", scores.in_common_lane.clone(), Some(common));
}

fn bools(list: &Value) -> Vec<bool> {
    list.as_array().unwrap().iter().map(|value| value.as_bool().unwrap()).collect()
}

fn compare_values(expected: &Value, scores: &PlannerScores, differences: &mut Differences) {
    for (metric, value) in scores.values() {
        let name = metric.nuplan_name();
        let (MetricValue::Defined(found), Some(wanted)) = (value, expected[name]["score"].as_f64()) else {
            differences.add(name, &format!("{value:?}"), &expected[name]["score"].to_string());
            continue;
        };
        if matches!(metric, PlannerMetric::Progress | PlannerMetric::SpeedLimit) {
            differences.real(name, found, wanted);
        } else {
            differences.verdict(name, found, wanted);
        }
    }
    differences.real("mean speed", scores.mean_speed, number(&expected["ego_mean_speed"]));
    let score = scores.score.cls().unwrap_or(f64::NAN);
    differences.real("score", score, number(&expected["scenario_score"]));
}

fn compare_collisions(expected: &Value, scores: &PlannerScores, differences: &mut Differences) {
    let contacts = expected["collisions"].as_array().unwrap();
    let found = &scores.collisions.contacts;
    differences.verdict("number of contacts", found.len(), contacts.len());
    for (contact, wanted) in found.iter().zip(contacts) {
        let what = format!("contact with {}", contact.object);
        differences.verdict(&what, Some(&*contact.object), wanted["track"].as_str());
        differences.verdict(&what, Some(contact.step as u64), wanted["step"].as_u64());
        differences.verdict(&what, Some(devkit_name(contact.class)), wanted["type"].as_str());
        differences.verdict(&what, contact.at_fault, wanted["at_fault"].as_bool());
        differences.real(&what, contact.delta_v, number(&wanted["delta_v"]));
    }
    let counts = scores.collisions.at_fault;
    for (name, count) in [
        ("at_fault_vrus", counts.vulnerable),
        ("at_fault_vehicles", counts.vehicles),
        ("at_fault_objects", counts.objects),
    ] {
        differences.verdict(name, Some(count as u64), expected[name].as_u64());
    }
}

fn devkit_name(class: ContactClass) -> &'static str {
    match class {
        ContactClass::StoppedEgo => "STOPPED_EGO_COLLISION",
        ContactClass::StoppedTrack => "STOPPED_TRACK_COLLISION",
        ContactClass::ActiveRear => "ACTIVE_REAR_COLLISION",
        ContactClass::ActiveFront => "ACTIVE_FRONT_COLLISION",
        ContactClass::ActiveLateral => "ACTIVE_LATERAL_COLLISION",
    }
}

fn compare_series(expected: &Value, scores: &PlannerScores, differences: &mut Differences) {
    let of = |metric: PlannerMetric| &expected[metric.nuplan_name()];
    let inside = bools(&of(PlannerMetric::DrivableArea)["corners_inside"]);
    differences.verdict("corners inside", scores.drivable_area.corners_inside.clone(), inside);

    let direction = of(PlannerMetric::DrivingDirection);
    differences.series("progress along the lane", &scores.driving_direction.progress, &direction["progress"]);
    differences.real("lowest progress", scores.driving_direction.lowest, number(&direction["min"]));

    let progress = of(PlannerMetric::Progress);
    let (found, wanted) = (&scores.progress, |name: &str| progress[name].as_f64());
    differences.real("progress of the expert", found.expert_total, wanted("expert_total").unwrap());
    differences.verdict("route", found.ego_total.is_some(), wanted("ego_total").is_some());
    if let (Some(found_total), Some(wanted)) = (found.ego_total, wanted("ego_total")) {
        differences.real("progress of ego", found_total, wanted);
        differences.series("progress of ego", &found.ego_progress, &progress["ego_progress"]);
    }

    let ttc = &of(PlannerMetric::TimeToCollision)["ttc"];
    differences.series("time to collision", &scores.time_to_collision.ttc, ttc);
    let overspeed = &of(PlannerMetric::SpeedLimit)["overspeed"];
    differences.series("excess of speed", &scores.speed_limit.overspeed, overspeed);
}

fn compare_comfort(expected: &Value, scores: &PlannerScores, differences: &mut Differences) {
    let comfort = &scores.comfort;
    let quantities: [(&str, &ComfortQuantity); 6] = [
        ("ego_lon_acceleration", &comfort.longitudinal_acceleration),
        ("ego_lat_acceleration", &comfort.lateral_acceleration),
        ("ego_jerk", &comfort.jerk),
        ("ego_lon_jerk", &comfort.longitudinal_jerk),
        ("ego_yaw_rate", &comfort.yaw_rate),
        ("ego_yaw_acceleration", &comfort.yaw_acceleration),
    ];
    for (name, quantity) in quantities {
        differences.verdict(name, Some(quantity.within), expected[name]["within"].as_bool());
        differences.series(name, &quantity.values, &expected[name]["values"]);
    }
}
