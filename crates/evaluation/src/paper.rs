//! The numbers that the paper of the benchmark states, and a run compared with them.

use std::collections::BTreeMap;

use rayon::prelude::*;
use reactsim_files::work::Pool;
use reactsim_metrics::{METRICS, Options, Unit};

use crate::deviation::pose::Pose;
use crate::error::EvaluationError;
use crate::folder::finished_run::FinishedRun;
use crate::motion::kind::RolloutCheck;
use crate::provenance::conditions::changed_options;
use crate::row::RecordPosition;
use crate::scoring::in_memory::score_in_memory;
use crate::source::scenario_files::ScenarioFiles;
use crate::statistics::Estimate;
use crate::statistics::tally::Tally;
use crate::summary::PAIRING_REFERENCE;

/// Name of the paper's numbers as a reference.
pub const PAPER: &str = "reactsim-bench-paper";
/// Number of scenarios of the paper's test set.
pub const PAPER_SCENARIOS: usize = 2636;

/// Metrics of the paper's main table, in its order.
pub(crate) const PAPER_METRICS: [&str; 7] =
    ["aav-collision", "aav-ttc", "aa-collision", "offroad", "direction", "acceleration", "curvature"];

/// The main table of ReactSim-Bench (arXiv 2606.14058, table 1) as printed: counts, then rates in percent.
pub const PAPER_ROWS: [(&str, [&str; 7]); 7] = [
    ("Log Replay", ["0.9829", "1.5380", "2.25", "0.18", "0.80", "0.16", "2.51"]),
    ("MTR", ["0.1457", "0.5819", "3.29", "2.67", "2.83", "0.64", "14.29"]),
    ("CTG", ["0.6195", "0.9476", "4.88", "2.95", "2.10", "10.87", "7.08"]),
    ("VBD", ["0.2276", "0.4711", "3.19", "1.03", "2.35", "0.01", "0.18"]),
    ("SMART", ["0.1419", "0.3976", "2.23", "0.68", "1.09", "9.74", "4.83"]),
    ("CATK", ["0.1426", "0.4029", "2.22", "0.69", "1.13", "10.25", "5.02"]),
    ("TrajTok", ["0.1407", "0.4173", "2.23", "0.61", "1.03", "3.23", "3.93"]),
];

/// Shares of scenarios in which an agent collides with the AV, and in which one is risky, in percent (section
/// "Reactive pressure"), by the metric that counts the agents.
const SHARES: [(&str, &str); 2] = [("aav-collision", "83.46"), ("aav-ttc", "98.14")];

/// Documented metric options that the paper leaves open, with the metrics that they affect.
const VARIANTS: [(&str, &str, &[&str]); 6] = [
    ("corner_rounding", "0", &["aav-collision", "aav-ttc", "aa-collision"]),
    ("fault_order", "nuplan", &["aav-collision"]),
    ("exclude_initial_overlap", "true", &["aav-collision", "aav-ttc", "aa-collision"]),
    ("offroad_corners", "true", &["offroad"]),
    ("dir_tracking", "pointwise", &["direction"]),
    ("velocity_source", "diff", &["aav-collision", "aav-ttc", "acceleration", "curvature"]),
];

/// Metrics that every run has, of which one may be meant by another metric of the paper.
const OTHER_METRICS: [(&str, &str); 2] =
    [("curvature", "curvature-velocity"), ("aav-collision", "aav-overlap")];

/// A number of the paper.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PaperNumber {
    /// Id of the metric.
    pub metric: &'static str,
    /// Whether it is the share of scenarios with at least one such event.
    pub is_share: bool,
    /// The number as printed.
    pub printed: &'static str,
}

/// How a number agrees with the paper's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Agreement {
    /// It is equal, as printed.
    Equal,
    /// The paper's number is within the 95 % interval.
    Within,
    /// It is outside the interval.
    Differs,
    /// There is no value, or no interval because there are too few scenarios.
    Unknown,
}

impl Agreement {
    /// Returns the text of tables.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Equal => "equal",
            Self::Within => "within the interval",
            Self::Differs => "differs",
            Self::Unknown => "no interval",
        }
    }
}

impl PaperNumber {
    /// Returns the numbers of log replay.
    pub fn all() -> impl Iterator<Item = Self> {
        let means = PAPER_METRICS.into_iter().zip(PAPER_ROWS[0].1);
        let means = means.map(|(metric, printed)| Self { metric, is_share: false, printed });
        means.chain(SHARES.map(|(metric, printed)| Self { metric, is_share: true, printed }))
    }

