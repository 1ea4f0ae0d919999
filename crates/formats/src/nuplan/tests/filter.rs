//! Scenario filters of nuPlan's devkit.

use std::fs;
use std::path::{Path, PathBuf};
use std::slice::from_ref;

use reactsim_test_support::nuplan::Fixture;

use super::super::filter::choose;
use super::{all, refusal};
use crate::{FormatError, LengthChoice, nuplan_filter};

/// First and last row of the only scene with two scenes before it and two after it.
const INNER: std::ops::RangeInclusive<u32> = 20..=200;

fn token(row: u32) -> String {
    format!("70000000{row:08x}")
}

fn written(folder: &Path, text: &str) -> PathBuf {
    let path = folder.join("filter.yaml");
    fs::write(&path, text).unwrap();
    path
}

/// Last row with 160 rows after it.
const LAST: u32 = 60;

/// Returns the rows that a filter chooses from logs, and the number of those without 160 rows after them.
fn chosen(logs: &[PathBuf], text: &str) -> Result<(Vec<u32>, usize), FormatError> {
    let folder = tempfile::tempdir().unwrap();
    let chosen = choose(&written(folder.path(), text), logs, LengthChoice::default())?;
    let row = |token: &super::super::token::Token| u32::from_str_radix(&token.to_string()[8..], 16).unwrap();
    let short = chosen.absent.iter().find(|(what, _)| what.starts_with("the window"));
    let number = |(_, text): &(String, String)| text.split(' ').next().unwrap().parse().unwrap();
    Ok((chosen.tokens.iter().map(row).collect(), short.map_or(0, number)))
}

fn rows(logs: &[PathBuf], text: &str) -> Result<Vec<u32>, FormatError> {
    chosen(logs, text).map(|(rows, _)| rows)
}

#[test]
fn filters_choose_as_the_devkit_does() {
    let made = Fixture::write().log(
        "UPDATE scene SET goal_ego_pose_token = (SELECT token FROM ego_pose LIMIT 1) WHERE name = 's2';
         INSERT INTO scenario_tag VALUES (x'7900000000000009', x'700000000000001e', 'zebra', NULL);",
    );
    let logs = [made.log.clone()];
    let inner: Vec<u32> = INNER.collect();
    let quoted = format!("scenario_tokens: ['{}', \"{}\"]", token(30), token(215));
    // The 181 frames are 178 without a tag, 20 `edge`, 30 `zebra` (the last of its types) and 31 `inner`.
    let untagged: Vec<u32> = inner.iter().copied().filter(|row| ![20, 30, 31].contains(row)).collect();
    let part = |step: usize, n: usize| {
        let mut kept: Vec<u32> = untagged.iter().copied().step_by(step).take(n).chain([20, 30, 31]).collect();
        kept.sort();
        kept
    };
    for (text, expected) in [
        ("scenario_types: null", inner.clone()),
        ("scenario_types: [inner]", vec![30, 31]),
        ("scenario_types:\n- inner # a type\n- 'edge'\nscenario_tokens:\n", vec![20, 30, 31]),
        (&quoted, vec![30]),
        (&format!("{quoted}\nscenario_types: [edge]"), vec![]),
        ("scenario_types: [inner]\nlog_names: [made]", vec![30, 31]),
        ("scenario_types: [inner]\nlog_names: [other]", vec![]),
        ("scenario_types: [inner]\nmap_names: [town]", vec![30, 31]),
        ("scenario_types: [inner]\nmap_names: [city]", vec![]),
        ("scenario_types: [inner]\nremove_invalid_goals: true", vec![30, 31]),
        ("scenario_types: [inner]\ntimestamp_threshold_s: 0.05", vec![30, 31]),
        ("scenario_types: [inner]\ntimestamp_threshold_s: 0.06", vec![30]),
        ("timestamp_threshold_s: 15", vec![20, 21, 30, 31]),
        ("num_scenarios_per_type: 2", vec![20, 21, 30, 31, 112]),
        ("limit_total_scenarios: 91", part(2, 88)),
        ("limit_total_scenarios: 0.5", part(2, 88)),
        ("limit_total_scenarios: 2", vec![20, 30]),
        ("limit_total_scenarios: 2\nscenario_types: [inner, zebra]", vec![30, 31]),
        ("limit_total_scenarios: 1_000_000\nshuffle: true\nexpand_scenarios: true", inner.clone()),
        (&format!("log_names: ${{splitter.log_splits.val}}\n{quoted}"), vec![30]),
    ] {
        let fit: Vec<u32> = expected.iter().copied().filter(|row| *row <= LAST).collect();
        let short = expected.len() - fit.len();
        assert_eq!(chosen(&logs, text).unwrap(), (fit, short), "{text}");
    }
    // Without a goal that is a pose.
    for goal in ["NULL", "x'0102030405060708'"] {
        let made = Fixture::write().log(&format!("UPDATE scene SET goal_ego_pose_token = {goal}"));
        assert_eq!(rows(from_ref(&made.log), "remove_invalid_goals: true").unwrap(), Vec::<u32>::new());
    }
}

