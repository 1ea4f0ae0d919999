//! Metrics of the user reach everything that the metrics of the benchmark reach, from Rust and from a file.

use std::fs;
use std::path::Path;

use reactsim::evaluation::{Estimate, read_rows, read_summary, read_tally};
use reactsim::metrics::{Case, Event, Metric, MetricSpec, Scope, Score, Unit};
use reactsim::{Benchmark, BenchmarkError};
use serde_json::{Value, json};

use crate::chromium::{Browser, chromium};
use crate::program::{json_of, lines_of, refused, said, text};
use crate::small_scenarios::{certified, write};

/// Number of agents that are simulated, plus `more`: 3 in every scenario.
struct Agents {
    id: &'static str,
    more: f64,
}

impl Metric for Agents {
    fn spec(&self) -> &'static MetricSpec {
        let (unit, scope) = (Unit::Other("veh"), Scope::Rollout);
        let source = "tests/it/own_metrics.rs";
        let spec = MetricSpec { id: self.id, title: "Vehicles", unit, scope, lower_is_better: false, source };
        Box::leak(Box::new(spec))
    }

    fn score(&self, case: &Case<'_>, events: &mut Vec<Event>) -> Option<Score> {
        events.push(Event {
            metric: "overwritten",
            step: 2,
            last_step: 5,
            agent: case.id(1),
            partner: None,
            reason: Some("counted"),
            counted: true,
            values: vec![("speed", 1.5)],
        });
        Some(Score::Value(case.agents().count() as f64 + self.more))
    }
}

const OWN: Agents = Agents { id: "agents", more: 0.0 };

fn benchmark() -> Benchmark {
    Benchmark::scenarios((0..6).map(certified)).baselines(["stop", "idm"]).rollouts(2).keep_rollouts()
}

fn own(folder: &Path) {
    benchmark().metric(Box::new(OWN)).folder(folder).run().unwrap();
}

