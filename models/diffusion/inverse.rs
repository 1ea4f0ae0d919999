//! Actions from motion: what a network is to learn.

use reactsim_geometry::wrap;
use reactsim_scene::{AgentState, DT, Frame};

/// Actions of an agent.
#[derive(Clone, Debug, PartialEq)]
pub struct Actions {
    /// Acceleration (m/s²) and yaw rate (rad/s) of each bin; 0 where unknown.
    pub values: Vec<[f64; 2]>,
    /// Whether the bin has a known action.
    pub known: Vec<bool>,
}

/// Returns the actions that explain a track, averaged over bins of `hold` steps: a step is known if the
/// frames at both of its ends are. A remainder shorter than a bin is left out.
///
/// Speeds are those of the states; where a state has no velocity, the step is unknown.
pub fn actions(track: &[Frame], hold: usize) -> Actions {
    let step = |pair: &[Frame]| {
        let (a, b) = (pair[0]?, pair[1]?);
        let speed = |state: &AgentState| state.velocity().map(|v| v.norm());
        Some([(speed(&b)? - speed(&a)?) / DT, wrap(b.heading - a.heading) / DT])
    };
    let steps: Vec<Option<[f64; 2]>> = track.windows(2).map(step).collect();
    let bin = |bin: &[Option<[f64; 2]>]| {
        let known: Vec<[f64; 2]> = bin.iter().flatten().copied().collect();
        let mean = |k: usize| known.iter().map(|a| a[k]).sum::<f64>() / known.len().max(1) as f64;
        ([mean(0), mean(1)], !known.is_empty())
    };
    let (values, known) = steps.chunks_exact(hold.max(1)).map(bin).unzip();
    Actions { values, known }
}
