//! From logs to a network that drives: training from the command line, its output, and its refusals.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use reactsim::formats;
use reactsim::formats::rollouts;
use reactsim::models::TASKS;
use reactsim::models::nn::Tensors;
use reactsim::scene::CURRENT;

use crate::program::{BENCH, MINI, json_of, log_rows, said, text, words};
use crate::small_scenarios::{scenario, write};

/// Returns what a command prints; it must succeed.
#[track_caller]
fn done(arguments: &[&str]) -> String {
    said(arguments, 0).0
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
[learning]
batch = 2
held_out = 0.3
validate_every = 2
";

/// Writes a folder with six scenarios to learn from, and a file with two others to drive in.
fn few(folder: &Path) -> (PathBuf, PathBuf) {
    let (few, driven) = (folder.join("few"), folder.join("driven.parquet"));
    fs::create_dir(&few).unwrap();
    write(&few.join("few.parquet"), (0..6).map(scenario));
    write(&driven, (6..8).map(scenario));
    (few, driven)
}

#[test]
fn a_network_is_trained_and_drives() {
    let folder = tempfile::tempdir().unwrap();
    let (few, driven) = few(folder.path());
    let recipe = folder.path().join("recipe.toml");
    fs::write(&recipe, SMALL).unwrap();

    let train = |out: &Path, more: &[&str], code| {
        let base = ["train", "ntp-reactive", text(&few), "--recipe", text(&recipe), "--out", text(out)];
        let rest = ["--closed-loop", text(&driven), "--most-closed-loop", "2"];
        said(&[&base[..], &rest, more].concat(), code).1
    };
    let (one, two) = (folder.path().join("one"), folder.path().join("two"));
    train(&one, &["--set", "learning.epochs=2", "--jobs", "1"], 0);
    train(&two, &["--set", "learning.epochs=2", "--jobs", "2"], 0);

    // The same numbers on any number of threads, closed loop included.
    assert_eq!(log_rows(&one), log_rows(&two));
    assert_eq!(
        fs::read(one.join("weights.safetensors")).unwrap(),
        fs::read(two.join("weights.safetensors")).unwrap()
    );
    let in_closed_loop = |id: &str| {
        log_rows(&one).into_iter().filter_map(|r| r["closed_loop"][id].as_f64()).collect::<Vec<_>>()
    };
    assert!(!in_closed_loop("aav-ttc").is_empty(), "what the network does in closed loop is logged");
    let (mean, least) = (in_closed_loop("ade"), in_closed_loop("min-ade"));
    assert_eq!(mean.len(), least.len());
    assert!(least.iter().zip(&mean).all(|(least, mean)| least <= mean), "{least:?} {mean:?}");

    let weights = format!("ntp-reactive={}", text(&one.join("weights.safetensors")));
    let run = ["run", text(&few), "--models", "ntp-reactive", "--model-weights", &weights, "--limit", "2"];
    assert!(done(&run).contains("| NTP-reactive "));

    let other = train(&one, &["--set", "learning.epochs=3", "--resume"], 2);
    assert!(other.contains("epochs"), "another training is not this one: {other}");
}

#[test]
fn a_motion_predictor_is_trained_and_drives() {
    let folder = tempfile::tempdir().unwrap();
    let (few, driven) = few(folder.path());
    let points = folder.path().join("points.safetensors");
    let made = done(&["train", "intentions", BENCH, "--points", "4", "--out", text(&points)]);
    let made: toml::Table = toml::from_str(&made).unwrap();
    assert_eq!(made["class"][0]["points"].as_array().unwrap().len(), 4);
    let again = folder.path().join("again.safetensors");
    done(&["train", "intentions", BENCH, "--points", "4", "--out", text(&again)]);
    assert_eq!(fs::read(&points).unwrap(), fs::read(&again).unwrap());

    let recipe = folder.path().join("recipe.toml");
    let learning =
        "[learning]\nbatch = 2\nepochs = 45.0\nlearning_rate = 3e-3\nheld_out = 0.3\nvalidate_every = 30\n";
    fs::write(&recipe, crate::qp_regression::small_recipe() + learning).unwrap();
    let train = |out: &Path, jobs: &str| {
        let base = ["train", "qp-regression", text(&few), "--recipe", text(&recipe), "--out", text(out)];
        let points = format!("intentions={}", text(&points));
        let more = ["--input", &points, "--closed-loop", text(&driven), "--jobs", jobs];
        done(&[&base[..], &more[..], &["--most-closed-loop", "1"]].concat())
    };
    let (one, two) = (folder.path().join("one"), folder.path().join("two"));
    train(&one, "1");
    train(&two, "2");
    let file = |out: &Path| fs::read(out.join("weights.safetensors")).unwrap();
    assert!(file(&one) == file(&two), "weights hang on the number of threads");
    let rows = log_rows(&one);
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
    let run = ["run", text(&few), "--models", "regression", "--model-weights", &weights, "--limit", "1"];
    assert!(done(&run).contains("| Regression "));

    // Its predictions, without driving; and a training that continues from it.
    let first = text(&one.join("weights.safetensors")).to_owned();
    let judged = done(&["train", "open-loop", text(&few), "--weights", &first]);
    assert!(judged.contains("| all | ") && judged.contains("| vehicle | "), "{judged}");
    assert!(judged.contains("6 scenarios, best of six modes"), "{judged}");
    let ade = |table: &str| -> f64 {
        let row = table.lines().find(|l| l.starts_with("| all ")).unwrap();
        row.split('|').nth(3).unwrap().trim().parse().unwrap()
    };
    let more = folder.path().join("more");
    let slow = ["--from", &first, "--set", "learning.epochs=1", "--set", "learning.learning_rate=1e-6"];
    let base = ["train", "qp-regression", text(&few), "--recipe", text(&recipe), "--out"];
    done(&[&base[..], &[text(&more)], &slow].concat());
    let after = text(&more.join("weights.safetensors")).to_owned();
    let after = done(&["train", "open-loop", text(&few), "--weights", &after]);
    assert!((ade(&after) - ade(&judged)).abs() < 0.01, "{judged}{after}");

    // The numbers of lines and agents have no weights, and of two decoder layers the first one is kept.
    let fewer = folder.path().join("fewer");
    let sizes =
        ["--set", "network.decoder_layers=1", "--set", "network.lines=9", "--set", "network.agents=5"];
    done(&[&base[..], &[text(&fewer)], &sizes, &slow].concat());
    let (parent, kept) = (file(&one), file(&fewer));
    let (parent, kept) = (Tensors::read(&parent).unwrap(), Tensors::read(&kept).unwrap());
    assert!(parent.shapes().any(|(name, _)| name.contains("decoder_layers.1.")));
    assert!(!kept.shapes().any(|(name, _)| name.contains("decoder_layers.1.")));
    for (name, _) in kept.shapes() {
        let pairs = parent.floats(name).unwrap().1.into_iter().zip(kept.floats(name).unwrap().1);
        assert!(pairs.into_iter().all(|(a, b)| (a - b).abs() < 1e-3), "{name} is not the parent's");
    }

    let refused = |arguments: &[&str]| {
        let no = folder.path().join("no");
        let base = ["train", "qp-regression", text(&few), "--out", text(&no)];
        said(&[&base[..], arguments].concat(), 2).1
    };
    let input = |path: &Path| format!("intentions={}", text(path));
    assert!(refused(&["--input", &input(&recipe)]).contains("not safetensors"));
    assert!(refused(&["--from", text(&recipe)]).contains("cannot use the weights"));
    assert!(refused(&["--from", &first]).contains("other sizes than the recipe"));
    let deeper = ["--recipe", text(&recipe), "--from", &first, "--set", "network.decoder_layers=3"];
    assert!(refused(&deeper).contains("other sizes than the recipe"));
    let sizes = ["--recipe", text(&recipe), "--from", &first];
    let fan = folder.path().join("fan.safetensors");
    done(&["train", "intentions", BENCH, "--points", "3", "--out", text(&fan)]);
    let other = refused(&[&sizes[..], &["--input", &input(&fan)]].concat());
    assert!(other.contains("the weights to start from have another one"), "{other}");
    let wrong = folder.path().join("wrong.toml");
    fs::write(&wrong, "[network]\nstep = 7").unwrap();
    assert!(refused(&["--recipe", text(&wrong)]).contains("step = 7"));
}

#[test]
fn what_can_not_be_learnt_from_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let refused = |arguments: &[&str]| {
        said(&[&["train", "ntp-reactive"], arguments, &["--out", text(&out)]].concat(), 2).1
    };
    let recipe = folder.path().join("recipe.toml");
    let (few, driven) = few(folder.path());
    let few = text(&few);
    for (text, part) in [
        ("[network]\nheads = 0", "`network.heads` is 0, expected 1 to 4096"),
        (
            "[network]\npest = 2",
            "`ntp-reactive` has no parameter `network.pest`; did you mean `network.past`?",
        ),
        ("[nonsense]\nluck = 2", "`ntp-reactive` has no parameter `nonsense.luck`; it has: agents, "),
        ("[learning]\nepochs = \"many\"", "not a valid `learning.epochs`"),
        ("[learning]\nbest_by = \"luck\"", "`learning.best_by` is \"luck\", expected loss or"),
        ("agents", "is not a recipe"),
    ] {
        fs::write(&recipe, text).unwrap();
        let said = refused(&[few, "--recipe", recipe.to_str().unwrap()]);
        assert!(said.contains(part), "{said}");
    }
    let input = format!("vocabulary={}", text(&recipe));
    for (arguments, part) in [
        (&[few, "--recipe", "quik"][..], "has quick; did you mean `quick`?"),
        (&[few, "--set", "learning.batch"], "write KEY=VALUE"),
        (&[few, "--input", "vocabulary"], "write NAME=FILE"),
        (&[few, "--input", "vocabluary=x"], "takes vocabulary; did you mean `vocabulary`?"),
        (&[few, "--input", &input], "cannot use the vocabulary"),
        (&[few, "--from", text(&recipe)], "cannot use the weights"),
        (&[few, "--set", "learning.best_by=ade"], "there is no closed-loop evaluation"),
        (&[], "scenarios to learn from"),
    ] {
        let error = refused(arguments);
        assert!(error.contains(part), "{arguments:?}: {error}");
    }

    // What networks are judged by is not learned from.
    assert!(refused(&[BENCH]).contains("this is the benchmark reactsim-bench v2"));
    let part = folder.path().join("part.parquet");
    write(&part, formats::open(Path::new(BENCH)).unwrap().take(1).map(Result::unwrap));
    let error = refused(&[few, text(&part)]);
    assert!(error.contains("is of the benchmark reactsim-bench v2"), "{error}");
    assert!(refused(&[text(&part), "--exclude", BENCH]).contains("no scenario to learn from"));
    let both = refused(&[few, text(&driven), "--closed-loop", text(&driven)]);
    assert!(both.contains("is both learned from and driven in"), "{both}");
    let misspelt = ["train", "ntp-reactve", few, "--out", text(&out)];
    assert!(said(&misspelt, 2).1.contains("did you mean `ntp-reactive`?"));
}

