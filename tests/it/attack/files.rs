//! Changed files of every kind that the program reads. The program must soon end with an exit code, and must
//! not panic, print a number that is not finite, or silently give another result.

use std::fs;
use std::path::{Path, PathBuf};

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::call::call;
use super::changes::changed;
use crate::program::{copy, said, words};

/// A file and the call that reads it. `{}` in the arguments is replaced by the path of the changed file.
struct Kind {
    name: &'static str,
    /// The unchanged file.
    file: PathBuf,
    /// Whether the changed file replaces the unchanged one in a copy of its folder; `{}` is then the path of
    /// the copy.
    in_folder: bool,
    arguments: Vec<String>,
}

fn text(path: &Path) -> String {
    path.to_str().unwrap().to_owned()
}

/// Makes a valid file of every kind.
fn kinds(home: &Path) -> Vec<Kind> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mini = root.join("scenarios/mini");
    let at = |name: &str| home.join(name);
    let make = |arguments: &[&str]| drop(said(arguments, 0));
    let (native, avs, run) = (text(&at("native.parquet")), text(&at("avs.json")), text(&at("run")));
    let (one, curated) = (text(&mini.join("cut-in.json")), text(&at("curated.parquet")));
    make(&["convert", &one, &text(&mini.join("merge.json")), "--out", &native]);
    make(&["export", "av", &native, "--out", &avs]);
    make(&["curate", &native, "--min-vehicles", "1", "--without-scenes", "--out", &curated]);
    make(&["run", &native, "--models", "stop,idm", "--keep-rollouts", "--out", &run]);
    let file = |name, file: &str, arguments: &[&str]| {
        let arguments = arguments.iter().map(|a| (*a).to_owned()).collect();
        Kind { name, file: PathBuf::from(file), in_folder: false, arguments }
    };
    let of_run = |name: &'static str, arguments: &[&str]| {
        let file = file(name, &format!("{run}/{name}"), arguments);
        Kind { in_folder: true, ..file }
    };
    let weights = text(&root.join("weights/ntp-reactive.safetensors"));
    let rollouts = format!("{run}/rollouts.parquet");
    let resume = ["run", &native, "--models", "stop,idm", "--keep-rollouts", "--out", "{}", "--resume"];
    let stop = ["--models", "stop", "--quiet"];
    vec![
        file("scenario document", &one, &[&["run", "{}"], &stop[..]].concat()),
        file("native scenarios", &native, &[&["run", "{}"], &stop[..]].concat()),
        file("deviations in JSON", &avs, &[&["run", &native, "--deviations", "{}"], &stop[..]].concat()),
        file(
            "deviations of curate",
            &curated,
            &[&["run", &native, "--deviations", "{}"], &stop[..]].concat(),
        ),
        file("candidates", &curated, &["curate", "stats", "{}"]),
        file("rollouts", &rollouts, &["score", "{}", "--scenarios", &native]),
        file(
            "futures",
            &rollouts,
            &words(&format!(
                "convert {native} --futures {{}} --model idm --out {}",
                text(&at("futures.parquet"))
            )),
        ),
        file(
            "weights",
            &weights,
            &["run", "--limit", "1", "--models", "ntp-reactive", "--model-weights", "ntp-reactive={}"],
        ),
        of_run("provenance.json", &["report", "{}"]),
        of_run("summary.json", &["report", "{}", "--format", "json"]),
        of_run("rows.jsonl", &["compare", &run, "{}"]),
        of_run("events.jsonl", &["report", "{}", "--format", "html", "--scenarios", &native]),
        of_run("rows.jsonl", &resume),
        of_run("events.jsonl", &resume),
        of_run("rollouts.parquet", &["report", "{}", "--format", "html", "--scenarios", &native]),
    ]
}

/// Attacks every kind of file with this number of changes.
fn attack(changes: u64) {
    let home = tempfile::tempdir().unwrap();
    let mut faults = Vec::new();
    for (k, kind) in kinds(home.path()).into_iter().enumerate() {
        let content = fs::read(&kind.file).unwrap();
        let place = home.path().join(format!("changed-{k}"));
        let file_name = kind.file.file_name().unwrap();
        for seed in 0..changes {
            let mut rng = ChaCha8Rng::seed_from_u64(1000 * k as u64 + seed);
            fs::create_dir_all(&place).unwrap();
            if kind.in_folder {
                copy(kind.file.parent().unwrap(), &place);
            }
            fs::write(place.join(file_name), changed(&content, &mut rng)).unwrap();
            let target = if kind.in_folder { place.clone() } else { place.join(file_name) };
            let arguments: Vec<String> =
                kind.arguments.iter().map(|a| a.replace("{}", &text(&target))).collect();
            let answer = call(&arguments, home.path());
            let fault = match answer.code {
                _ if answer.error.contains("panicked") => Some("panics"),
                None => Some("does not end, or is ended"),
                // Scripts of pages may contain such words.
                Some(0) if has_no_number(&answer.output) && !answer.output.starts_with("<!") => {
                    Some("prints a number that is none")
                }
                Some(0 | 1) => None,
                Some(2) if answer.error.trim().is_empty() => Some("says nothing"),
                Some(2) => None,
                Some(_) => Some("has an unknown exit code"),
            };
            if let Some(fault) = fault {
                let code = answer.code;
                faults.push(format!(
                    "{} {k}/{seed} {fault} ({code:?}): {}",
                    kind.name,
                    answer.error.trim_end()
                ));
            }
            fs::remove_dir_all(&place).unwrap();
        }
    }
    assert!(faults.is_empty(), "{} faults:\n{}", faults.len(), faults.join("\n"));
}

fn has_no_number(output: &str) -> bool {
    output.split(|c: char| !c.is_ascii_alphabetic()).any(|word| matches!(word, "NaN" | "inf"))
}

#[test]
#[cfg_attr(not(target_os = "linux"), ignore = "limits memory as Linux does")]
fn some_changed_files_of_every_kind_break_nothing() {
    attack(3);
}

#[test]
#[cfg_attr(not(target_os = "linux"), ignore = "limits memory as Linux does")]
#[cfg_attr(target_os = "linux", ignore = "calls the program thousands of times")]
fn changed_files_of_every_kind_break_nothing() {
    attack(400);
}
