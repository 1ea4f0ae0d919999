//! What a metric judges: one scenario with one rollout.

use super::Options;
use crate::scene::{Agent, Frame, Road};

/// One agent with its judged track.
#[derive(Clone, Debug)]
pub struct Object<'a> {
    /// The agent.
    pub agent: &'a Agent,
    /// 91 frames: history, then the judged future.
    pub track: Vec<Frame>,
}

/// One scenario with one rollout.
#[derive(Clone, Debug)]
pub struct Case<'a> {
    /// The map.
    pub road: Road<'a>,
    /// Every agent, the AV among them.
    pub objects: Vec<Object<'a>>,
    /// Index of the AV in `objects`.
    pub av: usize,
    /// The log, aligned with `objects`: 91 frames each.
    pub log: Option<Vec<Vec<Frame>>>,
    /// All rollouts of this scenario, each aligned with `objects`, 80 frames each; for the metrics over several rollouts.
    pub rollouts: Vec<Vec<Vec<Frame>>>,
    /// Variants.
    pub options: Options,
}
