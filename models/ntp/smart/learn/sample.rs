//! Training samples: logged scenes as tokens, with the token to choose at every step.

use rand::RngExt;
use reactsim_nn::learning::Window;
use reactsim_nn::training::Stream;
use reactsim_scene::{Frame, Scenario};

use super::super::super::token_loss::{Chooser, Target, loss_weight};
use super::super::super::tokens::{
    MapVocabulary, TOKEN_FRAMES, TOKEN_STEPS, TokenNoise, Vocabulary, curve_pieces, motion_between,
};
use super::super::{Edges, Scene, SmartConfig};
use super::tracked::{LoggedScene, scene_without_agents, tracked_agents};
use super::{Augmentation, Recipe};

/// Training sample of one scene: input of the network, and labels.
#[derive(Clone, Debug)]
pub struct Sample {
    /// Map, agents and steps.
    pub scene: Scene,
    /// Tokens to choose. Rows are nodes as in a batch: by agent, then step.
    pub(super) targets: Vec<Target>,
}

/// Builds the sample of a scenario, augmented by draws from the stream, or as logged. `None` if there is
/// nothing to learn.
pub(super) fn sample(
    scenario: &Scenario,
    recipe: &Recipe,
    config: &SmartConfig,
    vocabulary: &Vocabulary,
    map_vocabulary: &MapVocabulary,
    mut varied: Option<&mut Stream>,
) -> Option<Sample> {
    let window = Window::of(scenario, varied.as_deref_mut());
    let pieces = curve_pieces(&window.start);
    let mut logged = LoggedScene::of(window, pieces);
    let (mut shift, mut first, mut steps) = (0, 0, TOKEN_STEPS);
    let mut noise = None;
    if let Some(stream) = varied {
        let augmentation = &recipe.augmentation;
        logged = logged.varied(augmentation.mirror, augmentation.stretch, stream);
        shift = stream.random_range(0..=augmentation.shift);
        steps = augmentation.window.min(TOKEN_STEPS);
        first = stream.random_range(0..=TOKEN_STEPS - steps);
        noise = augmentation.noise().map(|noise| (noise, stream));
    }
    let scene = scene_without_agents(&logged, map_vocabulary, recipe.map_radius, steps)?;
    with_agents(scene, &logged, recipe, config, vocabulary, (shift, first), noise).map(|(sample, _)| sample)
}

/// Samples of several futures of a scenario, as [`sample`], which share the map.
pub(super) struct Futures<'s> {
    logged: LoggedScene,
    scene: Scene,
    recipe: &'s Recipe,
    config: &'s SmartConfig,
    vocabulary: &'s Vocabulary,
}

impl<'s> Futures<'s> {
    /// Begins with a scenario; `None` if the AV is not there.
    pub(super) fn of(
        scenario: &Scenario,
        recipe: &'s Recipe,
        config: &'s SmartConfig,
        vocabulary: &'s Vocabulary,
        map_vocabulary: &MapVocabulary,
    ) -> Option<Self> {
        let window = Window::of(scenario, None);
        let pieces = curve_pieces(&window.start);
        let logged = LoggedScene::of(window, pieces);
        let scene = scene_without_agents(&logged, map_vocabulary, recipe.map_radius, TOKEN_STEPS)?;
        Some(Self { logged, scene, recipe, config, vocabulary })
    }

    /// Builds the sample in which agents have these tracks. Also returns which agent chooses each target.
    pub(super) fn sample(&mut self, tracks: &[Vec<Frame>]) -> Option<(Sample, Vec<Chooser>)> {
        self.logged.tracks = tracks.to_vec();
        let (scene, recipe) = (self.scene.clone(), self.recipe);
        with_agents(scene, &self.logged, recipe, self.config, self.vocabulary, (0, 0), None)
    }
}

/// Adds the agents to a scene, with the token to choose at every step. Their tracks begin `shift` frames
/// later than the logged scene, and the steps of the scene with the number `first`. `None` if there is
/// nothing to learn. Also returns which agent chooses each target.
fn with_agents(
    mut scene: Scene,
    logged: &LoggedScene,
    recipe: &Recipe,
    config: &SmartConfig,
    vocabulary: &Vocabulary,
    (shift, first): (usize, usize),
    mut noise: Option<(TokenNoise, &mut Stream)>,
) -> Option<(Sample, Vec<Chooser>)> {
    let steps = scene.steps.len();
    let (mut targets, mut choosers) = (Vec::new(), Vec::new());
    for (number, agent) in tracked_agents(logged, recipe.agents, shift).enumerate() {
        let class = agent.class;
        let tokens = match &mut noise {
            Some((noise, stream)) => agent.track.noisy_tokens(vocabulary, class, *noise, stream),
            None => agent.track.nearest_tokens(vocabulary, class),
        };
        scene.agents.push(class, &logged.agents[agent.slot], recipe.height);
        let weight = loss_weight(logged, agent.slot);
        for (at, step) in (first..first + steps).zip(&mut scene.steps) {
            agent.put(step, &tokens, at);
            if !tokens.valid[at] || !tokens.valid.get(at + 1).copied().unwrap_or(false) {
                continue;
            }
            // The step that the history of a rollout begins with is not predicted from.
            let Some(goal) = agent.track.pose((at + 2) * TOKEN_FRAMES).filter(|_| at > 0) else { continue };
            let token = vocabulary.nearest(class, motion_between(tokens.poses[at], goal));
            targets.push(Target { row: number * steps + at - first, class, token, weight });
            choosers.push(Chooser { slot: agent.slot, frame: (at + 1) * TOKEN_FRAMES });
        }
    }
    if targets.is_empty() {
        return None;
    }
    forget_unseen_pieces(&mut scene, config);
    Some((Sample { scene, targets }, choosers))
}

/// Removes map tokens from which nothing reaches an agent, which are most of a map: agents see some tokens,
/// and every layer of the map connects those with their neighbours.
pub(super) fn forget_unseen_pieces(scene: &mut Scene, config: &SmartConfig) {
    let mut seen = vec![false; scene.map.len()];
    for step in &scene.steps {
        let edges = Edges::from_map(config, &scene.map, step);
        edges.sources.iter().for_each(|source| seen[*source as usize] = true);
    }
    let edges = Edges::among_map(config, &scene.map);
    for _ in 0..config.num_map_layers {
        let before = seen.clone();
        for (source, target) in edges.sources.iter().zip(&edges.targets) {
            seen[*source as usize] |= before[*target as usize];
        }
    }
    scene.map.retain(&seen);
}

impl Augmentation {
    /// Returns the choice among near tokens, if there is one.
    fn noise(&self) -> Option<TokenNoise> {
        let k = self.near_tokens;
        match self.temperature {
            _ if k <= 1 => None,
            temperature if temperature > 0.0 => Some(TokenNoise::Weighted { k, temperature }),
            _ => Some(TokenNoise::Uniform { k }),
        }
    }
}
