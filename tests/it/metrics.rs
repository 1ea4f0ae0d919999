//! Metrics: the worked cases, properties, and a slow literal reading of the definitions beside ours.

mod cases;
