//! Input of a rollout: the tokenised history of a scene, and the record to come back to.

use rand::RngExt;
use reactsim::dynamics::Pose;
use reactsim::scene::{CURRENT, Scenario};
use reactsim::training::Stream;

use super::super::super::super::tokens::{
    MapVocabulary, PreparedTrack, TOKEN_FRAMES, TOKEN_STEPS, Vocabulary, curve_pieces, fill_gaps,
};
use super::super::super::observed::map_tokens_of;
use super::super::super::{Agents, Scene, Step};
use super::super::sample::{class_of, loss_weight, put};
use super::CatkRecipe;
use crate::models::learning::LearningScene;
use crate::models::perception::Class;

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

/// Builds the sample of a scenario, augmented by draws from the stream, or as logged. `None` if no agent has both a
/// history and a record.
pub(super) fn sample(
    scenario: &Scenario,
    recipe: &CatkRecipe,
    vocabulary: &Vocabulary,
    map_vocabulary: &MapVocabulary,
    varied: Option<&mut Stream>,
) -> Option<CatkSample> {
    let mut scene = LearningScene::of(scenario, curve_pieces(&scenario.start));
    let mut first = 0;
    if let Some(stream) = varied {
        scene = scene.varied(recipe.mirror, recipe.stretch, stream);
        first = stream.random_range(0..=TOKEN_STEPS - HISTORY - recipe.steps);
    }
    let center = scene.tracks[0].get(CURRENT).copied().flatten()?.position();
    let mut sample = CatkSample {
        scene: Scene {
            map: map_tokens_of(&scene.map, map_vocabulary, center, recipe.map_radius),
            agents: Agents::default(),
            steps: vec![Step::default(); HISTORY],
        },
        agents: Vec::new(),
    };
    for slot in 0..scene.agents.len() {
        let Some(class) = class_of(&scene.agents, slot) else { continue };
        if sample.agents.len() == recipe.agents {
            break;
        }
        let mut track = scene.tracks[slot].clone();
        fill_gaps(&mut track);
        let track = PreparedTrack::new(&track);
        let tokens = track.nearest_tokens(vocabulary, class);
        let agent = &scene.agents[slot];
        sample.scene.agents.class.push(class.index() as u8);
        sample.scene.agents.shape.push([agent.length as f32, agent.width as f32, recipe.height as f32]);
        for (at, step) in (first..).zip(&mut sample.scene.steps) {
            put(step, &track, &tokens, at);
        }
        let last = first + HISTORY - 1;
        let frame = |step: usize| (last + step + 2) * TOKEN_FRAMES;
        sample.agents.push(RecordedAgent {
            class,
            pose: tokens.valid[last].then_some(tokens.poses[last]),
            record: (0..recipe.steps).map(|step| track.pose(frame(step))).collect(),
            weight: loss_weight(&scene, slot),
        });
    }
    let learns = |agent: &RecordedAgent| agent.pose.is_some() && agent.record[0].is_some();
    sample.agents.iter().any(learns).then_some(sample)
}
