//! How a network that is being trained does in closed loop: the numbers of the benchmark on a few scenarios.

use std::collections::BTreeMap;
use std::path::PathBuf;

use anyhow::{Context, bail};
use rayon::prelude::*;

use crate::cli::find_inputs;
use crate::metrics::{self, Case, Options};
use crate::rollout::{AvPolicy, Controller, DeviatedAv, LogAv, Request, Settings, roll_out};
use crate::scene::Scenario;

/// The metrics that are reported.
const REPORTED: [&str; 6] = ["aav-collision", "aav-ttc", "aa-collision", "offroad", "direction", "ade"];
/// Scenarios that are rolled out together.
const TOGETHER: usize = 8;

/// Scenarios to drive in: with the deviated AV that they carry, else with the logged one.
pub(super) struct ClosedLoop {
    scenarios: Vec<Scenario>,
}

impl ClosedLoop {
    /// Reads the first `most` scenarios of a file or folder.
    pub(super) fn read(path: &PathBuf, most: usize) -> anyhow::Result<Self> {
        let mut scenarios = Vec::new();
        for input in find_inputs(std::slice::from_ref(path))? {
            for scenario in input.format.open(&input.path)? {
                if scenarios.len() < most {
                    scenarios.push(scenario?);
                }
            }
        }
        if scenarios.is_empty() {
            bail!("{}: no scenario to drive in", path.display());
        }
        for scenario in &scenarios {
            av(scenario).with_context(|| format!("{}: scenario `{}`", path.display(), scenario.id))?;
        }
        Ok(Self { scenarios })
    }

    /// Means over scenarios of what a simulator scores, by metric.
    pub(super) fn measure(&self, controller: &Controller) -> Result<BTreeMap<String, f64>, String> {
        let options = Options::default();
        let scored: Result<Vec<_>, String> = self
            .scenarios
            .par_chunks(TOGETHER)
            .map(|chunk| {
                let requests = chunk.iter().map(|scenario| {
                    let av = av(scenario).map_err(|e| e.to_string())?;
                    Ok(Request { scenario, av, rollout: 0 })
                });
                let requests = requests.collect::<Result<Vec<_>, String>>()?;
                let rollouts = roll_out(requests, controller, &Settings::default());
                let judge = |(scenario, rollout): (&Scenario, Result<crate::rollout::Rollout, _>)| {
                    let rollout = rollout.map_err(|e: crate::rollout::RolloutError| e.to_string())?;
                    Ok(metrics::score_case(&Case::of_rollout(scenario, rollout.tracks, options)))
                };
                chunk.iter().zip(rollouts).map(judge).collect::<Result<Vec<_>, String>>()
            })
            .collect();
        let scored: Vec<_> = scored?.into_iter().flatten().collect();
        let mut means = BTreeMap::new();
        for id in REPORTED {
            let values: Vec<f64> = scored.iter().filter_map(|s| s.value(id)).collect();
            if !values.is_empty() {
                means.insert(id.to_owned(), values.iter().sum::<f64>() / values.len() as f64);
            }
        }
        Ok(means)
    }
}

fn av(scenario: &Scenario) -> anyhow::Result<Box<dyn AvPolicy>> {
    Ok(match &scenario.deviation {
        Some(deviation) => Box::new(DeviatedAv::new(&scenario.start.now(0), deviation.track.clone())?),
        None => Box::new(LogAv::new(scenario)?),
    })
}
