//! `reactsim train adapt`: from logs to a simulator that is adapted to them.

mod choice;
mod data;
mod model;
mod stage;
mod verdict;

use std::ffi::OsString;
use std::fs::{self, DirEntry};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use anyhow::{Context, bail};
use clap::Args;
use serde_json::{Value, json};

use self::data::{Files, Logs};
use self::model::AdaptableModel;
use self::stage::Stage;
use self::verdict::{Group, Judgement, Verdict};
use super::session::{SessionArgs, run_arguments};
use super::task;
use crate::cli::finished::{put_table, report_problems};
use crate::cli::inputs::inputs_of;
use crate::cli::output::{ExitStatus, lock_folder, say, stop_on_interrupt, write_result};
use crate::cli::run::{RunArgs, finished_until};
use crate::cli::subject::JobsArg;
use crate::evaluation::{Comparison, EvaluationError, ReadingSpec, read_tally};
use crate::files::{FolderLock, LOCK, read_regular, target_of};
use crate::formats::native::ByNumber;
use crate::metrics::wosac::Scorer;
use crate::models;
use crate::models::learning::TrainingTask;
use crate::report::{Run, TableStyle};
use crate::scene::wosac::WosacLog;
use crate::training::WEIGHTS;

/// Simulator whose reactions are learned from.
const REACTING: &str = "idm";
/// How often reactions and certificates are seen per epoch. In reactions all agents drive as the simulator does,
/// in certificates those that need not react keep their log.
const REACTIONS_PER_EPOCH: f64 = 1.0;
const CERTIFICATES_PER_EPOCH: f64 = 2.0;
/// Share of the time that may have passed when the training ends; the rest is for the choice of settings and the
/// table.
const TRAINED_AT: f64 = 0.7;
/// The same of the imitation, if a training by a reward follows.
const IMITATED_AT: f64 = 0.45;
/// Largest number of epochs: more learn single logs by heart.
const MOST_EPOCHS: f64 = 40.0;
/// Largest number of logs that are read, per minute of the time limit.
const MOST_LOGS: f64 = 600.0;
/// Largest number of scenarios to learn from whose AV deviates, per minute.
const MOST_DEVIATED: f64 = 60.0;
/// Largest number of scenarios to judge by, per minute.
const MOST_JUDGED: f64 = 15.0;
/// Rollouts with AVs that deviate to judge by, per minute: collisions are rare, and to see a doubling takes
/// many.
const REACTIONS: f64 = 60.0;
/// Number of generated logs to judge by, per minute.
const MOST_GENERATED: f64 = 6.0;
/// Largest number of scenarios by which haste is chosen, per minute.
const MOST_TRIED: f64 = 6.0;
/// Rollouts of each scenario for the choice of haste, and for the table if there are as many scenarios as
/// time allows.
const ROLLOUTS: u32 = 2;
/// Largest number of rollouts of each scenario for the table: if there are few scenarios, they get more.
const MOST_ROLLOUTS: u32 = 8;
/// Name of the file with the arguments in the folder.
const ARGUMENTS: &str = "adapt.json";
/// Name of the recipe in the folder.
const RECIPE: &str = "recipe.toml";
const REWARD_RECIPE: &str = "reward.toml";
/// Names of the trainings in the folder.
const TRAINING: &str = "training";
const REWARDED: &str = "rewarded";
/// Columns of the table.
const COLUMNS: &str = "aav-collision,aav-ttc,aa-collision,offroad,ade,progress,over-reaction";
/// Name of the choice of haste in the folder.
const HASTE: &str = "haste.txt";
/// Name of the verdict in the folder.
const VERDICT: &str = "verdict.json";

const AFTER: &str = "\
1. Divides the logs by their recordings: four fifths are learned from, the others are judged by.
2. Lets the AV deviate in both; in the first part, other agents react as `idm` does, and as the \
   certificate of the deviated AV says.
3. Continues the training of the shipped weights on logs, reactions and certificates, for as long as \
   --minutes allow, and keeps the network with the lowest validation loss.
   With --reward realism, a fine-tuning by the task `realism` follows.