/// Every recipe is complete, within its ranges, and reads back as it was printed.
#[test]
fn recipes_are_printed_and_read_back() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("recipe.toml");
    for task in TASKS {
        let recipe = task.recipe().unwrap();
        let described: Vec<String> = recipe.ranges().unwrap().into_iter().map(|(key, ..)| key).collect();
        assert!(described.len() > 20, "{}", task.id);
        for (_, _, range) in recipe.ranges().unwrap() {
            assert!(range.about.ends_with('.') && !range.unit.is_empty(), "{}: {}", task.id, range.about);
        }
        let names = task.recipes.iter().map(|r| Some(r.name)).chain([None]);
        for name in names {
            let chosen: Vec<&str> = name.into_iter().flat_map(|name| ["--recipe", name]).collect();
            let printed = done(&[&["train", task.id, "--print-recipe"], &chosen[..]].concat());
            fs::write(&file, &printed).unwrap();
            let again = done(&["train", task.id, "--print-recipe", "--recipe", text(&file)]);
            assert_eq!(printed, again);
        }
    }
    let quick = done(&["train", "ntp-reactive", "--print-recipe", "--recipe", "quick", "--set", "agents=7"]);
    assert!(
        quick.contains("# Largest distance of an agent attended to. 0.1 to 9999 m.\nagent_radius = 60.0")
    );
    assert!(quick.contains("\nhidden = 32\n") && quick.contains("\nagents = 7\n"), "{quick}");
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
    let (_, error) = said(&[&convert[..], &["--model", "idm"]].concat(), 2);
    assert!(error.contains("no rollouts of `idm`"), "{error}");
}

