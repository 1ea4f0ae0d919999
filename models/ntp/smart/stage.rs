//! Stages of the network, for tests that compare intermediate features.

/// Stage of the network at which features are observed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Stage {
    /// Map tokens before the first layer.
    MapInput,
    /// Map tokens after this layer.
    Map(usize),
    /// Nodes before the first block.
    Fused,
    /// Nodes after attention to their own past, in this block.
    OverTime(usize),
    /// Nodes after attention to the map, in this block.
    FromMap(usize),
    /// Nodes after attention to each other, in this block.
    AmongAgents(usize),
}
