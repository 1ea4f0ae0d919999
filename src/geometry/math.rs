//! Elementary functions whose results are the same bits on every machine.
//!
//! Those of the standard library (`f64::sin` and the like) call the C library of the platform, which differs from system to system
//! and picks its code by the processor: with and without fused multiply-add the last digit can differ, and a rollout with it. These are
//! written in Rust (crate `libm`): nothing but additions, multiplications, divisions and square roots, which IEEE 754 fixes to the bit,
//! and which the compiler neither reorders nor fuses. The linter refuses the others, and `powi`, of which not even the order of the
//! multiplications is promised (`clippy.toml`).
//!
//! Errors are a unit or two in the last place. Angles are in radians. Not a number in, not a number out.

pub use libm::{
    asinh, atan, atan2, atanh, cos, cosh, exp, exp10, hypot, log as ln, log10, pow, sin, sincos as sin_cos,
    sinh, tanh,
};