#[test]
fn certificates_become_futures() {
    let folder = tempfile::tempdir().unwrap();
    let (deviations, out) =
        (folder.path().join("deviations.parquet"), folder.path().join("certified.parquet"));
    done(&["curate", MINI, "--min-vehicles", "1", "--out", text(&deviations)]);
    done(&["convert", MINI, "--certificates", text(&deviations), "--out", text(&out)]);
    let records = reactsim::formats::deviations::read(&deviations).unwrap();
    let logged: Vec<_> = formats::open(Path::new(MINI)).unwrap().map(Result::unwrap).collect();
    let certified: Vec<_> = formats::open(&out).unwrap().map(Result::unwrap).collect();
    assert_eq!(certified.len(), records.values().filter(|r| r.certificate.is_some()).count());
    let mut responses = 0;
    for new in &certified {
        let id = new.id.strip_suffix("+certificate").unwrap();
        let old = logged.iter().find(|s| s.id == id).unwrap();
        let certificate = records[id].certificate_in(old.origin).unwrap();
        let av = records[id].track_in(old.origin);
        for (slot, agent) in old.start.agents.iter().enumerate() {
            let response = certificate.responses.iter().find(|r| r.agent == agent.id);
            responses += usize::from(response.is_some());
            for step in [1, 40, 80] {
                let wanted = match response {
                    _ if slot == 0 => Some(av[step - 1]),
                    Some(response) => Some(response.track[step]),
                    None => old.logged_at(slot, CURRENT + step),
                };
                let found = new.logged_at(slot, CURRENT + step);
                let near = |a: f64, b: f64| (a - b).abs() < 1e-6;
                let same = match (found, wanted) {
                    (Some(a), Some(b)) => near(a.x, b.x) && near(a.y, b.y),
                    (a, b) => a.is_none() && b.is_none(),
                };
                assert!(same, "{id}: {} at step {step}: {found:?}, not {wanted:?}", agent.id);
            }
        }
    }
    assert!(responses > 0);
    let (_, error) = said(&["convert", BENCH, "--certificates", text(&deviations), "--out", text(&out)], 2);
    assert!(error.contains("no scenario"), "{error}");
}

