//! A scenario made ready for the network to learn from.

use rand::RngExt;
use reactsim::geometry::{Vec2, direction};
use reactsim::scene::{CURRENT, DT, FRAMES, FUTURE, Frame};
use reactsim::training::Stream;
use serde::{Deserialize, Serialize};

use super::super::inputs::{Frame2, Scene, Surroundings, Survey};
use super::super::network::Config;
use super::Disturbance;
use crate::models::learning::LearningScene;
use crate::models::ntp::reactive::step::View;
use crate::models::ntp::tokens::Class;

/// How scenes are varied.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Augmentation {
    /// How often scenes are mirrored.
    pub mirror: f64,
    /// Scenes are stretched by up to this part, either way.
    pub stretch: f64,
    /// The moment from which is predicted is up to so many frames from the current one.
    pub shift: usize,
    /// How often the AV is not known one frame ahead.
    pub blind: f64,
    /// Agents beside their logs.
    pub disturbance: Disturbance,
}

/// Numbers of a true state: x, y, velocity x, y.
pub(super) const TRUTH: usize = 4;

/// What really happens to an agent at the instants that are predicted.
#[derive(Clone, Debug, Default)]
pub(super) struct Truth {
    /// `[states, 4]`, in the frame of the predicted agent; 0 where not known.
    pub states: Vec<f32>,
    /// `[states]`: 1 where known.
    pub known: Vec<f32>,
}

/// One agent to predict.
#[derive(Clone, Debug)]
pub(super) struct Target {
    /// What is around it.
    pub around: Surroundings,
    /// What it does.
    pub truth: Truth,
    /// Where it is after 8 s; where its log ends before, it goes on as it did.
    pub goal: Vec2,
    /// The unit vector of its last known heading.
    pub goal_ahead: Vec2,
    /// What those do who are shown, in their order.
    pub others: Vec<Truth>,
}

/// Some agents of a scenario.
#[derive(Clone, Debug)]
pub struct Sample {
    pub(super) targets: Vec<Target>,
}

/// Agents that are farther from the AV are not learnt from, metres.
const REACH: f64 = 80.0;
/// Who goes less far in the whole log is parked, metres; of those one in so many is learnt from.
const PARKED_WAY: f64 = 0.5;
const PARKED_PART: f64 = 0.1;
/// An agent is learnt from if so many of its states are known.
const LEAST_STATES: usize = 2;

/// Makes a sample of at most `most` agents, varied by what is drawn from the stream, or as logged, with those who are parked only if that is
/// asked for. `None` where nothing can be learnt.
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
        if stream.random::<f64>() < a.mirror {
            scene = scene.mirrored();
        }
        scene = scene.stretched(1.0 + a.stretch * (2.0 * stream.random::<f64>() - 1.0));
        now = (CURRENT + stream.random_range(0..=2 * a.shift)).saturating_sub(a.shift);
        blind = stream.random::<f64>() < a.blind;
        chosen = candidates(&scene, now);
        chosen.retain(|&slot| !is_parked(&scene.tracks[slot]) || stream.random::<f64>() < PARKED_PART);
        // The first of a list in random order.
        for i in 0..most.min(chosen.len()) {
            let j = stream.random_range(i..chosen.len());
            chosen.swap(i, j);
        }
        // The AV comes from outside: it is shown as recorded.
        for track in &mut scene.tracks[1..] {
            *track = a.disturbance.apply(track, now, stream);
        }
    } else {
        chosen = candidates(&scene, now);
        // Whoever is parked makes every figure better.
        chosen.retain(|&slot| parked || !is_parked(&scene.tracks[slot]));
    }
    chosen.truncate(most);
    let lights: Vec<_> = scene.lights.iter().map(|l| l[now]).collect();
    let av_next = if blind { None } else { scene.tracks[0].get(now + 1).copied().flatten() };
    let view = View { agents: &scene.agents, tracks: &scene.tracks, now, av_next, lights: &lights };
    let ground = scene.map.ground();
    let seen = Scene::of(&view, &ground);
    let target = |slot: usize| {
        let around = Surroundings::of(&seen, slot, config)?;
        let frame = Frame2::of(around.pose);
        let track = &scene.tracks[slot];
        let truth = truth(track, now, &frame, config);
        let known = truth.known.iter().filter(|k| **k > 0.0).count();
        if known < LEAST_STATES {
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

/// Agents that may be learnt from, nearest to the AV first.
fn candidates(scene: &LearningScene<Survey>, now: usize) -> Vec<usize> {
    let at = |slot: usize| scene.tracks[slot].get(now).copied().flatten();
    let Some(av) = at(0) else { return Vec::new() };
    let far = |slot: usize| at(slot).map(|s| (s.position() - av.position()).norm());
    let mut near: Vec<(f64, usize)> = (0..scene.agents.len())
        .filter(|&slot| Class::of(scene.agents[slot].kind).is_some())
        .filter_map(|slot| Some((far(slot).filter(|d| *d < REACH)?, slot)))
        .collect();
    near.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    near.into_iter().map(|n| n.1).collect()
}

/// The states of a track at the instants that are predicted.
fn truth(track: &[Frame], now: usize, frame: &Frame2, config: &Config) -> Truth {
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
                truth.states.extend([0.0; TRUTH]);
                truth.known.push(0.0);
            }
        }
    }
    truth
}

/// Where a track is after eight seconds, and its heading there.
fn goal(track: &[Frame], now: usize, frame: &Frame2) -> Option<(Vec2, Vec2)> {
    let end = now + FUTURE;
    let (at, state) = (now + 1..=end.min(FRAMES - 1)).rev().find_map(|f| Some((f, track[f]?)))?;
    let before = track[at - 1].map(|b| (state.position() - b.position()) / DT);
    let velocity = state.velocity().or(before).unwrap_or_default();
    let p = state.position() + velocity * ((end - at) as f64 * DT);
    Some((frame.point(p), frame.vector(direction(state.heading))))
}

fn is_parked(track: &[Frame]) -> bool {
    let mut present = track.iter().flatten();
    let Some(first) = present.next() else { return true };
    present.all(|s| (s.position() - first.position()).norm() < PARKED_WAY)
}
