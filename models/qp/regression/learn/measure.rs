//! Accuracy of predictions: displacements of the best mode, and the share of misses.

use reactsim_geometry::into_frame;
use reactsim_nn::perception::Class;
use reactsim_nn::training::Sums;

use super::super::network::{Config, LayerOutput, STATE};
use super::super::predict::kept_modes;
use super::sample::{Sample, TRUTH_SIZE, Target};

/// Names of the means over all targets and over those of each class: mean displacement of the best
/// mode, its last displacement (metres), share of misses.
pub const MEASURES: [(&str, [&str; 3]); 4] = [
    ("all", ["min_ade", "min_fde", "miss_rate"]),
    ("vehicle", ["min_ade_vehicle", "min_fde_vehicle", "miss_rate_vehicle"]),
    ("pedestrian", ["min_ade_pedestrian", "min_fde_pedestrian", "miss_rate_pedestrian"]),
    ("cyclist", ["min_ade_cyclist", "min_fde_cyclist", "miss_rate_cyclist"]),
];
/// Largest displacement along the true heading after 8 s that is no miss, metres, at [`FAST_SPEED`] and
/// above, as in the Waymo Open Motion challenge
/// (<https://waymo.com/open/challenges/2024/motion-prediction/>).
const MISS_ALONG: f64 = 6.0;
/// Largest displacement across the true heading after 8 s that is no miss, metres; see [`MISS_ALONG`].
const MISS_ACROSS: f64 = 3.0;
/// Speed in m/s up to which both thresholds are halved.
const SLOW_SPEED: f64 = 1.4;
/// Speed in m/s from which both thresholds apply in full.
const FAST_SPEED: f64 = 11.0;

/// Adds the measures of the modes that remain after suppression.
pub(super) fn measure(samples: &[Sample], last: LayerOutput, config: &Config, sums: &mut Sums) {
    let targets: Vec<&Target> = samples.iter().flat_map(|s| &s.targets).collect();
    let scores: Vec<f32> = last.scores.into_data().iter::<f32>().collect();
    let states: Vec<f32> = last.modes.into_data().iter::<f32>().collect();
    let queries = scores.len() / targets.len().max(1);
    let width = config.states() * STATE;
    for (i, target) in targets.iter().enumerate() {
        let own = &states[i * queries * width..(i + 1) * queries * width];
        let (kept, _) = kept_modes(&scores[i * queries..(i + 1) * queries], own, config);
        let modes: Vec<&[f32]> = kept.iter().map(|q| &own[q * width..(q + 1) * width]).collect();
        let best = |of: &dyn Fn(&[f32]) -> Option<f64>| {
            modes.iter().filter_map(|mode| of(mode)).min_by(f64::total_cmp)
        };
        let values = [
            best(&|mode| mean_displacement(mode, target)),
            best(&|mode| last_displacement(mode, target).map(|d| d.0)),
            best(&|mode| last_displacement(mode, target).map(|d| d.1)),
        ];
        let class = match target.around.class {
            Class::Vehicle => 1,
            Class::Pedestrian => 2,
            Class::Cyclist => 3,
        };
        for (k, value) in values.into_iter().enumerate() {
            if let Some(value) = value {
                sums.add(MEASURES[0].1[k], value, 1.0);
                sums.add(MEASURES[class].1[k], value, 1.0);
            }
        }
    }
}

/// Returns the displacement of a mode from the true state at the `k`-th instant, along x and y of the
/// frame; `None` where the state is unknown.
fn displacement(mode: &[f32], target: &Target, k: usize) -> Option<(f64, f64)> {
    let truth = &target.truth;
    let difference = |i: usize| f64::from(mode[k * STATE + i] - truth.states[k * TRUTH_SIZE + i]);
    (truth.known[k] > 0.0).then(|| (difference(0), difference(1)))
}

fn mean_displacement(mode: &[f32], target: &Target) -> Option<f64> {
    let known = (0..target.truth.known.len()).filter_map(|k| displacement(mode, target, k));
    let (sum, n) = known.fold((0.0, 0.0), |(sum, n), (x, y)| (sum + (x * x + y * y).sqrt(), n + 1.0));
    (n > 0.0).then(|| sum / n)
}

/// Returns the displacement at 8 s, and 1 for a miss, else 0.
fn last_displacement(mode: &[f32], target: &Target) -> Option<(f64, f64)> {
    let (x, y) = displacement(mode, target, target.truth.known.len().checked_sub(1)?)?;
    let at = into_frame(target.goal_ahead, reactsim_geometry::Vec2::new(x, y));
    let speed = target.around.velocity().norm();
    let scale = 0.5 + 0.5 * ((speed - SLOW_SPEED) / (FAST_SPEED - SLOW_SPEED)).clamp(0.0, 1.0);
    let missed = at.x.abs() > MISS_ALONG * scale || at.y.abs() > MISS_ACROSS * scale;
    Some((at.norm(), f64::from(missed)))
}
