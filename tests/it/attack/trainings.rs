//! Trainings that are killed at random moments and resumed: the same bytes as without the kills.

use std::fs;
use std::path::Path;
use std::process::{Child, Stdio};
use std::thread::sleep;
use std::time::Instant;

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

use crate::program::{log_rows, program};
use crate::small_scenarios::{scenario, write};

/// A network that learns in a moment, with a checkpoint after almost every step.
const RECIPE: &str = "agents = 8
[network]
hidden = 16
relation = 16
agent_layers = 1
[augmentation]
window = 4
[learning]
batch = 2
epochs = 8
held_out = 0.3
validate_every = 3
";

/// Writes the scenarios and the recipe of trainings.
pub(super) fn prepare(home: &Path) {
    write(&home.join("scenarios.parquet"), (0..8).map(scenario));
    fs::write(home.join("recipe.toml"), RECIPE).unwrap();
}

pub(super) fn train(home: &Path, out: &Path, resume: bool) -> Child {
    let mut command = program();
    command.args(["train", "ntp-reactive"]).arg(home.join("scenarios.parquet")).arg("--recipe");
    command.arg(home.join("recipe.toml")).args(["--checkpoint-every", "0.01s", "--out"]).arg(out);
    if resume {
        command.arg("--resume");
    }
    command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap()
}

/// Kills a training at so many moments, each in a folder of its own, and resumes it.
fn attack(moments: u32) {
    let home = tempfile::tempdir().unwrap();
    prepare(home.path());
    let whole = home.path().join("whole");
    let start = Instant::now();
    assert!(train(home.path(), &whole, false).wait().unwrap().success());
    let duration = start.elapsed();
    let (weights, log) = (fs::read(whole.join("weights.safetensors")).unwrap(), log_rows(&whole));
    let mut random = ChaCha8Rng::seed_from_u64(7);
    let mut killed = 0;
    for moment in 0..moments {
        let out = home.path().join(format!("killed-{moment}"));
        let mut child = train(home.path(), &out, false);
        sleep(duration.mul_f64(random.random_range(0.0..1.0)));
        killed += u32::from(child.try_wait().unwrap().is_none());
        child.kill().ok();
        child.wait().unwrap();
        assert!(
            train(home.path(), &out, true).wait().unwrap().success(),
            "moment {moment}: cannot be resumed"
        );
        assert!(
            fs::read(out.join("weights.safetensors")).unwrap() == weights,
            "moment {moment}: other weights"
        );
        assert_eq!(log_rows(&out), log, "moment {moment}");
    }
    assert!(killed > moments / 2, "only {killed} of {moments} trainings were killed before their end");
}

#[test]
fn a_training_killed_at_random_moments_can_be_resumed() {
    attack(2);
}

#[test]
#[ignore = "kills twenty trainings"]
fn a_training_killed_at_many_random_moments_can_be_resumed() {
    attack(20);
}
