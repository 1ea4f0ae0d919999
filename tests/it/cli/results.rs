//! Forms of results, and scores of kept rollouts.

use std::fs;

use reactsim::evaluation::read_summary;
use reactsim::geometry::Vec2;
use reactsim::scene::{FRAMES, LightParts, LightState, Scenario};

use crate::document::document;
use crate::program::{ended, json_of, result, said, text};
use crate::small_scenarios::{certified, parts, scenario, write};

#[test]
fn kept_rollouts_score_to_the_same_numbers() {
    let home = tempfile::tempdir().unwrap();
    let input = home.path().join("scenarios.parquet");
    write(&input, (0..5).map(scenario));
    let run =
        ["run", text(&input), "--models", "stop,constant-velocity", "--rollouts", "2", "--keep-rollouts"];
    let mut kept = Vec::new();
    for jobs in ["1", "3", "600"] {
        let out = home.path().join(jobs);
        let threads = ["--jobs", jobs, "--batch", "2"];
        ended(&[&run, &threads[..], &["--out", text(&out)]].concat(), 0);
        assert!(!out.join("parts").exists());
        kept.push(out.join("rollouts.parquet"));
    }
    let scored = result(&["score", text(&kept[0]), "--scenarios", text(&input)]);
    let summary = json_of(&home.path().join("1/summary.json"));
    for simulator in ["stop", "constant-velocity"] {
        assert_eq!(scored["simulators"][simulator]["metrics"], summary["simulators"][simulator]["metrics"]);
    }
    assert_eq!(scored["deviation"], summary["deviation"]);
    let svg = home.path().join("x.svg");
    let one = home.path().join("1");
    let begin = ["inspect", text(&input), "--id", "road-003", "--rollout", text(&one), "--simulator", "stop"];
    let steps = ["--index", "1", "--steps", "0,40,80", "--svg", text(&svg)];
    let (drawn, _) = said(&[&begin[..], &steps].concat(), 0);
    assert!(fs::read_to_string(&svg).unwrap().contains("</svg>"));
    assert!(drawn.contains("3 around the AV: 3 vehicles"), "{drawn}");
    ended(&[&run[..], &["--out", text(&home.path().join("3")), "--resume"]].concat(), 0);
    // Having far more threads than work changes nothing.
    for other in &kept[1..] {
        assert!(fs::read(&kept[0]).unwrap() == fs::read(other).unwrap());
    }
}

#[test]
fn results_come_in_every_form() {
    let home = tempfile::tempdir().unwrap();
    let (input, out) = (home.path().join("scenarios.parquet"), home.path().join("x_1"));
    write(&input, (0..3).map(scenario));
    let run = ended(&["run", text(&input), "--models", "log-replay,stop", "--out", text(&out)], 0);
    let report = |format: &str| ended(&["report", text(&out), "--format", format], 0).stdout;
    assert!(report("markdown") == run.stdout);
    assert!(report("json") == fs::read(out.join("summary.json")).unwrap());
    assert!(report("parquet").starts_with(b"PAR1"));
    let latex = String::from_utf8(report("latex")).unwrap();
    assert!(latex.contains("Log Replay$^\\dagger$ & ") && latex.contains("\\bottomrule"));
    let csv = String::from_utf8(report("csv")).unwrap();
    assert_eq!(
        csv.lines().next().unwrap(),
        "run,av,simulator,oracle,kind,category,difficulty,metric,mean,low,high,scenarios"
    );
    assert!(csv.contains("x_1,deviated,stop,false,difference,,,ade,"));
    // Two runs in one table are distinguished by their names.
    assert!(said(&["report", text(&out), text(&out)], 0).0.contains("| Run "));
}

#[test]
fn tables_have_difficulties_and_further_metrics_on_request() {
    let home = tempfile::tempdir().unwrap();
    let (input, out) = (home.path().join("scenarios.parquet"), home.path().join("x"));
    write(&input, (0..3).map(certified));
    let run = ["run", text(&input), "--models", "log-replay,stop", "--out", text(&out), "--keep-rollouts"];
    let (table, _) = said(&[&run[..], &["--also", "log-clinging,progress"]].concat(), 0);
    let at = |wanted: &str| table.find(wanted).unwrap_or_else(|| panic!("no `{wanted}` in {table}"));
    assert!(at("\nDirectional deviations (1 scenario):") < at("\nEasy conflicts (1 scenario):"));
    assert!(at("\nEasy conflicts") < at("\nMedium conflicts") && at("\nMedium") < at("\nHard conflicts"));
    let head = table.lines().next().unwrap();
    assert!(head.contains(" Way lost (m) ↓ ") && head.trim_end_matches([' ', '|']).ends_with("On log (%) ↓"));
    // Columns that the table has anyway are not repeated.
    assert_eq!(head.matches("Progress").count(), 1);
    assert_eq!(fs::read_to_string(out.join("summary.md")).unwrap(), table);
    assert!(fs::read_to_string(out.join("summary.json")).unwrap().contains("\"log-clinging\""));

    let report = |options: &[&str]| said(&[&["report", text(&out)], options].concat(), 0).0;
    assert!(!report(&[]).contains("On log"));
    assert_eq!(report(&["--also", "log-clinging"]), table);
    assert!(report(&["--format", "latex", "--also", "over-braking"]).contains("Over-br."));
    assert!(report(&["--format", "csv"]).contains("x,deviated,stop,false,mean,,hard,undisturbed-loss,"));
    let (_, unknown) = said(&["report", text(&out), "--also", "log-cling"], 2);
    assert!(unknown.contains("a similar value exists: 'log-clinging'"), "{unknown}");
    let (_, page) = said(&["report", text(&out), "--format", "html", "--also", "ade"], 2);
    assert!(page.contains("leave the options of tables out"), "{page}");

    let rollouts = out.join("rollouts.parquet");
    let also = ["--also", "log-clinging"];
    let (scored, _) =
        said(&[&["score", text(&rollouts), "--scenarios", text(&input)], &also[..]].concat(), 0);
    assert!(scored.contains("\nHard conflicts (1 scenario):") && scored.contains("On log (%)"), "{scored}");
}