4. Chooses the haste of `ntp-guarded` on the scenarios that it learned from: the smallest one that \
   keeps progress, if it is as safe and, beyond chance, no worse in displacement and over-reaction.
5. Judges by the other part, with up to eight AVs of each log and in both protocols, and by the safety of \
   reactions on generated scenarios: prints whether the network is adapted, the paired differences \
   between before and after with their power, and the table with `idm` and constant velocity.

A network that is worse in a column, with p below 0.05, is not called adapted, nor is one whose reactions \
are judged by so few scenarios that a doubling of collisions would not be seen, or without a value of a \
metric of safety.

The files in --out are the files of `generate`, `train` and `run`.

Example:
  reactsim train adapt logs/ --out adapted --minutes 10";

/// Arguments of `train adapt`.
#[derive(Debug, Args)]
#[command(after_help = AFTER)]
pub(super) struct AdaptArgs {
    /// Files or folders of logs, in any format
    #[arg(required_unless_present = "filter", value_name = "LOGS")]
    logs: Vec<PathBuf>,
    /// Model to adapt: ntp-guarded, ntp-reactive, smart-small, trajtok-small, smart-reactive, regression or vbd
    #[arg(long, default_value = "ntp-guarded", value_name = "ID")]
    model: String,
    /// Time for everything, minutes; the number of epochs follows from it and the speed of the machine
    #[arg(long, default_value_t = 10.0, value_name = "M")]
    minutes: f64,
    /// Fine-tune by this reward after the training: the Sim Agents metametric and reactions to deviated AVs
    #[arg(long, value_name = "NAME", value_parser = ["realism"])]
    reward: Option<String>,
    /// Files or folders of scenarios that are not learned from, even if they are among the others; may
    /// be repeated
    #[arg(long, value_name = "SCENARIOS")]
    exclude: Vec<PathBuf>,
    /// Folder to write: scenarios, training, runs
    #[arg(long, default_value = "adapted", value_name = "FOLDER")]
    out: PathBuf,
    /// Seed of all random choices
    #[arg(long, default_value_t = 0, value_name = "S")]
    seed: u64,
    /// Continue in --out where it was interrupted
    #[arg(long)]
    resume: bool,
    #[command(flatten)]
    jobs: JobsArg,
    #[command(flatten)]
    reading: ReadingSpec,
}

