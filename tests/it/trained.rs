//! From logs to a network that drives: training from the command line, its output, and its refusals.

use std::fs;
use std::path::Path;
use std::process::Output;

use reactsim::formats;
use reactsim::formats::rollouts;
use reactsim::scene::CURRENT;
use serde_json::Value;

use crate::program::reactsim;

const BENCH: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenarios/bench.parquet");

fn done(arguments: &[&str]) -> Output {
    let output = reactsim(arguments);
    assert_eq!(output.status.code(), Some(0), "{}", said(&output));
    output
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// Sizes of a network that learns in a moment.
const SMALL: &str = "agents = 12
[network]
hidden = 16
heads = 2
head_width = 8
relation = 16
feed_forward = 16
head_hidden = 16
map_layers = 1
agent_layers = 1
map_neighbours = 4
near_pieces = 4
ahead_pieces = 2
stops = 1
agents = 4
past = 2
agent_radius = 40.0
map_radius = 80.0
[augmentation]
mirror = 0.5
stretch = 0.1
shift = 4
window = 4
blind = 0.1
noise = { wrong = 0.2, among = 6, remains = 0.5 }
[smoothing]
uniform = 0.0
spatial = 0.1
";

#[test]
fn a_network_is_trained_and_drives() {
    let folder = tempfile::tempdir().unwrap();
    let few = folder.path().join("few");
    fs::create_dir(&few).unwrap();
    let native = few.join("few.parquet");
    let mut writer = formats::native::Writer::create(&native).unwrap();
    for scenario in formats::open(Path::new(BENCH)).unwrap().take(6) {
        writer.write(&scenario.unwrap()).unwrap();
    }
    writer.finish().unwrap();
    let recipe = folder.path().join("recipe.toml");
    fs::write(&recipe, SMALL).unwrap();

    let train = |out: &Path, more: &[&str]| {
        let base =
            ["train", "ntp", text(&few), "--recipe", text(&recipe), "--out", text(out), "--batch", "2"];
        let rest = ["--held-out", "0.3", "--validate-every", "2", "--closed-loop", text(&few)];
        let most = ["--most-closed-loop", "2"];
        reactsim(&[&base[..], &rest[..], &most[..], more].concat())
    };
    let (one, two) = (folder.path().join("one"), folder.path().join("two"));
    let output = train(&one, &["--epochs", "2", "--jobs", "1"]);
    assert_eq!(output.status.code(), Some(0), "{}", said(&output));
    let output = train(&two, &["--epochs", "2", "--jobs", "2"]);
    assert_eq!(output.status.code(), Some(0), "{}", said(&output));

    // The same numbers on any number of threads, closed loop included.
    let rows = |out: &Path| {
        let log = fs::read_to_string(out.join("log.jsonl")).unwrap();
        let mut rows: Vec<Value> = log.lines().map(|l| serde_json::from_str(l).unwrap()).collect();
        rows.iter_mut().for_each(|r| drop(r.as_object_mut().unwrap().remove("wall")));
        rows
    };
    assert_eq!(rows(&one), rows(&two));
    assert_eq!(
        fs::read(one.join("weights.safetensors")).unwrap(),
        fs::read(two.join("weights.safetensors")).unwrap()
    );
    let in_closed_loop =
        |id: &str| rows(&one).into_iter().filter_map(|r| r["closed_loop"][id].as_f64()).collect::<Vec<_>>();
    assert!(!in_closed_loop("aav-ttc").is_empty(), "what the network does in closed loop is logged");
    let (mean, least) = (in_closed_loop("ade"), in_closed_loop("min-ade"));
    assert_eq!(mean.len(), least.len());
    assert!(least.iter().zip(&mean).all(|(least, mean)| least <= mean), "{least:?} {mean:?}");

    let weights = format!("ntp-reactive={}", text(&one.join("weights.safetensors")));
    let output =
        done(&["run", text(&few), "--models", "ntp-reactive", "--model-weights", &weights, "--limit", "2"]);
    assert!(String::from_utf8_lossy(&output.stdout).contains("| NTP-reactive "));

    let other = train(&one, &["--epochs", "3", "--resume"]);
    assert!(said(&other).contains("epochs"), "another training is not this one: {}", said(&other));
}

#[test]
fn a_motion_predictor_is_trained_and_drives() {
    let folder = tempfile::tempdir().unwrap();
    let few = folder.path().join("few");
    fs::create_dir(&few).unwrap();
    let mut writer = formats::native::Writer::create(few.join("few.parquet")).unwrap();
    for scenario in formats::open(Path::new(BENCH)).unwrap().take(6) {
        writer.write(&scenario.unwrap()).unwrap();
    }
    writer.finish().unwrap();
    let points = folder.path().join("points.safetensors");
    let made = done(&["train", "intentions", BENCH, "--points", "4", "--out", text(&points)]);
    let made: toml::Table = toml::from_str(&String::from_utf8_lossy(&made.stdout)).unwrap();
    assert_eq!(made["class"][0]["points"].as_array().unwrap().len(), 4);
    let again = folder.path().join("again.safetensors");
    done(&["train", "intentions", BENCH, "--points", "4", "--out", text(&again)]);
    assert_eq!(fs::read(&points).unwrap(), fs::read(&again).unwrap());

    let recipe = folder.path().join("recipe.toml");
    fs::write(&recipe, crate::regression::small_recipe()).unwrap();
    let train = |out: &Path, jobs: &str| {
        let base = ["train", "qp-regression", text(&few), "--recipe", text(&recipe), "--out", text(out)];
        let more =
            ["--intentions", text(&points), "--batch", "2", "--epochs", "45", "--learning-rate", "3e-3"];
        let held =
            ["--held-out", "0.3", "--validate-every", "30", "--closed-loop", text(&few), "--jobs", jobs];
        done(&[&base[..], &more[..], &held[..], &["--most-closed-loop", "1"]].concat())
    };
    let (one, two) = (folder.path().join("one"), folder.path().join("two"));
    train(&one, "1");
    train(&two, "2");
    let file = |out: &Path| fs::read(out.join("weights.safetensors")).unwrap();
    assert!(file(&one) == file(&two), "weights hang on the number of threads");
    let log = fs::read_to_string(one.join("log.jsonl")).unwrap();
    let rows: Vec<Value> = log.lines().map(|l| serde_json::from_str(l).unwrap()).collect();
    let losses: Vec<f64> =
        rows.iter().filter(|r| r["row"] == "step").filter_map(|r| r["loss"].as_f64()).collect();
    let mean = |part: &[f64]| part.iter().sum::<f64>() / part.len() as f64;
    let (first, last) = (mean(&losses[..10]), mean(&losses[losses.len() - 10..]));
    assert!(last < 0.9 * first, "{first} became {last}");
    let checked = rows.iter().find(|r| r["row"] == "validation").unwrap();
    for name in ["min_ade", "min_ade_vehicle", "miss_rate", "surprise"] {
        assert!(checked["metrics"][name].is_number(), "{name} is not in {checked}");
    }
    assert!(checked["closed_loop"]["aav-collision"].is_number());

    let weights = format!("regression={}", text(&one.join("weights.safetensors")));
    let output =
        done(&["run", text(&few), "--models", "regression", "--model-weights", &weights, "--limit", "1"]);
    assert!(String::from_utf8_lossy(&output.stdout).contains("| Regression "));

    // Its predictions, without driving; and a training that continues from it.
    let first = text(&one.join("weights.safetensors")).to_owned();
    let judged = done(&["train", "open-loop", text(&few), "--weights", &first]);
    let judged = String::from_utf8_lossy(&judged.stdout).into_owned();
    assert!(judged.contains("| all | ") && judged.contains("| vehicle | "), "{judged}");
    assert!(judged.contains("6 scenarios, best of six modes"), "{judged}");
    let ade = |table: &str| -> f64 {
        let row = table.lines().find(|l| l.starts_with("| all ")).unwrap();
        row.split('|').nth(3).unwrap().trim().parse().unwrap()
    };
    let more = folder.path().join("more");
    let base = ["train", "qp-regression", text(&few), "--recipe", text(&recipe), "--out", text(&more)];
    done(
        &[&base[..], &["--from", &first, "--epochs", "1", "--batch", "2", "--learning-rate", "1e-6"]]
            .concat(),
    );
    let after =
        done(&["train", "open-loop", text(&few), "--weights", text(&more.join("weights.safetensors"))]);
    let after = String::from_utf8_lossy(&after.stdout).into_owned();
    assert!((ade(&after) - ade(&judged)).abs() < 0.01, "{judged}{after}");

    let refused = |arguments: &[&str]| {
        let no = folder.path().join("no");
        let base = ["train", "qp-regression", text(&few), "--out", text(&no)];
        let output = reactsim(&[&base[..], arguments].concat());
        assert_eq!(output.status.code(), Some(2), "{}", said(&output));
        said(&output)
    };
    assert!(refused(&["--intentions", text(&recipe)]).contains("not safetensors"));
    assert!(refused(&["--from", text(&recipe)]).contains("cannot use the weights"));
    assert!(refused(&["--from", &first]).contains("other sizes than the recipe"));
    assert!(refused(&["--from", &first, "--intentions", text(&points)]).contains("--intentions"));
    let wrong = folder.path().join("wrong.toml");
    fs::write(&wrong, crate::regression::small_recipe().replace("step = 5", "step = 7")).unwrap();
    assert!(refused(&["--recipe", text(&wrong)]).contains("step = 7"));
}

#[test]
fn what_can_not_be_learnt_from_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let empty = folder.path().join("empty");
    fs::create_dir(&empty).unwrap();
    let refused = |arguments: &[&str]| {
        let output = reactsim(&[&["train", "ntp"], arguments, &["--out", text(&out)]].concat());
        assert_eq!(output.status.code(), Some(2), "{}", said(&output));
        said(&output)
    };
    assert!(refused(&[text(&empty)]).contains("empty"));
    let recipe = folder.path().join("recipe.toml");
    fs::write(&recipe, SMALL.replace("heads = 2", "heads = 0")).unwrap();
    assert!(refused(&[BENCH, "--recipe", text(&recipe)]).contains("heads = 0"));
    fs::write(&recipe, SMALL.replace("past = 2", "pest = 2")).unwrap();
    assert!(refused(&[BENCH, "--recipe", text(&recipe)]).contains("pest"));
    assert!(refused(&[BENCH, "--vocabulary", text(&recipe)]).contains("vocabulary"));
}

