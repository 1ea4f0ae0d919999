//! Training samples made of scenarios.

use rand::RngExt;
use reactsim_geometry::{Vec2, direction};
use reactsim_nn::learning::{LearningScene, SceneAugmentation};
use reactsim_nn::perception::Class;
use reactsim_nn::training::Stream;
use reactsim_scene::{CURRENT, DT, FRAMES, FUTURE, Frame};
use serde::{Deserialize, Serialize};

use super::super::inputs::{LocalFrame, SceneContext, Surroundings, Survey};
use super::super::network::Config;
use super::Disturbance;

/// Parameters of the augmentation of scenes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Augmentation {
    /// Augmentation of the whole scene.
    #[serde(flatten)]
    pub scene: SceneAugmentation,
    /// Probability that the AV's next state is hidden.
    pub blind: f64,
    /// Disturbances of agents.
    pub disturbance: Disturbance,
}

/// Number of values per true state: x, y, velocity x, y.
pub(super) const TRUTH_SIZE: usize = 4;

/// True states of an agent at the predicted instants.
#[derive(Clone, Debug, Default)]
pub(super) struct Truth {
    /// `[states, 4]`, in the frame of the predicted agent; 0 where unknown.
    pub states: Vec<f32>,
    /// `[states]`: 1 where known.
    pub known: Vec<f32>,
}

/// One agent to predict.
#[derive(Clone, Debug)]
pub(super) struct Target {
    /// Surroundings of the agent.
    pub around: Surroundings,
    /// True states of the agent.
    pub truth: Truth,
    /// Position after 8 s. If the log ends earlier, the agent keeps its last velocity.
    pub goal: Vec2,
    /// Unit vector of its last known heading.
    pub goal_ahead: Vec2,
    /// True states of the agents in the input, in their order.
    pub others: Vec<Truth>,
}

/// Targets of one scenario.
#[derive(Clone, Debug)]
pub struct Sample {
    pub(super) targets: Vec<Target>,
}

/// Largest distance from the AV of agents to learn from, metres.
const TARGET_RANGE: f64 = 80.0;
/// Share of parked agents that are kept in training.
const PARKED_SHARE: f64 = 0.1;
/// Smallest number of known states of a target.
const MIN_KNOWN_STATES: usize = 2;

/// Makes a sample of at most `most` agents. With `varied` the scene is augmented by draws from the
/// stream; otherwise it stays as logged, and parked agents are included only if `parked` is set. `None`
/// if there is nothing to learn from.
pub(super) fn sample(
    mut scene: LearningScene<Survey>,
    config: &Config,
    most: usize,
    varied: Option<(&Augmentation, &mut Stream)>,
    parked: bool,
) -> Option<Sample> {
    let (mut now, mut blind) = (CURRENT, false);
    let mut chosen: Vec<usize>;
    if let Some((a, stream)) = varied {
        (scene, now) = scene.augmented(&a.scene, Some(&mut *stream));
        blind = stream.random::<f64>() < a.blind;
        chosen = candidates(&scene, now);
        chosen.retain(|&slot| !scene.is_parked(slot) || stream.random::<f64>() < PARKED_SHARE);
        // Take the first agents of a shuffled list.
        for i in 0..most.min(chosen.len()) {
            let j = stream.random_range(i..chosen.len());
            chosen.swap(i, j);
        }
        // The AV is an external input and stays as recorded.
        for track in &mut scene.tracks[1..] {
            *track = a.disturbance.apply(track, now, stream);
        }
    } else {
        chosen = candidates(&scene, now);
        // Parked agents would flatter every measure.
        chosen.retain(|&slot| parked || !scene.is_parked(slot));
    }
    chosen.truncate(most);
    let (scene, survey) = scene.split_map();
    let map = survey.features();
    let lights = scene.lights_at(now);
    let tracks = config.attributes.shown(&scene.tracks, now);
    let view = scene.view(&tracks, now, blind, &lights);
    let context = SceneContext::of(&view, &map);
    let target = |slot: usize| {
        let around = Surroundings::of(&context, slot, config)?;
        let frame = LocalFrame::of(around.pose);
        let track = &scene.tracks[slot];
        let truth = truth(track, now, &frame, config);
        let known = truth.known.iter().filter(|k| **k > 0.0).count();
        if known < MIN_KNOWN_STATES {
            return None;
        }
        let (goal, goal_ahead) = goal(track, now, &frame)?;
        let others =
            around.slots.iter().map(|&s| self::truth(&scene.tracks[s], now, &frame, config)).collect();
        Some(Target { around, truth, goal, goal_ahead, others })
    };
    let targets: Vec<Target> = chosen.into_iter().filter_map(target).collect();
    (!targets.is_empty()).then_some(Sample { targets })
}

/// Returns the slots of agents to learn from, nearest to the AV first.
fn candidates(scene: &LearningScene<Survey>, now: usize) -> Vec<usize> {
    let at = |slot: usize| scene.tracks[slot].get(now).copied().flatten();
    let Some(av) = at(0) else { return Vec::new() };
    let far = |slot: usize| at(slot).map(|s| (s.position() - av.position()).norm());
    let mut near: Vec<(f64, usize)> = (0..scene.agents.len())
        .filter(|&slot| Class::of(scene.agents[slot].kind).is_some())
        .filter_map(|slot| Some((far(slot).filter(|d| *d < TARGET_RANGE)?, slot)))
        .collect();
    near.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    near.into_iter().map(|n| n.1).collect()
}

/// Returns the true states of a track at the predicted instants.
fn truth(track: &[Frame], now: usize, frame: &LocalFrame, config: &Config) -> Truth {
    let mut truth = Truth::default();
    for k in 1..=config.states() {
        let at = now + k * config.step;
        match track.get(at).copied().flatten() {
            Some(state) => {
                let before = track[at - 1].map(|b| (state.position() - b.position()) / DT);
                let velocity = state.velocity().or(before).unwrap_or_default();
                let (p, v) = (frame.point(state.position()), frame.vector(velocity));
                truth.states.extend([p.x, p.y, v.x, v.y].map(|value| value as f32));
                truth.known.push(1.0);
            }
            None => {
                truth.states.extend([0.0; TRUTH_SIZE]);
                truth.known.push(0.0);
            }
        }
    }
    truth
}

/// Returns the position of a track after eight seconds, and its last known heading.
fn goal(track: &[Frame], now: usize, frame: &LocalFrame) -> Option<(Vec2, Vec2)> {
    let end = now + FUTURE;
    let (at, state) = (now + 1..=end.min(FRAMES - 1)).rev().find_map(|f| Some((f, track[f]?)))?;
    let before = track[at - 1].map(|b| (state.position() - b.position()) / DT);
    let velocity = state.velocity().or(before).unwrap_or_default();
    let p = state.position() + velocity * ((end - at) as f64 * DT);
    Some((frame.point(p), frame.vector(direction(state.heading))))
}
