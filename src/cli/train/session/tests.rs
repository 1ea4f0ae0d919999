use std::fs;
use std::path::Path;
use std::sync::atomic::AtomicBool;

use burn::module::Module;
use burn::nn::{Linear, LinearConfig};
use burn::tensor::{Device, Tensor, TensorData};
use clap::Parser;

use super::*;
use crate::models::learning::SimulatorTask;
use crate::scene::Scenario;
use crate::training::{LOG, Output, Stream, Sums, Task, draw_parameters, read_log};

#[derive(Debug, Parser)]
struct Line {
    #[command(flatten)]
    args: SessionArgs,
}

/// Predicts the displacement of agents after 8 s from their current speed.
struct Speeds;

#[derive(Module, Debug)]
struct Net {
    linear: Linear,
}

impl Task for Speeds {
    type Example = Scenario;
    type Sample = Vec<[f32; 2]>;
    type Model = Net;

    fn init(&self, seed: u64) -> Net {
        draw_parameters(Net { linear: LinearConfig::new(1, 1).init(&Device::flex().autodiff()) }, seed, 1.0)
    }

    fn prepare(&self, scenario: &Scenario, _: Option<&mut Stream>) -> Option<Self::Sample> {
        let pairs = (0..scenario.start.agents.len()).filter_map(|agent| {
            let speed = scenario.logged_velocity(agent, 10)?.norm();
            let (now, then) = (scenario.logged_at(agent, 10)?, scenario.logged_at(agent, 90)?);
            Some([speed as f32 / 10.0, ((then.position() - now.position()).norm() / 80.0) as f32])
        });
        Some(pairs.collect::<Vec<_>>()).filter(|pairs| !pairs.is_empty())
    }

    fn loss(&self, model: &Net, samples: &[Self::Sample], _: Option<&mut Stream>) -> Output {
        let pairs = samples.concat();
        let column = |i: usize| {
            let data = TensorData::new(pairs.iter().map(|p| p[i]).collect::<Vec<f32>>(), [pairs.len(), 1]);
            Tensor::<2>::from_data(data, &model.linear.weight.device())
        };
        let error = model.linear.forward(column(0)) - column(1);
        Output::new((error.clone() * error).sum(), pairs.len() as f64, Sums::new())
    }
}

impl SimulatorTask for Speeds {
    fn controller(&self, _: &Net) -> Result<Controller, String> {
        Err("it does not drive".to_owned())
    }
}

fn run(scenarios: &[&str], out: &Path, more: &[&str]) -> anyhow::Result<ExitStatus> {
    run_every(5, false, scenarios, out, more)
}

/// Trains with validations after so many steps; `interrupted` before the first one.
fn run_every(
    validate_every: u64,
    interrupted: bool,
    scenarios: &[&str],
    out: &Path,
    more: &[&str],
) -> anyhow::Result<ExitStatus> {
    let out = out.display().to_string();
    let line = [&["train"], scenarios, &["--out", &out], more].concat();
    let args = Line::try_parse_from(line)?.args;
    let settings = Settings {
        seed: args.seed,
        epochs: 20.0,
        batch: 4,
        learning_rate: 0.05,
        validate_every,
        ..Settings::default()
    };
    train(&args, &Speeds, settings, None, &AtomicBool::new(interrupted))
}

const MINI: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenarios/mini");

