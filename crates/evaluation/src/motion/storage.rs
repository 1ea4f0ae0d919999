//! Coordinates whose storage cannot resolve the motion.

use std::collections::BTreeSet;

use reactsim_geometry::Vec2;
use reactsim_scene::Frame;

use super::super::rollout_checks::RolloutCheck;
use super::{Finding, GivenScene};

/// Largest spacing of stored coordinates, metres.
const RESOLUTION: f64 = 0.01;
/// Largest difference of a coordinate that was stored in 32 bits from such a number, metres: rounding when
/// the origin is added and subtracted.
const ROUNDING: f64 = 1e-6;
/// Smallest number of different coordinates.
const LEAST: usize = 8;

/// Checks whether all coordinates in the world frame are 32-bit numbers with a spacing of more than 1 cm.
pub(super) fn float32(scene: &GivenScene<'_>) -> Option<Finding> {
    let given =
        |axis: fn(Vec2) -> f64| coarse(scene.agents.iter().map(|a| a.future), scene.origin, axis, LEAST);
    let recorded =
        |axis: fn(Vec2) -> f64| coarse(scene.agents.iter().map(|a| a.history), scene.origin, axis, 1);
    for (name, axis) in [("x", (|p: Vec2| p.x) as fn(Vec2) -> f64), ("y", |p: Vec2| p.y)] {
        // A recording that is stored like this is not the fault of the motion.
        let Some(spacing) = given(axis).filter(|_| recorded(axis).is_none()) else { continue };
        return Some(Finding::new(
            RolloutCheck::Float32,
            format!(
                "the {name} coordinates look like world coordinates in 32-bit numbers, which are {spacing} m apart \
                 there: steps of this size become accelerations and turns; compute and store them in 64 bits, or \
                 relative to the origin of the scenario"
            ),
        ));
    }
    None
}

/// Returns the spacing of 32-bit numbers if all coordinates, at least `least` different ones, are
/// such numbers and coarser than 1 cm.
fn coarse<'a>(
    tracks: impl Iterator<Item = &'a [Frame]>,
    origin: Vec2,
    axis: fn(Vec2) -> f64,
    least: usize,
) -> Option<f64> {
    let mut different = BTreeSet::new();
    let mut spacing: f64 = 0.0;
    for state in tracks.flatten().flatten() {
        let value = axis(state.position()) + axis(origin);
        let stored = value as f32;
        let apart = f64::from(stored.abs().next_up()) - f64::from(stored.abs());
        if apart <= RESOLUTION || (f64::from(stored) - value).abs() > ROUNDING {
            return None;
        }
        spacing = spacing.max(apart);
        different.insert(stored.to_bits());
    }
    (different.len() >= least).then_some(spacing)
}