/// Parts depend on the content of scenarios alone, hold every scenario once, and can be learned from.
#[test]
fn scenarios_are_split_by_content() {
    let folder = tempfile::tempdir().unwrap();
    let (all, more) = (folder.path().join("all.parquet"), folder.path().join("more.parquet"));
    write(&all, (0..12).map(scenario));
    write(&more, (0..20).map(scenario));
    let split = |input: &Path, out: &str, seed: &str| {
        let out = folder.path().join(out);
        let parts = ["--part", "train=0.6", "--part", "val=0.4", "--seed", seed];
        let said = done(&[&["train", "split", text(input), "--out", text(&out)], &parts[..]].concat());
        let ids = |name: &str| -> Vec<String> {
            formats::open(&out.join(name)).unwrap().map(|scenario| scenario.unwrap().id).collect()
        };
        let (train, val) = (ids("train.parquet"), ids("val.parquet"));
        assert!(said.contains(&format!("train.parquet: {} scenarios", train.len())), "{said}");
        (train, val)
    };
    let (train, val) = split(&all, "one", "0");
    assert_eq!(train.len() + val.len(), 12);
    let (train_of_more, val_of_more) = split(&more, "two", "0");
    assert!(
        train.iter().all(|id| train_of_more.contains(id)) && val.iter().all(|id| val_of_more.contains(id))
    );
    assert_ne!(split(&all, "three", "1"), (train, val));

    let refused = |parts: &[&str]| {
        let out = folder.path().join("no");
        let error = said(&[&["train", "split", text(&all), "--out", text(&out)], parts].concat(), 2).1;
        assert!(fs::read_dir(&out).is_ok_and(|mut files| files.next().is_none()) || !out.exists());
        error
    };
    for (parts, part) in [
        ("--part a=0.5", "at least two parts"),
        ("--part a=0.5 --part a=0.5", "two values for `a`"),
        ("--part a=0.5 --part b=0.6", "add up to 1.1"),
        ("--part a=1 --part b=0.6", "write NAME=SHARE"),
        ("--part ../a=0.5 --part b=0.5", "is not a name"),
        ("--part a=0.000001 --part b=0.999999", "would be empty"),
    ] {
        assert!(refused(&words(parts)).contains(part), "{parts}");
    }
}

