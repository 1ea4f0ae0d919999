//! Heights of the road under the agents of an episode.

use reactsim_rollout::Observation;
use reactsim_scene::{Frame, Start};

/// Heights of the road under agents at the latest frames of an episode, followed from one plan to the next,
/// so that a plan costs the same after any number of frames. In scenarios of one level there are none.
#[derive(Clone, Debug, Default)]
pub struct RoadHeights {
    /// First frame that is kept.
    first: usize,
    /// Height of each agent where it was last seen, metres; NaN if unknown.
    last: Vec<f64>,
    /// Height of each agent at each kept frame, metres; NaN if unknown, or if the agent is absent.
    kept: Vec<Vec<f64>>,
}

impl RoadHeights {
    /// Follows the road under agents up to the present, and forgets frames before `first`.
    pub fn follow(&mut self, seen: &Observation<'_>, first: usize) {
        let start = seen.start();
        if !start.has_levels() {
            return;
        }
        if self.last.is_empty() {
            self.last = (0..start.agents.len()).map(|slot| start.height_now(slot)).collect();
            self.kept = vec![Vec::new(); start.agents.len()];
            self.first = start.current();
        }
        let forgotten = first.saturating_sub(self.first).min(seen.frame() - self.first);
        for (slot, (last, kept)) in self.last.iter_mut().zip(&mut self.kept).enumerate() {
            let next = self.first + kept.len();
            let frames = seen.track(slot).get(next..).unwrap_or_default();
            // The height at the current frame is recorded.
            let is_recorded = next == start.current();
            for (k, frame) in frames.iter().enumerate() {
                kept.push(below(start, frame, last, is_recorded && k == 0));
            }
            kept.drain(..forgotten);
        }
        self.first += forgotten;
    }

    /// Returns the height of an agent at a frame from the first kept one on, metres; NaN if unknown. `track`
    /// has its frames up to this one, from frame `from` on; those after the present are planned.
    pub(super) fn at(&self, start: &Start, slot: usize, frame: usize, track: &[Frame], from: usize) -> f64 {
        let Some(kept) = self.kept.get(slot) else { return f64::NAN };
        let next = self.first + kept.len();
        if frame < next {
            return frame.checked_sub(self.first).map_or(f64::NAN, |k| kept[k]);
        }
        let mut last = self.last[slot];
        let planned = next.checked_sub(from).and_then(|k| track.get(k..=frame - from)).unwrap_or_default();
        let heights = planned.iter().map(|frame| below(start, frame, &mut last, false));
        heights.last().unwrap_or(f64::NAN)
    }
}

/// Returns the height of the road below an agent, metres; NaN if unknown, or if the agent is absent. `last`
/// is that where it was last seen, which is `known` to be its present one.
fn below(start: &Start, frame: &Frame, last: &mut f64, known: bool) -> f64 {
    let Some(state) = frame else { return f64::NAN };
    if !known {
        *last = start.road().ground_height(state.position(), *last);
    }
    *last
}

#[cfg(test)]
mod tests {
    use reactsim_geometry::Vec2;
    use reactsim_scene::{
        Agent, AgentKind, AgentState, DT, FRAMES, HISTORY, LaneParts, LoggedAgent, MapHeights, MapParts,
        Scenario, ScenarioParts,
    };

    use super::*;

    /// A road along x and a bridge across it, 6 m above, with an agent on each.
    fn scenario() -> Scenario {
        let points =
            |from: Vec2, to: Vec2| (0..=60).map(|k| from + (to - from) * (f64::from(k) / 60.0)).collect();
        let lane = |id: &str, points| LaneParts { id: id.into(), points, ..LaneParts::default() };
        let below = lane("below", points(Vec2::new(-60.0, 0.0), Vec2::new(60.0, 0.0)));
        let above = lane("above", points(Vec2::new(20.0, -60.0), Vec2::new(20.0, 60.0)));
        let heights = MapHeights { lanes: vec![vec![0.0; 61], vec![6.0; 61]], ..MapHeights::default() };
        let agent = |id: &str, from: Vec2, v: Vec2, height: f64| {
            let at = |f: usize| {
                let p = from + v * (DT * f as f64);
                Some(AgentState { x: p.x, y: p.y, heading: v.y.atan2(v.x), vx: v.x, vy: v.y })
            };
            let agent = Agent { id: id.into(), kind: AgentKind::Vehicle, length: 4.0, width: 2.0 };
            let heights = vec![Some(height); FRAMES];
            LoggedAgent { agent, track: (0..FRAMES).map(at).collect(), heights }
        };
        let agents = vec![
            agent("av", Vec2::zeros(), Vec2::new(10.0, 0.0), 0.0),
            agent("over", Vec2::new(20.0, -20.0), Vec2::new(0.0, 10.0), 6.0),
        ];
        let map = MapParts { lanes: vec![below, above], heights, ..MapParts::default() };
        Scenario::assemble(ScenarioParts { id: "bridge".into(), agents, map, ..Default::default() }).unwrap()
    }

    #[test]
    fn heights_are_those_along_the_whole_track() {
        let scenario = scenario();
        let (start, current) = (&scenario.start, HISTORY - 1);
        assert!(start.has_levels());
        let logged: Vec<Vec<Frame>> = (0..2).map(|slot| scenario.logged(slot)).collect();
        let whole = |slot: usize, track: &[Frame]| *start.heights_along(slot, track).last().unwrap();
        let mut heights = RoadHeights::default();
        for frame in (current..current + 42).step_by(3) {
            let mut tracks: Vec<Vec<Frame>> = logged.iter().map(|track| track[..=frame].to_vec()).collect();
            if let Some(absent) = tracks[1].get_mut(19) {
                *absent = None;
            }
            heights.follow(&Observation::new(start, &tracks, &[], None), frame - 4);
            assert!(heights.kept.iter().all(|kept| kept.len() <= 5), "only the latest frames are kept");
            for (slot, track) in tracks.iter_mut().enumerate() {
                for at in (frame - 4).max(current)..=frame {
                    let (found, wanted) =
                        (heights.at(start, slot, at, track, 0), whole(slot, &track[current..=at]));
                    assert_eq!(found.to_bits(), wanted.to_bits(), "agent {slot} at frame {at}");
                }
                // Two planned frames, at the end of a part of the track.
                track.extend_from_slice(&logged[slot][frame + 1..frame + 3]);
                let found = heights.at(start, slot, frame + 2, &track[frame - 2..], frame - 2);
                let wanted = whole(slot, &track[current..]);
                assert_eq!(found.to_bits(), wanted.to_bits(), "agent {slot} after frame {frame}");
                assert_eq!(found, 6.0 * slot as f64);
            }
        }
    }
}
