//! Coordinates whose storage cannot resolve the motion.

use std::collections::BTreeSet;

use reactsim_geometry::{Vec2, wrap};
use reactsim_scene::{AgentState, Frame};

use super::{CheckedScene, Finding, median};
use crate::motion::kind::RolloutCheck;

/// Largest spacing of stored coordinates, metres.
const RESOLUTION: f64 = 0.01;
/// Largest difference of a coordinate that was stored in 32 bits from such a number, metres: rounding when
/// the origin is added and subtracted.
const ROUNDING: f64 = 1e-6;
/// Smallest number of different coordinates.
const LEAST: usize = 8;

/// Checks whether all coordinates in the world frame are 32-bit numbers with a spacing of more than 1 cm.
pub(super) fn float32(scene: &CheckedScene<'_>) -> Option<Finding> {
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

/// Number of frames of a window, 2 s.
const WINDOW: usize = 20;
/// Smallest number of different accelerations in succession by which a window of a track shows a grid.
const LEAST_CHANGES: usize = 5;
/// Largest deviation from a grid, as a share of its spacing.
const OFF_GRID: f64 = 0.1;
/// Share of the windows that the same grid, or one of powers of two, must explain.
const MOST: f64 = 0.8;
/// Smallest number of windows on a grid.
const LEAST_WINDOWS: usize = 2;
/// Correlation of successive accelerations below which they alternate, as rounding makes them: by rounding it
/// is -0.67, by independent accelerations 0.
const ALTERNATING: f64 = -0.3;

/// A number of each state, and the spacing of a grid that is too coarse for it.
struct Quantity {
    name: &'static str,
    unit: &'static str,
    spacing: f64,
    of: fn(&AgentState) -> [f64; 2],
}

const QUANTITIES: [Quantity; 3] = [
    Quantity { name: "positions", unit: "m", spacing: RESOLUTION, of: |s| [s.x, s.y] },
    Quantity { name: "headings", unit: "rad", spacing: 0.01, of: |s| [s.heading, f64::NAN] },
    Quantity { name: "velocities", unit: "m/s", spacing: 0.25, of: |s| [s.vx, s.vy] },
];

/// Formats of numbers with 16 bits: their significant bits, and the text.
const FORMATS: [(u32, &str); 2] = [(8, " as in bfloat16"), (11, " as in float16")];

/// Checks whether numbers are rounded to a grid, whatever its origin.
pub(super) fn resolution(scene: &CheckedScene<'_>) -> Option<Finding> {
    QUANTITIES.iter().find_map(|quantity| {
        let given: Vec<&[Frame]> = scene.agents.iter().map(|a| a.future).collect();
        let recorded: Vec<&[Frame]> = scene.agents.iter().map(|a| a.history).collect();
        // A recording that is stored like this is not the fault of the motion.
        let (spacing, format) = grid(&given, quantity).filter(|_| grid(&recorded, quantity).is_none())?;
        let Quantity { name, unit, .. } = quantity;
        let spacing = (spacing * 1e5).round() / 1e5;
        Some(Finding::new(
            RolloutCheck::Resolution,
            format!(
                "the {name} look rounded{format}, to a grid of {spacing} {unit}: steps of this size become \
                 accelerations and turns; compute and store them in 32 or 64 bits, without rounding"
            ),
        ))
    })
}

/// Rounds a number to this many significant bits.
fn rounded(v: f64, bits: u32) -> f64 {
    let dropped = f64::MANTISSA_DIGITS - bits;
    f64::from_bits((v.to_bits() + (1 << (dropped - 1))) & !((1 << dropped) - 1))
}

/// Returns the spacing of the grid to which most tracks are rounded, the median if it differs, and the text
/// of the format of the numbers.
fn grid(tracks: &[&[Frame]], quantity: &Quantity) -> Option<(f64, &'static str)> {
    let (mut spacings, mut free, mut product, mut square) = (Vec::new(), 0, 0.0, 0.0);
    for window in tracks.iter().flat_map(|track| track.chunks(WINDOW)) {
        let values: Vec<[f64; 2]> = window.iter().flatten().map(quantity.of).collect();
        for axis in 0..2 {
            let values: Vec<f64> = values.iter().map(|v| v[axis]).collect();
            let steps = values.windows(2).map(|v| v[1] - v[0]);
            let steps: Vec<f64> =
                if quantity.unit == "rad" { steps.map(wrap).collect() } else { steps.collect() };
            let second: Vec<f64> = steps.windows(2).map(|v| v[1] - v[0]).collect();
            match spacing(&second, quantity.spacing) {
                None => {}
                Some(0.0) => free += 1,
                Some(spacing) if spacing <= 1.01 * quantity.spacing => {}
                Some(spacing) => {
                    let mean = second.iter().sum::<f64>() / second.len() as f64;
                    product += second.windows(2).map(|v| (v[0] - mean) * (v[1] - mean)).sum::<f64>();
                    square += second.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>();
                    spacings.push(spacing);
                }
            }
        }
    }
    let typical = median(spacings.iter().copied())?;
    let common = spacings.iter().filter(|s| (**s / typical - 1.0).abs() <= 0.02).count();
    let binary = spacings.iter().filter(|s| (*s / rounded(**s, 1) - 1.0).abs() <= 0.01).count();
    let all_fit = |bits: u32| {
        let values = tracks.iter().copied().flatten().flatten().flat_map(quantity.of);
        values.filter(|v| !v.is_nan()).all(|v| (rounded(v, bits) - v).abs() <= ROUNDING)
    };
    // Close to 0 numbers of 16 bits are dense: their grid shows elsewhere, but all are such numbers.
    if let Some((_, format)) = FORMATS.into_iter().find(|(bits, _)| all_fit(*bits)) {
        return Some((typical, format));
    }
    let is_grid = spacings.len() >= LEAST_WINDOWS
        && common.max(binary) as f64 >= MOST * (spacings.len() + free) as f64
        && product <= ALTERNATING * square;
    is_grid.then_some((typical, ""))
}

/// Returns the spacing of the grid on which second differences are, 0 if they are on none, and `None` if they
/// do not show it.
fn spacing(second: &[f64], coarse: f64) -> Option<f64> {
    let still = 0.02 * coarse;
    let least = second.iter().map(|v| v.abs()).filter(|v| *v > still).min_by(f64::total_cmp)?;
    let multiples: Vec<f64> = second.iter().map(|v| (v / least).round()).collect();
    let is_on_grid = second.iter().zip(&multiples).all(|(v, n)| (v / least - n).abs() <= OFF_GRID);
    let changes = multiples.windows(2).filter(|n| n[0] != n[1]).count();
    (changes >= LEAST_CHANGES).then_some(if is_on_grid { least } else { 0.0 })
}
