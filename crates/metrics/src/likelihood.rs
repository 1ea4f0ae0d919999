//! Kinematic likelihood of the log under the rollouts (Waymo sim-agents challenge, configuration of 2024 and
//! 2025).

use reactsim_geometry::{math, wrap};
use reactsim_scene::{DT, FUTURE, Frame};

use super::{Case, Judgement, LoggedTrack, MetricSpec, OfBenchmark, Scope, Score, Unit};

/// Likelihoods of one scenario of 80 steps, each in (0, 1]; `None` if no logged sample is valid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KinematicLikelihood {
    /// Likelihoods of speed, acceleration, yaw rate and yaw acceleration, by the name of the feature.
    pub features: [(&'static str, Option<f64>); 4],
    /// Number of objects.
    pub objects: u64,
}

impl KinematicLikelihood {
    /// Returns the mean of the four with equal weights; `None` if one is undefined.
    pub fn kinematic(&self) -> Option<f64> {
        self.features.iter().try_fold(0.0, |sum, f| Some(sum + f.1?)).map(|sum| sum / 4.0)
    }
}

/// The range of a histogram, and its number of equal bins.
struct Bins {
    min: f64,
    max: f64,
    bins: usize,
}

/// Bins of speed (m/s), acceleration (m/s²), yaw rate (rad/s) and yaw acceleration (rad/s²).
#[expect(clippy::approx_constant, reason = "the challenge's bound is 3.14, not pi")]
const FEATURES: [Bins; 4] = [
    Bins { min: 0.0, max: 25.0, bins: 10 },
    Bins { min: -12.0, max: 12.0, bins: 11 },
    Bins { min: -0.628, max: 0.628, bins: 11 },
    Bins { min: -3.14, max: 3.14, bins: 11 },
];
/// Maximum number of bins of any feature.
const MAX_BINS: usize = 11;
/// Count added to every bin before normalisation.
const PSEUDOCOUNT: f64 = 0.1;

/// A histogram with edges in single precision, as computed by the challenge's code.
struct Histogram {
    /// Lower edges of all bins but the first; NaN, which no value reaches, beyond the last bin.
    edges: [f64; MAX_BINS - 1],
    bins: usize,
}

impl Histogram {
    fn new(spec: &Bins) -> Self {
        let (min, max) = (spec.min as f32, spec.max as f32);
        let step = (max - min) / spec.bins as f32;
        let mut edges = [f64::NAN; MAX_BINS - 1];
        for (i, edge) in (1..spec.bins).zip(&mut edges) {
            *edge = f64::from(min + step * i as f32);
        }
        Self { edges, bins: spec.bins }
    }

    /// Returns the half-open bin of a value clipped to the range. NaN falls into the last bin, as in the
    /// challenge's code.
    fn bin(&self, value: f64) -> usize {
        if value.is_nan() {
            return self.bins - 1;
        }
        self.edges.iter().map(|&edge| usize::from(value >= edge)).sum()
    }
}

/// Poses of one object over all frames, and the four features over the same frames.
#[derive(Default)]
struct Series {
    x: Vec<f64>,
    y: Vec<f64>,
    heading: Vec<f64>,
    turn: Vec<f64>,
    features: [Vec<f64>; 4],
}

impl Series {
    fn push(&mut self, [x, y, heading]: [f64; 3]) {
        self.x.push(x);
        self.y.push(y);
        self.heading.push(heading);
    }

    fn truncate(&mut self, frames: usize) {
        self.x.truncate(frames);
        self.y.truncate(frames);
        self.heading.truncate(frames);
    }

    /// Computes central differences, NaN at both ends. Only the frames from `first` on are needed.
    fn differentiate(&mut self, first: usize) {
        let n = self.x.len();
        let [speed, acceleration, rate, angular] = &mut self.features;
        for values in [&mut self.turn, &mut *speed, &mut *acceleration, &mut *rate, &mut *angular] {
            values.clear();
            values.resize(n, f64::NAN);
        }
        for f in first.saturating_sub(1).max(1)..n.saturating_sub(1) {
            let dx = (self.x[f + 1] - self.x[f - 1]) / 2.0;
            let dy = (self.y[f + 1] - self.y[f - 1]) / 2.0;
            speed[f] = (dx * dx + dy * dy).sqrt() / DT;
            self.turn[f] = wrap(2.0 * ((self.heading[f + 1] - self.heading[f - 1]) / 2.0)) / 2.0;
            rate[f] = self.turn[f] / DT;
        }
        for f in first.max(1)..n.saturating_sub(1) {
            acceleration[f] = (speed[f + 1] - speed[f - 1]) / 2.0 / DT;
            let turn = (self.turn[f + 1] - self.turn[f - 1]) / 2.0;
            angular[f] = wrap(2.0 * turn) / 2.0 / (DT * DT);
        }
    }
}

fn pose(frame: Frame) -> [f64; 3] {
    frame.map_or([f64::NAN; 3], |s| [s.x, s.y, s.heading])
}

fn push_history(series: &mut Series, log: &LoggedTrack<'_>, frames: usize) {
    for f in 0..frames {
        let recorded = log.recorded_history.and_then(|h| h.get(f).copied());
        series.push(recorded.unwrap_or_else(|| pose(log.at(f))));
    }
}

/// Returns whether the feature `k` needs a frame that is absent at a step. Accelerations are differences of
/// differences.
fn needs_absent(is_absent: &[bool], k: usize, step: usize) -> bool {
    let needed: &[isize] = if k.is_multiple_of(2) { &[-1, 1] } else { &[-2, 0, 2] };
    needed.iter().any(|&by| step.checked_add_signed(by).and_then(|at| is_absent.get(at)) == Some(&true))
}

/// Returns the validity of central differences: a frame is valid if both neighbours are; the ends are not.
fn neighbours_valid(valid: &[bool]) -> Vec<bool> {
    (0..valid.len()).map(|k| k > 0 && k + 1 < valid.len() && valid[k - 1] && valid[k + 1]).collect()
}

impl Judgement for Option<KinematicLikelihood> {
    fn compute(case: &Case<'_>) -> Self {
        let log = case.log.as_ref().filter(|_| !case.rollouts.is_empty() && case.future().len() == FUTURE)?;
        let histograms = FEATURES.each_ref().map(Histogram::new);
        let first = case.current + 1;
        let (mut logged, mut rolled) = (Series::default(), Series::default());
        let (mut sums, mut samples) = ([0.0_f64; 4], [0_u64; 4]);
        let mut objects = 0;
        for i in 0..case.objects.len() {
            if !(case.evaluated(i) || (i == case.av && case.present(i) && case.options.lik_include_av)) {
                continue;
            }
            objects += 1;
            let mut counts = [[0_u64; MAX_BINS]; 4];
            rolled.truncate(0);
            push_history(&mut rolled, &log[i], first);
            for rollout in &case.rollouts {
                rolled.truncate(first);
                for f in case.future() {
                    rolled.push(pose(rollout[i].get(f - first).copied().flatten()));
                }
                rolled.differentiate(first);
                let is_absent: Vec<bool> = rolled.x[first..].iter().map(|x| x.is_nan()).collect();
                let is_complete = !case.may_leave || !is_absent.contains(&true);
                for (k, histogram) in histograms.iter().enumerate() {
                    for (step, &value) in rolled.features[k][first..].iter().enumerate() {
                        if is_complete || !needs_absent(&is_absent, k, step) {
                            counts[k][histogram.bin(value)] += 1;
                        }
                    }
                }
            }
            logged.truncate(0);
            push_history(&mut logged, &log[i], first);
            for f in case.future() {
                logged.push(pose(log[i].at(f)));
            }
            logged.differentiate(first);
            let valid: Vec<bool> = case.future().map(|f| log[i].at(f).is_some()).collect();
            let speed_valid = neighbours_valid(&valid);
            let acceleration_valid = neighbours_valid(&speed_valid);
            for (k, histogram) in histograms.iter().enumerate() {
                let total = counts[k].iter().sum::<u64>() as f64 + PSEUDOCOUNT * histogram.bins as f64;
                // Few bins are met; the logarithm of each is computed once.
                let mut logarithms = [None; MAX_BINS];
                let valid = if k % 2 == 0 { &speed_valid } else { &acceleration_valid };
                for (&value, _) in logged.features[k][first..].iter().zip(valid).filter(|s| *s.1) {
                    let bin = histogram.bin(value);
                    let share = || math::ln((counts[k][bin] as f64 + PSEUDOCOUNT) / total);
                    sums[k] += *logarithms[bin].get_or_insert_with(share);
                    samples[k] += 1;
                }
            }
        }
        let of = |k: usize| (samples[k] > 0).then(|| math::exp(sums[k] / samples[k] as f64));
        Some(KinematicLikelihood {
            features: [
                ("linear_speed", of(0)),
                ("linear_acceleration", of(1)),
                ("angular_speed", of(2)),
                ("angular_acceleration", of(3)),
            ],
            objects,
        })
    }
}

/// Returns the likelihoods of the case's log under its rollouts; `None` without a log, without rollouts, or
/// if it has another number of steps than the challenge.
pub(super) fn likelihood(case: &Case<'_>) -> Option<KinematicLikelihood> {
    *case.judgement::<Option<KinematicLikelihood>>()
}

/// Mean of the four kinematic likelihoods.
pub(super) const LIKELIHOOD: &OfBenchmark = &OfBenchmark {
    spec: MetricSpec {
        id: "kinematic-likelihood",
        title: "Kin. Lik.",
        unit: Unit::Plain,
        scope: Scope::Scenario,
        lower_is_better: false,
        source: "Waymo sim-agents challenge 2025: the kinematic features, equal weights",
    },
    has_events: false,
    score: |case, _| likelihood(case)?.kinematic().map(Score::Value),
};
