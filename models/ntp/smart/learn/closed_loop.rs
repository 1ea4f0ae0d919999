//! Samples of trainings in closed loop: the tokenised history of a scene, from which the network drives, and
//! the record.

use rand::RngExt;
use reactsim_nn::learning::Window;
use reactsim_nn::perception::Class;
use reactsim_nn::training::Stream;
use reactsim_scene::Scenario;
use reactsim_scene::dynamics::Pose;
use serde::{Deserialize, Serialize};

use super::super::super::token_loss::loss_weight;
use super::super::super::tokens::{
    MapVocabulary, TOKEN_FRAMES, TOKEN_STEPS, Vocabulary, curve_pieces, token_of_motion,
};
use super::super::{CachedScene, InputError, Scene, Smart, TokenTables};
use super::tracked::{LoggedScene, scene_without_agents, tracked_agents};

/// Number of the AV among the agents of a sample.
pub(super) const AV: usize = 0;

/// Number of steps of the history that a rollout begins with.
pub(super) const HISTORY: usize = 2;

/// Part of a scenario that becomes a sample, and its augmentation.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Excerpt {
    /// Number of agents per scenario, nearest to the AV first.
    pub agents: usize,
    /// Radius of the known map around the AV's position at the current frame, metres.
    pub map_radius: f64,
    /// Height of all boxes, metres.
    pub height: f64,
    /// Number of steps that the network drives; at most 16.
    pub steps: usize,
    /// Whether the AV follows its record instead of the network.
    pub external_av: bool,
    /// Probability that a scene is mirrored.
    pub mirror: f64,
    /// Largest relative change of scale, up or down.
    pub stretch: f64,
}

/// Training sample: a scene with its history, and the record.
#[derive(Clone, Debug)]
pub struct ClosedLoopSample {
    /// Map, agents, and the steps of the history.
    pub(super) scene: Scene,
    /// The agents of the scene.
    pub(super) agents: Vec<RecordedAgent>,
}

/// An agent and its record.
#[derive(Clone, Debug)]
pub(super) struct RecordedAgent {
    pub(super) class: Class,
    /// Length and width, metres.
    pub(super) extent: [f64; 2],
    /// Pose at the end of the history; `None` if the agent is not there.
    pub(super) pose: Option<Pose>,
    /// Recorded pose at the end of every step after the history.
    pub(super) record: Vec<Option<Pose>>,
    /// Weight of its labels.
    pub(super) weight: f32,
}

/// Builds the sample of a scenario, augmented by draws from the stream, or as logged. `None` if no agent that
/// the network drives has both a history and a record.
pub(super) fn sample(
    scenario: &Scenario,
    excerpt: &Excerpt,
    vocabulary: &Vocabulary,
    map_vocabulary: &MapVocabulary,
    mut varied: Option<&mut Stream>,
) -> Option<ClosedLoopSample> {
    let window = Window::of(scenario, varied.as_deref_mut());
    let pieces = curve_pieces(&window.start);
    let mut logged = LoggedScene::of(window, pieces);
    let mut first = 0;
    if let Some(stream) = varied {
        logged = logged.varied(excerpt.mirror, excerpt.stretch, stream);
        first = stream.random_range(0..=TOKEN_STEPS - HISTORY - excerpt.steps);
    }
    let mut scene = scene_without_agents(&logged, map_vocabulary, excerpt.map_radius, HISTORY)?;
    let mut agents = Vec::new();
    for agent in tracked_agents(&logged, excerpt.agents, 0) {
        let tokens = agent.track.nearest_tokens(vocabulary, agent.class);
        scene.agents.push(agent.class, &logged.agents[agent.slot], excerpt.height);
        for (at, step) in (first..).zip(&mut scene.steps) {
            agent.put(step, &tokens, at);
        }
        let last = first + HISTORY - 1;
        let frame = |step: usize| (last + step + 2) * TOKEN_FRAMES;
        agents.push(RecordedAgent {
            class: agent.class,
            extent: [logged.agents[agent.slot].length, logged.agents[agent.slot].width],
            pose: tokens.valid[last].then_some(tokens.poses[last]),
            record: (0..excerpt.steps).map(|step| agent.track.pose(frame(step))).collect(),
            weight: loss_weight(&logged, agent.slot),
        });
    }
    let driven = if excerpt.external_av { &agents[(AV + 1).min(agents.len())..] } else { &agents[..] };
    let learns = |agent: &RecordedAgent| agent.pose.is_some() && agent.record[0].is_some();
    driven.iter().any(learns).then_some(ClosedLoopSample { scene, agents })
}

impl ClosedLoopSample {
    /// Begins a rollout: the scene has all of the history but its last step.
    ///
    /// # Errors
    /// [`InputError`] if the network cannot read the sample.
    pub(super) fn begin(&self, network: &Smart, tables: &TokenTables) -> Result<CachedScene, InputError> {
        let map = network.encode_map(tables, &self.scene.map)?;
        let mut scene = network.begin(tables, map, self.scene.agents.clone())?;
        for earlier in &self.scene.steps[..HISTORY - 1] {
            network.advance(tables, &mut scene, earlier.clone())?;
        }
        Ok(scene)
    }
}

impl RecordedAgent {
    /// Follows the record from a pose for a step: the recorded pose at its end, `None` if there is none, and
    /// the token that describes the motion best.
    pub(super) fn follow(&self, pose: Pose, step: usize, vocabulary: &Vocabulary) -> (Option<Pose>, usize) {
        match self.record[step] {
            Some(goal) => (Some(goal), token_of_motion(vocabulary, self.class, pose, goal).0),
            None => (None, 0),
        }
    }
}
