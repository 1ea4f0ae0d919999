//! The choice of settings by closed-loop safety, on scenarios that were learned from.

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::anyhow;

use super::model::AdaptableModel;
use crate::cli::say;
use crate::cli::train::closed_loop::ClosedLoop;
use crate::evaluation::{Adjustments, PlannedSimulator, weights_file};

/// Parameter that is chosen.
pub(super) const HASTE: &str = "haste.weight";
/// Values that are tried, in ascending order.
const TRIED: [&str; 4] = ["0", "1", "3", "5"];
/// Largest displacement, relative to the smallest one.
const MOST_ADE: f64 = 1.15;

/// What a simulator does on the scenarios.
struct Behavior {
    /// Mean number of contacts and of too short times to collision with the AV.
    danger: f64,
    /// Mean displacement from the log, metres.
    ade: f64,
}

/// Chooses the largest haste that is as safe as the safest one, up to one scenario, and hardly farther from the
/// log, on the first `most` scenarios of a file. Warns if the adapted network is less safe than the shipped one.
/// `None` if there are no scenarios, if the model has no haste, or if it was stopped.
pub(super) fn choose(
    model: &AdaptableModel,
    (shipped, adapted): (&Path, &Path),
    tuning: &Path,
    most: usize,
    jobs: usize,
    stop: &AtomicBool,
) -> anyhow::Result<Option<&'static str>> {
    let Some(scenarios) = ClosedLoop::of_file(tuning, most, 1)? else { return Ok(None) };
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
    let mut found = Vec::new();
    for value in TRIED {
        if stop.load(Ordering::Relaxed) {
            return Ok(None);
        }
        found.push((value, measure(adapted, Some(value))?));
    }
    let least =
        |value: fn(&Behavior) -> f64| found.iter().map(|(_, b)| value(b)).fold(f64::INFINITY, f64::min);
    let (danger, ade) = (least(|b| b.danger), least(|b| b.ade));
    let fits = |(_, b): &&(_, Behavior)| b.danger <= danger + one && b.ade <= MOST_ADE * ade;
    let chosen = found.iter().rev().find(fits).or_else(|| found.first());
    Ok(chosen.map(|(value, after)| {
        warn(&before, after, one);
        *value
    }))
}

/// Warns of a network that is less safe than before by more than one scenario.
fn warn(before: &Behavior, after: &Behavior, one: f64) {
    if after.danger > before.danger + one {
        say(format_args!(
            "warning: the adapted network is less safe with an AV that deviates than the shipped one: give more logs \
             or other --minutes, and look at the table"
        ));
    }
}
