//! Training samples: logged scenes as tokens, with the token to choose at every step.

use rand::RngExt;
use reactsim::geometry::Vec2;
use reactsim::scene::{Agent, CURRENT, Frame, Scenario};
use reactsim::training::Stream;

use super::super::super::token_loss::Target;
use super::super::super::tokens::{
    CurveKind, CurvePiece, MapVocabulary, ORIGIN, PreparedTrack, TOKEN_FRAMES, TOKEN_STEPS, TokenNoise,
    TokenTrack, Vocabulary, curve_pieces, fill_gaps, motion_between,
};
use super::super::observed::map_tokens_of;
use super::super::{Agents, Edges, Scene, SmartConfig, Step};
use super::{Augmentation, Recipe};
use crate::models::learning::{LearningMap, LearningScene};
use crate::models::perception::Class;

/// Training sample of one scene: input of the network, and labels.
#[derive(Clone, Debug)]
pub struct Sample {
    /// Map, agents and steps.
    pub scene: Scene,
    /// Tokens to choose. Rows are nodes as in a batch: by agent, then step.
    pub(super) targets: Vec<Target>,
}

/// Loss weight of parked agents; that of others is 1.
const PARKED_WEIGHT: f32 = 0.05;

impl LearningMap for Vec<CurvePiece> {
    fn mirror(&mut self, flip: fn(Vec2) -> Vec2) {
        for piece in self {
            piece.points.iter_mut().for_each(|p| *p = flip(*p));
            // Road edges have the road on their left.
            if matches!(piece.kind, CurveKind::EdgeBoundary | CurveKind::EdgeMedian) {
                piece.points.reverse();
            }
        }
    }

    fn stretch(&mut self, factor: f64) {
        self.iter_mut().flat_map(|piece| &mut piece.points).for_each(|p| *p *= factor);
    }
}

/// Builds the sample of a scenario, augmented by draws from the stream, or as logged. `None` if there is
/// nothing to learn.
pub(super) fn sample(
    scenario: &Scenario,
    recipe: &Recipe,
    config: &SmartConfig,
    vocabulary: &Vocabulary,
    map_vocabulary: &MapVocabulary,
    varied: Option<(&Augmentation, &mut Stream)>,
) -> Option<Sample> {
    let mut scene = LearningScene::of(scenario, curve_pieces(&scenario.start));
    let (mut shift, mut first, mut steps) = (0, 0, TOKEN_STEPS);
    let mut noise = None;
    if let Some((a, stream)) = varied {
        scene = scene.varied(a.mirror, a.stretch, stream);
        shift = stream.random_range(0..=a.shift);
        steps = a.window.min(TOKEN_STEPS);
        first = stream.random_range(0..=TOKEN_STEPS - steps);
        noise = Some((a.noise(), stream));
    }
    let center = scene.tracks[0].get(CURRENT).copied().flatten()?.position();
    let mut sample = Sample {
        scene: Scene {
            map: map_tokens_of(&scene.map, map_vocabulary, center, recipe.map_radius),
            agents: Agents::default(),
            steps: vec![Step::default(); steps],
        },
        targets: Vec::new(),
    };
    let mut known = 0;
    for slot in 0..scene.agents.len() {
        let Some(class) = class_of(&scene.agents, slot) else { continue };
        if known == recipe.agents {
            break;
        }
        known += 1;
        let mut track: Vec<Frame> = scene.tracks[slot].iter().skip(shift).copied().collect();
        fill_gaps(&mut track);
        let track = PreparedTrack::new(&track);
        let tokens = match &mut noise {
            Some((Some(noise), stream)) => track.noisy_tokens(vocabulary, class, *noise, stream),
            _ => track.nearest_tokens(vocabulary, class),
        };
        let agent = &scene.agents[slot];
        sample.scene.agents.class.push(class.index() as u8);
        sample.scene.agents.shape.push([agent.length as f32, agent.width as f32, recipe.height as f32]);
        let weight = loss_weight(&scene, slot);
        for (at, step) in (first..first + steps).zip(&mut sample.scene.steps) {
            put(step, &track, &tokens, at);
            if !tokens.valid[at] || !tokens.valid.get(at + 1).copied().unwrap_or(false) {
                continue;
            }
            // The step that the history of a rollout begins with is not predicted from.
            let Some(goal) = track.pose((at + 2) * TOKEN_FRAMES).filter(|_| at > 0) else { continue };
            let token = vocabulary.nearest(class, motion_between(tokens.poses[at], goal));
            let row = (known - 1) * steps + at - first;
            sample.targets.push(Target { row, class, token, weight });
        }
    }
    if sample.targets.is_empty() {
        return None;
    }
    forget_unseen_pieces(&mut sample.scene, config);
    Some(sample)
}

/// Removes map tokens from which nothing reaches an agent, which are most of a map: agents see some tokens, and
/// every layer of the map connects those with their neighbours.
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

/// Adds an agent to a step of a scene. At an invalid step its true position is stated, from which the motion at the
/// next step counts.
pub(super) fn put(step: &mut Step, track: &PreparedTrack, tokens: &TokenTrack, at: usize) {
    let (token, valid) = (tokens.tokens[at], tokens.valid[at]);
    let pose = if valid { Some(tokens.poses[at]) } else { track.pose((at + 1) * TOKEN_FRAMES) };
    let pose = pose.unwrap_or(ORIGIN);
    step.position.push([pose.position.x as f32, pose.position.y as f32]);
    step.heading.push(pose.heading as f32);
    step.valid.push(valid);
    step.token.push(token as u32);
}

/// Returns the class of an agent; the AV counts as a vehicle.
pub(super) fn class_of(agents: &[Agent], slot: usize) -> Option<Class> {
    if slot == 0 { Some(Class::Vehicle) } else { Class::of(agents[slot].kind) }
}

/// Returns the weight of an agent's labels.
pub(super) fn loss_weight<M>(scene: &LearningScene<M>, slot: usize) -> f32 {
    if scene.is_parked(slot) { PARKED_WEIGHT } else { 1.0 }
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
