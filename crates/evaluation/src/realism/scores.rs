//! Scores of many scenarios, computed on several threads and reported in their order.

use rayon::prelude::*;
use reactsim_files::work::Pool;
use reactsim_metrics::wosac::{Config, MeanMetrics, RolloutShare, Scorer, WosacError, WosacMetrics};
use reactsim_scene::wosac::{ScenarioRollouts, WosacLog};
use serde::{Deserialize, Serialize};

use crate::statistics::Estimate;

/// Pairs per thread that are in memory at a time.
const PAIRS_PER_THREAD: usize = 2;

/// The configurations of a scoring and its number of threads.
#[derive(Clone, Copy, Debug)]
pub struct RealismSettings<'a> {
    /// Configurations of the metrics.
    pub configs: &'a [Config],
    /// Whether rows have the shares of the rollouts.
    pub shares: bool,
    /// Number of threads, which does not change the result.
    pub jobs: usize,
}

/// The log of a scenario and rollouts of it, with the place that errors refer to.
pub struct ScoredPair {
    /// File and record of the rollouts.
    pub place: String,
    /// The log.
    pub log: WosacLog,
    /// The rollouts.
    pub rollouts: ScenarioRollouts,
}

/// The metrics of one scenario.
#[derive(Clone, Debug, PartialEq)]
pub struct RealismRow {
    /// Id of the scenario.
    pub scenario_id: String,
    /// Number of rollouts.
    pub rollouts: usize,
    /// Metrics in the order of [`RealismScores::configs`].
    pub metrics: Vec<WosacMetrics>,
    /// Shares in the metrics, by configuration and rollout. Without entries if [`RealismSettings`] exclude
    /// them; entries without shares if there is one rollout.
    pub shares: Vec<Vec<RolloutShare>>,
}

/// A scenario, record or file without scores.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RealismFailure {
    /// Id of the scenario, if it is known.
    pub scenario_id: Option<String>,
    /// Reason, with file, scenario and object.
    pub error: String,
}

/// The scores of a set of rollouts.
#[derive(Clone, Debug, Default)]
pub struct RealismScores {
    /// Name of the method or simulator.
    pub method: String,
    /// Configurations of the metrics.
    pub configs: Vec<Config>,
    /// Scores by scenario, in the order of the rollouts.
    pub rows: Vec<RealismRow>,
    /// Scenarios, records and files without scores.
    pub failures: Vec<RealismFailure>,
    /// Ids of the scenarios that have a log but no rollouts.
    pub missing: Vec<String>,
}

impl RealismScores {
    /// Returns the unweighted means over scenarios by configuration; empty without scores.
    pub fn means(&self) -> Vec<(&Config, WosacMetrics)> {
        let mean = |(i, config)| {
            let mut mean = MeanMetrics::default();
            self.rows.iter().for_each(|row| mean.add(&row.metrics[i]));
            Some((config, mean.mean()?))
        };
        self.configs.iter().enumerate().filter_map(mean).collect()
    }

    /// Returns mean and 95 % bootstrap interval of a metric over the scenarios; `value` takes it from a row.
    pub fn estimate(&self, name: &str, value: impl Fn(&RealismRow) -> Option<f64>) -> Estimate {
        let values: Vec<f64> = self.rows.iter().filter_map(value).collect();
        Estimate::of(&values, 0, name)
    }

    /// Returns mean and interval of every aggregate of a leaderboard in a configuration, by the names of the
    /// official message and in the order of
    /// [`WosacMetrics::buckets`](reactsim_metrics::wosac::WosacMetrics::buckets).
    ///
    /// # Panics
    /// If there is no such configuration.
    pub fn aggregates(&self, config: usize) -> Vec<(&'static str, Estimate)> {
        let of = &self.configs[config];
        let fields = |row: &RealismRow| row.metrics[config].buckets(of);
        let Some(first) = self.rows.first() else { return Vec::new() };
        let estimate = |(i, (name, _)): (usize, (&'static str, _))| {
            let stream = format!("{}-{name}", of.id);
            (name, self.estimate(&stream, |row| fields(row)[i].1))
        };
        fields(first).into_iter().enumerate().map(estimate).collect()
    }
}

/// Scores all pairs. Pairs that cannot be scored become failures; `observe` is called with the number of
/// scenarios so far and with each failure.
pub fn score_all(
    pairs: impl Iterator<Item = Result<ScoredPair, RealismFailure>>,
    settings: &RealismSettings,
    observe: &mut dyn FnMut(usize, Option<&RealismFailure>),
) -> RealismScores {
    let pool = Pool::new(settings.jobs);
    let mut scores = RealismScores { configs: settings.configs.to_vec(), ..RealismScores::default() };
    let mut pairs = pairs.fuse();
    loop {
        let chunk: Vec<_> = pairs.by_ref().take(PAIRS_PER_THREAD * settings.jobs.max(1)).collect();
        if chunk.is_empty() {
            return scores;
        }
        let scored: Vec<Result<RealismRow, RealismFailure>> =
            pool.install(|| chunk.into_par_iter().map(|pair| score(&pair?, settings)).collect());
        for row in scored {
            match row {
                Ok(row) => scores.rows.push(row),
                Err(failure) => {
                    observe(scores.rows.len() + scores.failures.len(), Some(&failure));
                    scores.failures.push(failure);
                }
            }
        }
        observe(scores.rows.len() + scores.failures.len(), None);
    }
}

fn score(pair: &ScoredPair, settings: &RealismSettings) -> Result<RealismRow, RealismFailure> {
    metrics(pair, settings).map_err(|error| RealismFailure {
        scenario_id: Some(pair.rollouts.scenario_id.clone()),
        error: format!("{}: {error}", pair.place),
    })
}

fn metrics(pair: &ScoredPair, settings: &RealismSettings) -> Result<RealismRow, WosacError> {
    let scorer = Scorer::new(&pair.log)?;
    let (metrics, shares) = match settings.shares {
        true => scorer.score_with_shares(&pair.rollouts, settings.configs)?.into_iter().unzip(),
        false => (scorer.score(&pair.rollouts, settings.configs)?, Vec::new()),
    };
    let (scenario_id, rollouts) = (pair.rollouts.scenario_id.clone(), pair.rollouts.joint_scenes.len());
    Ok(RealismRow { scenario_id, rollouts, metrics, shares })
}
