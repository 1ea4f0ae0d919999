//! Layers and tools that several networks share: where they run, how their weights are read.

mod device;

pub use device::device;