#[test]
fn a_metric_of_the_user_is_in_every_result() {
    let home = tempfile::tempdir().unwrap();
    let run = home.path().join("run");
    own(&run);
    for row in read_rows(&run).unwrap() {
        let expected = row.rollout.map(|_| Some(Score::Value(3.0)));
        assert_eq!(row.metrics.get("agents").copied(), expected, "{row:?}");
    }
    let summary = read_summary(&run).unwrap();
    let all = Estimate { mean: Some(3.0), low: Some(3.0), high: Some(3.0), scenarios: 6 };
    let idm = &summary.simulators["idm"];
    assert_eq!(idm.metrics["agents"], all);
    assert!(idm.by_category.values().all(|part| part.metrics["agents"].mean == Some(3.0)));
    let events = lines_of(&run.join("events.jsonl"));
    let events: Vec<&Value> = events.iter().filter(|event| event["metric"] == "agents").collect();
    assert_eq!(events.len(), 6 * 2 * 2);
    assert_eq!((&events[0]["step"], &events[0]["agent"]), (&json!(2), &json!("beside")));
    assert!(events.iter().all(|event| event["values"] == json!({ "speed": 1.5 })));
    let record = &json_of(&run.join("provenance.json"))["own_metrics"][0];
    let titled = json!({ "id": "agents", "title": "Vehicles", "unit": "veh", "scope": "rollout",
                         "lower_is_better": false, "source": "tests/it/own_metrics.rs" });
    assert_eq!(*record, titled);

    // The program, which does not compute the metric, shows it.
    let report = |format: &str| said(&["report", text(&run), "--format", format], 0).0;
    assert!(report("markdown").contains("| Vehicles (veh) ↑ |"), "{}", report("markdown"));
    assert!(report("markdown").contains(" 3.000"));
    assert!(report("latex").contains("Vehicles $\\uparrow$ (veh)"));
    assert!(report("csv").contains("idm,false,mean,,,agents,3,3,3,6"), "{}", report("csv"));
    let compared = said(&["compare", text(&run), text(&run), "--worse", "agents=0"], 0).0;
    assert!(compared.contains("Vehicles (veh) ↑"), "{compared}");
    let unknown = refused(&["compare", text(&run), text(&run), "--worse", "agent=0"]);
    assert!(unknown.contains("there is no metric `agent`") && unknown.contains("`agents`"), "{unknown}");
    let page = said(&["report", text(&run), "--format", "html"], 0).0;
    assert!(page.contains(r#""id":"agents","title":"Vehicles","unit":"veh","lower_is_better":false"#));
    assert!(page.contains(r#""source":"tests/it/own_metrics.rs","own":true"#));
    assert_eq!(read_tally(&run).unwrap().metrics.last().unwrap().title, "Vehicles");
}

#[test]
fn the_page_shows_values_and_events() {
    let Some(chromium) = chromium() else { return crate::skipped("no Chromium on this machine") };
    let home = tempfile::tempdir().unwrap();
    let (file, run, page) =
        (home.path().join("mine.parquet"), home.path().join("run"), home.path().join("page.html"));
    write(&file, (0..6).map(certified));
    let benchmark = Benchmark::files([&file]).baselines(["stop", "idm"]).keep_rollouts();
    benchmark.metric(Box::new(OWN)).folder(&run).run().unwrap();
    let scenarios = ["--scenarios", text(&file), "--all", "--out", text(&page)];
    said(&[&["report", text(&run), "--format", "html"], &scenarios[..]].concat(), 0);
    let mut browser = Browser::new(&chromium);
    browser.open(&format!("file://{}#scenario=road-000&t=0.5&left=stop&right=idm", page.display()));
    browser.until("document.body?.dataset.ready === 'yes'");
    browser.until("!document.getElementById('stage').hidden");
    let mut texts = |selector: &str| {
        let all = format!("[...document.querySelectorAll('{selector}')].map(e => e.textContent).join('; ')");
        browser.evaluate(&all).as_str().unwrap().to_owned()
    };
    assert!(texts("#main-table th").contains("(veh) ↑"), "{}", texts("#main-table th"));
    assert!(texts("#main-table td[data-metric=agents]").starts_with("3.000"));
    assert!(texts("#events-table th").contains("Vehicles"));
    assert!(
        texts("#events li").contains("left: Vehicles: beside, counted (speed 1.5 m/s)"),
        "{}",
        texts("#events li")
    );
    assert!(texts("td[data-whole=agents]").contains("3.000"));
    assert!(texts("#legend li").contains("event of another metric"));
    assert_eq!(browser.errors, Vec::<String>::new());
}

#[test]
fn runs_without_such_metrics_are_as_before() {
    let home = tempfile::tempdir().unwrap();
    let (plain, with) = (home.path().join("plain"), home.path().join("with"));
    benchmark().folder(&plain).run().unwrap();
    own(&with);
    let at = |run: &Path, name: &str| fs::read_to_string(run.join(name)).unwrap();
    for name in ["provenance.json", "rows.jsonl", "events.jsonl", "summary.json"] {
        assert!(
            !at(&plain, name).contains("own_metrics") && !at(&plain, name).contains("\"agents\""),
            "{name}"
        );
    }
    let without = at(&with, "rows.jsonl").replace(r#""agents":{"value":3.0},"#, "");
    assert_eq!(without, at(&plain, "rows.jsonl"));
    let lines = at(&with, "events.jsonl");
    let kept = lines.lines().filter(|line| !line.contains(r#""metric":"agents""#));
    assert_eq!(kept.map(|line| format!("{line}\n")).collect::<String>(), at(&plain, "events.jsonl"));
}

#[test]
fn unfit_metrics_are_refused() {
    let taken = benchmark().metric(Box::new(Agents { id: "ade", more: 0.0 })).run().unwrap_err();
    assert!(matches!(taken, BenchmarkError::Metric(_)), "{taken:?}");
    assert!(taken.to_string().starts_with("metric `ade`: the id is taken"), "{taken}");

    let infinite = benchmark().metric(Box::new(Agents { id: "agents", more: f64::INFINITY })).run();
    let Err(BenchmarkError::NothingRun(reason)) = infinite else { panic!("{infinite:?}") };
    assert!(reason.contains("scenario `road-000`: metric `agents` is inf, expected a finite"), "{reason}");
}

#[test]
fn metrics_from_a_file_are_as_those_of_a_run() {
    let home = tempfile::tempdir().unwrap();
    let (with, added) = (home.path().join("with"), home.path().join("added"));
    own(&with);
    benchmark().folder(&added).run().unwrap();
    let events = lines_of(&with.join("events.jsonl"));
    let rollouts = lines_of(&with.join("rows.jsonl")).into_iter().filter(|row| !row["rollout"].is_null());
    let rollouts = rollouts.map(|row| {
        let is_own = |event: &&Value| {
            event["metric"] == "agents"
                && ["scenario", "simulator", "rollout"].iter().all(|key| event[*key] == row[*key])
        };
        let own: Vec<&Value> = events.iter().filter(is_own).collect();
        json!({ "scenario": row["scenario"], "simulator": row["simulator"], "rollout": row["rollout"],
                "values": { "agents": 3.0 }, "events": own })
    });
    let metrics = json_of(&with.join("provenance.json"))["own_metrics"].clone();
    let document = json!({ "metrics": metrics, "rollouts": rollouts.collect::<Vec<_>>() });
    let file = home.path().join("metrics.json");
    let add = ["score", text(&added), "--add-metrics", text(&file)];

    let refused_as = |change: &dyn Fn(&mut Value), part: &str| {
        let (mut changed, before) = (document.clone(), fs::read(added.join("rows.jsonl")).unwrap());
        change(&mut changed);
        fs::write(&file, changed.to_string()).unwrap();
        let error = refused(&add);
        assert!(error.contains(part), "{error}");
        assert_eq!(fs::read(added.join("rows.jsonl")).unwrap(), before);
    };
    refused_as(&|d| d["metrics"][0]["id"] = json!("ade"), "metric `ade`: the id is taken");
    refused_as(&|d| d["rollouts"][0]["values"] = json!({}), "metric `agents` has no entry");
    refused_as(&|d| drop(d["rollouts"].as_array_mut().unwrap().pop()), "no values are given");
    refused_as(&|d| d["rollouts"][0]["rollout"] = json!(7), "no values are given");
    refused_as(&|d| d["rollouts"][0]["events"][0]["last_step"] = json!(81), "steps from 1 to 80");
    fs::write(&file, document.to_string().replace("3.0", "1e999")).unwrap();
    assert!(refused(&add).contains("number out of range"));

    // A second time, they replace those of the first time.
    for _ in 0..2 {
        fs::write(&file, document.to_string()).unwrap();
        assert!(said(&add, 0).0.contains("Vehicles (veh) ↑"));
        for name in ["provenance.json", "rows.jsonl", "events.jsonl", "summary.json", "values.parquet"] {
            let [found, expected] = [&added, &with].map(|run| fs::read(run.join(name)).unwrap());
            assert!(found == expected, "{name}");
        }
    }
    assert!(fs::read_to_string(added.join("summary.md")).unwrap().contains("Vehicles (veh) ↑"));
}
