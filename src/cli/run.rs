//! `reactsim run`: simulators on scenarios.

use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::thread;

use anyhow::{Context, bail};
use clap::{Args, ValueEnum};

use super::progress::Progress;
use super::report::formats as table_formats;
use super::{ExitStatus, count, find_inputs, metric_options, say, shipped, stop_on_interrupt, write_result};
use crate::evaluation::{
    self, AV_CHOICES, Adjustments, AvChoice, Deviations, Execution, FileRecord, Outcome, Plan,
    PlannedSimulator, RunFolder, RunSettings, Source, Summary, TABLE, Tally,
};
use crate::formats::{self, FormatError, PendingScenarios};
use crate::models::qp::Smoothing;
use crate::report::{Run, exporter};
use crate::rollout::{Protocol, Replan, Settings};

/// A stage behind simulators, or none.
type Stage = std::option::Option<Smoothing>;

/// Arguments of `run`.
#[derive(Debug, Args)]
pub(super) struct RunArgs {
    /// Files or folders of scenarios [default: the shipped benchmark]
    #[arg(value_name = "SCENARIOS")]
    scenarios: Vec<PathBuf>,
    /// Simulators, separated by commas [default: all baselines that have what they need]
    #[arg(long, value_delimiter = ',', value_name = "IDS")]
    models: Vec<String>,
    /// Weights of a simulator, such as pufferdrive=puffer.safetensors; may be repeated
    #[arg(long = "model-weights", value_name = "ID=FILE")]
    model_weights: Vec<String>,
    /// Another value for a parameter of a simulator's card, such as idm.vehicle.headway=1.5; may be
    /// repeated
    #[arg(long, value_name = "ID.KEY=VALUE")]
    set: Vec<String>,
    /// A stage behind every simulator but log replay: qp (smooth, within limits, on the road and clear of
    /// others) or qp-alone (clear of nobody). Ids say it: idm+qp; --models takes such ids too
    #[arg(long, default_value = "off", value_name = "STAGE", value_parser = smoothing)]
    smooth: Stage,
    /// Whether the AV is an external input (Algorithm 1) or moved by the simulator too (2)
    #[arg(long, value_enum, default_value = "reactive")]
    protocol: ProtocolName,
    /// Who drives the AV: deviated, log, constant-velocity, brake:<m/s²>, retime:<factor>,
    /// shift:<m> or file:<path> [default: deviated]
    #[arg(long, value_name = "POLICY")]
    av: Option<AvChoice>,
    /// Deviated AVs by scenario id, Parquet or JSON; scenarios that it does not name are passed over
    #[arg(long, value_name = "FILE")]
    deviations: Option<PathBuf>,
    /// How often simulators plan anew, such as 2hz or 5steps
    #[arg(long, default_value = "2hz", value_name = "RATE")]
    replan: Replan,
    /// Whether agents at t+1 see the AV at t+1 (1) or only up to t (0)
    #[arg(long, default_value = "1", value_name = "0|1", value_parser = ["0", "1"])]
    av_lookahead: String,
    /// Seed of all random choices
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Rollouts per scenario and simulator
    #[arg(long, default_value_t = 1, value_name = "R", value_parser = clap::value_parser!(u32).range(1..=10_000))]
    rollouts: u32,
    /// Only the first N scenarios of every file [default: all]
    #[arg(long, value_name = "N")]
    limit: Option<NonZeroUsize>,
    /// A variant of the metrics, such as fault_order=nuplan; may be repeated
    #[arg(long = "metric-option", value_name = "NAME=VALUE")]
    metric_options: Vec<String>,
    /// Run folder: provenance, rows, events, summary [default: only the table is printed]
    #[arg(long, value_name = "FOLDER")]
    out: Option<PathBuf>,
    /// Continue the run in --out where it was interrupted
    #[arg(long, requires = "out")]
    resume: bool,
    /// Keep the rollouts in the run folder
    #[arg(long, requires = "out")]
    keep_rollouts: bool,
    /// Threads [default: one per core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    jobs: Option<u16>,
    /// Scenarios that a thread steps together; more need more memory
    #[arg(long, default_value = "4", value_name = "N")]
    batch: NonZeroUsize,
    /// Form of the table on stdout
    #[arg(long, default_value = "markdown", value_parser = table_formats())]
    format: String,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum ProtocolName {
    // Comments here would make the help of `run` twice as long; the flag's own says it.
    Reactive,
    Realism,
}

pub(super) fn run(args: RunArgs) -> anyhow::Result<ExitStatus> {
    // Everything that can be wrong is found before the first scenario.
    let plan = plan(&args)?;
    let mut tally = Tally::new(plan.simulators.iter().map(|s| s.id.clone()).collect(), args.rollouts);
    let provenance = plan.provenance();
    let folder = match &args.out {
        Some(path) if args.resume => Some(RunFolder::resume(path, &provenance, &mut tally)?),
        Some(path) => Some(RunFolder::create(path, &provenance)?),
        None => None,
    };
    let stop = stop_on_interrupt(if args.out.is_some() { "writing what is finished" } else { "stopping" })?;
    let jobs =
        args.jobs.map_or_else(|| thread::available_parallelism().map_or(1, NonZeroUsize::get), usize::from);
    let execution = Execution { jobs, batch: args.batch.get() };
    let progress = Progress::new();
    let outcome = evaluation::run(&plan, execution, folder.as_ref(), tally, &progress, &stop);
    progress.end();
    match outcome? {
        Outcome::Interrupted => {
            match &args.out {
                Some(path) => say(format_args!(
                    "interrupted; finished rows are in {}; go on with the same command and --resume",
                    path.display()
                )),
                None => say(format_args!("interrupted; nothing is kept without --out")),
            }
            Ok(ExitStatus::Interrupted)
        }
        Outcome::Finished(summary) => finish(&args, folder.as_ref(), &summary),
    }
}

/// Prints the table and says how it went.
fn finish(args: &RunArgs, folder: Option<&RunFolder>, summary: &Summary) -> anyhow::Result<ExitStatus> {
    let run = [Run { name: "", summary }];
    if let (Some(folder), Some(markdown)) = (folder, exporter("markdown")) {
        let mut text = Vec::new();
        markdown.export(&run, &mut text).context("could not make the table")?;
        let mut text = String::from_utf8_lossy(&text).into_owned();
        text.push_str(&outcomes(summary));
        text.push_str(&failures(summary));
        folder.put(TABLE, &text)?;
    }
    tell_left_out(summary);
    if summary.provenance.scenarios == 0 {
        bail!("no scenario could be run: see the warnings above");
    }
    if let Some(exporter) = exporter(&args.format) {
        write_result(None, |out| {
            exporter.export(&run, out)?;
            let below = if args.format == "markdown" { outcomes(summary) } else { String::new() };
            out.write_all(below.as_bytes())
        })?;
    }
    let failed = summary.provenance.failures.len();
    if failed > 0 {
        say(format_args!("warning: {failed} failed; the others are in the table"));
        return Ok(ExitStatus::SomeFailed);
    }
    Ok(ExitStatus::Done)
}

/// Says what the file of deviations and the inputs do not have in common.
fn tell_left_out(summary: &Summary) {
    let p = &summary.provenance;
    if p.passed_over > 0 {
        let n = count(p.passed_over, "scenario");
        say(format_args!("{n} passed over: no deviated AV in the file of deviations"));
    }
    if p.unused_deviations > 0 {
        let n = count(p.unused_deviations, "deviation");
        say(format_args!("warning: {n} not used: for scenarios that are not among those that were read"));
    }
}

/// Per simulator that counts them: how parts of plans ended.
fn endings(summary: &Summary) -> impl Iterator<Item = String> {
    let counting = summary.simulators.iter().filter(|(_, s)| !s.outcomes.is_empty());
    counting.map(|(id, simulator)| {
        let all = simulator.outcomes.iter().map(|(name, n)| format!("{n} {name}"));
        format!("{id}: {}", all.collect::<Vec<_>>().join(", "))
    })
}

/// The same as a list in Markdown, below the table.
fn outcomes(summary: &Summary) -> String {
    let lines: String = endings(summary).map(|line| format!("- {line}\n")).collect();
    if lines.is_empty() { lines } else { format!("\nHow plans ended:\n\n{lines}") }
}

/// What failed, as a list in Markdown.
fn failures(summary: &Summary) -> String {
    let failures = &summary.provenance.failures;
    let mut text = String::new();
    if !failures.is_empty() {
        text.push_str("\nFailed:\n\n");
    }
    for failure in failures {
        let simulator = failure.simulator.as_deref().map(|s| format!(" ({s})")).unwrap_or_default();
        let line = format!("- {} record {}{simulator}: {}\n", failure.file, failure.record, failure.error);
        text.push_str(&line);
    }
    text
}

fn plan(args: &RunArgs) -> anyhow::Result<Plan> {
    let options = metric_options(&args.metric_options)?;
    let simulators = PlannedSimulator::adjusted(&args.models, &adjustments(args)?)?;
    let protocol = match args.protocol {
        ProtocolName::Reactive => Protocol::Reactive,
        ProtocolName::Realism => Protocol::Realism,
    };
    if protocol == Protocol::Realism && (args.av.is_some() || args.deviations.is_some()) {
        bail!("the simulator moves the AV in the realism protocol: leave --av and --deviations out");
    }
    let deviated = matches!(args.av, None | Some(AvChoice::Deviated));
    let deviations = match (&args.deviations, &args.av) {
        (Some(_), Some(AvChoice::File(_))) => bail!("give either --deviations or --av file:<path>"),
        (Some(_), _) if !deviated => bail!("--deviations goes with --av deviated only"),
        (Some(path), _) | (None, Some(AvChoice::File(path))) => Some(read_deviations(path)?),
        (None, _) => None,
    };
    let sources = sources(&args.scenarios, args.limit)?;
    let av = match (&args.av, protocol) {
        (Some(av), _) => av.clone(),
        (None, Protocol::Realism) => AvChoice::Log,
        (None, Protocol::Reactive) => {
            if deviations.is_none() && !args.scenarios.is_empty() && !first_is_deviated(&sources) {
                bail!(
                    "the scenarios carry no deviated AV: give --deviations <file>, or say with --av who drives: \
                     {AV_CHOICES}"
                );
            }
            AvChoice::Deviated
        }
    };
    let settings = RunSettings {
        rollout: Settings {
            protocol,
            replan: args.replan,
            av_lookahead: args.av_lookahead == "1",
            seed: args.seed,
        },
        av,
        rollouts: args.rollouts,
        options,
        limit: args.limit.map(NonZeroUsize::get),
    };
    Ok(Plan { sources, simulators, deviations, settings, keep_rollouts: args.keep_rollouts })
}

/// The stage of a name; `off` is none.
fn smoothing(name: &str) -> Result<Option<Smoothing>, String> {
    if name == "off" {
        return Ok(None);
    }
    let all = || Smoothing::ALL.map(Smoothing::name).join(", ");
    Smoothing::from_name(name).map(Some).ok_or_else(|| format!("expected {} or off", all()))
}

/// The weights and parameters that were asked for.
fn adjustments(args: &RunArgs) -> anyhow::Result<Adjustments> {
    let mut asked = Adjustments { smoothing: args.smooth, ..Adjustments::default() };
    for text in &args.model_weights {
        match text.split_once('=') {
            Some((id, file)) if !id.is_empty() && !file.is_empty() => {
                asked.weights.push((id.to_owned(), PathBuf::from(file)));
            }
            _ => bail!("--model-weights `{text}`: write ID=FILE, such as pufferdrive=puffer.safetensors"),
        }
    }
    for text in &args.set {
        let parts = text.split_once('=').and_then(|(path, value)| Some((path.split_once('.')?, value)));
        let Some(((id, key), value)) = parts else {
            bail!("--set `{text}`: write ID.KEY=VALUE, such as idm.vehicle.headway=1.5");
        };
        asked.parameters.push((id.trim().to_owned(), key.trim().to_owned(), value.trim().to_owned()));
    }
    Ok(asked)
}

/// The files of scenarios, each found and recognised; the shipped benchmark where none is named.
fn sources(paths: &[PathBuf], limit: Option<NonZeroUsize>) -> anyhow::Result<Vec<Source>> {
    let most = limit.map_or(usize::MAX, NonZeroUsize::get);
    if paths.is_empty() {
        return Ok(vec![shipped::benchmark(most)]);
    }
    let mut sources = Vec::new();
    for input in find_inputs(paths)? {
        let file = FileRecord::of(&input.path, input.format.id())?;
        let open = Box::new(move || -> Result<PendingScenarios, FormatError> {
            Ok(Box::new(input.format.open_undecoded(&input.path)?.take(most)))
        });
        sources.push(Source { file, open });
    }
    Ok(sources)
}

fn read_deviations(path: &Path) -> anyhow::Result<Deviations> {
    let tracks = formats::deviations::read(path)?;
    Ok(Deviations { file: FileRecord::of(path, "deviations")?, tracks })
}

/// Whether the first scenario that can be read carries a deviated AV. Where none can be read the run will say so.
fn first_is_deviated(sources: &[Source]) -> bool {
    let scenarios = sources.iter().filter_map(|s| (s.open)().ok()).flatten();
    let mut readable = scenarios.filter_map(|s| s.and_then(|decode| decode()).ok());
    readable.next().is_none_or(|s| s.deviation.is_some())
}