/// The published network learns from logs and drives, and continues from its weights.
#[test]
fn the_published_network_is_trained_and_drives() {
    let folder = tempfile::tempdir().unwrap();
    let (few, driven) = few(folder.path());
    let at = |name: &str| folder.path().join(name).display().to_string();
    let (tokens, map) = (at("tokens.safetensors"), at("map.safetensors"));
    done(&words(&format!(
        "train vocabulary {} --method k-disks --tokens 64 --fill --out {tokens} --map-out {map}",
        text(&few)
    )));
    let recipe = folder.path().join("recipe.toml");
    let small = "agents = 6\nmap_radius = 50.0\n[network]\nhidden_dim = 16\nnum_freq_bands = 4\nnum_heads = 2\nhead_dim = 8\n\
        num_agent_layers = 1\nmlp_embedding_first_width = 16\nseparate_heads = true\n[augmentation]\nwindow = 6\nnear_tokens = 3\n\
        [learning]\nbatch = 2\nepochs = 6\nlearning_rate = 3e-3\nheld_out = 0.3\nvalidate_every = 4\n";
    fs::write(&recipe, small).unwrap();
    let inputs = [format!("vocabulary={tokens}"), format!("map-vocabulary={map}")];
    let base = ["train", "smart", text(&few), "--recipe", text(&recipe)];
    let files = ["--input", &inputs[0], "--input", &inputs[1]];
    let train = |out: &str, jobs: &str, more: &[&str]| {
        done(&[&base[..], more, &["--out", out, "--jobs", jobs, "--closed-loop", text(&driven)]].concat());
        fs::read(Path::new(out).join("weights.safetensors")).unwrap()
    };
    let (one, two) = (at("one"), at("two"));
    assert!(train(&one, "1", &files) == train(&two, "2", &files), "weights depend on the number of threads");
    let losses: Vec<f64> = log_rows(Path::new(&one)).iter().filter_map(|r| r["loss"].as_f64()).collect();
    assert!(losses[losses.len() - 1] < losses[0], "{losses:?}");
    assert!(Path::new(&one).join("events.out.tfevents.0.reactsim").metadata().unwrap().len() > 100);

    let weights = format!("{one}/weights.safetensors");
    let given = format!("smart={weights}");
    let table = done(&["run", text(&driven), "--models", "smart", "--model-weights", &given]);
    assert!(table.contains("| SMART "));
    let own = [format!("vocabulary={weights}"), format!("map-vocabulary={weights}")];
    let inputs = ["--input", &own[0], "--input", &own[1]];
    let again = [&inputs[..], &["--from", &weights, "--set", "learning.epochs=1"]].concat();
    train(&at("further"), "2", &again);

    // Fine-tuning in closed loop, from these weights.
    let tune = |out: &str, jobs: &str| {
        let base = ["train", "catk", text(&few), "--recipe", "reactive", "--from", &weights];
        let settings = ["--set", "learning.epochs=1", "--set", "learning.batch=2", "--set", "steps=6"];
        done(&[&base[..], &settings, &["--out", out, "--jobs", jobs]].concat());
        fs::read(Path::new(out).join("weights.safetensors")).unwrap()
    };
    assert!(tune(&at("tuned"), "1") == tune(&at("again"), "2"), "weights depend on the number of threads");
    assert!(
        said(&["train", "catk", text(&few), "--out", &at("no")], 2).1.contains("give its file as `from`")
    );

    let refused = |more: &[&str]| said(&[&base[..], more, &["--out", &at("no")]].concat(), 2).1;
    assert!(refused(&files[..2]).contains("needs a file `map-vocabulary`"));
    let shared = [&files[..], &["--set", "network.separate_heads=false"]].concat();
    let text = refused(&shared);
    assert!(text.contains("tokens, but one head"), "{text}");
    assert!(
        refused(&["--from", &weights, "--set", "network.num_heads=4"])
            .contains("other sizes than the recipe")
    );
}

