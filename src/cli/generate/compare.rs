//! `reactsim generate compare`: compares generated logs with recorded ones.

use std::fs::OpenOptions;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use anyhow::bail;
use clap::{Args, ValueEnum};

use crate::cli::progress::Progress;
use crate::cli::{ExitStatus, find_inputs, say, write_result};
use crate::curation::driver::CurationObserver;
use crate::formats::{FormatError, Input, PendingScenarios};
use crate::generation::realism::{Comparison, Measured};
use crate::report::{realism_charts, realism_tables};
use crate::work::available_threads;

/// Arguments of `generate compare`.
#[derive(Debug, Args)]
pub(super) struct CompareArgs {
    /// File or folder of the generated scenarios
    #[arg(value_name = "GENERATED")]
    generated: PathBuf,
    /// File or folder of the scenarios to compare them with
    #[arg(value_name = "REFERENCE")]
    reference: PathBuf,
    /// Format of the output
    #[arg(long, value_enum, default_value = "markdown")]
    format: Format,
    /// Also draw the histograms to this file, as SVG
    #[arg(long, value_name = "FILE")]
    svg: Option<PathBuf>,
    /// Only the first N scenarios of every file [default: all]
    #[arg(long, value_name = "N")]
    limit: Option<NonZeroUsize>,
    /// Threads; they do not change the result [default: one per core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    jobs: Option<u16>,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Format {
    /// Readable tables
    Markdown,
    /// One line per statistic and set
    Csv,
    /// All values, including histograms
    Json,
}

pub(super) fn compare(args: &CompareArgs) -> anyhow::Result<ExitStatus> {
    // Report every input error before the first scenario.
    let inputs = |path: &PathBuf| find_inputs(std::slice::from_ref(path));
    let (generated, reference) = (inputs(&args.generated)?, inputs(&args.reference)?);
    if let Some(path) = &args.svg {
        // The picture is written at the end: check now that the file can be written.
        OpenOptions::new()
            .append(true)
            .create(true)
            .open(path)
            .with_context(|| format!("could not write {}", path.display()))?;
    }
    let progress = Progress::new();
    let sets = measured(&args.generated, generated, args, &progress)
        .and_then(|set| Ok((set, measured(&args.reference, reference, args, &progress)?)));
    progress.end();
    let (generated, reference) = sets?;
    let comparison =
        Comparison::new((&name(&args.generated), &generated), (&name(&args.reference), &reference));
    if let Some(path) = &args.svg {
        let svg = realism_charts::draw(&comparison)?;
        write_result(Some(path), |out| out.write_all(svg.as_bytes()))?;
    }
    write_result(None, |out| match args.format {
        Format::Markdown => realism_tables::write_markdown(out, &comparison),
        Format::Csv => realism_tables::write_csv(out, &comparison),
        Format::Json => realism_tables::write_json(out, &comparison),
    })?;
    let failures = generated.failures + reference.failures;
    if failures > 0 {
        say(format_args!("warning: {failures} records could not be read; the others are compared"));
        return Ok(ExitStatus::SomeFailed);
    }
    Ok(ExitStatus::Done)
}

/// Reads and measures the scenarios at a path.
fn measured(
    path: &Path,
    inputs: Vec<Input>,
    args: &CompareArgs,
    progress: &Progress,
) -> anyhow::Result<Measured> {
    let most = args.limit.map_or(usize::MAX, NonZeroUsize::get);
    let jobs = args.jobs.map_or_else(available_threads, usize::from);
    let mut done = 0;
    let records = inputs.into_iter().flat_map(|input| -> PendingScenarios {
        match input.open_undecoded() {
            Ok(records) => Box::new(records.take(most)),
            Err(error) => Box::new(std::iter::once(Err(error))),
        }
    });
    let records = records.map(|record| {
        done += 1;
        CurationObserver::scenario_done(progress, done);
        move || record.and_then(|decode| decode())
    });
    let set = Measured::of(records, jobs, |error: FormatError| {
        CurationObserver::failed(progress, &error.to_string());
    });
    if set.halves[0].scenarios == 0 {
        bail!("{}: no scenario could be read", path.display());
    }
    Ok(set)
}

/// Returns the name of a file or folder without the path to it, which is private to this machine.
fn name(path: &Path) -> String {
    let name = path.canonicalize().ok().and_then(|p| Some(p.file_name()?.to_string_lossy().into_owned()));
    name.unwrap_or_else(|| path.display().to_string())
}