#[test]
fn numbers_per_type_count_over_logs() {
    let (first, second) = (Fixture::write(), Fixture::write());
    let logs = [first.log.clone(), second.log.clone()];
    // Of the four frames with the tag in two logs, every second one, in the order of the logs.
    let text = "scenario_types: [inner]\nnum_scenarios_per_type: 2";
    assert_eq!(rows(&logs, text).unwrap(), [30, 30]);
    let folder = tempfile::tempdir().unwrap();
    let filter = written(folder.path(), "scenario_types: [inner]\nnum_scenarios_per_type: 1");
    assert_eq!(choose(&filter, &logs, LengthChoice::default()).unwrap().logs, logs[..1]);
}

#[test]
fn what_cannot_be_expressed_is_refused_by_name() {
    let made = Fixture::write();
    for (text, expected) in [
        ("_target_: interplan.BenchmarkScenarioFilter", "_target_ is `interplan.Bench"),
        ("scenario_tokens:\n- 168c4e592f1b5984-s2", "scenario_tokens is `168c4e592f1b5984-s2`"),
        ("scenario_tokens: []", "scenario_tokens is a list of 0"),
        ("scenario_tokens: [[log, 700000000000001e]]", "scenario_tokens is nested"),
        ("scenario_types: {a: b}", "scenario_types is nested"),
        ("log_names: ${splitter.log_splits.val}", "log_names is `${splitter.log_splits.val}`"),
        ("num_scenarios_per_type: 0", "num_scenarios_per_type is `0`"),
        ("num_scenarios_per_type: '3'", "num_scenarios_per_type is `3`"),
        ("limit_total_scenarios: 1.0", "limit_total_scenarios is `1.0`"),
        ("timestamp_threshold_s: soon", "timestamp_threshold_s is `soon`"),
        ("timestamp_threshold_s: .inf", "timestamp_threshold_s is `.inf`"),
        ("shuffle: maybe", "shuffle is `maybe`"),
        ("shuffle: true\nnum_scenarios_per_type: 2", "draws 2 of 178 of `unknown`"),
        ("shuffle: true\nlimit_total_scenarios: 0.5", "draws 88 of 178 of `unknown`"),
        ("ego_displacement_minimum_m: 5.0", "ego_displacement_minimum_m is `5.0`, expected null"),
        ("ego_start_speed_threshold: 1", "ego_start_speed_threshold is `1`, expected null"),
        ("token_set_path: a.json", "token_set_path is `a.json`, expected null"),
        ("ego_route_radius: 50", "ego_route_radius is `50`, expected null"),
        ("defaults:\n- modifications: some", "defaults is nested"),
        ("scenario_type: [a]", "scenario_type is a list of 1, expected a key"),
        ("shuffle: true\nshuffle: false", "line 2: expected a key"),
        ("a: &x b\nc: *x", "expected"),
        ("- scenario_types", "line 1: expected a mapping"),
        ("", "expected a mapping"),
        ("a: [", "not YAML"),
        ("a:\n\t- b: 'c", "not YAML"),
    ] {
        let error = rows(from_ref(&made.log), text).unwrap_err().to_string();
        assert!(error.contains(expected), "{text}: {error}");
    }
    let deep = format!("a: {}", "[".repeat(100_000));
    assert!(rows(from_ref(&made.log), &deep).is_err());
    let deep = format!("a:\n{}b", "- ".repeat(100_000));
    assert!(rows(from_ref(&made.log), &deep).is_err());
}

