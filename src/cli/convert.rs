//! `reactsim convert`: scenarios of any format to native Parquet.

use std::collections::BTreeSet;
use std::path::PathBuf;

use anyhow::bail;
use clap::Args;

use super::certified;
use super::futures::Futures;
use super::inputs::inputs_of;
use super::output::{ExitStatus, count, nothing, say};
use super::progress::Progress;
use crate::curation::driver::CurationObserver;
use crate::evaluation::{ReadingSpec, SelectionSpec};
use crate::formats::native::Writer;
use crate::formats::{self, FormatError, Scenarios};
use crate::scene::Scenario;

/// Arguments of `convert`.
#[derive(Debug, Args)]
pub(super) struct ConvertArgs {
    /// Files, folders or URLs of scenarios
    #[arg(required_unless_present = "filter", value_name = "IN")]
    inputs: Vec<PathBuf>,
    /// The native Parquet file to write
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    #[command(flatten)]
    selection: SelectionSpec,
    #[command(flatten)]
    reading: ReadingSpec,
    /// Rollouts (of `run --keep-rollouts`) that replace the logged future; scenarios without a
    /// rollout are left out
    #[arg(long, value_name = "ROLLOUTS", requires = "model")]
    futures: Option<PathBuf>,
    /// Deviations (of `curate`) that replace the logged future of the AV, and whose certificates replace the
    /// future of the agents that respond to it; scenarios without a certificate are left out
    #[arg(long, value_name = "DEVIATIONS", conflicts_with = "futures")]
    certificates: Option<PathBuf>,
    /// Leave out everything after the current frame, so that the file can be given to others
    #[arg(long, conflicts_with_all = ["futures", "certificates"])]
    history_only: bool,
    /// Simulator whose rollouts are taken
    #[arg(long, value_name = "ID", requires = "futures")]
    model: Option<String>,
}

pub(super) fn convert(args: &ConvertArgs) -> anyhow::Result<ExitStatus> {
    // Find all inputs before reading the first and before touching the output.
    let inputs = inputs_of(&args.reading, &args.inputs)?;
    let replacer: Option<Replacer> = match (&args.futures, &args.model, &args.certificates) {
        (Some(path), Some(model), _) => {
            let mut futures = Futures::open(path, model)?;
            Some(Box::new(move |scenario| futures.put_into(scenario)))
        }
        (_, _, Some(path)) => {
            let deviations = certified::open(path)?;
            Some(Box::new(move |scenario| certified::put_into(&deviations, scenario)))
        }
        _ => None,
    };
    let progress = Progress::new();
    let streamed = stream(&inputs, args, replacer, &progress);
    progress.end();
    let (good, bad) = streamed?;
    say(format_args!("converted {}, {bad} failed", count(good, "scenario")));
    Ok(if bad > 0 { ExitStatus::SomeFailed } else { ExitStatus::Done })
}

/// Replaces the future of a scenario. Returns `false` if there is none for it.
type Replacer = Box<dyn FnMut(&mut Scenario) -> anyhow::Result<bool>>;

/// Writes every readable scenario. Returns the numbers of written and of failed scenarios.
fn stream(
    inputs: &[formats::Input],
    args: &ConvertArgs,
    mut replacer: Option<Replacer>,
    progress: &Progress,
) -> anyhow::Result<(usize, usize)> {
    let mut writer = Writer::create(&args.out)?;
    progress.set_total(inputs.iter().map(formats::Input::count).sum());
    let (mut good, mut bad, mut ids) = (0, 0, BTreeSet::new());
    let selection = args.selection.selection();
    for (done, (input, scenario)) in scenarios(inputs).enumerate() {
        progress.scenario_done(done);
        let mut scenario = match scenario {
            Ok(scenario) if !selection.has(&scenario, None, false) => continue,
            Ok(scenario) if ids.insert(scenario.id.clone()) => scenario,
            Ok(scenario) => {
                let file = input.path.display();
                progress.failed(&format!("{file}: scenario `{}`: an earlier one has this id", scenario.id));
                bad += 1;
                continue;
            }
            Err(error) => {
                progress.failed(&error.to_string());
                bad += 1;
                continue;
            }
        };
        if let Some(replace) = &mut replacer
            && !replace(&mut scenario)?
        {
            continue;
        }
        if args.history_only {
            scenario = scenario.without_future();
        }
        writer.write(&scenario)?;
        good += 1;
    }
    // Dropped unfinished, the writer leaves no file behind.
    if good == 0 && bad == 0 {
        bail!("no scenario is selected: leave out --id, --category, --futures or --certificates");
    }
    if good == 0 {
        return Err(nothing("no scenario could be converted"));
    }
    writer.finish()?;
    Ok((good, bad))
}

/// Returns the scenarios of all files, each with its file. A file that cannot be opened counts as one
/// scenario.
fn scenarios(
    inputs: &[formats::Input],
) -> impl Iterator<Item = (&formats::Input, Result<Scenario, FormatError>)> {
    inputs.iter().flat_map(|input| {
        let scenarios: Scenarios = input.open().unwrap_or_else(|error| Box::new(std::iter::once(Err(error))));
        scenarios.map(move |scenario| (input, scenario))
    })
}