#[test]
fn rollout_documents_are_scored() {
    let home = tempfile::tempdir().unwrap();
    let file = home.path().join("document.json");
    let document = document().to_string();
    fs::write(&file, &document).unwrap();
    let (result, _) = said(&["score", text(&file)], 0);
    let result: serde_json::Value = serde_json::from_str(&result).unwrap();
    assert_eq!(result["aggregate"]["a_av_collision_count"], 0.0);
    assert_eq!(result["aggregate"]["a_a_collision_rate"], 0.0);
    assert!(result["aggregate"]["offroad_rate"].is_null(), "no drivable area, nothing judged");
    fs::write(&file, document.replace("rollouts-v1", "rollouts-v9")).unwrap();
    let (_, error) = said(&["score", text(&file)], 2);
    assert!(error.contains("reactsim-rollouts-v9"), "{error}");
    let rows = home.path().join("rows.parquet");
    write(&rows, [scenario(0)]);
    assert!(said(&["score", text(&rows)], 2).1.contains("give --scenarios"));
}

/// A semi-trailer overlaps its tractor by 1.5 m all the time: 2 of 4 agents collide, unless such pairs are
/// left out.
#[test]
fn pairs_that_overlap_at_first_are_left_out_on_request() {
    let home = tempfile::tempdir().unwrap();
    let input = home.path().join("trailer.parquet");
    let mut parts = parts(0, false);
    let mut trailer = parts.agents[2].clone();
    trailer.agent.id = "trailer".to_owned();
    trailer.track.iter_mut().flatten().for_each(|state| state.x -= 3.0);
    parts.agents.push(trailer);
    write(&input, std::iter::once(Scenario::assemble(parts).unwrap()));
    let (told, _) = said(&["inspect", text(&input)], 0);
    assert!(told.contains("2 agents overlap another one at the current frame (towed"), "{told}");
    let collisions = |excluded: &str| {
        let out = home.path().join(excluded);
        let option = format!("exclude_initial_overlap={excluded}");
        let run = ["run", text(&input), "--av", "log", "--models", "log-replay", "--metric-option", &option];
        said(&[&run[..], &["--out", text(&out)]].concat(), 0);
        read_summary(&out).unwrap().simulators["log-replay"].metrics["aa-collision"].mean
    };
    assert_eq!((collisions("false"), collisions("true")), (Some(0.5), Some(0.0)));
}

/// One of three vehicles, the AV not counted, crosses a stop line on its lane under red.
#[test]
fn red_lights_are_in_tables_and_events_of_scenarios_with_lights() {
    let home = tempfile::tempdir().unwrap();
    let (input, out) = (home.path().join("light.parquet"), home.path().join("run"));
    let mut parts = parts(0, false);
    parts.lights.push(LightParts {
        lane: "right".to_owned(),
        stop_point: Vec2::new(20.0, 0.0),
        states: vec![Some(LightState::Stop); FRAMES],
    });
    write(&input, std::iter::once(Scenario::assemble(parts).unwrap()));
    let models = "--models=log-replay,stop";
    let also = "--also=red-light";
    let (table, _) = said(&["run", text(&input), "--av", "log", models, also, "--out", text(&out)], 0);
    assert!(table.lines().next().unwrap().contains(" Red light (%) ↓ "), "{table}");
    assert!(table.lines().nth(2).unwrap().contains(" 33.33 "), "{table}");
    let summary = read_summary(&out).unwrap();
    assert_eq!(summary.simulators["stop"].metrics["red-light"].mean, Some(0.0));
    let events = fs::read_to_string(out.join("events.jsonl")).unwrap();
    let events: Vec<&str> = events.lines().filter(|line| line.contains("\"red-light\"")).collect();
    assert!(
        events.len() == 1 && events[0].contains("\"behind\"") && events[0].contains("\"stop\""),
        "{events:?}"
    );
    assert!(said(&["report", text(&out), "--format", "csv", also], 0).0.contains("red-light"));
    // Without lights nothing is judged.
    let dark = home.path().join("dark.parquet");
    write(&dark, std::iter::once(scenario(0)));
    let (table, _) = said(&["run", text(&dark), "--av", "log", "--models", "log-replay", also], 0);
    assert!(table.lines().nth(2).unwrap().trim_end().ends_with("– |"), "{table}");
}
