//! Metrics: the worked cases, hand arithmetic, properties, and a slow literal reading of the definitions beside ours.

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
