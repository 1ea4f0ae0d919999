//! Resuming after an interruption, and obstacles to it.

use std::fs::{self, OpenOptions};
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use reactsim_nn::training::{Ending, LOG, NamedTensors, Observer, Row, Settings, TrainingError, WEIGHTS};

use super::toy::{Curve, Toy, Trial, checkpoints, left, settings};

/// Stops a training at a step.
struct StopAt<'a>(u64, &'a AtomicBool);

impl Observer for StopAt<'_> {
    fn row(&self, row: &Row) {
        if row.step() == self.0 {
            self.1.store(true, Ordering::Relaxed);
        }
    }
}

/// Returns the results of a training that is not interrupted.
fn uninterrupted() -> (Vec<Row>, NamedTensors) {
    let folder = tempfile::tempdir().unwrap();
    Trial { checkpoint_every: Duration::from_secs(3600), ..Trial::default() }
        .learn(folder.path(), false)
        .unwrap();
    left(folder.path())
}

/// Runs a training and interrupts it after this number of steps.
fn interrupted(folder: &Path, step: u64) {
    let stop = AtomicBool::new(false);
    let observer = StopAt(step, &stop);
    let trial =
        Trial { observer: &observer, checkpoint_every: Duration::from_secs(3600), ..Trial::default() };
    let outcome = trial.learn_until(folder, false, &stop).unwrap();
    assert_eq!((outcome.ending, outcome.steps), (Ending::Interrupted, step));
}

#[test]
fn what_is_resumed_comes_out_as_if_it_had_never_ended() {
    let expected = uninterrupted();
    for step in [1, 7, 20] {
        let folder = tempfile::tempdir().unwrap();
        interrupted(folder.path(), step);
        // Rows of steps after the checkpoint, and a torn one, as a kill leaves them.
        let log = folder.path().join(LOG);
        let mut text = fs::read_to_string(&log).unwrap();
        text.push_str(&text.lines().last().unwrap().replace(&format!("\"step\":{step},"), "\"step\":999,"));
        text.push_str("\n{\"row\":\"st");
        fs::write(&log, text).unwrap();
        let half = folder.path().join(".checkpoint-00000099.safetensors.1.partial");
        fs::write(&half, "half").unwrap();
        let outcome = Trial { jobs: 1, ..Trial::default() }.learn(folder.path(), true).unwrap();
        assert_eq!(outcome.ending, Ending::Finished);
        assert!(left(folder.path()) == expected, "resumed at {step}");
        assert_eq!(checkpoints(folder.path()).len(), 2);
        assert!(!half.exists());
    }
}

#[test]
fn the_validation_before_the_first_step_is_kept_or_repeated() {
    let trial = || Trial {
        task: Toy { trained: true },
        settings: Settings { learning_rate: 100.0, ..settings() },
        ..Trial::default()
    };
    let whole = tempfile::tempdir().unwrap();
    trial().learn(whole.path(), false).unwrap();
    for is_kept in [true, false] {
        let folder = tempfile::tempdir().unwrap();
        let stop = AtomicBool::new(false);
        Trial { observer: &StopAt(1, &stop), ..trial() }.learn_until(folder.path(), false, &stop).unwrap();
        if !is_kept {
            checkpoints(folder.path()).iter().for_each(|path| fs::remove_file(path).unwrap());
        }
        trial().learn(folder.path(), true).unwrap();
        assert!(left(folder.path()) == left(whole.path()), "kept: {is_kept}");
    }
}

#[test]
fn what_was_killed_comes_out_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let mut child = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "resuming::a_training_to_be_killed", "--ignored", "--nocapture"])
        .env("REACTSIM_TEST_TRAINING", folder.path())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let lines = BufReader::new(child.stdout.take().unwrap()).lines();
    // The child prints every step, and is killed in the middle of one.
    let steps = lines.map_while(Result::ok).filter(|line| line.contains("a step")).take(12).count();
    child.kill().unwrap();
    child.wait().unwrap();
    assert_eq!(steps, 12);
    assert!(!folder.path().join("finished").exists());
    Trial::default().learn(folder.path(), true).unwrap();
    assert!(left(folder.path()) == uninterrupted());
}

/// Prints every step, slowly.
struct Loud;

impl Observer for Loud {
    #[expect(clippy::print_stdout, reason = "another process listens")]
    fn row(&self, _: &Row) {
        println!("a step");
        std::thread::sleep(Duration::from_millis(20));
    }
}

#[test]
#[ignore = "is run by another test, which kills it"]
fn a_training_to_be_killed() {
    let Some(folder) = std::env::var_os("REACTSIM_TEST_TRAINING") else { return };
    let folder = Path::new(&folder);
    let trial = Trial { observer: &Loud, checkpoint_every: Duration::from_millis(70), ..Trial::default() };
    trial.learn(folder, false).unwrap();
    fs::write(folder.join("finished"), "").unwrap();
}

#[test]
fn other_settings_and_data_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    interrupted(folder.path(), 3);
    let refusal = |trial: Trial<'_>| trial.learn(folder.path(), true).unwrap_err().to_string();
    let other = refusal(Trial { settings: Settings { batch: 8, seed: 1, ..settings() }, ..Trial::default() });
    assert!(
        other.contains("`settings.batch` is 16 there and 8 now; `settings.seed` is 0 there and 1 now"),
        "{other}"
    );
    let other = refusal(Trial { source: Curve::of(63), ..Trial::default() });
    assert!(other.contains("`data.digest` is \"curve-64\" there and \"curve-63\" now"), "{other}");
    let text = Trial::default().learn(folder.path(), false).unwrap_err().to_string();
    assert!(text.contains("already holds a training; continue it with `resume`"), "{text}");
}

