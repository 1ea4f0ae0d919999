//! The learning loop, on networks small enough to learn in a second.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]
#![allow(
    clippy::disallowed_methods,
    reason = "expected values may come from the platform: they have tolerances"
)]

mod averages;
mod learning;
mod memory;
mod resuming;
mod toy;
