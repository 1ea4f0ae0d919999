//! Stills and animations of a scenario or of rollouts of it.

use std::path::Path;
use std::sync::Arc;

use anyhow::{anyhow, bail};

use super::recorded::{marks, rollout, with_entered};
use super::{InspectArgs, write_result};
use crate::evaluation::PlannedSimulator;
use crate::report::animation::{Animation, Panel};
use crate::report::birdseye::{self, Mark, View, marks_of};
use crate::rollout::{DeviatedAv, Request, Settings, roll_out};
use crate::scene::{Frame, Scenario};

/// A rollout of one simulator, to be drawn.
struct DrawnRollout {
    simulator: String,
    tracks: Vec<Vec<Frame>>,
    marks: Vec<Mark>,
}

impl DrawnRollout {
    fn panel(&self) -> Panel<'_> {
        Panel { title: self.simulator.clone(), rollout: Some(&self.tracks), marks: self.marks.clone() }
    }
}

/// Draws the requested pictures.
pub(super) fn draw(args: &InspectArgs, scenario: &Scenario) -> anyhow::Result<()> {
    if args.svg.is_none() && args.gif.is_none() {
        return Ok(());
    }
    let last = scenario.length().future;
    if let Some(step) = args.steps.iter().find(|step| usize::from(**step) > last) {
        bail!("--steps {step}: `{}` has {last} steps after the current frame", scenario.id);
    }
    let entered = match &args.rollout {
        Some(run) => with_entered(run, &args.simulator, args.index, scenario)?,
        None => None,
    };
    let scenario = entered.as_ref().unwrap_or(scenario);
    let mut rollouts = match &args.rollout {
        Some(run) => {
            args.simulator.iter().map(|id| recorded(args, run, id, scenario)).collect::<Result<_, _>>()?
        }
        None => rolled_out(args, scenario)?,
    };
    if let Some(path) = &args.svg {
        let text = stills(args, scenario, rollouts.first());
        write_result(Some(path), |out| out.write_all(text.as_bytes()))?;
    }
    if let Some(path) = &args.gif {
        if rollouts.is_empty() {
            rollouts.extend(log_replay(scenario));
        }
        let panels = rollouts.iter().map(DrawnRollout::panel).collect();
        let animation = Animation {
            radius: args.radius,
            size: args.size,
            every: usize::from(args.every),
            follow: args.follow,
            ..Animation::new(scenario, panels)
        };
        let bytes = animation.encode()?;
        write_result(Some(path), |out| out.write_all(&bytes))?;
    }
    Ok(())
}

/// Reads a rollout of a simulator from a run folder.
fn recorded(
    args: &InspectArgs,
    run: &Path,
    simulator: &str,
    scenario: &Scenario,
) -> anyhow::Result<DrawnRollout> {
    Ok(DrawnRollout {
        simulator: simulator.to_owned(),
        tracks: rollout(run, simulator, args.index, scenario)?,
        marks: marks(run, simulator, args.index, &scenario.id)?,
    })
}

/// Runs the requested simulators on the scenario.
fn rolled_out(args: &InspectArgs, scenario: &Scenario) -> anyhow::Result<Vec<DrawnRollout>> {
    if args.simulator.is_empty() {
        return Ok(Vec::new());
    }
    let simulators = PlannedSimulator::by_ids(&args.simulator)?;
    simulators.iter().map(|simulator| live(simulator, args.index, scenario)).collect()
}

/// Runs rollout `index` of a simulator against the deviated AV of a scenario, with the default settings of
/// `run` and the same result.
fn live(simulator: &PlannedSimulator, index: u32, scenario: &Scenario) -> anyhow::Result<DrawnRollout> {
    let deviation = scenario.deviation.as_ref().ok_or_else(|| {
        anyhow!(
            "scenario `{}` has no deviated AV for the simulators to react to; run them with --av or \
             --deviations and --keep-rollouts, and give the run folder with --rollout",
            scenario.id
        )
    })?;
    let av = DeviatedAv::new(scenario, deviation.track.clone())?;
    let request = Request { scenario, av: Some(Arc::new(av)), rollout: index };
    let mut results = roll_out(vec![request], &simulator.controller, &Settings::default());
    let tracks =
        results.pop().ok_or_else(|| anyhow!("scenario `{}`: no rollout was produced", scenario.id))??.tracks;
    let marks = marks_of(scenario, &tracks);
    Ok(DrawnRollout { simulator: simulator.id.clone(), tracks, marks })
}

fn stills(args: &InspectArgs, scenario: &Scenario, rollout: Option<&DrawnRollout>) -> String {
    let view = View {
        radius: args.radius.unwrap_or(View::default().radius),
        steps: args.steps.iter().map(|s| usize::from(*s)).collect(),
        title: rollout.map(|r| format!("{} · {} · rollout {}", scenario.id, r.simulator, args.index)),
        rollout: rollout.map(|r| &r.tracks[..]),
        marks: rollout.map(|r| r.marks.clone()).unwrap_or_default(),
        ..View::default()
    };
    birdseye::draw(scenario, &view)
}

/// Returns the deviated AV among agents that follow the log, with the resulting events; `None` for a
/// scenario without a deviated AV.
fn log_replay(scenario: &Scenario) -> Option<DrawnRollout> {
    let deviation = scenario.deviation.as_ref()?;
    let mut tracks: Vec<Vec<Frame>> = (0..scenario.start.agents.len()).map(|i| scenario.logged(i)).collect();
    tracks[0].truncate(scenario.length().history);
    tracks[0].extend(deviation.track.iter().copied().map(Some));
    let marks = marks_of(scenario, &tracks);
    Some(DrawnRollout { simulator: scenario.id.clone(), tracks, marks })
}