#[test]
fn a_checkpoint_that_is_cut_short_is_refused_and_the_one_before_is_named() {
    let folder = tempfile::tempdir().unwrap();
    interrupted(folder.path(), 9);
    let all = checkpoints(folder.path());
    let [first, last] = &all[..] else { panic!("{all:?}") };
    let whole = fs::read(last).unwrap();
    let mut flipped = whole.clone();
    *flipped.last_mut().unwrap() ^= 1;
    let damages: [(&[u8], &str); 4] = [
        (&whole[..whole.len() - 1], "it is truncated"),
        (&whole[..100], "it is truncated"),
        (&[], "it is truncated"),
        (&flipped, "it is damaged"),
    ];
    for (content, expected) in damages {
        fs::write(last, content).unwrap();
        let text = Trial::default().learn(folder.path(), true).unwrap_err().to_string();
        assert!(text.contains(expected) && text.contains(&format!("{}", last.display())), "{text}");
        assert!(text.ends_with(&format!("delete it to continue from {}", first.display())), "{text}");
    }
    fs::remove_file(last).unwrap();
    Trial::default().learn(folder.path(), true).unwrap();
    assert!(left(folder.path()) == uninterrupted());
}

#[test]
fn a_checkpoint_of_something_else_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    interrupted(folder.path(), 9);
    let last = checkpoints(folder.path()).pop().unwrap();
    let refusal = |file: &NamedTensors| {
        file.write(&last).unwrap();
        Trial::default().learn(folder.path(), true).unwrap_err().to_string()
    };
    let good = NamedTensors::read(&last).unwrap();
    let weights = NamedTensors::read(&folder.path().join(WEIGHTS)).unwrap();
    assert!(refusal(&weights).contains("it is not a checkpoint of a training"));
    let mut other = good.clone();
    other.about["training"]["settings"]["clip"] = 7.0.into();
    assert!(refusal(&other).contains("it is of another training: `settings.clip` is 7.0 there and 1.0 now"));
    let mut other = good.clone();
    other.tensors.remove("first.second.bias").unwrap();
    assert!(refusal(&other).contains("the tensor `first.second.bias` is missing"));
    let mut other = good.clone();
    other.tensors.get_mut("model.first.weight").unwrap().shape = vec![32, 1];
    assert!(refusal(&other).contains("the tensor `model.first.weight` is [32, 1], expected [1, 32]"));
    let foreign = safetensors::serialize(
        [("x", &safetensors::tensor::TensorView::new(safetensors::Dtype::F32, vec![1], &[0; 4]).unwrap())],
        None,
    );
    fs::write(&last, foreign.unwrap()).unwrap();
    let text = Trial::default().learn(folder.path(), true).unwrap_err().to_string();
    assert!(text.contains("its metadata has no `reactsim`: another program wrote it"), "{text}");
}

/// Puts something in the place of the checkpoint of a step that cannot be replaced.
struct BlockedAt<'a>(u64, &'a Path);

impl Observer for BlockedAt<'_> {
    fn row(&self, row: &Row) {
        if row.step() == self.0 {
            std::os::unix::fs::symlink("/dev/full", self.1).unwrap();
        }
    }
}

#[test]
fn a_failed_write_ends_it_and_the_last_checkpoint_stays_whole() {
    let folder = tempfile::tempdir().unwrap();
    let blocked = folder.path().join("checkpoint-00000011.safetensors");
    let trial = Trial { observer: &BlockedAt(11, &blocked), ..Trial::default() };
    let error = trial.learn(folder.path(), false).unwrap_err();
    let TrainingError::Write { path, .. } = &error else { panic!("{error}") };
    assert_eq!(path, &blocked);
    fs::remove_file(&blocked).unwrap();
    let names: Vec<String> = checkpoints(folder.path())
        .iter()
        .map(|p| p.file_name().unwrap().to_string_lossy().into_owned())
        .collect();
    assert_eq!(names, ["checkpoint-00000009.safetensors", "checkpoint-00000010.safetensors"]);
    Trial::default().learn(folder.path(), true).unwrap();
    assert!(left(folder.path()) == uninterrupted());
}

#[test]
fn a_folder_that_can_not_be_written_is_refused_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("file");
    fs::write(&file, "").unwrap();
    let error = Trial::default().learn(&file.join("out"), false).unwrap_err();
    assert!(matches!(error, TrainingError::Write { .. }), "{error}");
    // A folder that another training holds is refused, too.
    let out = folder.path().join("out");
    interrupted(&out, 3);
    // Nothing in it is touched: the holder goes on writing to the same files.
    let held = reactsim_files::lock_folder(&out).unwrap().unwrap();
    let mut log = OpenOptions::new().append(true).open(out.join("log.jsonl")).unwrap();
    let error = Trial::default().learn(&out, true).unwrap_err();
    assert!(matches!(error, TrainingError::Busy { .. }), "{error}");
    log.write_all(b"more\n").unwrap();
    assert!(fs::read_to_string(out.join("log.jsonl")).unwrap().ends_with("\nmore\n"));
    drop(held);
}
