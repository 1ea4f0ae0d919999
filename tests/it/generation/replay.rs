//! The metrics of the benchmark find no fault with generated logs.

use rayon::prelude::*;
use reactsim::scene::DT;

use super::sample::sample;
use crate::scenes::{roll_with, scores};

/// Largest value of each metric, as the mean over the scenarios.
const BOUNDS: [(&str, f64); 6] = [
    ("aav-collision", 0.0),
    ("aa-collision", 0.001),
    ("offroad", 0.0005),
    ("direction", 0.001),
    ("acceleration", 0.002),
    ("curvature", 0.005),
];

#[test]
fn log_replay_is_faultless() {
    let found: Vec<_> = sample()
        .par_iter()
        .map(|generated| {
            let scenario = &generated.scenario;
            let av = scenario.log_future.tracks[0].iter().map(|s| s.unwrap()).collect();
            let rollout = roll_with("log-replay", scenario, av, &reactsim::rollout::Settings::default(), 0);
            (scenario, scores(scenario, &rollout))
        })
        .collect();
    let mut told = Vec::new();
    for (id, bound) in BOUNDS {
        let values: Vec<f64> = found.iter().filter_map(|(_, scores)| scores.value(id)).collect();
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        if mean <= bound {
            continue;
        }
        told.push(format!("{id}: {mean:.5}, at most {bound}"));
        for (scenario, scores) in &found {
            for e in scores.events.iter().filter(|e| e.metric == id && e.counted).take(4) {
                let time = (e.step + 10) as f64 * DT;
                told.push(format!(
                    "  {} ({}): {} {} at {time:.1} s for {:.1} s {:?}",
                    scenario.id,
                    scenario.source,
                    e.agent,
                    e.partner.as_deref().unwrap_or(""),
                    (e.last_step + 1 - e.step) as f64 * DT,
                    e.values
                ));
            }
        }
    }
    assert!(told.is_empty(), "{}", told.join("\n"));
}
