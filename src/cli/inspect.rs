//! `reactsim inspect`: what is in a scenario.

use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};

use anyhow::{Context, anyhow, bail};
use clap::Args;
use serde_json::Value;

use super::{ExitStatus, say, write_result};
use crate::evaluation::{EVENTS, ROLLOUTS, recorded_tracks};
use crate::formats;
use crate::report::birdseye::{self, Layout, Mark, MarkKind, View};
use crate::scene::{AgentKind, CURRENT, FUTURE, Frame, LaneKind, Scenario};

/// Arguments of `inspect`.
#[derive(Debug, Args)]
pub(super) struct InspectArgs {
    /// File or folder of scenarios
    #[arg(value_name = "SCENARIO")]
    scenario: PathBuf,
    /// Id of the scenario [default: the first one]
    #[arg(long)]
    id: Option<String>,
    /// Draw a rollout of this run folder (made with --keep-rollouts)
    #[arg(long, value_name = "RUN", requires_all = ["simulator", "svg"])]
    rollout: Option<PathBuf>,
    /// Simulator of the rollout
    #[arg(long, value_name = "ID", requires = "rollout")]
    simulator: Option<String>,
    /// Index of the rollout
    #[arg(long, value_name = "N", default_value_t = 0)]
    index: u32,
    /// Draw the scenario to this file
    #[arg(long, value_name = "FILE")]
    svg: Option<PathBuf>,
    /// Steps to draw, 0 (now) to 80, separated by commas
    #[arg(long, value_delimiter = ',', default_value = "0", value_name = "STEPS",
          value_parser = clap::value_parser!(u8).range(0..=80))]
    steps: Vec<u8>,
    /// Half of the side of a picture, metres
    #[arg(long, default_value_t = 60.0, value_name = "M")]
    radius: f64,
}

pub(super) fn inspect(args: &InspectArgs) -> anyhow::Result<ExitStatus> {
    if !(5.0..=1000.0).contains(&args.radius) {
        bail!("--radius is {}, expected 5 to 1000 m", args.radius);
    }
    let scenario = find(args)?;
    let tracks = match (&args.rollout, &args.simulator) {
        (Some(run), Some(simulator)) => Some(rollout(args, run, simulator, &scenario)?),
        _ => None,
    };
    if let Some(path) = &args.svg {
        let marks = match (&args.rollout, &args.simulator) {
            (Some(run), Some(simulator)) => marks(run, simulator, args.index, &scenario.id)?,
            _ => Vec::new(),
        };
        let title =
            args.simulator.as_ref().map(|s| format!("{} · {s} · rollout {}", scenario.id, args.index));
        let view = View {
            radius: args.radius,
            steps: args.steps.iter().map(|s| usize::from(*s)).collect(),
            layout: Layout::Strip,
            title,
            rollout: tracks.as_deref(),
            marks,
            ..View::default()
        };
        let text = birdseye::draw(&scenario, &view);
        write_result(Some(path), |out| out.write_all(text.as_bytes()))?;
    }
    let lines = describe(&scenario);
    let width = lines.iter().map(|(name, _)| name.len()).max().unwrap_or(0);
    write_result(None, |out| {
        lines.iter().try_for_each(|(name, text)| writeln!(out, "{name:width$}  {text}"))
    })?;
    Ok(ExitStatus::Done)
}

/// The scenario with the wanted id, or the first one.
fn find(args: &InspectArgs) -> anyhow::Result<Scenario> {
    let mut scenarios = formats::open(&args.scenario)?;
    let Some(id) = &args.id else {
        let first = scenarios.next().ok_or_else(|| anyhow!("{} is empty", args.scenario.display()))??;
        if scenarios.next().is_some() {
            say(format_args!("note: there are more scenarios; choose one with --id"));
        }
        return Ok(first);
    };
    let mut bad = 0;
    for scenario in scenarios {
        match scenario {
            Ok(scenario) if scenario.id == *id => return Ok(scenario),
            Ok(_) => {}
            Err(error) => {
                bad += 1;
                say(format_args!("warning: {error}"));
            }
        }
    }
    let damaged = if bad > 0 { format!(" ({bad} records can not be read)") } else { String::new() };
    bail!("{} holds no scenario `{id}`{damaged}", args.scenario.display())
}

/// The realised tracks of a rollout in a run folder.
fn rollout(
    args: &InspectArgs,
    run: &Path,
    simulator: &str,
    scenario: &Scenario,
) -> anyhow::Result<Vec<Vec<Frame>>> {
    let path = run.join(ROLLOUTS);
    if !path.exists() {
        bail!("{} has no {ROLLOUTS}: run with --keep-rollouts", run.display());
    }
    for record in formats::rollouts::read(&path)? {
        let record = record?;
        if record.scenario_id == scenario.id && record.simulator == simulator && record.rollout == args.index
        {
            return Ok(recorded_tracks(scenario, &record)?);
        }
    }
    bail!("{} holds no rollout {} of `{simulator}` in `{}`", path.display(), args.index, scenario.id)
}

