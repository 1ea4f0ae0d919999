//! A scenario made ready for the network to learn from.

use rand::RngExt;
use reactsim::scene::{AgentState, CURRENT, FRAMES, FUTURE, Frame};
use reactsim::training::Stream;
use serde::{Deserialize, Serialize};

use super::super::execute::Executor;
use super::super::reactive::Config;
use super::super::reactive::known_map::KnownMap;
use super::super::reactive::places::Places;
use super::super::reactive::step::{Earlier, Step, View};
use super::super::tokens::{Class, TOKEN_FRAMES, Vocabulary};
use super::drive::{Noise, drive};
use crate::models::learning::LearningScene;

/// How scenes are varied.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Augmentation {
    /// How often scenes are mirrored.
    pub mirror: f64,
    /// Scenes are stretched by up to this part, either way.
    pub stretch: f64,
    /// The first step is up to so many frames from the current one, or from one that is some half seconds later.
    pub shift: usize,
    /// Steps that are learnt from at a time, from a random one on: fewer cost less, and neighbouring steps teach much the same.
    pub window: usize,
    /// How often the AV is not known one step ahead.
    pub blind: f64,
    /// Errors put in.
    pub noise: Noise,
}

/// What is to be chosen at a node.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Target {
    /// Row of the node.
    pub row: usize,
    /// Its class.
    pub class: Class,
    /// The token.
    pub token: usize,
    /// How much it counts.
    pub weight: f32,
}

/// One scene: the steps as the network reads them and what it should choose.
#[derive(Clone, Debug)]
pub struct Sample {
    pub(crate) places: Places,
    pub(crate) steps: Vec<Step>,
    pub(crate) targets: Vec<Target>,
}

/// Steps from the current frame to the last one.
const ALL_STEPS: usize = FUTURE / TOKEN_FRAMES;
/// What parked vehicles count.
const PARKED: f32 = 0.05;
/// Who moves less than this over the whole log is parked, metres.
const PARKED_WAY: f64 = 0.5;

/// Makes a sample of at most `most` agents, varied by what is drawn from the stream, or as logged. `None` where nothing can be learnt.
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
        if stream.random::<f64>() < a.mirror {
            scene = scene.mirrored();
        }
        scene = scene.stretched(1.0 + a.stretch * (2.0 * stream.random::<f64>() - 1.0));
        let later = ALL_STEPS.saturating_sub(a.window);
        let later = TOKEN_FRAMES * stream.random_range(0..=later);
        first = (CURRENT + later + stream.random_range(0..=2 * a.shift)).saturating_sub(a.shift);
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
        // The AV comes from outside: it is shown as recorded.
        tracks.push(if slot == 0 { logged.clone() } else { driven.track });
        labels.push(driven.labels);
    }
    let weights: Vec<f32> =
        scene.tracks[..count].iter().map(|t| if is_parked(t) { PARKED } else { 1.0 }).collect();

    let places = Places::of(&scene.map, config);
    let mut sample = Sample { places, steps: Vec::new(), targets: Vec::new() };
    let mut earlier: Vec<Earlier> = Vec::new();
    let mut row = 0;
    // Two steps before the first one, as far as there are any: what a rollout remembers when it begins.
    let mut at = first - TOKEN_FRAMES * (first / TOKEN_FRAMES).min(2);
    while at + TOKEN_FRAMES < FRAMES && at < first + window * TOKEN_FRAMES {
        let lights: Vec<_> = scene.lights.iter().map(|l| l[at]).collect();
        let av_next: Option<AgentState> = if blind { None } else { tracks[0][at + 1] };
        let view =
            View { agents: &scene.agents[..count], tracks: &tracks, now: at, av_next, lights: &lights };
        let step = Step::of(&view, &sample.places, &earlier, config);
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
    /// Most of a map is seen by nobody.
    fn forget_unused_places(&mut self, hops: usize) {
        let used = self.steps.iter().flat_map(|s| s.places.sources());
        let (places, moved) = self.places.reduced(used, hops);
        for step in &mut self.steps {
            for (index, open) in step.places.index.iter_mut().zip(&step.places.open) {
                *index = if *open { moved[*index as usize] } else { 0 };
            }
        }
        self.places = places;
    }
}

fn is_parked(track: &[Frame]) -> bool {
    let mut present = track.iter().flatten();
    let Some(first) = present.next() else { return true };
    present.all(|s| (s.position() - first.position()).norm() < PARKED_WAY)
}
