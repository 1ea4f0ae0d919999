//! The learning loop, on networks small enough to learn in a second.

mod averages;
mod learning;
mod memory;
mod resuming;
mod toy;
