//! Speed of the program on real scenarios: rollouts, metrics, curation, generation, reading, threads, memory.
//!
//! `cargo bench --bench throughput [-- FOLDER]`; without a folder the shared validation split is taken, and
//! where that is missing there is nothing to measure. Each figure is measured in several rounds: the best and
//! the median are printed, by the wall clock, and the best by the processor time of the measuring thread,
//! which other programs on the machine disturb less.
#![expect(clippy::print_stdout, clippy::print_stderr, reason = "the table is what this program is for")]

use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use mimalloc::MiMalloc;
use reactsim::curation::{CurationOutcome, CurationSettings, SOURCES, curate_scenario};
use reactsim::evaluation::{
    self, Execution, FileRecord, Outcome, PlannedSimulator, RunFolder, RunParts, RunSpec, Source,
};
use reactsim::formats::{self, Input, native::Writer};
use reactsim::generation::{GenerationSettings, Generator, Preset};
use reactsim::metrics::{self, Case, Options};
use reactsim::models;
use reactsim::rollout::{Controller, Request, Rollout, ScriptedAv, Settings, roll_out};
use reactsim::scene::{FUTURE, MAX_AGENTS, Scenario};

// As in the program.
#[global_allocator]
static ALLOCATOR: MiMalloc = MiMalloc;

/// Number of rounds of every measurement on one thread, and of whole runs.
const ROUNDS: usize = 5;
const RUNS: usize = 4;
/// Number of generated scenarios: in benchmarks, ten of every map type.
const GENERATED: u64 = 210;
/// The AV of all rollouts.
const AV: &str = "brake:4";

fn main() -> Result<()> {
    let folder = std::env::args().skip(1).find(|a| !a.starts_with("--")).map(PathBuf::from);
    let folder =
        folder.unwrap_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data/womd/val"));
    if !folder.exists() {
        eprintln!("{} is missing: nothing is measured; give a folder of scenarios", folder.display());
        return Ok(());
    }
    let inputs = formats::find_inputs(&folder)?;
    let home = tempfile::tempdir()?;
    let native = home.path().join("native.parquet");
    let count = convert(&inputs, &native)?;
    let plain = decompress(&inputs, home.path())?;
    println!("{count} scenarios of {}; AV `{AV}`, replanning at 2 Hz\n", folder.display());
    println!("| what | best | median | best by CPU time | aim |\n|---|--:|--:|--:|--:|");

    let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    alone.install(|| one_thread(&native, &plain))?;
    for preset in Preset::ALL {
        alone.install(|| generation(preset))?;
    }
    threads(&native, home.path())?;
    for (name, input) in [("native", &native), ("as given", &folder)] {
        let peak = peak_memory(input, home.path())?;
        let peak = peak.map_or_else(|| "not known here".to_owned(), |mib| format!("{mib:.0} MiB"));
        println!("| peak memory of `run`, all baselines, 2 threads, {name} | {peak} | | | < 500 MiB |");
    }
    Ok(())
}

/// Writes all scenarios to one native file; returns their number.
fn convert(inputs: &[Input], out: &Path) -> Result<usize> {
    let (mut writer, mut count) = (Writer::create(out)?, 0);
    for input in inputs {
        for scenario in input.open()? {
            writer.write(&scenario?)?;
            count += 1;
        }
    }
    writer.finish()?;
    Ok(count)
}

/// Writes the TFRecord files without compression; `None` if there are no such files.
fn decompress(inputs: &[Input], home: &Path) -> Result<Option<PathBuf>> {
    let folder = home.join("tfrecord");
    let womd: Vec<&Input> = inputs.iter().filter(|i| i.format.id() == "womd").collect();
    if womd.is_empty() {
        return Ok(None);
    }
    fs::create_dir(&folder)?;
    for (k, input) in womd.into_iter().enumerate() {
        let mut from = File::open(&input.path)?;
        let mut to = File::create(folder.join(format!("{k:05}.tfrecord")))?;
        match input.path.extension().and_then(|e| e.to_str()) {
            Some("zst") => zstd::stream::copy_decode(from, &mut to)?,
            Some("gz") => {
                io::copy(&mut flate2::read::MultiGzDecoder::new(from), &mut to)?;
            }
            _ => {
                io::copy(&mut from, &mut to)?;
            }
        }
    }
    Ok(Some(folder))
}