#[test]
fn selections_and_inputs_take_filters() {
    let made = Fixture::write();
    let home = made.log.parent().unwrap();
    let filter = written(home, "scenario_types: [inner]\nscenario_tokens: null");
    let ids = [token(30), token(31)];
    let selection = home.join("selection.json");
    fs::write(&selection, r#"{"format": "reactsim-nuplan-v1", "logs": ["."], "filter": "filter.yaml"}"#)
        .unwrap();
    let found = |scenarios: Vec<Result<reactsim_scene::Scenario, FormatError>>| -> Vec<String> {
        scenarios.into_iter().map(|scenario| scenario.unwrap().id).collect()
    };
    assert_eq!(found(all(&selection)), ids);
    let input = nuplan_filter(&filter, &[home.to_owned()], None).unwrap();
    assert_eq!(found(input.open().unwrap().collect()), ids);
    let files = [made.log.clone(), made.map.clone()];
    assert_eq!(input.companions(), files);
    let of_selection = crate::find_inputs(&selection).unwrap().remove(0);
    assert_eq!(of_selection.companions(), [from_ref(&filter), &files].concat());
    assert!(refusal(&filter).contains("give it as `filter`"), "{}", refusal(&filter));
    for (key, value) in [("tokens", r#"["00"]"#), ("tags", r#"["a"]"#), ("every_seconds", "1")] {
        let text = fs::read_to_string(&selection).unwrap().replace('}', &format!(r#", "{key}": {value}}}"#));
        fs::write(home.join("both.json"), text).unwrap();
        let error = refusal(&home.join("both.json"));
        assert!(error.contains(&format!("{key} is given together with `filter`")), "{error}");
    }
    let empty = tempfile::tempdir().unwrap();
    assert!(nuplan_filter(&filter, &[empty.path().to_owned()], None).is_err());
    assert!(nuplan_filter(&filter, &[home.to_owned()], Some(empty.path().to_owned())).is_err());
}

#[test]
fn what_is_not_among_the_logs_is_counted() {
    let made = Fixture::write();
    let home = made.log.parent().unwrap();
    fs::write(home.join("broken.db"), "SQLite format 3\0").unwrap();
    let tokens = [30, 31, 900, 901].map(token).join(", ");
    let filter = written(home, &format!("scenario_tokens: [{tokens}]\nlog_names: [made, broken, absent]"));
    let input = nuplan_filter(&filter, &[home.to_owned()], None).unwrap();
    let (good, bad): (Vec<_>, Vec<_>) = input.open().unwrap().partition(Result::is_ok);
    assert_eq!(good.len(), 2);
    let bad: Vec<String> = bad.into_iter().map(|error| error.unwrap_err().to_string()).collect();
    assert_eq!(bad.len(), 3, "{bad:?}");
    assert!(bad[0].contains("broken.db") && bad[0].contains("truncated"), "{bad:?}");
    assert!(
        bad[1]
            .contains("scenario_tokens is in part not among the logs: 2 of 4, the first `7000000000000384`")
    );
    assert!(
        bad[2].contains("log_names is in part not among the logs: 1 of 3, the first `absent`"),
        "{bad:?}"
    );
    let none = written(home, "scenario_types: [no]\nlog_names: [made]");
    let input = nuplan_filter(&none, &[home.to_owned()], None).unwrap();
    let error = input.open().unwrap().next().unwrap().unwrap_err().to_string();
    assert!(error.contains("the filter is met by no frame"), "{error}");
}
