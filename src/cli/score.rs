//! `reactsim score`: scores rollouts that any program produced.

mod partition;
mod wosac;

pub(super) use partition::merge;

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use clap::Args;

use super::finished::{put_table, report_notes, show_next_steps};
use super::inputs::inputs_of;
use super::output::{ExitStatus, count, nothing, say, write_result};
use super::table_output::{TableArgs, formats as table_formats};
use crate::evaluation::document::{check_document, score_document};
use crate::evaluation::{
    AddedMetrics, Deviations, Failure, MotionSpec, NuplanSpec, ReadingSpec, RunFolder, RunObserver, Scoring,
    metric_options, split_metric_option,
};
use crate::files::read_regular;
use crate::formats;
use crate::formats::document::Document;
use crate::report::Run;

/// Arguments of `score`.
#[derive(Debug, Args)]
pub(super) struct ScoreArgs {
    /// A rollout document (JSON), or rollouts in Parquet, which need --scenarios; with --wosac a submission
    /// to the Sim Agents challenge (.tar.gz, a folder or a .binproto) or a run folder with kept rollouts;
    /// with --add-metrics a run folder
    #[arg(required = true, value_name = "ROLLOUTS")]
    rollouts: Vec<PathBuf>,
    /// Scenarios of the rollouts; may be repeated
    #[arg(long, value_name = "PATH")]
    scenarios: Vec<PathBuf>,
    #[command(flatten)]
    reading: ReadingSpec,
    /// Metrics of your own that any program computed for the rollouts of a run, as JSON: their values and
    /// events are added to the run folder
    #[arg(long, value_name = "FILE", conflicts_with_all = ["scenarios", "deviations", "allow", "pose",
          "metric_options", "out", "wosac"])]
    add_metrics: Option<PathBuf>,
    /// Deviated AVs with which the rollouts were made, if they are not those in the scenario files
    #[arg(long, value_name = "FILE")]
    deviations: Option<PathBuf>,
    #[command(flatten)]
    motion: MotionSpec,
    /// Variant of the metrics, such as fault_order=nuplan; may be repeated. `reactsim list
    /// metric-options` shows all
    #[arg(long = "metric-option", value_name = "NAME=VALUE")]
    metric_options: Vec<String>,
    /// Format of the table [default: terminal on a terminal, else markdown]
    #[arg(long, value_parser = table_formats([]))]
    format: Option<String>,
    #[command(flatten)]
    table: TableArgs,
    /// For rollouts in Parquet a run folder to write: provenance, rows, events, rollouts, summary; for a
    /// document the file of the scores [default: stdout only]
    #[arg(long, value_name = "PATH")]
    out: Option<PathBuf>,
    #[command(flatten)]
    wosac: wosac::WosacArgs,
}

impl ScoreArgs {
    /// Refuses options that say how scenarios are read, where none are, for this reason.
    fn check_not_read(&self, reason: &str) -> anyhow::Result<()> {
        let nuplan = (self.reading.nuplan != NuplanSpec::default()).then_some("nuplan");
        match self.reading.named().map(|(key, _)| key).chain(nuplan).next() {
            Some(key) => bail!("{reason}: leave --{key} out"),
            None => Ok(()),
        }
    }
}

pub(super) fn score(args: &ScoreArgs) -> anyhow::Result<ExitStatus> {
    if args.wosac.wosac {
        return match (args.wosac.partition.partition, &args.out) {
            (Some(partition), Some(out)) => partition::score(args, partition, out),
            _ => wosac::score(args),
        };
    }
    args.wosac.check_absent()?;
    args.table.check(args.format.as_deref())?;
    if let Some(file) = &args.add_metrics {
        return add_metrics(args, file);
    }
    let is_parquet = |path: &PathBuf| {
        formats::is_parquet(path).with_context(|| format!("could not read {}", path.display()))
    };
    let kinds: Vec<bool> = args.rollouts.iter().map(is_parquet).collect::<Result<_, _>>()?;
    match (kinds.iter().all(|p| *p), args.rollouts.as_slice()) {
        (true, paths) => score_parquet(args, paths),
        (false, [document]) => score_json(args, document),
        (false, _) => bail!("give one rollout document, or any number of rollout files in Parquet"),
    }
}