/// Wall-clock and processor time of some work, seconds.
#[derive(Clone, Copy)]
struct Time {
    wall: f64,
    cpu: Option<f64>,
}

/// Returns the processor time of this thread so far, seconds; `None` if the system does not report it.
fn cpu_time() -> Option<f64> {
    let text = fs::read_to_string("/proc/thread-self/schedstat").ok()?;
    Some(text.split_ascii_whitespace().next()?.parse::<f64>().ok()? * 1e-9)
}

fn timed<T>(into: &mut Vec<Time>, work: impl FnOnce() -> T) -> T {
    let (wall, cpu) = (Instant::now(), cpu_time());
    let done = work();
    let cpu = cpu.and_then(|before| Some(cpu_time()? - before));
    into.push(Time { wall: wall.elapsed().as_secs_f64(), cpu });
    done
}

/// Adds up the times of several works, round by round.
fn sum(works: &[&Vec<Time>]) -> Vec<Time> {
    let rounds = works.iter().map(|w| w.len()).min().unwrap_or(0);
    let add = |k: usize| {
        let wall = works.iter().map(|w| w[k].wall).sum();
        Time { wall, cpu: works.iter().map(|w| w[k].cpu).sum() }
    };
    (0..rounds).map(add).collect()
}

/// Prints a row; `shown` formats the seconds that a round took.
fn row(what: &str, rounds: &[Time], aim: &str, shown: impl Fn(f64) -> String) {
    let mut wall: Vec<f64> = rounds.iter().map(|t| t.wall).collect();
    wall.sort_by(f64::total_cmp);
    let cpu = rounds.iter().filter_map(|t| t.cpu).min_by(f64::total_cmp);
    let (best, median) = (shown(wall[0]), shown(wall[wall.len() / 2]));
    println!("| {what} | {best} | {median} | {} | {aim} |", cpu.map_or_else(|| "–".to_owned(), shown));
}

/// Times of the works on one thread, round by round.
#[derive(Default)]
struct Works {
    native: Vec<Time>,
    womd: Vec<Time>,
    index: Vec<Time>,
    av: Vec<Time>,
    idm: Vec<Time>,
    idm_metrics: Vec<Time>,
    replay: Vec<Time>,
    replay_metrics: Vec<Time>,
    curation: Vec<Time>,
    kept: usize,
}

fn one_thread(native: &Path, plain: &Option<PathBuf>) -> Result<()> {
    let (idm, replay) = (controller("idm")?, controller("log-replay")?);
    let mut works = Works::default();
    let (mut scenarios, mut agents) = (0, 0);
    for _ in 0..ROUNDS {
        if let Some(plain) = plain {
            // Scenarios are dropped one by one, as in a run.
            timed(&mut works.womd, || formats::open(plain)?.try_for_each(|s| s.map(drop)))?;
        }
        let all: Vec<Scenario> =
            timed(&mut works.native, || formats::open(native)?.collect::<Result<_, _>>())?;
        scenarios = all.len();
        timed(&mut works.index, || all.iter().for_each(|s| _ = s.start.road()));
        let avs = timed(&mut works.av, || {
            all.iter().map(|scenario| av(scenario).map(Arc::new)).collect::<Result<Vec<_>>>()
        })?;
        let done = timed(&mut works.idm, || all_rollouts(&all, &avs, &idm))?;
        timed(&mut works.idm_metrics, || judge(&all, &done));
        let done = timed(&mut works.replay, || all_rollouts(&all, &avs, &replay))?;
        timed(&mut works.replay_metrics, || judge(&all, &done));
        works.kept = timed(&mut works.curation, || curate(&all));
        agents = all.iter().map(|s| s.start.agents.len()).sum();
    }
    let (n, w) = (scenarios as f64, &works);
    let slots = n * (MAX_AGENTS * FUTURE) as f64;
    let real = (agents * FUTURE) as f64;
    let rate = |steps: f64| move |s: f64| format!("{:.2} M/s", steps / s * 1e-6);
    let each = |s: f64| format!("{:.2} ms", s / n * 1e3);
    let per_second = |s: f64| format!("{:.0} /s", n / s);
    let judged = sum(&[&w.index, &w.idm, &w.idm_metrics]);
    row("`idm` + all metrics (map index included), agent-steps, 64 slots", &judged, "1 M/s", rate(slots));
    row("the same, agents that are there", &judged, "", rate(real));
    row("the same, per scenario", &judged, "5 ms", each);
    row("— map index", &w.index, "", each);
    row("— `idm` rollout", &w.idm, "", each);
    row("— metrics of it", &w.idm_metrics, "2 ms", each);
    row("— scripted AV (not included above)", &w.av, "", each);
    let replayed = sum(&[&w.index, &w.replay, &w.replay_metrics]);
    row(
        "`log-replay` + all metrics (map index included), agent-steps, 64 slots",
        &replayed,
        "3 M/s",
        rate(slots),
    );
    row("the same, agents that are there", &replayed, "", rate(real));
    row("— `log-replay` rollout", &w.replay, "", each);
    row("— metrics of it", &w.replay_metrics, "2 ms", each);
    row("curation, 16 candidates, all scenarios", &w.curation, "10 /s", per_second);
    let kept = |s: f64| format!("{:.0} /s", w.kept as f64 / s);
    row("the same, scenarios that step 1 keeps", &w.curation, "", kept);
    row("reading native", &w.native, "300 /s", per_second);
    if !w.womd.is_empty() {
        row("reading WOMD TFRecord, not compressed", &w.womd, "40 /s", per_second);
    }
    Ok(())
}