pub(super) fn adapt(args: &AdaptArgs) -> anyhow::Result<ExitStatus> {
    let begun = Instant::now();
    if !(args.minutes > 0.0 && args.minutes <= 100_000.0) {
        bail!("--minutes {}: expected a number above 0, up to 100000", args.minutes);
    }
    let model = AdaptableModel::find(&args.model)?;
    let reward = args.reward.as_deref().map(|task| rewarding(model, task)).transpose()?;
    let mut inputs = inputs_of(&args.reading, &args.logs)?;
    // If there are too many logs for the time, those that are read are a random sample of the files.
    inputs.sort_by_key(|input| {
        let name = input.path.file_name().unwrap_or_default().to_string_lossy();
        data::place(&name, args.seed).to_bits()
    });
    let _lock = claim_folder(args)?;
    let stop = stop_on_interrupt("keeping what is finished")?;
    let session = |name| SessionArgs::within(args.out.join(name), args.seed, args.resume, args.jobs);
    let (mut imitating, mut rewarded) = (session(TRAINING), session(REWARDED));
    let jobs = args.jobs.count();
    let idm = models::find(REACTING).context("there is no reacting simulator")?.simulator()?;
    let interrupted = || {
        say(format_args!("interrupted; to continue, repeat the command with --resume"));
        Ok(ExitStatus::Interrupted)
    };
    let of_minutes = |count: f64, least: f64| (args.minutes * count).max(least) as usize;
    let logs = Logs {
        inputs: &inputs,
        exclude: &args.exclude,
        most: of_minutes(MOST_LOGS, 100.0),
        most_deviated: of_minutes(MOST_DEVIATED, 40.0),
        most_judged: of_minutes(MOST_JUDGED, 20.0),
        reactions: of_minutes(REACTIONS, 40.0),
        most_generated: of_minutes(MOST_GENERATED, 12.0),
        seed: args.seed,
        jobs,
        stop: &stop,
    };
    let files = data::make(&logs, &args.out, (REACTING, &idm))?;
    let Some(files) = files else { return interrupted() };
    if reward.is_some() {
        // Of logs of one kind, the first one shows whether the metric is defined.
        let mut log =
            WosacLog::of_scenario(&ByNumber::open(&files.logs)?.read(0)?).context("--reward realism")?;
        // The reward chooses the objects that it judges.
        log.tracks_to_predict.clear();
        Scorer::new(&log).context("--reward realism")?;
    }
    let shipped = shipped_weights(model, &args.out)?;
    let until = if reward.is_some() { IMITATED_AT } else { TRAINED_AT };
    let imitation = Stage::of_model(model, &shipped, until)?;
    imitating.scenarios = learned(&files)?;
    let mut status = imitation.train(args, &imitating, begun, &stop)?;
    let mut weights = imitating.folder()?.join(WEIGHTS);
    if let Some(task) = reward.filter(|_| status == ExitStatus::Done) {
        let stage = Stage::of_reward(task, &weights);
        rewarded.scenarios = vec![files.logs.display().to_string()];
        // Of scenarios with one id, the first one can be held out: that whose AV deviates.
        if !ByNumber::open(&files.tuning)?.is_empty() {
            rewarded.scenarios.insert(0, files.tuning.display().to_string());
        }
        status = stage.train(args, &rewarded, begun, &stop)?;
        weights = rewarded.folder()?.join(WEIGHTS);
    }
    if status != ExitStatus::Done {
        return Ok(status);
    }
    let haste = chosen_haste(args, model, (&shipped, &weights), &files, jobs, &stop)?;
    if stop.load(Ordering::Relaxed) {
        return interrupted();
    }
    let arguments = variant_arguments(model, &weights, haste.as_deref());
    let judgement = Judgement { model, haste: haste.as_deref(), minutes: args.minutes, groups: Vec::new() };
    let usual = ROLLOUTS as usize;
    let rollouts = [logs.reactions, usual * logs.most_generated, usual * logs.most_judged];
    let Some((status, verdict)) = table(args, &arguments, (&files, rollouts), judgement, &stop)? else {
        return Ok(ExitStatus::Interrupted);
    };
    let name = if verdict == Verdict::Better { "adapted" } else { "trained" };
    say(format_args!("the {name} simulator runs with: reactsim run {}", arguments.join(" ")));
    Ok(status)
}

/// Returns the task of a reward, for a model that learns by it.
fn rewarding(model: &AdaptableModel, task: &str) -> anyhow::Result<&'static TrainingTask> {
    if !model.takes_rewards() {
        bail!("--reward {task}: `{}` does not learn by rewards; a network of tokens does", model.id);
    }
    task::find(task)
}

/// Locks the folder and writes the arguments. Refuses a folder of other files, or of an adaptation with other
/// arguments.
fn claim_folder(args: &AdaptArgs) -> anyhow::Result<FolderLock> {
    // A refused folder is not written to; only the check with the lock is certain.
    check_folder(args)?;
    let lock = lock_folder(&args.out)?;
    if let Some(text) = check_folder(args)? {
        write_result(Some(&args.out.join(ARGUMENTS)), |file| writeln!(file, "{text}"))?;
    }
    Ok(lock)
}

