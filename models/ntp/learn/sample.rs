//! Training samples of the network.

use rand::RngExt;
use reactsim_nn::learning::{LearningScene, shifted};
use reactsim_nn::perception::{KnownMap, denoised};
use reactsim_nn::training::Stream;
use reactsim_scene::{CURRENT, FRAMES, FUTURE, Frame};
use serde::{Deserialize, Serialize};

use super::super::drive::{Perturbation, drive};
use super::super::execute::Executor;
use super::super::reactive::Config;
use super::super::reactive::linked_places::LinkedPlaces;
use super::super::reactive::step::{EarlierNode, StepGraph};
use super::super::token_loss::{Target, loss_weight};
use super::super::tokens::{TOKEN_FRAMES, Vocabulary};

/// Data augmentation.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Augmentation {
    /// Probability that a scene is mirrored.
    pub mirror: f64,
    /// Largest relative change of scale, up or down.
    pub stretch: f64,
    /// Largest shift of the first step, in frames, from the current frame or from a later one on the
    /// same half-second grid.
    pub shift: usize,
    /// Number of steps per sample, starting at a random one: fewer cost less, and neighbouring steps
    /// teach much the same.
    pub window: usize,
    /// Probability that the AV is not known one frame ahead.
    pub blind: f64,
    /// Deliberate errors during replay.
    pub noise: Perturbation,
}

/// Training sample of one scene: network inputs of its steps, and labels.
#[derive(Clone, Debug)]
pub struct Sample {
    pub(crate) linked: LinkedPlaces,
    pub(crate) steps: Vec<StepGraph>,
    pub(crate) targets: Vec<Target>,
}

/// Number of steps from the current frame to the last one.
const ALL_STEPS: usize = FUTURE / TOKEN_FRAMES;

/// Builds a sample of at most `most` agents, augmented by draws from the stream, or as logged. `None` if
/// there is nothing to learn.
pub(crate) fn sample(
    mut scene: LearningScene<KnownMap>,
    config: &Config,
    vocabulary: &Vocabulary,
    most: usize,
    varied: Option<(&Augmentation, &mut Stream)>,
) -> Option<Sample> {
    let (mut first, mut blind, mut window) = (CURRENT, false, ALL_STEPS);
    let mut noise = None;
    if let Some((a, stream)) = varied {
        scene = scene.varied(a.mirror, a.stretch, stream);
        let later = ALL_STEPS.saturating_sub(a.window);
        let later = TOKEN_FRAMES * stream.random_range(0..=later);
        first = shifted(CURRENT + later, a.shift, stream);
        window = a.window;
        blind = stream.random::<f64>() < a.blind;
        noise = Some((&a.noise, stream));
    }
    let mut executor = Executor::new(true);
    let count = scene.agents.len().min(most);
    let mut tracks: Vec<Vec<Frame>> = Vec::with_capacity(count);
    let mut labels = Vec::with_capacity(count);
    for slot in 0..count {
        let logged = &scene.tracks[slot];
        let driven = drive(
            &scene.agents[slot],
            logged,
            first,
            vocabulary,
            &mut executor,
            noise.as_mut().map(|(n, s)| (*n, &mut **s)),
        );
        // The AV is an external input: it is shown as recorded.
        tracks.push(if slot == 0 { logged.clone() } else { driven.track });
        labels.push(driven.labels);
    }
    let tracks = denoised(&tracks, first);
    let weights: Vec<f32> = (0..count).map(|slot| loss_weight(&scene, slot)).collect();

    let linked = LinkedPlaces::of(&scene.map, config);
    let mut sample = Sample { linked, steps: Vec::new(), targets: Vec::new() };
    let mut earlier: Vec<EarlierNode> = Vec::new();
    let mut row = 0;
    // Start two steps before the first one, if they exist: the past of a rollout when it begins.
    let mut at = first - TOKEN_FRAMES * (first / TOKEN_FRAMES).min(2);
    while at + TOKEN_FRAMES < FRAMES && at < first + window * TOKEN_FRAMES {
        let lights = scene.lights_at(at);
        let view = scene.view(&tracks, at, blind, &lights);
        let step = StepGraph::of(&view, &sample.linked.places, &earlier, config);
        if let Some(k) = at.checked_sub(first).map(|d| d / TOKEN_FRAMES) {
            for (i, (&slot, &class)) in step.slots.iter().zip(&step.classes).enumerate() {
                if let Some(token) = labels[slot].get(k).copied().flatten() {
                    sample.targets.push(Target { row: row + i, class, token, weight: weights[slot] });
                }
            }
        }
        row += step.slots.len();
        earlier.extend_from_slice(&step.here);
        sample.steps.push(step);
        at += TOKEN_FRAMES;
    }
    sample.forget_unused_places(config.map_layers);
    (!sample.targets.is_empty()).then_some(sample)
}

impl Sample {
    /// Returns the number of its nodes.
    pub(super) fn nodes(&self) -> usize {
        self.steps.iter().map(|step| step.slots.len()).sum()
    }

    /// Removes places that no agent attends to, which are most of a map.
    fn forget_unused_places(&mut self, hops: usize) {
        let used = self.steps.iter().flat_map(|s| s.places.sources());
        let (linked, moved) = self.linked.reduced(used, hops);
        for step in &mut self.steps {
            for (index, open) in step.places.index.iter_mut().zip(&step.places.open) {
                *index = if *open { moved[*index as usize] } else { 0 };
            }
        }
        self.linked = linked;
    }
}
