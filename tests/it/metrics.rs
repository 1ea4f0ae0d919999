//! Metrics: the worked cases, hand arithmetic, properties, and a slow literal reading of the definitions beside ours.

mod bad_documents;
mod cases;
mod hand;
mod literal;
mod properties;
mod scenes;
