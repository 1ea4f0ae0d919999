//! Stills and animations of a scenario or of rollouts of it.

use std::path::Path;

use super::recorded::{marks, marks_of, rollout};
use super::{InspectArgs, live, write_result};
use crate::evaluation::PlannedSimulator;
use crate::metrics::{Case, Options, score_case};
use crate::report::animation::{Animation, Panel};
use crate::report::birdseye::{self, Layout, Mark, View};
use crate::scene::{Frame, HISTORY, Scenario};

/// What one simulator made of the scenario.
struct Shown {
    simulator: String,
    tracks: Vec<Vec<Frame>>,
    marks: Vec<Mark>,
}

impl Shown {
    fn panel(&self) -> Panel<'_> {
        Panel { title: self.simulator.clone(), rollout: Some(&self.tracks), marks: self.marks.clone() }
    }
}

/// Draws the pictures that are asked for.
pub(super) fn draw(args: &InspectArgs, scenario: &Scenario) -> anyhow::Result<()> {
    if args.svg.is_none() && args.gif.is_none() {
        return Ok(());
    }
    let mut shown = match &args.rollout {
        Some(run) => {
            args.simulator.iter().map(|id| recorded(args, run, id, scenario)).collect::<Result<_, _>>()?
        }
        None => rolled_out(args, scenario)?,
    };
    if let Some(path) = &args.svg {
        let text = stills(args, scenario, shown.first());
        write_result(Some(path), |out| out.write_all(text.as_bytes()))?;
    }
    if let Some(path) = &args.gif {
        if shown.is_empty() {
            shown.extend(nobody_reacts(scenario));
        }
        let panels = shown.iter().map(Shown::panel).collect();
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

/// What a run folder holds of a simulator.
fn recorded(args: &InspectArgs, run: &Path, simulator: &str, scenario: &Scenario) -> anyhow::Result<Shown> {
    Ok(Shown {
        simulator: simulator.to_owned(),
        tracks: rollout(run, simulator, args.index, scenario)?,
        marks: marks(run, simulator, args.index, &scenario.id)?,
    })
}

/// What the named simulators make of the scenario now.
fn rolled_out(args: &InspectArgs, scenario: &Scenario) -> anyhow::Result<Vec<Shown>> {
    if args.simulator.is_empty() {
        return Ok(Vec::new());
    }
    let simulators = PlannedSimulator::by_ids(&args.simulator)?;
    let roll_out = |simulator: &PlannedSimulator| {
        let (tracks, marks) = live::rollout(simulator, args.index, scenario)?;
        Ok(Shown { simulator: simulator.id.clone(), tracks, marks })
    };
    simulators.iter().map(roll_out).collect()
}

fn stills(args: &InspectArgs, scenario: &Scenario, shown: Option<&Shown>) -> String {
    let view = View {
        radius: args.radius.unwrap_or(View::default().radius),
        steps: args.steps.iter().map(|s| usize::from(*s)).collect(),
        layout: Layout::Strip,
        title: shown.map(|s| format!("{} · {} · rollout {}", scenario.id, s.simulator, args.index)),
        rollout: shown.map(|s| &s.tracks[..]),
        marks: shown.map(|s| s.marks.clone()).unwrap_or_default(),
        ..View::default()
    };
    birdseye::draw(scenario, &view)
}

/// The deviated AV among others who do as they did in the log, with what comes of it; `None` without a deviated AV.
fn nobody_reacts(scenario: &Scenario) -> Option<Shown> {
    let deviation = scenario.deviation.as_ref()?;
    let mut tracks: Vec<Vec<Frame>> = (0..scenario.start.agents.len()).map(|i| scenario.logged(i)).collect();
    tracks[0].truncate(HISTORY);
    tracks[0].extend(deviation.track.iter().copied().map(Some));
    let scores = score_case(&Case::of_rollout(scenario, tracks.clone(), Options::default()));
    Some(Shown { simulator: scenario.id.clone(), tracks, marks: marks_of(&scores.events) })
}