#[test]
fn scenarios_of_any_format_are_learned_from() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("a");
    assert_eq!(run(&[MINI], &out, &["--jobs", "2"]).unwrap(), ExitStatus::Done);
    for name in [ABOUT, LOG, WEIGHTS, CURVES, "cache"] {
        assert!(out.join(name).exists(), "{name}");
    }
    let losses = |out: &Path| -> Vec<Option<f64>> {
        let rows = read_log(&out.join(LOG)).unwrap();
        rows.iter()
            .filter_map(|r| if let crate::training::Row::Step(r) = r { Some(r.loss) } else { None })
            .collect()
    };
    let first = losses(&out);
    assert!(first[first.len() - 1].unwrap() < 0.5 * first[0].unwrap(), "{first:?}");
    // Native files given directly are the same data, and need no cache.
    let natives: Vec<String> =
        fs::read_dir(out.join("cache")).unwrap().map(|e| e.unwrap().path().display().to_string()).collect();
    let mut natives: Vec<&str> = natives.iter().map(String::as_str).collect();
    natives.sort_unstable();
    let other = folder.path().join("b");
    run(&natives, &other, &["--jobs", "1"]).unwrap();
    assert!(!other.join("cache").exists());
    assert_eq!(losses(&other).len(), first.len());
    // Seeing scenarios twice as often doubles the number of steps.
    let twice = folder.path().join("c");
    run(&[&format!("{MINI}=2")], &twice, &["--cache", &out.join("cache").display().to_string()]).unwrap();
    assert!(!twice.join("cache").exists() && losses(&twice).len() > first.len());
}

#[test]
fn an_interrupted_training_leaves_a_checkpoint_and_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    assert_eq!(run_every(5, true, &[MINI], folder.path(), &[]).unwrap(), ExitStatus::Interrupted);
    assert!(folder.path().join("checkpoint-00000000.safetensors").exists());
    assert!(!folder.path().join(WEIGHTS).exists());
    let again = run(&[MINI], folder.path(), &["--resume"]).unwrap();
    assert_eq!(again, ExitStatus::Done);
    assert!(folder.path().join(WEIGHTS).exists());
}

#[test]
fn weights_that_are_gone_are_missed() {
    let folder = tempfile::tempdir().unwrap();
    let trained = |more: &[&str]| run_every(4, false, &[MINI], folder.path(), more);
    assert_eq!(trained(&[]).unwrap(), ExitStatus::Done);
    let weights = folder.path().join(WEIGHTS);
    let bytes = fs::read(&weights).unwrap();
    fs::remove_file(&weights).unwrap();
    // The best network is that of the last checkpoint, or it is lost.
    match trained(&["--resume"]) {
        Ok(status) => assert!(status == ExitStatus::Done && fs::read(&weights).unwrap() == bytes),
        Err(error) => {
            assert!(format!("{error:#}").contains("is missing: it had the best network"), "{error:#}")
        }
    }
}

#[test]
fn wrong_input_is_refused_with_its_remedy() {
    let folder = tempfile::tempdir().unwrap();
    let refusal = |scenarios: &[&str], out: &Path, more: &[&str]| {
        format!("{:#}", run(scenarios, out, more).unwrap_err())
    };
    let out = folder.path().join("out");
    let empty = folder.path().display().to_string();
    assert!(refusal(&[&empty], &out, &[]).contains("holds no scenario file"));
    assert!(refusal(&["nowhere"], &out, &[]).contains("nowhere"));
    assert!(refusal(&[&format!("{MINI}=x")], &out, &[]).contains("x is not a weight"));
    assert!(refusal(&[MINI], &out, &["--checkpoint-every", "3"]).contains("90s, 3m or 1h"));
    assert!(refusal(&[MINI], Path::new("/proc/out"), &[]).contains("could not write /proc/out"));
    run(&[MINI], &out, &[]).unwrap();
    assert!(refusal(&[MINI], &out, &[]).contains("already holds a training"));
    assert!(
        refusal(&[MINI], &out, &["--resume", "--seed", "3"]).contains("`settings.seed` is 0 there and 3 now")
    );
}

#[test]
fn times_have_units() {
    assert_eq!("90s".parse(), Ok(Time(Duration::from_secs(90))));
    assert_eq!("3m".parse(), Ok(Time(Duration::from_secs(180))));
    assert_eq!("0.5h".parse(), Ok(Time(Duration::from_secs(1800))));
    for wrong in ["", "m", "3", "-1s", "3 min", "é"] {
        assert!(wrong.parse::<Time>().is_err(), "{wrong}");
    }
}