/// Refuses a folder as [`claim_folder`] does. Returns the arguments to write, unless they are there.
fn check_folder(args: &AdaptArgs) -> anyhow::Result<Option<Value>> {
    let (path, out) = (args.out.join(ARGUMENTS), args.out.display());
    let mut wanted = json!({
        "logs": args.logs,
        "frames": format!("{:?}", args.reading.frames()),
        "all_agents": args.reading.has_all_agents(),
        "model": args.model,
        "minutes": args.minutes,
        "seed": args.seed,
    });
    if let Some(history) = args.reading.history {
        wanted["history"] = json!(history);
    }
    if let Some(future) = args.reading.future {
        wanted["future"] = json!(future);
    }
    if let Some(filter) = &args.reading.nuplan.filter {
        wanted["filter"] = json!(filter.display().to_string());
    }
    if let Some(reward) = &args.reward {
        wanted["reward"] = json!(reward);
    }
    if !args.exclude.is_empty() {
        wanted["exclude"] = json!(args.exclude);
    }
    if path.exists() && args.resume {
        let found: Value = serde_json::from_slice(&read_regular(&path)?)
            .with_context(|| format!("{} is damaged: give another --out", path.display()))?;
        if found != wanted {
            bail!(
                "{out} was begun with other arguments ({found}): repeat these with --resume, or give another --out"
            );
        }
        return Ok(None);
    }
    // A command that was refused may be repeated.
    let is_own = |name: &str| name == ARGUMENTS || name == LOCK || target_of(name) == Some(ARGUMENTS);
    let is_other = |entry: io::Result<DirEntry>| {
        entry.map_or(true, |entry| !entry.file_name().to_str().is_some_and(is_own))
    };
    let read = || format!("could not read {out}");
    if args.out.exists() && fs::read_dir(&args.out).with_context(read)?.any(is_other) {
        bail!("{out} has files already: give another --out, or --resume");
    }
    Ok(Some(wanted))
}

/// Returns the scenarios to learn from, with their repetitions.
fn learned(files: &Files) -> anyhow::Result<Vec<String>> {
    let mut parts = vec![files.logs.display().to_string()];
    for (path, times) in
        [(&files.reactions, REACTIONS_PER_EPOCH), (&files.certificates, CERTIFICATES_PER_EPOCH)]
    {
        if !ByNumber::open(path)?.is_empty() {
            parts.push(format!("{}={times}", path.display()));
        }
    }
    if parts.len() == 1 {
        say(format_args!(
            "warning: no AV of the logs could deviate: nothing is learned about reactions, and recordings unlearn them"
        ));
    }
    Ok(parts)
}

/// Writes the shipped weights of a model into the folder; returns the file.
fn shipped_weights(model: &AdaptableModel, folder: &Path) -> anyhow::Result<PathBuf> {
    let Some(weights) = models::weights::shipped(model.id)? else {
        bail!("this program has no weights of `{}` to start from", model.id);
    };
    let path = folder.join("shipped.safetensors");
    write_result(Some(&path), |out| out.write_all(&weights.bytes))?;
    Ok(path)
}

/// Returns the haste that was chosen, or chooses it.
fn chosen_haste(
    args: &AdaptArgs,
    model: &AdaptableModel,
    weights: (&Path, &Path),
    files: &Files,
    jobs: usize,
    stop: &AtomicBool,
) -> anyhow::Result<Option<String>> {
    let path = args.out.join(HASTE);
    if path.exists() {
        let text = String::from_utf8(read_regular(&path)?)?;
        return Ok(Some(text.trim().to_owned()));
    }
    let scenarios = (args.minutes * MOST_TRIED).clamp(10.0, 200.0) as usize;
    let Some(value) = choice::choose(model, weights, &files.tuning, scenarios, (args.seed, jobs), stop)?
    else {
        return Ok(None);
    };
    write_result(Some(&path), |out| writeln!(out, "{value}"))?;
    Ok(Some(value.to_owned()))
}

/// Returns the arguments of `run` that add the adapted model.
fn variant_arguments(model: &AdaptableModel, weights: &Path, haste: Option<&str>) -> Vec<String> {
    let id = format!("{}@mine", model.id);
    let mut arguments = vec![
        "--models".to_owned(),
        format!("constant-velocity,idm,{},{id}", model.id),
        "--model-weights".to_owned(),
        format!("{id}={}", weights.display()),
    ];
    if let Some(haste) = haste {
        arguments.extend(["--set".to_owned(), format!("{id}.{}={haste}", choice::HASTE)]);
    }
    arguments
}

