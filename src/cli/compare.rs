//! `reactsim compare`: two runs on the same scenarios.

use std::path::PathBuf;

use anyhow::bail;
use clap::Args;

use super::output::{ExitStatus, say, write_result};
use crate::evaluation::suggestion::did_you_mean;
use crate::evaluation::{
    Comparison, Condition, ConditionDifference, Provenance, read_provenance, read_tally,
};
use crate::metrics::{MetricSpec, Unit};
use crate::report::comparison;

const AFTER: &str = "\
Examples:
  reactsim compare runs/before runs/after
  reactsim compare runs/all runs/all --models idm,qp-regression
  reactsim compare runs/before runs/after --worse aav-collision=0.05 --worse offroad=0.5

Bounds are in the units of the tables (percent for rates). The last command exits with code 1 if \
a metric got worse by more than its bound in any comparison.

Runs are refused if they differ in a setting on which the numbers depend, unless --despite names \
it: protocol, av, av-lookahead, entering, deviations, replan, rollouts, metric-options.";

/// Arguments of `compare`.
#[derive(Debug, Args)]
#[command(after_help = AFTER)]
pub(super) struct CompareArgs {
    /// Folder of the first run
    #[arg(value_name = "FIRST")]
    first: PathBuf,
    /// Folder of the second run
    #[arg(value_name = "SECOND")]
    second: PathBuf,
    /// Simulator of the first run and simulator of the second [default: all that both runs have]
    #[arg(long, value_name = "ID,ID", value_delimiter = ',', num_args = 1)]
    models: Vec<String>,
    /// Compare although the runs differ in this setting; may be repeated
    #[arg(long, value_name = "SETTING", value_delimiter = ',', value_parser = condition)]
    despite: Vec<Condition>,
    /// Exit with code 1 if METRIC got worse by more than BOUND; may be repeated
    #[arg(long, value_name = "METRIC=BOUND")]
    worse: Vec<String>,
    /// Scenarios to list per metric: N that got worse and N that got better
    #[arg(long, value_name = "N", default_value_t = 3)]
    top: usize,
    /// Seed of all random choices
    #[arg(long, value_name = "S", default_value_t = 0)]
    seed: u64,
    /// Format of the output
    #[arg(long, default_value = "markdown", value_parser = ["markdown", "json"])]
    format: String,
}

/// Largest accepted worsening of a metric.
struct Bound {
    metric: &'static str,
    /// In the unit of the metric's values; rates as fractions.
    worsening: f64,
    /// As given on the command line.
    text: String,
}

pub(super) fn compare(args: &CompareArgs) -> anyhow::Result<ExitStatus> {
    let (before, after) = (read_provenance(&args.first)?, read_provenance(&args.second)?);
    let differences = differences([&before, &after], args)?;
    let (first, second) = (read_tally(&args.first)?, read_tally(&args.second)?);
    let bounds = args.worse.iter().map(|text| bound(text, &first.metrics)).collect::<Result<Vec<_>, _>>()?;
    let pairs: Vec<(&str, &str)> = match args.models.as_slice() {
        [] => {
            let common = first.simulators.iter().filter(|id| second.simulators.contains(id));
            common.map(|id| (id.as_str(), id.as_str())).collect()
        }
        [a, b] => vec![(a, b)],
        _ => bail!(
            "--models names {} simulators: give one for the first run and one for the second",
            args.models.len()
        ),
    };
    if pairs.is_empty() {
        bail!(
            "the runs have no simulator in common ({} and {}): give --models ID,ID",
            first.simulators.join(", "),
            second.simulators.join(", ")
        );
    }
    let compared = pairs.iter().map(|(a, b)| Comparison::of((&first, a), (&second, b), args.seed));
    let comparisons: Vec<Comparison> = compared.collect::<Result<_, _>>()?;
    write_result(None, |out| match args.format.as_str() {
        "json" => writeln!(out, "{}", serde_json::to_string_pretty(&comparisons)?),
        _ => {
            comparison::write(&comparisons, [&before.settings, &after.settings], &differences, args.top, out)
        }
    })?;
    let mut status = ExitStatus::Done;
    for comparison in &comparisons {
        for bound in &bounds {
            let Some(paired) = comparison.metrics.get(bound.metric) else {
                bail!("`{}` has no value for `{}` in any scenario", comparison.second, bound.metric);
            };
            if paired.worsening() > bound.worsening {
                say(format_args!("`{}` got worse by more than {}", comparison.second, bound.text));
                status = ExitStatus::SomeFailed;
            }
        }
    }
    Ok(status)
}

/// Returns the settings in which the runs differ, all of which must be named by --despite.
fn differences(
    [first, second]: [&Provenance; 2],
    args: &CompareArgs,
) -> anyhow::Result<Vec<ConditionDifference>> {
    let differences = Condition::differences(first, second);
    let refused = differences.iter().filter(|difference| !args.despite.contains(&difference.condition));
    let refused: Vec<String> =
        refused.map(|d| format!("\n  {}: {} and {}", d.condition.name(), d.first, d.second)).collect();
    if refused.is_empty() {
        return Ok(differences);
    }
    let named: Vec<&str> = differences.iter().map(|d| d.condition.name()).collect();
    bail!(
        "the runs differ in settings on which the numbers depend:{}\n--despite {} compares them nevertheless",
        refused.concat(),
        named.join(",")
    )
}

/// Parses the name of a condition.
fn condition(name: &str) -> Result<Condition, String> {
    let known = || Condition::ALL.map(Condition::name).join(", ");
    Condition::from_name(name).ok_or_else(|| format!("expected one of {}", known()))
}

fn bound(text: &str, metrics: &[&'static MetricSpec]) -> anyhow::Result<Bound> {
    let Some((id, value)) = text.split_once('=') else {
        bail!("--worse `{text}`: write METRIC=BOUND, such as aav-collision=0.05");
    };
    let Some(spec) = metrics.iter().find(|spec| spec.id == id) else {
        let meant = did_you_mean(id, metrics.iter().map(|spec| spec.id));
        bail!("--worse `{text}`: there is no metric `{id}`; `reactsim list metrics` lists all{meant}");
    };
    let bound = value.parse::<f64>().ok().filter(|v| v.is_finite() && *v >= 0.0);
    let Some(bound) = bound else { bail!("--worse `{text}`: `{value}` is not a number of at least 0") };
    let worsening = if spec.unit == Unit::Rate { bound / 100.0 } else { bound };
    Ok(Bound { metric: spec.id, worsening, text: text.to_owned() })
}
