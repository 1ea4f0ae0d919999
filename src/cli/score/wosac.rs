//! `reactsim score --wosac`: the realism metrics of the Sim Agents challenge.

use std::fs;
use std::io::{self, Write};
use std::path::Path;

use anyhow::bail;
use clap::Args;

use super::ScoreArgs;
use crate::cli::inputs::recorded_logs;
use crate::cli::output::{ExitStatus, count, lock_folder, note, nothing, say, write_result};
use crate::cli::partition::PartitionArg;
use crate::cli::progress::Progress;
use crate::cli::subject::JobsArg;
use crate::evaluation::PROVENANCE;
use crate::evaluation::realism::{
    LogFiles, LogSource, REALISM_ROWS, RealismFailure, RealismScores, RealismSettings, RunPairs,
    SubmittedPairs, score_all,
};
use crate::formats::wosac::SubmissionReader;
use crate::metrics::wosac::Config;
use crate::report::wosac_tables;

/// Number of missing scenarios that are named.
const NAMED_MISSING: usize = 3;

/// Arguments of `score --wosac`.
#[derive(Debug, Args)]
pub(super) struct WosacArgs {
    /// Compute the realism metrics of the Waymo Open Sim Agents Challenge. --scenarios are then files of the
    /// Waymo Open Motion Dataset, or for a run folder its scenarios [default: the shipped ones]
    #[arg(long)]
    pub(super) wosac: bool,
    /// Configurations: 2025, 2024, 2023 (histograms and weights of that year, present code),
    /// 2024_challenge_code
    #[arg(long = "wosac-config", value_name = "YEAR", value_delimiter = ',', value_parser = config,
          default_value = "2025")]
    pub(super) configs: Vec<Config>,
    /// Accept a submission with scenarios of the recordings missing, or with another number of rollouts than
    /// 32
    #[arg(long)]
    pub(super) partial: bool,
    /// Simulator, if the run has several
    #[arg(long, value_name = "ID")]
    pub(super) simulator: Option<String>,
    #[command(flatten)]
    jobs: JobsArg,
    #[command(flatten)]
    pub(super) partition: PartitionArg,
}

impl WosacArgs {
    /// Refuses options without effect.
    pub(super) fn check_absent(&self) -> anyhow::Result<()> {
        let only_2025 = matches!(self.configs.as_slice(), [config] if config.id == Config::CHALLENGE_2025.id);
        for (option, is_given) in [
            ("--wosac-config", !only_2025),
            ("--partial", self.partial),
            ("--simulator", self.simulator.is_some()),
            ("--jobs", self.jobs.jobs.is_some()),
            ("--partition", self.partition.partition.is_some()),
        ] {
            if is_given {
                bail!("{option} goes with --wosac only");
            }
        }
        Ok(())
    }
}

fn config(id: &str) -> Result<Config, String> {
    let known = || Config::ALL.map(|config| config.id).join(", ");
    Config::find(id).ok_or_else(|| format!("expected one of {}", known()))
}

pub(super) fn score(args: &ScoreArgs) -> anyhow::Result<ExitStatus> {
    let path = check(args)?;
    let _lock = args.out.as_deref().map(lock_folder).transpose()?;
    let (settings, progress) = (settings(args)?, Progress::new());
    let mut observe = observer(&progress);
    let scores = if is_run(path) {
        score_run(args, run_pairs(args, path)?, &settings, &mut observe)
    } else {
        let mut pairs = submitted_pairs(args, path)?;
        let mut scores = score_all(pairs.by_ref(), &settings, &mut observe);
        describe_submission(args, &mut scores, &mut pairs, &mut observe);
        scores
    };
    progress.end();
    finish(args, &scores)
}

/// Returns what is computed. Only JSON has the shares of the rollouts.
pub(super) fn settings(args: &ScoreArgs) -> anyhow::Result<RealismSettings<'_>> {
    Ok(RealismSettings {
        configs: &args.wosac.configs,
        shares: matches!(Format::of(args.format.as_deref())?, Format::Json),
        jobs: args.wosac.jobs.count(),
    })
}

/// Checks the options; returns the path of the rollouts.
pub(super) fn check(args: &ScoreArgs) -> anyhow::Result<&Path> {
    let [path] = args.rollouts.as_slice() else {
        bail!("give one submission or run folder with --wosac");
    };
    args.check_not_read("realism is computed for 80 steps after the recorded frame, or as a run states")?;
    let has_reactions = !args.motion.allow.is_empty() || args.deviations.is_some();
    if !args.metric_options.is_empty() || has_reactions || !args.table.is_usual() {
        bail!(
            "--metric-option, --allow, --deviations and options of tables have no effect with --wosac: leave \
             them out"
        );
    }
    Format::of(args.format.as_deref())?;
    if !path.exists() {
        bail!("could not find {}: give a submission or a run folder", path.display());
    }
    if args
        .out
        .as_deref()
        .is_some_and(|out| out.exists() && fs::read_dir(out).map_or(true, |mut d| d.next().is_some()))
    {
        bail!("--out names a folder to write, which must be new or empty");
    }
    if args.wosac.simulator.is_some() && !is_run(path) {
        bail!("--simulator goes with a run folder: a submission has one method");
    }
    Ok(path)
}

/// Returns whether the rollouts are those of a run folder, not of a submission.
pub(super) fn is_run(rollouts: &Path) -> bool {
    rollouts.join(PROVENANCE).exists()
}

