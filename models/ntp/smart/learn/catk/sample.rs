//! Input of a rollout: the tokenised history of a scene, and the record to come back to.

use rand::RngExt;
use reactsim::dynamics::Pose;
use reactsim::scene::Scenario;
use reactsim::training::Stream;

use super::super::super::super::token_loss::loss_weight;
use super::super::super::super::tokens::{
    MapVocabulary, TOKEN_FRAMES, TOKEN_STEPS, Vocabulary, curve_pieces,
};
use super::super::super::Scene;
use super::super::tracked::{LoggedScene, scene_without_agents, tracked_agents};
use super::CatkRecipe;
use crate::models::perception::Class;

/// Number of the AV among the agents of a sample.
pub(super) const AV: usize = 0;

/// Number of steps of the history that a rollout begins with.
pub(super) const HISTORY: usize = 2;

/// Training sample: a scene with its history, and the record.
#[derive(Clone, Debug)]
pub struct CatkSample {
    /// Map, agents, and the steps of the history.
    pub(super) scene: Scene,
    /// The agents of the scene.
    pub(super) agents: Vec<RecordedAgent>,
}

/// An agent and its record.
#[derive(Clone, Debug)]
pub(super) struct RecordedAgent {
    pub(super) class: Class,
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
    recipe: &CatkRecipe,
    vocabulary: &Vocabulary,
    map_vocabulary: &MapVocabulary,
    varied: Option<&mut Stream>,
) -> Option<CatkSample> {
    let mut logged = LoggedScene::of(scenario, curve_pieces(&scenario.start));
    let mut first = 0;
    if let Some(stream) = varied {
        logged = logged.varied(recipe.mirror, recipe.stretch, stream);
        first = stream.random_range(0..=TOKEN_STEPS - HISTORY - recipe.steps);
    }
    let mut scene = scene_without_agents(&logged, map_vocabulary, recipe.map_radius, HISTORY)?;
    let mut agents = Vec::new();
    for agent in tracked_agents(&logged, recipe.agents, 0) {
        let tokens = agent.track.nearest_tokens(vocabulary, agent.class);
        scene.agents.push(agent.class, &logged.agents[agent.slot], recipe.height);
        for (at, step) in (first..).zip(&mut scene.steps) {
            agent.put(step, &tokens, at);
        }
        let last = first + HISTORY - 1;
        let frame = |step: usize| (last + step + 2) * TOKEN_FRAMES;
        agents.push(RecordedAgent {
            class: agent.class,
            pose: tokens.valid[last].then_some(tokens.poses[last]),
            record: (0..recipe.steps).map(|step| agent.track.pose(frame(step))).collect(),
            weight: loss_weight(&logged, agent.slot),
        });
    }
    let driven = if recipe.external_av { &agents[(AV + 1).min(agents.len())..] } else { &agents[..] };
    let learns = |agent: &RecordedAgent| agent.pose.is_some() && agent.record[0].is_some();
    driven.iter().any(learns).then_some(CatkSample { scene, agents })
}
