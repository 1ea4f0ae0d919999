//! Scenes to learn from as input of the network: the map, and the agents with their tracks.

use reactsim_geometry::Vec2;
use reactsim_nn::learning::{LearningMap, LearningScene};
use reactsim_nn::perception::Class;
use reactsim_scene::{CURRENT, Frame};

use super::super::super::tokens::{
    CurveKind, CurvePiece, MapVocabulary, ORIGIN, PreparedTrack, TOKEN_FRAMES, TokenTrack, fill_gaps,
};
use super::super::observed::{class_of, map_tokens_of};
use super::super::{Agents, Scene, Step};

/// A logged scene with the map in pieces.
pub(super) type LoggedScene = LearningScene<Vec<CurvePiece>>;

impl LearningMap for CurvePiece {
    fn mirror(&mut self, flip: fn(Vec2) -> Vec2) {
        self.points.iter_mut().for_each(|p| *p = flip(*p));
        // Road edges have the road on their left.
        if matches!(self.kind, CurveKind::EdgeBoundary | CurveKind::EdgeMedian) {
            self.points.reverse();
        }
    }

    fn stretch(&mut self, factor: f64) {
        self.points.iter_mut().for_each(|p| *p *= factor);
    }
}

/// An agent of a scene, prepared for matching.
pub(super) struct TrackedAgent {
    /// Slot of the agent.
    pub(super) slot: usize,
    pub(super) class: Class,
    pub(super) track: PreparedTrack,
}

/// Returns the agents that a network knows, nearest to the AV first, at most `most`. Their tracks begin
/// `shift` frames later than the scene.
pub(super) fn tracked_agents(
    scene: &LoggedScene,
    most: usize,
    shift: usize,
) -> impl Iterator<Item = TrackedAgent> {
    let known = (0..scene.agents.len()).filter_map(|slot| Some((slot, class_of(&scene.agents, slot)?)));
    known.take(most).map(move |(slot, class)| {
        let mut track: Vec<Frame> = scene.tracks[slot].iter().skip(shift).copied().collect();
        fill_gaps(&mut track);
        TrackedAgent { slot, class, track: PreparedTrack::new(&track) }
    })
}

/// Returns the input of a network with the map within `radius` metres of the AV's current position, empty
/// steps, and no agents yet. `None` if the AV is not there.
pub(super) fn scene_without_agents(
    scene: &LoggedScene,
    map_vocabulary: &MapVocabulary,
    radius: f64,
    steps: usize,
) -> Option<Scene> {
    let center = scene.tracks[0].get(CURRENT).copied().flatten()?.position();
    Some(Scene {
        map: map_tokens_of(&scene.map, map_vocabulary, center, radius),
        agents: Agents::default(),
        steps: vec![Step::default(); steps],
    })
}

impl TrackedAgent {
    /// Adds the agent to a step of a scene. At an invalid step its true position is stated, from which the
    /// motion at the next step counts.
    pub(super) fn put(&self, step: &mut Step, tokens: &TokenTrack, at: usize) {
        let valid = tokens.valid[at];
        let pose = if valid { Some(tokens.poses[at]) } else { self.track.pose((at + 1) * TOKEN_FRAMES) };
        step.push(pose.unwrap_or(ORIGIN), tokens.tokens[at], valid);
    }
}