/// Measures generation: the map, traffic with its warm-up, and the scenario made of them.
fn generation(preset: Preset) -> Result<()> {
    let generator = Generator::new(GenerationSettings { preset, ..GenerationSettings::default() })?;
    let mut rounds = Vec::new();
    for _ in 0..ROUNDS {
        timed(&mut rounds, || (0..GENERATED).try_for_each(|n| generator.scenario(n).map(drop)))?;
    }
    let what = format!("generated scenarios, preset `{}`", preset.name());
    row(&what, &rounds, "20 /s", |s| format!("{:.0} /s", GENERATED as f64 / s));
    Ok(())
}

fn controller(id: &str) -> Result<Controller> {
    let baseline = models::find(id).with_context(|| format!("there is no baseline `{id}`"))?;
    Ok(baseline.simulator()?)
}

/// Returns the scripted AV, or one that goes straight on if the logged AV is not always present.
fn av(scenario: &Scenario) -> Result<ScriptedAv> {
    let scripted = ScriptedAv::new(scenario, AV.parse()?);
    Ok(scripted.or_else(|_| ScriptedAv::new(scenario, "constant-velocity".parse().expect("a script")))?)
}

fn all_rollouts(all: &[Scenario], avs: &[Arc<ScriptedAv>], by: &Controller) -> Result<Vec<Rollout>> {
    let settings = Settings::default();
    let mut rollouts = Vec::with_capacity(all.len());
    for (scenario, av) in all.iter().zip(avs) {
        let request = Request { scenario, av: Some(av.clone()), rollout: 0 };
        for rollout in roll_out(vec![request], by, &settings) {
            rollouts.push(rollout?);
        }
    }
    Ok(rollouts)
}

/// Computes everything that a run computes for a rollout.
fn judge(all: &[Scenario], rollouts: &[Rollout]) {
    let options = Options::default();
    for (scenario, rollout) in all.iter().zip(rollouts) {
        let case = Case::of_rollout(scenario, &rollout.tracks, options);
        let scores = metrics::score_case(&case);
        let together = metrics::Metrics::default().score_rollouts(case, &[&rollout.tracks]);
        std::hint::black_box((together, scores));
    }
}

/// Runs steps 1 to 3 for every scenario and returns the number that step 1 keeps.
fn curate(all: &[Scenario]) -> usize {
    let settings = CurationSettings::default();
    let kept =
        |s: &&Scenario| matches!(curate_scenario(s, SOURCES[0], &settings), CurationOutcome::Retained(..));
    all.iter().filter(kept).count()
}

