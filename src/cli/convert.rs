//! `reactsim convert`: any format to native Parquet.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use anyhow::bail;
use clap::Args;

use super::futures::Futures;
use super::{ExitStatus, Reading, count, say};
use crate::formats::{self, native::Writer};

/// Arguments of `convert`.
#[derive(Debug, Args)]
pub(super) struct ConvertArgs {
    /// Files or folders of scenarios
    #[arg(required = true, value_name = "IN")]
    inputs: Vec<PathBuf>,
    /// The native Parquet file to write
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    #[command(flatten)]
    reading: Reading,
    /// Rollouts (`run --keep-rollouts`) that take the place of what was logged after the current frame; scenarios without one are left out
    #[arg(long, value_name = "ROLLOUTS", requires = "model")]
    futures: Option<PathBuf>,
    /// The simulator whose rollouts these are
    #[arg(long, value_name = "ID", requires = "futures")]
    model: Option<String>,
}

pub(super) fn convert(args: &ConvertArgs) -> anyhow::Result<ExitStatus> {
    // All inputs are found before the first is read, and before the output is touched.
    let inputs = args.reading.find_inputs(&args.inputs)?;
    if let Some(same) = inputs.iter().find(|i| is_same(&i.path, &args.out)) {
        bail!("{} is both input and output; choose another --out", same.path.display());
    }
    let mut futures = match (&args.futures, &args.model) {
        (Some(path), Some(model)) => Some(Futures::open(path, model)?),
        _ => None,
    };
    let (good, bad) = stream(&inputs, &args.out, futures.as_mut())?;
    say(format_args!("converted {}, {bad} failed", count(good, "scenario")));
    Ok(if bad > 0 { ExitStatus::SomeFailed } else { ExitStatus::Done })
}

/// Writes every good scenario; counts the good and the bad.
fn stream(
    inputs: &[formats::Input],
    out: &Path,
    mut futures: Option<&mut Futures>,
) -> anyhow::Result<(usize, usize)> {
    let mut writer = Writer::create(out)?;
    let (mut good, mut bad, mut ids) = (0, 0, BTreeSet::new());
    for input in inputs {
        let scenarios = match input.open() {
            Ok(scenarios) => scenarios,
            Err(error) => {
                say(format_args!("warning: {error}"));
                bad += 1;
                continue;
            }
        };
        for scenario in scenarios {
            match scenario {
                Ok(scenario) if !ids.insert(scenario.id.clone()) => {
                    let file = input.path.display();
                    say(format_args!(
                        "warning: {file}: scenario `{}`: an earlier one has this id",
                        scenario.id
                    ));
                    bad += 1;
                }
                Ok(mut scenario) => {
                    if let Some(futures) = &mut futures
                        && !futures.put_into(&mut scenario)?
                    {
                        continue;
                    }
                    writer.write(&scenario)?;
                    good += 1;
                }
                Err(error) => {
                    say(format_args!("warning: {error}"));
                    bad += 1;
                }
            }
        }
    }
    // The writer leaves no file behind where it is not finished.
    if good == 0 {
        bail!("no scenario could be converted: see the warnings above");
    }
    writer.finish()?;
    Ok((good, bad))
}

fn is_same(a: &Path, b: &Path) -> bool {
    matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b)
}