    /// Returns a value as the paper prints it: with as many digits, rates and shares in percent.
    pub fn print(&self, value: f64) -> String {
        format!("{:.*}", self.digits(), self.scale() * value)
    }

    /// Returns the number of printed digits after the point.
    fn digits(&self) -> usize {
        self.printed.split_once('.').map_or(0, |(_, digits)| digits.len())
    }

    fn scale(&self) -> f64 {
        let metric = METRICS.iter().map(|m| m.spec()).find(|spec| spec.id == self.metric);
        if self.is_share || metric.is_some_and(|spec| spec.unit == Unit::Rate) { 100.0 } else { 1.0 }
    }

    /// Compares an estimate with the number; half a unit of the last printed digit is tolerated.
    pub fn agreement(&self, found: &Estimate) -> Agreement {
        let (Some(mean), Ok(paper)) = (found.mean, self.printed.parse::<f64>()) else {
            return Agreement::Unknown;
        };
        let half = (0..self.digits()).fold(0.5, |half, _| half / 10.0);
        match (found.low, found.high) {
            _ if self.print(mean) == self.printed => Agreement::Equal,
            (Some(low), Some(high)) => {
                let within = self.scale() * low - half <= paper && paper <= self.scale() * high + half;
                if within { Agreement::Within } else { Agreement::Differs }
            }
            _ => Agreement::Unknown,
        }
    }

    /// Returns the estimate of a simulator of a tally, with another metric if one is given.
    fn estimate(&self, tally: &Tally, simulator: usize, metric: &str, seed: u64) -> Estimate {
        let Some(m) = tally.metric(metric) else { return Estimate::default() };
        let value =
            |cell: &crate::statistics::tally::Cell| if self.is_share { cell.any[m] } else { cell.values[m] };
        let cells = tally.entries.values().filter_map(|entry| entry.cells[simulator].as_ref());
        let values: Vec<f64> = cells.filter_map(value).collect();
        Estimate::of(&values, seed, metric)
    }
}

/// A number of a run with a variant of the metric.
#[derive(Clone, Debug)]
pub struct VariantNumber {
    /// The paper's number.
    pub number: PaperNumber,
    /// The variant: `NAME=VALUE` of a metric option, or the id of another metric.
    pub variant: String,
    /// The value with the variant.
    pub found: Estimate,
}

/// A run compared with the paper.
#[derive(Clone, Debug)]
pub struct PaperComparison {
    /// Number of scenarios of log replay.
    pub scenarios: usize,
    /// Numbers of the paper, each with the estimate for log replay in the run.
    pub numbers: Vec<(PaperNumber, Estimate)>,
    /// Numbers that are not equal, with the variants of their metrics that change them.
    pub variants: Vec<VariantNumber>,
    /// Why variants of metrics were not computed, if they are needed.
    pub not_computed: Option<String>,
    /// Metric options of the run other than the defaults, as `NAME=VALUE`.
    pub options: Vec<String>,
}

