//! Closed-loop evaluation of a network during training: benchmark metrics on a few scenarios.

use std::collections::BTreeMap;
use std::path::PathBuf;

use anyhow::{Context, bail};
use clap::Args;
use rayon::prelude::*;

use crate::cli::find_inputs;
use crate::metrics::{self, Case, Options};
use crate::rollout::{AvPolicy, Controller, DeviatedAv, LogAv, Request, Settings, roll_out};
use crate::scene::{Frame, Scenario};

/// Ids of the reported metrics.
const REPORTED: [&str; 6] = ["aav-collision", "aav-ttc", "aa-collision", "offroad", "direction", "ade"];
/// Number of scenarios rolled out together.
const BATCH: usize = 4;

/// Name of the metric that is the minimum over all rollouts of a scenario.
const MIN_ADE: &str = "min-ade";

/// Scenarios for closed-loop evaluation.
#[derive(Debug, Args)]
pub(super) struct ClosedLoopArgs {
    /// Scenarios for closed-loop evaluation at every validation; the log records the metrics
    #[arg(long, value_name = "SCENARIOS")]
    closed_loop: Option<PathBuf>,
    /// Maximum number of scenarios for closed-loop evaluation
    #[arg(long, default_value_t = 32, value_name = "N")]
    most_closed_loop: usize,
    /// Rollouts of each of them: the log records means, and the minimum displacement over rollouts
    #[arg(long, default_value_t = 2, value_name = "R", value_parser = clap::value_parser!(u32).range(1..))]
    closed_loop_rollouts: u32,
}

impl ClosedLoopArgs {
    /// Reads the scenarios; `None` if none are requested.
    pub(super) fn read(&self) -> anyhow::Result<Option<ClosedLoop>> {
        let read = |path| ClosedLoop::read(path, self.most_closed_loop, self.closed_loop_rollouts);
        self.closed_loop.as_ref().map(read).transpose()
    }
}

/// Scenarios to drive in, with their deviated AV if they have one, else with the logged AV.
pub(super) struct ClosedLoop {
    scenarios: Vec<Scenario>,
    /// Rollouts per scenario.
    rollouts: u32,
}

impl ClosedLoop {
    /// Reads the first `most` scenarios of a file or folder.
    fn read(path: &PathBuf, most: usize, rollouts: u32) -> anyhow::Result<Self> {
        let mut scenarios = Vec::new();
        for input in find_inputs(std::slice::from_ref(path))? {
            for scenario in input.open()? {
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
        Ok(Self { scenarios, rollouts })
    }

    /// Returns the ids of the scenarios.
    pub(super) fn ids(&self) -> impl Iterator<Item = &str> {
        self.scenarios.iter().map(|scenario| scenario.id.as_str())
    }

    /// Returns the means over scenarios of a simulator's metrics, by metric id.
    pub(super) fn measure(&self, controller: &Controller) -> Result<BTreeMap<String, f64>, String> {
        let scored: Result<Vec<_>, String> =
            self.scenarios.par_chunks(BATCH).map(|chunk| self.score(chunk, controller)).collect();
        let scored: Vec<_> = scored?.into_iter().flatten().collect();
        let mut means = BTreeMap::new();
        for id in REPORTED.into_iter().chain([MIN_ADE]) {
            let values: Vec<f64> = scored.iter().filter_map(|s| s.get(id).copied()).collect();
            if let Some(mean) = mean(&values) {
                means.insert(id.to_owned(), mean);
            }
        }
        Ok(means)
    }

    /// Returns, per scenario, the means over its rollouts, by metric id.
    fn score(
        &self,
        scenarios: &[Scenario],
        controller: &Controller,
    ) -> Result<Vec<BTreeMap<&'static str, f64>>, String> {
        let request = |(scenario, rollout)| {
            let av = av(scenario).map_err(|e| e.to_string())?;
            Ok(Request { scenario, av, rollout })
        };
        let pairs = scenarios.iter().flat_map(|scenario| (0..self.rollouts).map(move |r| (scenario, r)));
        let requests = pairs.map(request).collect::<Result<Vec<_>, String>>()?;
        let tracks = roll_out(requests, controller, &Settings::default())
            .into_iter()
            .map(|rollout| rollout.map(|r| r.tracks).map_err(|e| e.to_string()))
            .collect::<Result<Vec<_>, String>>()?;
        let options = Options::default();
        let of_scenario = |(scenario, tracks): (&Scenario, &[Vec<Vec<Frame>>])| {
            let each: Vec<_> = tracks
                .iter()
                .map(|t| metrics::score_case(&Case::of_rollout(scenario, t.clone(), options)))
                .collect();
            let mut means = BTreeMap::new();
            for id in REPORTED {
                let values: Vec<f64> = each.iter().filter_map(|s| s.value(id)).collect();
                means.extend(mean(&values).map(|value| (id, value)));
            }
            let tracks: Vec<_> = tracks.iter().map(Vec::as_slice).collect();
            let all = metrics::score_rollouts(scenario, &tracks, options);
            means.extend(all.displacement.map(|d| (MIN_ADE, d.min_ade)));
            means
        };
        Ok(scenarios.iter().zip(tracks.chunks(self.rollouts as usize)).map(of_scenario).collect())
    }
}

fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

fn av(scenario: &Scenario) -> anyhow::Result<Box<dyn AvPolicy>> {
    Ok(match &scenario.deviation {
        Some(deviation) => Box::new(DeviatedAv::new(&scenario.start.now(0), deviation.track.clone())?),
        None => Box::new(LogAv::new(scenario)?),
    })
}
