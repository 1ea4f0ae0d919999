//! Elementary functions with bit-identical results on every machine.
//!
//! The functions of the standard library (`f64::sin` and the like) call the C library of the platform, which
//! differs between systems and selects code by processor: with and without fused multiply-add the last digit
//! can differ, and then the rollout differs too. The functions here are written in Rust (crate `libm`). They
//! use only additions, multiplications, divisions and square roots, which IEEE 754 defines to the bit and
//! which the compiler neither reorders nor fuses. The linter refuses the standard functions, and `powi`,
//! whose order of multiplications is unspecified (`clippy.toml`).
//!
//! Errors are one or two units in the last place. Angles are in radians. NaN in, NaN out.

pub use libm::{
    asinh, atan, atan2, atanh, cos, cosh, exp, exp10, hypot, log as ln, log10, pow, sin, sincos as sin_cos,
    sinh, tanh,
};

/// Returns a standard normal number for two independent uniform numbers, `u` above 0 and at most 1, `v` from 0 to
/// 1 (Box and Muller 1958, <https://doi.org/10.1214/aoms/1177706645>).
pub fn standard_normal(u: f64, v: f64) -> f64 {
    (-2.0 * ln(u)).sqrt() * cos(std::f64::consts::TAU * v)
}
