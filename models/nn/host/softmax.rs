//! Softmax weights of a row of scores.

use super::super::turns::ROUNDING_OFFSET;
use super::LANES;

/// Difference to the largest score of a row below which a weight is exactly 0: e⁻⁸⁰ is far below the
/// last bit of any sum, and products with smaller numbers would be subnormal, with which processors are
/// slow.
const LEAST: f32 = -80.0;

/// Replaces scores, whole blocks of [`LANES`], by weights e^(score - largest). Returns sums of the weights,
/// each of every [`LANES`]-th weight.
#[inline(always)]
pub(super) fn partial_weights(scores: &mut [f32]) -> [f32; LANES] {
    let (blocks, _) = scores.as_chunks_mut::<LANES>();
    let mut largest = [f32::NEG_INFINITY; LANES];
    for block in blocks.iter() {
        for i in 0..LANES {
            largest[i] = larger(block[i], largest[i]);
        }
    }
    let mut half = LANES / 2;
    while half > 0 {
        for i in 0..half {
            largest[i] = larger(largest[i + half], largest[i]);
        }
        half /= 2;
    }
    for score in blocks.as_flattened_mut() {
        *score = exp(*score - largest[0]);
    }
    let mut sums = [0.0; LANES];
    for block in blocks.iter() {
        for i in 0..LANES {
            sums[i] += block[i];
        }
    }
    sums
}

/// Returns the larger number; the second one if the first is NaN.
#[inline(always)]
pub(super) fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// Returns eˣ for x at most 0, to 2e-7 of its value; 0 below [`LEAST`]; NaN for NaN. It has no branches, so
/// that a processor computes several at once.
#[inline(always)]
pub(super) fn exp(x: f32) -> f32 {
    // ln 2 in two parts, the first of which has so few bits that its products are exact.
    const LN_2_HIGH: f32 = 0.693_359_4;
    const LN_2_LOW: f32 = -2.121_944_4e-4;
    let open = if x < LEAST { 0.0 } else { x };
    let shifted = open * std::f32::consts::LOG2_E + ROUNDING_OFFSET;
    let doublings = shifted - ROUNDING_OFFSET;
    let r = (open - doublings * LN_2_HIGH) - doublings * LN_2_LOW;
    // Taylor series; r is at most ln 2 / 2 in magnitude, so the truncation error is below 6e-9.
    let series = 1.0 / 24.0 + r * (1.0 / 120.0 + r * (1.0 / 720.0 + r / 5040.0));
    let fraction = 1.0 + r * (1.0 + r * (0.5 + r * (1.0 / 6.0 + r * series)));
    let scale = f32::from_bits((shifted.to_bits() << 23).wrapping_add(0x3f80_0000));
    if x < LEAST { 0.0 } else { fraction * scale }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exponentials_are_accurate() {
        for i in 0..80_000 {
            let x = -(i as f32) * 1e-3;
            let (found, wanted) = (f64::from(exp(x)), f64::from(x).exp());
            assert!((found - wanted).abs() <= 2e-7 * wanted, "{x}: {found} {wanted}");
        }
        assert_eq!((exp(0.0), exp(-80.1), exp(-1e9), exp(f32::NEG_INFINITY)), (1.0, 0.0, 0.0, 0.0));
        assert!(exp(f32::NAN).is_nan());
    }

    #[test]
    fn weights_follow_from_differences() {
        let mut row = [-1e9; 2 * LANES];
        row[0] = 3.0;
        row[LANES + 7] = 3.0 - std::f32::consts::LN_2;
        let sum: f32 = partial_weights(&mut row).into_iter().sum();
        assert!((sum - 1.5).abs() < 1e-6);
        assert_eq!((row[0], row[1]), (1.0, 0.0));
        assert!((row[LANES + 7] - 0.5).abs() < 1e-6);
        // If all are closed, all count alike, as in a softmax of equal scores.
        assert_eq!(partial_weights(&mut [-1e9; LANES]), [1.0; LANES]);
    }
}
