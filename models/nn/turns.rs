//! Cosines and sines of many angles at a time, computed in turns instead of radians.

use std::f32::consts::TAU;

use reactsim_geometry::math;

/// Number of turns above which f32 can no longer resolve quarter turns accurately enough for
/// [`cos_sin`].
const MAX_TURNS: f32 = 1_048_576.0;

/// 1.5 · 2²³. Adding it removes the fraction: the last bits are those of the nearest whole number.
pub(super) const ROUNDING_OFFSET: f32 = 12_582_912.0;

/// Returns, for every scalar u, a row of cos(2πfu) for all frequencies f, then sin(2πfu), then u.
pub fn cos_sin_rows(scalars: impl ExactSizeIterator<Item = f32>, frequencies: &[f32]) -> Vec<f32> {
    let count = frequencies.len();
    let fastest = frequencies.iter().fold(0.0f32, |most, f| most.max(f.abs()));
    let mut rows = vec![0.0; scalars.len() * (2 * count + 1)];
    for (row, u) in rows.chunks_exact_mut(2 * count + 1).zip(scalars) {
        let (cosines, rest) = row.split_at_mut(count);
        let (sines, last) = rest.split_at_mut(count);
        last[0] = u;
        let each = cosines.iter_mut().zip(sines).zip(frequencies);
        if (u * fastest).abs() < MAX_TURNS {
            each.for_each(|((cos, sin), f)| (*cos, *sin) = cos_sin(f * u));
        } else {
            each.for_each(|((cos, sin), f)| {
                let angle = f64::from(f * u).fract() * std::f64::consts::TAU;
                (*cos, *sin) = (math::cos(angle) as f32, math::sin(angle) as f32);
            });
        }
    }
    rows
}

/// Returns the gradients with respect to the frequencies, for rows of [`cos_sin_rows`] with this number of
/// frequencies and the gradients with respect to these rows.
pub(crate) fn frequency_gradients(rows: &[f32], of_rows: &[f32], count: usize) -> Vec<f32> {
    let mut sums = vec![0.0_f64; count];
    let width = 2 * count + 1;
    for (row, of_row) in rows.chunks_exact(width).zip(of_rows.chunks_exact(width)) {
        let turn = TAU * row[2 * count];
        let ((cos, sin), (of_cos, of_sin)) =
            (row[..2 * count].split_at(count), of_row[..2 * count].split_at(count));
        for i in 0..count {
            sums[i] += f64::from(turn * (cos[i] * of_sin[i] - sin[i] * of_cos[i]));
        }
    }
    sums.into_iter().map(|sum| sum as f32).collect()
}

/// Returns cosine and sine of `turns` turns, fewer than [`MAX_TURNS`], to 2e-7. It has no branches,
/// so that a processor computes several at once.
#[inline(always)]
fn cos_sin(turns: f32) -> (f32, f32) {
    // The last bits are the number of quarter turns.
    let quarters = turns * 4.0 + ROUNDING_OFFSET;
    let angle = (turns - (quarters - ROUNDING_OFFSET) * 0.25) * TAU;
    // Taylor series; the angle is at most π/4, so the truncation errors are below 2e-9 and 3e-8.
    let square = angle * angle;
    let sin = angle
        * (1.0
            + square * (-1.0 / 6.0 + square * (1.0 / 120.0 + square * (-1.0 / 5040.0 + square / 362_880.0))));
    let cos = 1.0 + square * (-0.5 + square * (1.0 / 24.0 + square * (-1.0 / 720.0 + square / 40320.0)));
    let bits = quarters.to_bits();
    let (first, second) = if bits & 1 == 1 { (sin, cos) } else { (cos, sin) };
    let flip = |value: f32, negative: u32| f32::from_bits(value.to_bits() ^ (negative << 30));
    (flip(first, (bits + 1) & 2), flip(second, bits & 2))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn they_are_cosines_and_sines() {
        let frequencies = [0.0, 0.02, -0.37, 1.0, 40.0];
        let scalars: Vec<f32> = (-4000..4000).map(|i| i as f32 * 0.013).chain([1e5, 3e7, -8e9]).collect();
        let rows = cos_sin_rows(scalars.iter().copied(), &frequencies);
        for (row, u) in rows.chunks(11).zip(&scalars) {
            assert_eq!(row[10], *u);
            for (i, f) in frequencies.iter().enumerate() {
                let angle = f64::from(f * u).fract() * std::f64::consts::TAU;
                assert!((f64::from(row[i]) - angle.cos()).abs() < 3e-7, "{f} {u}");
                assert!((f64::from(row[5 + i]) - angle.sin()).abs() < 3e-7, "{f} {u}");
            }
        }
    }
}