impl PaperComparison {
    /// Compares log replay in a run with the paper. Where a number is not equal, its kept rollouts are scored
    /// again with the variants of its metric, on `jobs` threads. `progress` is called with the number of scenarios scored.
    ///
    /// # Errors
    /// [`EvaluationError`] if the run has no log replay, or its rollouts or scenarios cannot be read.
    pub fn of(
        run: &FinishedRun,
        scenarios: &ScenarioFiles,
        jobs: usize,
        progress: &dyn Fn(usize),
    ) -> Result<Self, EvaluationError> {
        let (tally, provenance) = (run.tally(), &run.summary().provenance.run);
        let seed = provenance.settings.seed;
        let simulator = tally.simulator(PAIRING_REFERENCE)?;
        let numbers: Vec<(PaperNumber, Estimate)> = PaperNumber::all()
            .map(|number| (number, number.estimate(tally, simulator, number.metric, seed)))
            .collect();
        let open: Vec<PaperNumber> = numbers
            .iter()
            .filter(|(number, found)| number.agreement(found) != Agreement::Equal)
            .map(|(number, _)| *number)
            .collect();
        let mut variants = Vec::new();
        for (metric, other) in OTHER_METRICS {
            for number in open.iter().filter(|number| number.metric == metric) {
                let found = number.estimate(tally, simulator, other, seed);
                variants.push(VariantNumber { number: *number, variant: other.to_owned(), found });
            }
        }
        let is_needed = |metrics: &[&str]| open.iter().any(|number| metrics.contains(&number.metric));
        let wanted = VARIANTS.into_iter().filter(|(.., metrics)| is_needed(metrics));
        let mut options = Vec::new();
        for (name, value, metrics) in wanted {
            let mut changed = Options::default();
            for (name, value) in &provenance.metric_options {
                // Options of another version of the program change nothing.
                changed.set(name, value).ok();
            }
            let before = changed;
            if changed.set(name, value).is_ok() && changed != before {
                options.push((format!("{name}={value}"), metrics, changed));
            }
        }
        let files = &provenance.inputs;
        let is_absent =
            tally.entries.keys().any(|place| !files.get(place.input).is_some_and(|f| scenarios.has(f)));
        let not_computed = match (options.is_empty(), run.keeps_rollouts(), is_absent) {
            (true, ..) | (_, true, false) => None,
            (_, false, _) => Some("the run did not keep its rollouts: repeat it with `keep-rollouts`"),
            (.., true) => Some("the scenarios of the run are not there: give them"),
        };
        if not_computed.is_none() && !options.is_empty() {
            let all: Vec<Options> = options.iter().map(|(.., options)| *options).collect();
            let tallies = rescored(run, simulator, scenarios, (&all, jobs), progress)?;
            for ((variant, metrics, _), tally) in options.into_iter().zip(&tallies) {
                for number in open.iter().filter(|number| metrics.contains(&number.metric)) {
                    let found = number.estimate(tally, 0, number.metric, seed);
                    variants.push(VariantNumber { number: *number, variant: variant.clone(), found });
                }
            }
        }
        let base =
            |of: &PaperNumber| numbers.iter().find(|(number, _)| number == of).map(|(_, found)| found.mean);
        variants.retain(|variant| base(&variant.number) != Some(variant.found.mean));
        let order: BTreeMap<(&str, bool), usize> =
            numbers.iter().enumerate().map(|(i, (n, _))| ((n.metric, n.is_share), i)).collect();
        variants.sort_by_key(|v| order.get(&(v.number.metric, v.number.is_share)).copied());
        let scenarios = tally.entries.values().filter(|entry| entry.cells[simulator].is_some()).count();
        Ok(Self {
            scenarios,
            numbers,
            variants,
            not_computed: not_computed.map(str::to_owned),
            options: changed_options(provenance),
        })
    }

    /// Returns whether all numbers are equal or within the intervals.
    pub fn passed(&self) -> bool {
        let agrees = |agreement| matches!(agreement, Agreement::Equal | Agreement::Within);
        self.numbers.iter().all(|(number, found)| agrees(number.agreement(found)))
    }
}

/// Scores the kept rollouts of a simulator again, once with each set of options.
fn rescored(
    run: &FinishedRun,
    simulator: usize,
    scenarios: &ScenarioFiles,
    (options, jobs): (&[Options], usize),
    progress: &dyn Fn(usize),
) -> Result<Vec<Tally>, EvaluationError> {
    let (tally, files) = (run.tally(), &run.summary().provenance.run.inputs);
    let simulators = vec![tally.simulators[simulator].clone()];
    let (metrics, rollouts) = (tally.metrics.clone(), tally.rollouts);
    let empty = Tally { metrics, simulators, rollouts, entries: BTreeMap::new() };
    let mut tallies = vec![empty; options.len()];
    let pool = Pool::new(jobs);
    for (done, (place, entry)) in tally.entries.iter().enumerate() {
        progress(done);
        if entry.cells[simulator].is_none() {
            continue;
        }
        let Some(file) = files.get(place.input) else { continue };
        let Some(scenario) = scenarios.read(file, place.record, &entry.digest)? else { continue };
        let mut records = Vec::new();
        for rollout in 0..tally.rollouts {
            records.extend(run.recorded(&scenario.id, simulator, rollout)?);
        }
        let score = |options: &Options| {
            let allowed = &RolloutCheck::ALL;
            score_in_memory(&scenario, &entry.digest, records.clone(), *options, Pose::Centre, allowed)
        };
        let scored: Vec<_> = pool.install(|| options.par_iter().map(score).collect::<Result<_, _>>())?;
        let RecordPosition { input, record } = *place;
        for (tally, (mut rows, _)) in tallies.iter_mut().zip(scored) {
            rows.iter_mut().for_each(|row| (row.input, row.record) = (input, record));
            tally.add(&rows);
        }
    }
    Ok(tallies)
}
