//! The choice of settings by closed-loop safety, on scenarios that were learned from.

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::anyhow;

use super::ROLLOUTS;
use super::model::AdaptableModel;
use crate::cli::output::say;
use crate::cli::train::closed_loop::ClosedLoop;
use crate::evaluation::{Adjustments, PlannedSimulator, weights_file};

/// Parameter that is chosen.
pub(super) const HASTE: &str = "haste.weight";
/// Values that are tried, in ascending order.
const TRIED: [&str; 6] = ["0", "1", "2", "3", "4", "5"];

/// What a simulator does on the scenarios.
struct Behavior {
    /// Mean number of contacts and of too short times to collision with the AV.
    danger: f64,
    /// Mean displacement from the log, metres.
    ade: f64,
}

impl Behavior {
    /// Returns whether this is as safe as an earlier behaviour, up to `one`, the share of one scenario.
    fn is_as_safe_as(&self, before: &Self, one: f64) -> bool {
        self.danger <= before.danger + one
    }
}

/// Chooses the haste on the first `most` scenarios of a file, as [`largest_no_worse`] says. Warns if the
/// adapted network is less safe than the shipped one. `None` if there are no scenarios, if the model has no
/// haste, or if it was stopped.
pub(super) fn choose(
    model: &AdaptableModel,
    (shipped, adapted): (&Path, &Path),
    tuning: &Path,
    most: usize,
    jobs: usize,
    stop: &AtomicBool,
) -> anyhow::Result<Option<&'static str>> {
    let Some(scenarios) = ClosedLoop::of_file(tuning, most, ROLLOUTS)? else { return Ok(None) };
    let one = 1.0 / scenarios.ids().count() as f64 + 1e-9;
    let measure = |weights: &Path, haste: Option<&str>| -> anyhow::Result<Behavior> {
        let parameter = |value: &str| (model.id.to_owned(), HASTE.to_owned(), value.to_owned());
        let adjustments = Adjustments {
            weights: vec![(model.id.to_owned(), weights_file(weights)?)],
            parameters: haste.map(parameter).into_iter().collect(),
            ..Adjustments::default()
        };
        let simulator = PlannedSimulator::adjusted(&[model.id.to_owned()], &adjustments)?.pop();
        let simulator = simulator.ok_or_else(|| anyhow!("`{}` is not a simulator", model.id))?;
        let measured = scenarios.measure(simulator.controller, jobs).map_err(|error| anyhow!(error))?;
        let of = |metric: &str| measured.get(metric).copied().unwrap_or(f64::INFINITY);
        let (contacts, risky, ade) = (of("aav-collision"), of("aav-ttc"), of("ade"));
        let name = if weights == shipped { "before" } else { "after" };
        let with = haste.map_or_else(String::new, |value| format!(", haste {value}"));
        say(format_args!("{name}{with}: A-AV {contacts:.3}, risky {risky:.3}, ADE {ade:.2} m"));
        Ok(Behavior { danger: contacts + risky, ade })
    };
    let before = measure(shipped, None)?;
    if !model.has_haste {
        warn(&before, &measure(adapted, None)?, one);
        return Ok(None);
    }
    let mut tried = Vec::new();
    for value in TRIED {
        if stop.load(Ordering::Relaxed) {
            return Ok(None);
        }
        tried.push(measure(adapted, Some(value))?);
    }
    let chosen = largest_no_worse(&before, &tried, one);
    warn(&before, &tried[chosen], one);
    Ok(Some(TRIED[chosen]))
}

/// Returns the index of the last behaviour that is as safe as the one before and no farther from the log:
/// adaptation can cost progress and add over-reaction, and a larger haste makes up for both. If there is
/// none, returns the index of the safest one.
fn largest_no_worse(before: &Behavior, tried: &[Behavior], one: f64) -> usize {
    let fits = |b: &Behavior| b.is_as_safe_as(before, one) && b.ade <= before.ade;
    let safest = || tried.iter().enumerate().min_by(|a, b| a.1.danger.total_cmp(&b.1.danger));
    tried.iter().rposition(fits).or_else(|| safest().map(|(i, _)| i)).unwrap_or(0)
}

/// Warns of a network that is less safe than before by more than one scenario.
fn warn(before: &Behavior, after: &Behavior, one: f64) {
    if !after.is_as_safe_as(before, one) {
        say(format_args!(
            "warning: the adapted network is less safe with an AV that deviates than the shipped one: give more logs \
             or other --minutes, and look at the table"
        ));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_largest_haste_that_is_no_worse_is_chosen() {
        let behavior = |(danger, ade)| Behavior { danger, ade };
        let chosen =
            |before, tried: [(f64, f64); 3]| largest_no_worse(&behavior(before), &tried.map(behavior), 0.1);
        assert_eq!(chosen((0.2, 2.0), [(0.0, 1.6), (0.3, 2.0), (0.2, 2.1)]), 1);
        assert_eq!(chosen((0.2, 2.0), [(0.0, 1.6), (0.4, 1.8), (0.1, 1.9)]), 2);
        // Nothing is as good as before.
        assert_eq!(chosen((0.2, 2.0), [(0.5, 2.5), (0.4, 1.8), (0.2, 2.1)]), 2);
    }
}
