//! Metrics: the worked cases, hand arithmetic, properties, and a comparison with a slow, literal
//! implementation of the definitions.

#![allow(
    clippy::unwrap_used,
    clippy::print_stderr,
    reason = "a test may fail loudly, and says when it is skipped"
)]

mod bad_documents;
mod cases;
mod hand;
mod literal;
mod properties;
mod scenes;
