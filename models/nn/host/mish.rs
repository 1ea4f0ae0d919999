//! The activation Mish of numbers without gradients.

use std::array;
use std::sync::LazyLock;

use burn::tensor::Tensor;
use pulp::{Arch, Simd, WithSimd};
use reactsim_geometry::math;

use super::{LANES, Numbers};

/// Number above which exponentials are cut: Mish is the identity there to single precision.
pub(crate) const LARGE: f64 = 20.0;
/// Parts of the range between two powers of 2.
const PARTS: usize = 32;
/// Added and taken away again, it rounds a 64-bit number to an integer, which is then in its lowest bits.
const ROUNDING_OFFSET: f64 = 6_755_399_441_055_744.0;

/// For each part p the bits of 2^(p / 32) without p / 32 in the exponent, so that adding the bits of a whole
/// number of parts gives a power of 2.
static POWERS: LazyLock<[u64; PARTS]> = LazyLock::new(|| {
    array::from_fn(|p| {
        let power = math::pow(2.0, p as f64 / PARTS as f64);
        power.to_bits().wrapping_sub((p as u64) << 47)
    })
});

/// Returns x · tanh(ln(1 + eˣ)) of each number x.
pub(crate) fn mish<const D: usize>(x: Tensor<D>) -> Tensor<D> {
    let device = x.device();
    let mut data = Numbers::own(x);
    // Networks are loaded and computed in this type.
    let numbers = data.as_mut_slice().expect("32-bit floating-point numbers");
    Arch::new().dispatch(Mish { numbers, powers: &POWERS });
    Tensor::from_data(data, &device)
}

struct Mish<'a> {
    numbers: &'a mut [f32],
    powers: &'a [u64; PARTS],
}

impl WithSimd for Mish<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let (blocks, rest) = self.numbers.as_chunks_mut::<LANES>();
        for block in blocks {
            apply(block, self.powers);
        }
        let mut last = [0.0; LANES];
        last[..rest.len()].copy_from_slice(rest);
        apply(&mut last, self.powers);
        rest.copy_from_slice(&last[..rest.len()]);
    }
}

/// Applies Mish by the operations that the backend would use.
#[inline(always)]
fn apply(numbers: &mut [f32; LANES], powers: &[u64; PARTS]) {
    let exponentials = exp(numbers, powers);
    for i in 0..LANES {
        let w = exponentials[i];
        let n = w * (w + 2.0);
        numbers[i] *= n / (n + 2.0);
    }
}

/// Returns eˣ, or e²⁰ for larger x, to 0.51 units of the last place: a power of 2 and a polynomial of degree
/// 3 in 64 bits (coefficients of `expf` of the Arm Optimized Routines). A processor computes several at once,
/// except for the table of powers.
///
/// The function of the softmax is shorter, but its last bits are not those of the C library, with which the
/// published numbers were computed.
#[inline(always)]
fn exp(x: &[f32; LANES], powers: &[u64; PARTS]) -> [f32; LANES] {
    let (mut bits, mut rest) = ([0; LANES], [0.0; LANES]);
    for i in 0..LANES {
        // Below -150 the result is 0 in 32 bits.
        let parts = f64::from(x[i]).clamp(-150.0, LARGE) * (std::f64::consts::LOG2_E * PARTS as f64);
        let shifted = parts + ROUNDING_OFFSET;
        bits[i] = shifted.to_bits();
        rest[i] = parts - (shifted - ROUNDING_OFFSET);
    }
    let mut found = [0; LANES];
    for i in 0..LANES {
        found[i] = powers[bits[i] as usize % PARTS];
    }
    let [a, b, c] = [1.693_835_925_092_021_2e-6, 2.345_980_978_950_900_4e-4, 0.021_660_849_396_613_134];
    let mut exponentials = [0.0; LANES];
    for i in 0..LANES {
        let (r, power) = (rest[i], f64::from_bits(found[i].wrapping_add(bits[i] << 47)));
        exponentials[i] = (((a * r + b) * (r * r) + (c * r + 1.0)) * power) as f32;
    }
    exponentials
}

#[cfg(test)]
mod tests {
    use super::*;

    fn one(x: f32) -> f32 {
        exp(&[x; LANES], &POWERS)[LANES - 1]
    }

    #[test]
    fn exponentials_are_accurate() {
        for i in -120_000..20_000 {
            let x = i as f32 * 1e-3;
            let (found, wanted) = (one(x), math::exp(f64::from(x)));
            let unit = f64::from((wanted as f32).next_up()) - f64::from(wanted as f32);
            assert!((f64::from(found) - wanted).abs() <= 0.51 * unit, "{x}: {found} {wanted}");
        }
        assert_eq!((one(f32::NEG_INFINITY), one(0.0)), (0.0, 1.0));
        assert_eq!(one(f32::INFINITY), one(LARGE as f32));
        assert!(one(f32::NAN).is_nan());
    }
}