/// The events of a rollout that a picture points out.
fn marks(run: &Path, simulator: &str, rollout: u32, scenario: &str) -> anyhow::Result<Vec<Mark>> {
    let path = run.join(EVENTS);
    let name = || format!("could not read {}", path.display());
    let mut marks = Vec::new();
    for line in BufReader::new(File::open(&path).with_context(name)?).lines() {
        let event: Value = serde_json::from_str(&line.with_context(name)?).with_context(name)?;
        let text = |key: &str| event[key].as_str().unwrap_or_default();
        if text("scenario") != scenario
            || text("simulator") != simulator
            || event["rollout"].as_u64() != Some(u64::from(rollout))
        {
            continue;
        }
        let kind = match text("metric") {
            "aav-collision" if event["counted"] == true => MarkKind::AtFault,
            "aav-collision" | "aa-collision" => MarkKind::Contact,
            "aav-ttc" => MarkKind::Risky,
            "offroad" => MarkKind::OffRoad,
            _ => continue,
        };
        let step = event["step"].as_u64().and_then(|s| usize::try_from(s).ok()).unwrap_or(0);
        marks.push(Mark { agent: text("agent").to_owned(), step, kind });
    }
    Ok(marks)
}

/// What is in a scenario, by name.
fn describe(scenario: &Scenario) -> Vec<(&'static str, String)> {
    let (start, map) = (&scenario.start, &scenario.start.map);
    let kinds = |agents: &mut dyn Iterator<Item = AgentKind>| {
        let all: Vec<AgentKind> = agents.collect();
        let of = |kind: AgentKind| {
            let n = all.iter().filter(|k| **k == kind).count();
            (n > 0).then(|| format!("{n} {kind}{}", if n == 1 { "" } else { "s" }))
        };
        let parts: Vec<String> = AgentKind::ALL.into_iter().filter_map(of).collect();
        if parts.is_empty() { "none".to_owned() } else { parts.join(", ") }
    };
    let world = start.agents.len().saturating_sub(1);
    let lanes = |kind: LaneKind| map.lanes.iter().filter(|l| l.kind == kind).count();
    let metres: f64 = map.lanes.iter().map(|l| l.baseline.length()).sum();
    let seen =
        (0..start.lights.len()).filter(|&i| scenario.light_states(i).iter().any(Option::is_some)).count();
    let mut lines = vec![
        ("scenario", scenario.id.clone()),
        ("source", scenario.source.clone()),
        ("digest", scenario.digest()),
        ("origin", format!("({:.3}, {:.3}) m in the world", scenario.origin.x, scenario.origin.y)),
        (
            "agents",
            format!("{world} around the AV: {}", kinds(&mut start.agents[1..].iter().map(|a| a.kind))),
        ),
        ("context", kinds(&mut scenario.unselected.iter().map(|a| a.agent.kind))),
        (
            "lanes",
            format!(
                "{} lanes, {} connectors, {metres:.0} m",
                lanes(LaneKind::Lane),
                lanes(LaneKind::Connector)
            ),
        ),
        (
            "map",
            format!(
                "{} road edges, {} road lines, {} stop lines, {} crosswalks, {} speed bumps, {} driveways",
                map.road_edges.len(),
                map.road_lines.len(),
                map.stop_lines.len(),
                map.crosswalks.len(),
                map.speed_bumps.len(),
                map.driveways.len()
            ),
        ),
        (
            "drivable area",
            map.drivable_area.as_ref().map_or("by road edges".into(), |a| format!("{} polygons", a.len())),
        ),
        ("lights", format!("{}, {seen} of them observed", start.lights.len())),
        ("AV", travel(scenario)),
        (
            "deviation",
            scenario.deviation.as_ref().map_or("none".into(), |d| {
                let category = d.category.map_or("of unknown category", |c| c.name());
                let end = d.track.last().map(|s| s.position());
                let logged = scenario.log_future.tracks[0].last().copied().flatten().map(|s| s.position());
                match end.zip(logged) {
                    Some((end, logged)) => {
                        format!("{category}, {:.1} m off at the end", (end - logged).norm())
                    }
                    None => category.to_owned(),
                }
            }),
        ),
    ];
    for (what, n) in &scenario.repairs {
        lines.push(("left out", format!("{n} {what}")));
    }
    lines
}

/// How far the logged AV drives, and how fast it is now.
fn travel(scenario: &Scenario) -> String {
    let track = scenario.logged(0);
    let pairs = track[CURRENT..].windows(2).filter_map(|w| Some((w[0]?, w[1]?)));
    let metres: f64 = pairs.map(|(a, b)| (b.position() - a.position()).norm()).sum();
    let steps = track[CURRENT + 1..].iter().flatten().count();
    let now = scenario.start.now(0);
    let agent = &scenario.start.agents[0];
    let gaps = if steps < FUTURE { format!(", present at {steps} of {FUTURE} steps") } else { String::new() };
    let speed =
        if now.speed().is_finite() { format!("{:.1} m/s now", now.speed()) } else { "speed unknown".into() };
    format!(
        "`{}`, {:.2} m x {:.2} m, {speed}, drives {metres:.1} m{gaps}",
        agent.id, agent.length, agent.width
    )
}