/// Runs the model before and after, and baselines, on every group of scenarios to judge by, with about these
/// numbers of rollouts. Prints the verdict, the differences and one table. `None` if it was interrupted.
fn table(
    args: &AdaptArgs,
    arguments: &[String],
    (files, numbers): (&Files, [usize; 3]),
    mut judgement: Judgement<'_>,
    stop: &AtomicBool,
) -> anyhow::Result<Option<(ExitStatus, Verdict)>> {
    let runs: [(Group, &PathBuf, &[&str]); 3] = [
        (Group::Reactive, &files.deviated, &[]),
        (Group::Generated, &files.generated, &[]),
        (Group::Realism, &files.judged, &["--protocol", "realism"]),
    ];
    let recording = files.recordings()?;
    let mut summaries = Vec::new();
    for ((group, scenarios, protocol), number) in runs.into_iter().zip(numbers) {
        let (name, count) = (group.name(), ByNumber::open(scenarios)?.len());
        if count == 0 {
            if group == Group::Reactive {
                say(format_args!(
                    "warning: no AV of the part to judge by could deviate: there is no run in the reactive protocol"
                ));
            }
            continue;
        }
        let out = args.out.join(name);
        let mut line: Vec<OsString> = vec!["run".into(), scenarios.into()];
        line.extend(protocol.iter().map(OsString::from));
        line.extend(arguments.iter().map(OsString::from));
        line.extend(run_arguments(&out, args.resume, args.jobs));
        line.extend(["--columns".into(), COLUMNS.into()]);
        line.extend(["--rollouts".into(), rollouts(count, number).to_string().into()]);
        let run = RunArgs::parse(line)?;
        let Some((folder, mut summary)) = finished_until(&run, stop)? else { return Ok(None) };
        if let Some(folder) = folder {
            put_table(&folder, &summary, TableStyle::default())?;
        }
        report_problems(&summary);
        let found = compared((group, &out), judgement.model.id, args.seed, &recording)?;
        judgement.groups.extend(found.map(|found| (group, found)));
        // The table is for all scenarios: that of the folder has the categories of deviations.
        for simulator in summary.simulators.values_mut() {
            simulator.by_category.clear();
            simulator.by_difficulty.clear();
        }
        summaries.push((name, summary, run.table));
    }
    let rows: Vec<Run<'_>> = summaries.iter().map(|(name, summary, _)| Run { name, summary }).collect();
    let Some((.., style)) = summaries.last() else { bail!("there is no scenario to judge by") };
    write_result(Some(&args.out.join(VERDICT)), |file| writeln!(file, "{:#}", judgement.to_json()))?;
    write_result(None, |out| judgement.write(out))?;
    style.write(&rows, None, None, "")?;
    let failed = rows.iter().any(|run| !run.summary.provenance.failures.is_empty());
    let status = if failed { ExitStatus::SomeFailed } else { ExitStatus::Done };
    Ok(Some((status, judgement.verdict())))
}

/// Returns the number of rollouts of each of `count` scenarios, for about `number` of them in all.
fn rollouts(count: usize, number: usize) -> u32 {
    u32::try_from(number / count.max(1)).unwrap_or(u32::MAX).clamp(1, MOST_ROLLOUTS)
}

/// Compares the model before and after in the run of a group, in the columns of the table by which it is
/// judged there. Scenarios of one recording depend on each other. `None` if there is no scenario in which
/// both have a result.
fn compared(
    (group, run): (Group, &Path),
    id: &str,
    seed: u64,
    recording: &dyn Fn(&str) -> String,
) -> anyhow::Result<Option<Comparison>> {
    let tally = read_tally(run)?;
    let mut found =
        match Comparison::of_groups((&tally, id), (&tally, &format!("{id}@mine")), seed, recording) {
            Err(EvaluationError::NothingInCommon { .. }) => return Ok(None),
            found => found?,
        };
    found.metrics.retain(|metric, _| COLUMNS.split(',').any(|column| column == *metric) && group.has(metric));
    Ok(Some(found))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_scenarios_have_more_rollouts() {
        assert_eq!([rollouts(45, 90), rollouts(40, 90), rollouts(15, 90)], [2, 2, 6]);
        assert_eq!([rollouts(3, 90), rollouts(60, 90), rollouts(99, 90)], [8, 1, 1]);
    }
}
