//! Time of the kinematic likelihood of one scenario with 84 agents and 32 rollouts, on one thread.
//!
//! `cargo bench --bench likelihood`. This is the size of a large scenario of Waymo's Sim Agents challenge,
//! for which the challenge's own implementation was measured to take 114 s of processor time, with all its
//! metrics. The scenario here is generated; its agents are repeated until there are 84 of them, and the
//! rollouts are the log, moved a little.
#![expect(clippy::print_stdout, reason = "the table is what this program is for")]

use std::time::Instant;

use anyhow::{Context, Result, bail};
use reactsim::generation::{GenerationSettings, Generator, Preset};
use reactsim::geometry::math;
use reactsim::metrics::{Case, LoggedTrack, Object, Options, metric};
use reactsim::scene::{Frame, Scenario};

/// Number of agents, including the AV, and of rollouts.
const AGENTS: usize = 84;
const ROLLOUTS: usize = 32;
/// Number of rounds, of which the best and the median are printed.
const ROUNDS: usize = 50;
/// Target in milliseconds.
const AIM: f64 = 20.0;
/// Number of generated scenarios, of which the one with the most agents is used.
const SCENARIOS: u64 = 40;

fn main() -> Result<()> {
    let generator =
        Generator::new(GenerationSettings { preset: Preset::Bench, ..GenerationSettings::default() })?;
    let mut scenario: Option<Scenario> = None;
    for number in 0..SCENARIOS {
        let next = generator.scenario(number)?;
        if scenario.as_ref().is_none_or(|s| s.start.agents.len() < next.start.agents.len()) {
            scenario = Some(next);
        }
    }
    let scenario = scenario.context("no scenario")?;
    let there = scenario.start.agents.len();
    let futures: Vec<Vec<Vec<Frame>>> =
        (0..ROLLOUTS).map(|r| (0..AGENTS).map(|i| moved(&scenario, i % there, i, r)).collect()).collect();
    let object = |i: usize| Object {
        agent: &scenario.start.agents[i % there],
        track: scenario.logged(i % there).into(),
    };
    let log = |i: usize| LoggedTrack {
        history: &scenario.start.history[i % there],
        future: &scenario.log_future.tracks[i % there],
        recorded_history: None,
    };
    let likelihood = metric("kinematic-likelihood").context("no such metric")?;
    let (mut times, mut values) = (Vec::new(), Vec::new());
    for _ in 0..ROUNDS {
        let objects = (0..AGENTS).map(object).collect();
        let case = Case::new(scenario.start.road(), objects, 0, Options::default())
            .with_log((0..AGENTS).map(log).collect())
            .with_rollouts(futures.iter().map(|r| r.iter().map(Vec::as_slice).collect()).collect());
        let begun = Instant::now();
        let score = likelihood.score(&case, &mut Vec::new());
        times.push(begun.elapsed().as_secs_f64() * 1e3);
        values.push(score);
    }
    if values.iter().any(|v| v.is_none() || *v != values[0]) {
        bail!("the likelihood differs between rounds, or there is none: {values:?}");
    }
    times.sort_by(f64::total_cmp);
    println!("| kinematic likelihood | best | median | aim |\n|---|--:|--:|--:|");
    println!(
        "| {AGENTS} agents, {ROLLOUTS} rollouts | {:.2} ms | {:.2} ms | {AIM} ms |",
        times[0],
        times[ROUNDS / 2]
    );
    println!("\n`{}`, {there} agents repeated; value {:?}", scenario.id, values[0]);
    Ok(())
}

/// Returns the logged future of an agent as a rollout might have it: ahead or behind, and turned a little.
fn moved(scenario: &Scenario, logged: usize, object: usize, rollout: usize) -> Vec<Frame> {
    let mut future = scenario.log_future.tracks[logged].clone();
    let phase = (object * ROLLOUTS + rollout) as f64;
    for (k, state) in future.iter_mut().enumerate() {
        let Some(state) = state else { continue };
        let t = k as f64 * 0.1;
        let (sway, swing) = (math::sin(0.37 * t + phase), math::sin(0.9 * t + 1.7 * phase));
        let (sin, cos) = math::sin_cos(state.heading);
        state.x += t * sway * cos;
        state.y += t * sway * sin;
        state.heading += 0.05 * swing;
    }
    future
}