/// Shows what is scored.
pub(super) fn observer(progress: &Progress) -> impl FnMut(usize, Option<&RealismFailure>) {
    |done: usize, failure: Option<&RealismFailure>| match failure {
        Some(failure) => progress.failure(format_args!(": {}", failure.error)),
        None => progress.set_done(done),
    }
}

/// Opens the rollouts of a run folder with their logs.
pub(super) fn run_pairs(args: &ScoreArgs, folder: &Path) -> anyhow::Result<RunPairs> {
    let sources = recorded_logs(&args.scenarios)?;
    Ok(RunPairs::open(folder, args.wosac.simulator.as_deref(), sources)?)
}

/// Scores the rollouts of a run, and adds what is known about them.
pub(super) fn score_run(
    args: &ScoreArgs,
    mut pairs: RunPairs,
    settings: &RealismSettings<'_>,
    observe: &mut dyn FnMut(usize, Option<&RealismFailure>),
) -> RealismScores {
    let mut scores = score_all(pairs.by_ref(), settings, observe);
    pairs.simulator().clone_into(&mut scores.method);
    if !args.wosac.partial {
        scores.missing.extend_from_slice(pairs.missing());
    }
    scores
}

/// Opens a submission with its logs.
pub(super) fn submitted_pairs(args: &ScoreArgs, path: &Path) -> anyhow::Result<SubmittedPairs> {
    let mut recordings = Vec::new();
    for source in recorded_logs(&args.scenarios)? {
        match source {
            LogSource::Recording(path) => recordings.push(path),
            LogSource::Scenarios(_) | LogSource::Shipped => bail!(
                "a submission needs the recordings of its scenarios: give files of the Waymo Open Motion \
                 Dataset with --scenarios"
            ),
        }
    }
    Ok(SubmittedPairs::new(SubmissionReader::open(path)?, LogFiles::new(recordings), args.wosac.partial))
}

/// Adds what is known about a submission that was read to its end.
pub(super) fn describe_submission(
    args: &ScoreArgs,
    scores: &mut RealismScores,
    pairs: &mut SubmittedPairs,
    observe: &mut dyn FnMut(usize, Option<&RealismFailure>),
) {
    pairs.method().unwrap_or_default().clone_into(&mut scores.method);
    let (missing, unreadable) = if args.wosac.partial { Default::default() } else { pairs.missing() };
    scores.missing = missing;
    for error in unreadable {
        let failure = RealismFailure { scenario_id: None, error: error.to_string() };
        observe(scores.rows.len() + scores.failures.len(), Some(&failure));
        scores.failures.push(failure);
    }
    if pairs.is_plain_archive() && !args.wosac.partial {
        say(format_args!(
            "warning: the server would refuse the submission: it is a tar archive without gzip compression; \
             make it a .tar.gz"
        ));
    }
    if let Some(fault) = pairs.metadata_fault().filter(|_| !args.wosac.partial) {
        say(format_args!("warning: the server would refuse the metadata: {fault}"));
    }
}

/// Format of the result on stdout.
#[derive(Clone, Copy)]
enum Format {
    Markdown,
    Json,
    Csv,
}

impl Format {
    fn of(name: Option<&str>) -> anyhow::Result<Self> {
        match name {
            None | Some("markdown" | "terminal") => Ok(Self::Markdown),
            Some("json") => Ok(Self::Json),
            Some("csv") => Ok(Self::Csv),
            Some(other) => bail!("--wosac has no format `{other}`: choose markdown, json or csv"),
        }
    }
}

/// Prints the result and writes the folder, which is locked.
pub(super) fn finish(args: &ScoreArgs, scores: &RealismScores) -> anyhow::Result<ExitStatus> {
    let format = Format::of(args.format.as_deref())?;
    if scores.rows.is_empty() {
        return Err(nothing("no scenario could be scored"));
    }
    write_result(None, |out| match format {
        Format::Markdown => wosac_tables::write_markdown(scores, out),
        Format::Json => scores.write_json(out),
        Format::Csv => wosac_tables::write_csv(scores, out),
    })?;
    if let Some(folder) = &args.out {
        let write = |name: &str, writer: fn(&RealismScores, &mut dyn Write) -> io::Result<()>| {
            write_result(Some(&folder.join(name)), |out| writer(scores, out))
        };
        write(REALISM_ROWS, RealismScores::write_rows)?;
        write("wosac.md", wosac_tables::write_markdown)?;
        write("wosac.json", RealismScores::write_json)?;
        note(format_args!("{} contains wosac.json, wosac.md and wosac.jsonl", folder.display()));
    }
    if !scores.missing.is_empty() {
        let named: Vec<&str> = scores.missing.iter().take(NAMED_MISSING).map(String::as_str).collect();
        let more = if scores.missing.len() > NAMED_MISSING { ", …" } else { "" };
        let n = count(scores.missing.len(), "scenario");
        say(format_args!("warning: {n} without rollouts: {}{more}", named.join(", ")));
    }
    if !scores.failures.is_empty() {
        let n = scores.failures.len();
        say(format_args!("warning: {n} failed; the means are those of the others"));
    }
    let is_whole = scores.failures.is_empty() && scores.missing.is_empty();
    Ok(if is_whole { ExitStatus::Done } else { ExitStatus::SomeFailed })
}