/// Measures whole runs with one thread and with two.
fn threads(native: &Path, home: &Path) -> Result<()> {
    let mut rounds = [Vec::new(), Vec::new()];
    for round in 0..RUNS {
        for jobs in [1, 2] {
            let out = home.join(format!("run-{round}-{jobs}"));
            timed(&mut rounds[jobs - 1], || whole_run(native, &out, jobs))?;
        }
    }
    for (jobs, times) in rounds.iter_mut().enumerate() {
        // The processor time of the first of several threads is meaningless.
        times.iter_mut().for_each(|t| t.cpu = None);
        let what = format!("whole run, `log-replay` and `idm`, {} thread(s), wall", jobs + 1);
        row(&what, times, "", |s| format!("{s:.2} s"));
    }
    let ratio = |k: usize| {
        let mut times: Vec<f64> = rounds[k].iter().map(|t| t.wall).collect();
        times.sort_by(f64::total_cmp);
        (times[0], times[times.len() / 2])
    };
    let (one, two) = (ratio(0), ratio(1));
    println!("| two threads against one | {:.2} | {:.2} | – | 1.8 |", one.0 / two.0, one.1 / two.1);
    let machine = machine();
    println!("| what two threads gain here when each only counts | {machine:.2} | | – | |");
    Ok(())
}

/// Returns the gain of a second thread on work that shares nothing: the most that the machine grants now.
fn machine() -> f64 {
    let count = || {
        let mut x = 1_u64;
        for k in 0..200_000_000_u64 {
            x = std::hint::black_box(x.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(k));
        }
        std::hint::black_box(x);
    };
    let mut best = 0.0_f64;
    for _ in 0..3 {
        let alone = Instant::now();
        count();
        let alone = alone.elapsed().as_secs_f64();
        let both = Instant::now();
        thread::scope(|scope| {
            scope.spawn(count);
            count();
        });
        best = best.max(2.0 * alone / both.elapsed().as_secs_f64());
    }
    best
}

fn whole_run(native: &Path, out: &Path, jobs: usize) -> Result<()> {
    let input = formats::find_inputs(native)?.remove(0);
    let file = FileRecord::of(&input.path, input.format.id())?;
    let open = Box::new(move |first| input.open_from(first));
    let sources = vec![Source { file, open, count: None }];
    let simulators = PlannedSimulator::by_ids(&["log-replay".to_owned(), "idm".to_owned()])?;
    let mut spec = RunSpec::default();
    spec.subject.av = Some(AV.parse()?);
    let plan = spec.plan(RunParts { sources, simulators, ..RunParts::default() })?;
    let tally = plan.tally();
    let folder = RunFolder::create(out, &plan.provenance())?;
    let execution = Execution { jobs, batch: 4 };
    match evaluation::run(&plan, execution, Some(&folder), tally, &(), &AtomicBool::new(false))? {
        Outcome::Finished(_) => Ok(()),
        Outcome::Interrupted => bail!("the run was interrupted"),
    }
}

/// Returns the largest memory of a run of the program in MiB, as the system counted it until the last
/// hundredth of a second of the run.
fn peak_memory(input: &Path, home: &Path) -> Result<Option<f64>> {
    let out = tempfile::tempdir_in(home)?;
    let mut child = Command::new(env!("CARGO_BIN_EXE_reactsim"))
        .args(["run", "--av", AV, "--jobs", "2", "--out"])
        .arg(out.path().join("run"))
        .arg(input)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()?;
    let status = PathBuf::from(format!("/proc/{}/status", child.id()));
    let mut peak = None;
    loop {
        let text = fs::read_to_string(&status).unwrap_or_default();
        let line = text.lines().find_map(|l| l.strip_prefix("VmHWM:"));
        let held = line.and_then(|l| l.trim().strip_suffix("kB")?.trim().parse::<f64>().ok());
        peak = held.map(|kb| kb / 1024.0).or(peak);
        if let Some(ended) = child.try_wait()? {
            // A run with some failed scenarios (exit code 1) is a valid measurement.
            return if ended.code().is_some_and(|c| c <= 1) {
                Ok(peak)
            } else {
                bail!("`run` ended with {ended}")
            };
        }
        thread::sleep(Duration::from_millis(10));
    }
}