#[test]
fn rollouts_become_futures() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    let base = ["run", BENCH, "--limit", "3", "--models", "log-replay,stop"];
    done(&[&base[..], &["--keep-rollouts", "--out", text(&run)]].concat());
    let file = run.join("rollouts.parquet");
    let out = folder.path().join("stopped.parquet");
    let convert = ["convert", BENCH, "--futures", text(&file), "--out", text(&out)];
    done(&[&convert[..], &["--model", "stop"]].concat());
    let stopped: Vec<_> = formats::open(&out).unwrap().map(Result::unwrap).collect();
    let logged: Vec<_> = formats::open(Path::new(BENCH)).unwrap().take(3).map(Result::unwrap).collect();
    assert_eq!(stopped.len(), 3);
    let records: Vec<_> = rollouts::read(&file).unwrap().map(Result::unwrap).collect();
    for (new, old) in stopped.iter().zip(&logged) {
        assert_eq!(new.id, format!("{}+stop", old.id));
        assert_eq!(new.start.history, old.start.history);
        let record = records.iter().find(|r| r.simulator == "stop" && r.scenario_id == old.id).unwrap();
        let tracks = record.tracks_in(old.origin);
        for (slot, agent) in old.start.agents.iter().enumerate() {
            let at = record.agent_ids.iter().position(|id| *id == agent.id).unwrap();
            let wanted = tracks[at].last().unwrap().map(|s| (s.x, s.y));
            let found = new.logged_at(slot, CURRENT + 80).map(|s| (s.x, s.y));
            assert_eq!(found, wanted, "{}", agent.id);
        }
        assert!(new.deviation.is_none());
    }
    let output = reactsim(&[&convert[..], &["--model", "idm"]].concat());
    assert!(said(&output).contains("no rollouts of `idm`"), "{}", said(&output));
}