fn add_metrics(args: &ScoreArgs, file: &Path) -> anyhow::Result<ExitStatus> {
    args.check_not_read("the scenarios of a run are known")?;
    let [folder] = args.rollouts.as_slice() else { bail!("give one run folder with --add-metrics") };
    let (run, summary) = AddedMetrics::add(file, folder)?;
    put_table(&run, &summary, args.table.style())?;
    args.table.write(&[Run { name: "", summary: &summary }], args.format.as_deref(), None, "")?;
    Ok(ExitStatus::Done)
}

fn score_json(args: &ScoreArgs, path: &Path) -> anyhow::Result<ExitStatus> {
    if !args.scenarios.is_empty() {
        bail!("a rollout document holds its scenarios: leave --scenarios out");
    }
    args.check_not_read("a rollout document holds its scenarios")?;
    if !args.motion.allow.is_empty() || args.deviations.is_some() {
        bail!("a rollout document is scored as it is: leave --allow and --deviations out");
    }
    if !args.table.is_usual() || args.format.is_some() {
        bail!("a rollout document is scored without a table: leave the options of tables out");
    }
    let read = || format!("could not read {}", path.display());
    let text = String::from_utf8(read_regular(path).with_context(read)?).with_context(read)?;
    let mut document = Document::from_json(&text).with_context(read)?;
    // Options of the command line take precedence over those of the document.
    for option in &args.metric_options {
        let (name, value) = split_metric_option(option)?;
        document.options.push((name.to_owned(), value.to_owned()));
    }
    for (check, n, first) in check_document(&document).iter() {
        let n = count(n, "scenario");
        say(format_args!(
            "warning: check `{}` of the motion fails in {n}, the first: {first}",
            check.allowance()
        ));
    }
    let result = score_document(&document).with_context(read)?;
    write_result(args.out.as_deref(), |out| {
        serde_json::to_writer_pretty(&mut *out, &result)?;
        out.write_all(b"\n")
    })?;
    Ok(ExitStatus::Done)
}

fn score_parquet(args: &ScoreArgs, paths: &[PathBuf]) -> anyhow::Result<ExitStatus> {
    if args.reading.is_shipped(&args.scenarios) {
        bail!("rollouts in Parquet need their scenarios: give --scenarios <path>");
    }
    let options = metric_options(&args.metric_options)?;
    let inputs = inputs_of(&args.reading, &args.scenarios)?;
    let mut scoring = Scoring::new(paths, &inputs, options, args.motion.pose.unwrap_or_default())?;
    if let Some(path) = &args.deviations {
        scoring = scoring.deviations(Deviations::read(path)?);
    }
    let folder = args.out.as_ref().map(|path| RunFolder::create(path, scoring.provenance())).transpose()?;
    let scored = scoring.run(&args.motion.allow, folder.as_ref(), &Warnings).map_err(anyhow::Error::from);
    let scored = scored.and_then(|summary| match summary.provenance.scenarios {
        0 => Err(nothing("no rollout could be scored")),
        _ => Ok(summary),
    });
    let summary = match scored {
        Ok(summary) => summary,
        Err(error) => {
            // Refused rollouts leave no folder that looks like a run.
            folder.map(RunFolder::discard).transpose()?;
            return Err(error);
        }
    };
    if let Some(folder) = &folder {
        put_table(folder, &summary, args.table.style())?;
    }
    report_notes(&summary);
    args.table.write(&[Run { name: "", summary: &summary }], args.format.as_deref(), None, "")?;
    if let Some(path) = &args.out {
        show_next_steps(path, true);
    }
    Ok(if summary.provenance.failures.is_empty() { ExitStatus::Done } else { ExitStatus::SomeFailed })
}

/// Prints failures as warnings.
struct Warnings;

impl RunObserver for Warnings {
    fn failed(&self, failure: &Failure) {
        let simulator = failure.simulator.as_deref().map(|s| format!("`{s}`: ")).unwrap_or_default();
        say(format_args!("warning: {simulator}{}", failure.error));
    }
}
