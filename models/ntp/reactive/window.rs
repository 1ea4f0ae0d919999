//! Memory of computed steps between plans.

use reactsim_nn::SharedRows;
use reactsim_nn::perception::{Body, SceneView, denoised};
use reactsim_rollout::Observation;
use reactsim_scene::Frame;
use reactsim_scene::levels::RoadHeights;

use super::super::tokens::TOKEN_FRAMES;
use super::choice::Surroundings;
use super::config::Config;
use super::step::{EarlierNode, StepGraph};

/// A computed step.
#[derive(Clone, Debug)]
pub(crate) struct StepMemory {
    /// Frame of the step.
    pub frame: usize,
    /// Nodes of the step.
    pub nodes: Vec<EarlierNode>,
    /// For each block, the nodes as later steps attend to them, in tensors that the episodes of a batch
    /// share.
    pub entering: SharedRows,
}

/// Returns the frames of the earlier steps that a step at `now` attends to, oldest first: every half
/// second, as far as they exist.
pub(crate) fn earlier_frames(now: usize, past: usize) -> Vec<usize> {
    let back = |k: usize| now.checked_sub(k * TOKEN_FRAMES);
    (1..=past).rev().filter_map(back).collect()
}

/// The latest frames of an episode, as far back as steps look, followed by those that are planned.
#[derive(Clone, Debug)]
pub(crate) struct RecentTracks {
    /// Frame of the episode with which the tracks begin.
    pub first: usize,
    /// Realized frames of every agent, then planned ones.
    pub all: Vec<Vec<Frame>>,
    /// The same without the noise of recorded positions, as the network sees them.
    pub shown: Vec<Vec<Frame>>,
}

/// Number of frames before a step that its features depend on: past poses, and the courses that they belong
/// to.
const FEATURE_FRAMES: usize = 20;

impl RecentTracks {
    /// Returns the latest frames, as many as a network that attends to `past` earlier steps looks back; all
    /// frames while recorded ones are among them, which have noise.
    pub(crate) fn of(seen: &Observation<'_>, past: usize) -> Self {
        let (now, current) = (seen.frame(), seen.start().current());
        let back = past.saturating_mul(TOKEN_FRAMES).saturating_add(FEATURE_FRAMES);
        let first = now.checked_sub(back).filter(|first| *first > current).unwrap_or(0);
        let all: Vec<_> = seen.tracks().iter().map(|track| track[first..].to_vec()).collect();
        let shown = if first == 0 { denoised(&all, current).into_owned() } else { all.clone() };
        Self { first, all, shown }
    }
}

/// What steps of an observed episode are made of.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ObservedEpisode<'a> {
    /// Agents and lights.
    pub seen: &'a Observation<'a>,
    /// The latest frames.
    pub recent: &'a RecentTracks,
    /// Heights of the road under agents.
    pub heights: &'a RoadHeights,
}

impl ObservedEpisode<'_> {
    /// Returns the steps at these frames, oldest first, and the bodies at the last one. For frames before the
    /// last realized one, the AV's next state is known if the protocol shows the AV one frame ahead at all.
    pub(crate) fn steps(
        &self,
        frames: &[usize],
        around: &mut Surroundings<'_>,
        config: &Config,
    ) -> (Vec<StepGraph>, Vec<Body>) {
        let mut earlier = Vec::new();
        let mut steps = Vec::with_capacity(frames.len());
        let mut bodies = Vec::new();
        for &now in frames {
            let step;
            (step, bodies) = self.step(&[], now, around, &earlier, config);
            earlier.extend_from_slice(&step.here);
            steps.push(step);
        }
        (steps, bodies)
    }

    /// Returns the step at one frame, and the bodies of its nodes. `standing` are agents that stand, by slot,
    /// and are no nodes.
    pub(crate) fn step(
        &self,
        standing: &[(usize, Body)],
        frame: usize,
        around: &mut Surroundings<'_>,
        earlier: &[EarlierNode],
        config: &Config,
    ) -> (StepGraph, Vec<Body>) {
        let Self { seen, recent, heights } = *self;
        let (realized, now) = (seen.frame(), frame - recent.first);
        // After the last realized frame the AV is only predicted, and lights keep their states.
        let av_next = match seen.av_next() {
            Some(next) if frame == realized => Some(next),
            Some(_) if frame < realized => recent.shown[0][now + 1],
            _ => None,
        };
        let lights = (0..seen.start().lights.len()).map(|l| seen.light(l)[frame.min(realized)]);
        let lights: Vec<_> = lights.collect();
        let view = SceneView {
            agents: &seen.start().agents,
            tracks: &recent.shown,
            now,
            first: recent.first,
            av_next,
            lights: &lights,
            start: Some(seen.start()),
            heights: Some(heights),
        };
        StepGraph::around(standing, &view, around, earlier, config)
    }
}

#[cfg(test)]
mod tests {
    use reactsim_scene::{Agent, AgentKind, AgentState, LoggedAgent, Scenario, ScenarioParts};

    use super::*;

    #[test]
    fn plans_see_a_window_of_an_episode_of_any_length() {
        let at = |f: usize| Some(AgentState { x: f as f64, y: 0.0, heading: 0.0, vx: 10.0, vy: 0.0 });
        let agent = Agent { id: "av".into(), kind: AgentKind::Vehicle, length: 4.0, width: 2.0 };
        let logged = LoggedAgent { agent, track: (0..91).map(at).collect(), heights: Vec::new() };
        let parts = ScenarioParts { id: "av".into(), agents: vec![logged], ..Default::default() };
        let scenario = Scenario::assemble(parts).unwrap();
        for now in [10, 40, 50, 51, 90, 6010] {
            let tracks = [(0..=now).map(at).collect::<Vec<_>>()];
            let recent = RecentTracks::of(&Observation::new(&scenario.start, &tracks, &[], None), 4);
            // All frames as long as recorded ones are among the last forty.
            assert_eq!(recent.first, if now <= 50 { 0 } else { now - 40 }, "{now}");
            assert_eq!(recent.all[0][..], tracks[0][recent.first..]);
            assert_eq!(recent.shown, recent.all, "nothing to smooth");
            assert!(recent.all[0].len() <= 51);
        }
    }
}
