//! Metrics: hand arithmetic, properties, and a comparison with a slow, literal implementation of the definitions.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]
#![allow(
    clippy::disallowed_methods,
    reason = "expected values may come from the platform: they have tolerances"
)]

mod entering;
mod hand;
mod lengths;
mod literal;
mod properties;
mod scenes;
