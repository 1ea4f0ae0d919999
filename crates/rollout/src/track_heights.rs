//! Heights of the agents of a rollout along their tracks.

use reactsim_scene::{Frame, Scenario};

use super::entering::Entered;

/// Heights of agents at all frames of their tracks, which grow: each frame is looked up once. In scenarios of
/// one level none is known.
#[derive(Default)]
pub(crate) struct TrackHeights(Vec<Along>);

/// The heights of an agent.
struct Along {
    /// Height where it was last seen, metres; NaN if unknown.
    last: f64,
    /// Height at each frame so far, metres.
    all: Vec<Option<f64>>,
}

impl TrackHeights {
    /// Returns the height of the agent with a slot at each frame of its track, metres: the recorded one up to
    /// its beginning, then that of the road under it. `entered`: agents that follow those of the beginning.
    pub(crate) fn along(
        &mut self,
        scenario: &Scenario,
        entered: &[Entered],
        slot: usize,
        track: &[Frame],
    ) -> &[Option<f64>] {
        let start = &scenario.start;
        while self.0.len() <= slot {
            let next = self.0.len();
            self.0.push(match next.checked_sub(start.agents.len()) {
                None => {
                    let mut all = start.heights.get(next).cloned().unwrap_or_default();
                    all.resize(start.current() + 1, None);
                    Along { last: start.height_now(next), all }
                }
                Some(index) => Along { last: entered[index].first_height(scenario), all: Vec::new() },
            });
        }
        let Along { last, all } = &mut self.0[slot];
        for frame in track.get(all.len()..).unwrap_or_default() {
            all.push(Some(start.follow_height(frame, last, false)).filter(|z| !z.is_nan()));
        }
        all
    }
}