/// Shipped networks of both kinds are fine-tuned by realism from the command line, and drive.
#[test]
fn networks_are_tuned_by_realism() {
    let folder = tempfile::tempdir().unwrap();
    let (few, _) = few(folder.path());
    let at = |name: &str| folder.path().join(name).display().to_string();
    let base = ["train", "realism", text(&few), "--set", "rollouts=2", "--set", "learning.held_out=0"];
    let short = ["--set", "learning.batch=1", "--set", "learning.epochs=0.3", "--jobs", "1"];
    for (from, reader) in [("ntp-reactive", "ntp-reactive"), ("trajtok-small", "smart")] {
        let (out, more) = (at(from), ["--from", from, "--set", "features=kinematic", "--out"]);
        let (_, notes) = said(&[&base[..], &short, &more, &[out.as_str()]].concat(), 0);
        assert!(notes.contains("trained 2 steps"), "{notes}");
        let row = log_rows(Path::new(&out)).pop().unwrap();
        for name in ["metametric", "av-contacts", "lost", "divergence", "entropy"] {
            assert!(row["metrics"][name].is_number(), "{name} is not in {row}");
        }
        let weights = format!("{reader}={out}/weights.safetensors");
        done(&["run", text(&few), "--models", reader, "--model-weights", &weights, "--limit", "1"]);
    }
    let refused = |more: &[&str]| said(&[&base[..], more, &["--out", &at("no")]].concat(), 2).1;
    assert!(refused(&[]).contains("give its file as `from`"));
    assert!(refused(&["--from", "regression"]).contains("weights neither of `ntp-reactive`"));
    assert!(refused(&["--from", "idm"]).contains("this program has no weights of it"));
    let nothing = ["--from", "ntp-reactive", "--set", "weights.realism=0", "--set", "weights.reactions=0"];
    assert!(refused(&nothing).contains("nothing is rewarded"));
    assert!(refused(&["--from", "ntp-reactive", "--set", "features=map"]).contains("kinematic"));
    let long = at("long.parquet");
    done(&words(&format!("generate --preset train --count 1 --future 100 --out {long} --quiet")));
    let refused = said(&["train", "realism", &long, "--from", "ntp-reactive", "--out", &at("no")], 2).1;
    assert!(refused.contains("no other length"), "{refused}");
}

/// The quick training reacts to deviated AVs better than constant velocity, and stays near the log.
#[test]
#[ignore = "trains for some minutes"]
fn the_quick_training_beats_constant_velocity() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("quick");
    done(&["train", "quick", "--out", text(&out), "--quiet"]);
    let summary = json_of(&out.join("run/summary.json"));
    let mean =
        |id: &str, metric: &str| summary["simulators"][id]["metrics"][metric]["mean"].as_f64().unwrap();
    let raw = "ntp-reactive-raw@quick";
    assert!(mean(raw, "aav-collision") < mean("constant-velocity", "aav-collision"));
    assert!(mean(raw, "ade") < 3.5);
}

