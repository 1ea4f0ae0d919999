//! The choice of settings by closed-loop behaviour, on scenarios that were learned from.

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::anyhow;

use super::ROLLOUTS;
use super::model::AdaptableModel;
use crate::cli::output::say;
use crate::cli::train::closed_loop::{ClosedLoop, NETWORK};
use crate::evaluation::{
    Adjustments, Comparison, PairedDifference, PlannedSimulator, Tally, Verdict, weights_file,
};

/// Parameter that is chosen.
pub(super) const HASTE: &str = "haste.weight";
/// Values that are tried, in ascending order.
const TRIED: [&str; 6] = ["0", "1", "2", "3", "4", "5"];

/// What a simulator does on the scenarios, next to the shipped one.
struct Behavior {
    /// Mean number of contacts and of too short times to collision with the AV.
    danger: f64,
    /// By how much mean progress is below that of the shipped one; negative if it is above.
    lag: f64,
    /// Whether displacement or over-reaction is worse than that of the shipped one, by more than chance.
    is_worse: bool,
}

impl Behavior {
    /// Describes the second simulator of a comparison with the shipped one.
    fn of(comparison: &Comparison) -> Self {
        let of = |metric: &str| comparison.metrics.get(metric);
        let mean = |metric: &str| of(metric).map_or(f64::INFINITY, |paired| paired.second);
        let is_worse = |metric: &str| of(metric).is_some_and(|paired| paired.verdict == Verdict::Worse);
        Self {
            danger: mean("aav-collision") + mean("aav-ttc"),
            lag: of("progress").map_or(0.0, PairedDifference::worsening),
            is_worse: is_worse("ade") || is_worse("over-reaction"),
        }
    }

    /// Returns whether this is as safe as an earlier behaviour, up to `one`, the share of one scenario.
    fn is_as_safe_as(&self, before: &Self, one: f64) -> bool {
        self.danger <= before.danger + one
    }
}

/// Chooses the haste on the first `most` scenarios of a file, as [`smallest_that_keeps_progress`] says. Warns
/// if the adapted network is less safe than the shipped one. `None` if there are no scenarios, if the model
/// has no haste, or if it was stopped.
pub(super) fn choose(
    model: &AdaptableModel,
    (shipped, adapted): (&Path, &Path),
    tuning: &Path,
    most: usize,
    (seed, jobs): (u64, usize),
    stop: &AtomicBool,
) -> anyhow::Result<Option<&'static str>> {
    let Some(scenarios) = ClosedLoop::of_file(tuning, most, ROLLOUTS)? else { return Ok(None) };
    let one = 1.0 / scenarios.ids().count() as f64 + 1e-9;
    let drive = |weights: &Path, haste: Option<&str>| -> anyhow::Result<Tally> {
        let parameter = |value: &str| (model.id.to_owned(), HASTE.to_owned(), value.to_owned());
        let adjustments = Adjustments {
            weights: vec![(model.id.to_owned(), weights_file(weights)?)],
            parameters: haste.map(parameter).into_iter().collect(),
            ..Adjustments::default()
        };
        let simulator = PlannedSimulator::adjusted(&[model.id.to_owned()], &adjustments)?.pop();
        let simulator = simulator.ok_or_else(|| anyhow!("`{}` is not a simulator", model.id))?;
        scenarios.tally(simulator.controller, jobs).map_err(|error| anyhow!(error))
    };
    let before = drive(shipped, None)?;
    let compare = |name: &str, tally: &Tally| -> anyhow::Result<Behavior> {
        let comparison = Comparison::of((&before, NETWORK), (tally, NETWORK), seed)?;
        say(format_args!("{name}: {}", means(&comparison)));
        Ok(Behavior::of(&comparison))
    };
    let unchanged = compare("before", &before)?;
    if !model.has_haste {
        warn(&unchanged, &compare("after", &drive(adapted, None)?)?, one);
        return Ok(None);
    }
    let mut tried = Vec::new();
    for value in TRIED {
        if stop.load(Ordering::Relaxed) {
            return Ok(None);
        }
        tried.push(compare(&format!("after, haste {value}"), &drive(adapted, Some(value))?)?);
    }
    let chosen = smallest_that_keeps_progress(&unchanged, &tried, one);
    warn(&unchanged, &tried[chosen], one);
    Ok(Some(TRIED[chosen]))
}

/// Returns the means of the second simulator in words.
fn means(comparison: &Comparison) -> String {
    let mean = |metric: &str, decimals: usize| match comparison.metrics.get(metric) {
        Some(paired) => format!("{:.decimals$}", paired.second),
        None => "–".to_owned(),
    };
    format!(
        "A-AV {}, risky {}, ADE {} m, progress {}, over-reaction {} m",
        mean("aav-collision", 3),
        mean("aav-ttc", 3),
        mean("ade", 2),
        mean("progress", 3),
        mean("over-reaction", 2)
    )
}

/// Returns the index of the first behaviour with as much progress as before, among those that are as safe
/// and, beyond chance, no worse in displacement and over-reaction: adaptation can cost progress, which a
/// larger haste makes up for at the price of displacement. If none has as much, returns the index of the last
/// of these; if there are none, that of the safest one.
fn smallest_that_keeps_progress(before: &Behavior, tried: &[Behavior], one: f64) -> usize {
    let fits = |b: &Behavior| b.is_as_safe_as(before, one) && !b.is_worse;
    let safest = || tried.iter().enumerate().min_by(|a, b| a.1.danger.total_cmp(&b.1.danger));
    let keeping = tried.iter().position(|b| fits(b) && b.lag <= 0.0);
    keeping.or_else(|| tried.iter().rposition(fits)).or_else(|| safest().map(|(i, _)| i)).unwrap_or(0)
}

/// Warns of a network that is less safe than before by more than one scenario.
fn warn(before: &Behavior, after: &Behavior, one: f64) {
    if !after.is_as_safe_as(before, one) {
        say(format_args!(
            "warning: with an AV that deviates, the adapted network is less safe than the shipped one, in \
             scenarios that it learned from: give more logs or other --minutes, and look at the verdict"
        ));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_smallest_haste_that_keeps_progress_is_chosen() {
        let behavior = |(danger, lag, is_worse)| Behavior { danger, lag, is_worse };
        let before = behavior((0.2, 0.0, false));
        let chosen =
            |tried: [(f64, f64, bool); 3]| smallest_that_keeps_progress(&before, &tried.map(behavior), 0.1);
        assert_eq!(chosen([(0.0, -0.02, false), (0.0, -0.03, false), (0.2, -0.04, false)]), 0);
        assert_eq!(chosen([(0.0, 0.05, false), (0.3, 0.0, false), (0.2, -0.02, false)]), 1);
        assert_eq!(chosen([(0.0, 0.05, false), (0.4, 0.0, false), (0.3, -0.02, false)]), 2);
        assert_eq!(chosen([(0.0, -0.02, true), (0.1, -0.03, false), (0.2, -0.04, true)]), 1);
        // None has as much progress: the one with the most that is no worse otherwise.
        assert_eq!(chosen([(0.0, 0.06, false), (0.1, 0.03, false), (0.2, 0.01, true)]), 1);
        // Nothing is as safe as before.
        assert_eq!(chosen([(0.5, 0.0, false), (0.4, 0.0, false), (0.6, 0.0, false)]), 1);
    }
}
