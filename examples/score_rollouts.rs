//! Scores a rollout that another program made, without a simulator: all metrics, and the events behind them.
//!
//! ```sh
//! cargo run --release --example score_rollouts
//! ```

// Examples print; the library does not.
#![allow(clippy::print_stdout, clippy::print_stderr)]

use std::path::Path;

use reactsim::formats;
use reactsim::metrics::{Case, Options, score_case};
use reactsim::scene::{Frame, HISTORY};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/scenarios/mini/stopped-av-ahead.json");
    let scenario = formats::open(Path::new(path))?.next().ok_or("the file is empty")??;
    let deviation = scenario.deviation.as_ref().ok_or("the scenario has no deviated AV")?;

    // The rollout: the deviated AV, and all other agents as recorded. 91 frames per agent: history, then
    // 80 steps.
    let mut tracks: Vec<Vec<Frame>> = (0..scenario.start.agents.len()).map(|i| scenario.logged(i)).collect();
    tracks[0].truncate(HISTORY);
    tracks[0].extend(deviation.track.iter().copied().map(Some));

    let scores = score_case(&Case::of_rollout(&scenario, tracks, Options::default()));
    for (spec, score) in &scores.values {
        println!("{:24} {score:?}", spec.id);
    }
    for event in scores.events.iter().filter(|e| e.counted) {
        println!("{} at step {}: agent `{}`", event.metric, event.step, event.agent);
    }
    Ok(())
}
