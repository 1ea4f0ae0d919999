//! JSON documents of rollouts: the worked cases, and refusals.

mod cases;
mod refusals;