/// `train adapt` judges by other recordings than it learns from, runs the network before and after in both
/// protocols, and continues where it was.
#[test]
fn shipped_networks_are_adapted_to_logs() {
    let folder = tempfile::tempdir().unwrap();
    let logs = folder.path().join("logs.parquet");
    done(&words(&format!("generate --preset train --count 14 --seed 31 --out {} --quiet", text(&logs))));
    let out = folder.path().join("adapted");
    let adapt = ["train", "adapt", text(&logs), "--minutes", "0.05", "--out", text(&out)];
    let refused = |arguments: &[&str], expected: &str| {
        let (_, error) = said(arguments, 2);
        assert!(error.contains(expected), "{error}");
    };
    refused(&[&adapt[..], &["--model", "smart-smal"]].concat(), "did you mean `smart-small`");
    refused(&["train", "adapt", BENCH, "--out", text(&out)], "this is the benchmark");

    let (table, notes) = said(&adapt, 0);
    for part in ["scenarios to learn from is little", "simulator runs with: reactsim run --models"] {
        assert!(notes.contains(part), "{notes}");
    }
    // The verdict comes first, then the paired differences.
    let verdict = json_of(&out.join("verdict.json"));
    assert_eq!(table.lines().next(), verdict["text"].as_str());
    assert!(table.contains("Before and after in the realism protocol, "), "{table}");
    // So few logs cannot show that it is no less safe.
    assert!(["worse", "not-judged"].contains(&verdict["verdict"].as_str().unwrap()), "{table}");
    assert!(!table.starts_with("adapted") && notes.contains("the trained simulator"), "{table}");
    let power = verdict["power"]["reactive"]["aav-collision"].as_str().unwrap();
    assert!(power.contains("cannot see a doubling") && table.contains(&format!("\n- {power}\n")), "{table}");
    for run in ["reactive", "realism"] {
        let metrics = verdict[run]["metrics"].as_object().unwrap();
        assert!(metrics.contains_key("ade") && !metrics.contains_key("min-ade"), "{metrics:?}");
    }
    let metrics = verdict["generated"]["metrics"].as_object().unwrap();
    assert!(metrics.contains_key("aav-ttc") && !metrics.contains_key("ade"), "{metrics:?}");
    let ids = |name: &str| -> Vec<String> {
        formats::open(&out.join(name)).unwrap().map(|scenario| scenario.unwrap().id).collect()
    };
    let (learned, judged) = (ids("logs.parquet"), ids("held-out.parquet"));
    assert_eq!(learned.len() + judged.len(), 14);
    assert!(!judged.is_empty() && judged.iter().all(|id| !learned.contains(id)));
    // Logs have several AVs, which are one observation.
    let of_logs: BTreeSet<String> =
        ids("deviated.parquet").iter().map(|id| id.split('+').next().unwrap().to_owned()).collect();
    assert!(of_logs.iter().all(|id| judged.contains(id)));
    let paired = &verdict["reactive"]["metrics"]["aav-collision"];
    assert_eq!(paired["groups"].as_u64(), Some(of_logs.len() as u64));
    assert!(paired["difference"]["scenarios"].as_u64() > paired["groups"].as_u64(), "{paired}");
    for run in ["reactive", "generated", "realism"] {
        let summary = json_of(&out.join(run).join("summary.json"));
        let rows: Vec<&String> = summary["simulators"].as_object().unwrap().keys().collect();
        assert_eq!(rows, ["constant-velocity", "idm", "ntp-guarded", "ntp-guarded@mine"], "{run}");
    }

    let weights = || fs::read(out.join("training/weights.safetensors")).unwrap();
    let before = weights();
    fs::remove_dir_all(out.join("realism")).unwrap();
    refused(&adapt, "has files already");
    for other in ["--seed=1", "--history=5", "--future=6s"] {
        refused(&[&adapt[..], &["--resume", other]].concat(), "was begun with other arguments");
    }
    done(&[&adapt[..], &["--resume"]].concat());
    assert!(out.join("realism/summary.json").exists());
    assert_eq!(weights(), before);

    let other = folder.path().join("rewarded");
    let rewarded =
        ["train", "adapt", text(&logs), "--minutes", "0.05", "--reward", "realism", "--out", text(&other)];
    refused(&[&rewarded[..], &["--model", "regression"]].concat(), "does not learn by rewards");
    let (_, notes) = said(&rewarded, 0);
    assert!(notes.contains("rewarded/weights.safetensors"), "{notes}");
    let identity = &json_of(&other.join("rewarded/training.json"))["training"]["task"];
    assert_eq!(identity["recipe"]["features"], "all");
    assert!(other.join("reward.toml").exists() && other.join("realism/summary.json").exists());
}
