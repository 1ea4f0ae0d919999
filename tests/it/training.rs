//! The learning loop, on networks small enough to learn in a second.

mod learning;
mod resuming;
mod toy;
