//! Replay of logged tracks by tokens: training states and the token to choose in each.
//!
//! Every agent follows its logged track by tokens, as a simulator executes them, with deliberate errors:
//! some tokens are not the nearest, and some steps start off the log. The target in each state leads
//! part of the way back to the log, so that errors decay without swerving.

use rand::RngExt;
use reactsim_nn::perception::Class;
use reactsim_nn::training::Stream;
use reactsim_scene::dynamics::Pose;
use reactsim_scene::{Agent, AgentKind, FRAMES, Frame};
use serde::{Deserialize, Serialize};

use super::execute::Executor;
use super::slowdown::Slowdown;
use super::tokens::{TOKEN_FRAMES, Vocabulary, motion_between, moved};

/// Deliberate errors during replay.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Perturbation {
    /// Probability that an agent does not take the token nearest to the target.
    pub wrong: f64,
    /// Number of nearest tokens from which it then chooses.
    pub among: usize,
    /// Fraction of the offset from the log that remains after a correct token.
    pub remains: f64,
    /// Probability that a vehicle brakes for no reason at some time. From then on its labels lead back to the
    /// speeds of the log, along the logged path.
    #[serde(default)]
    pub slowed: f64,
}

/// Executed track of an agent, with the token to choose at every step.
#[derive(Clone, Debug)]
pub(crate) struct LabeledTrack {
    /// 91 states.
    pub track: Vec<Frame>,
    /// Nearest token to the target at each step; `None` if there is nothing to learn.
    pub labels: Vec<Option<usize>>,
}

/// Replays the log of an agent from frame `first` in steps of half a second. Without `noise` it follows
/// the log as closely as tokens can.
pub(crate) fn drive(
    agent: &Agent,
    logged: &[Frame],
    first: usize,
    vocabulary: &Vocabulary,
    executor: &mut Executor,
    mut noise: Option<(&Perturbation, &mut Stream)>,
) -> LabeledTrack {
    let steps = (FRAMES - 1 - first) / TOKEN_FRAMES;
    let slowdown = match &mut noise {
        Some((noise, stream)) if agent.kind == AgentKind::Vehicle && noise.slowed > 0.0 => {
            // The same draws whatever the log, so that the noise of others does not depend on it.
            let drawn = Slowdown::draw(logged, first, stream);
            if stream.random::<f64>() < noise.slowed { drawn } else { None }
        }
        _ => None,
    };
    let mut driven = LabeledTrack { track: logged[..=first].to_vec(), labels: vec![None; steps] };
    let Some(class) = Class::of(agent.kind) else {
        driven.track.extend_from_slice(&logged[first + 1..]);
        return driven;
    };
    for (step, label) in driven.labels.iter_mut().enumerate() {
        let at = first + step * TOKEN_FRAMES;
        let next = at + TOKEN_FRAMES;
        let here = driven.track[at];
        let (Some(state), Some(log), Some(goal)) = (here, logged[at], logged[next]) else {
            // Agents that appear or disappear are shown as recorded.
            driven.track.extend_from_slice(&logged[at + 1..=next]);
            continue;
        };
        let (from, mut log, mut goal) = (Pose::from(state), Pose::from(log), Pose::from(goal));
        let mut braked = None;
        if let Some(slowdown) = slowdown.as_ref().filter(|s| step >= s.first) {
            let speed = state.velocity().map_or(0.0, |v| v.norm());
            let passage = slowdown.passage(from.position, speed, next, step);
            (log, goal, braked) = (passage.here, passage.recovers, passage.brakes);
        }
        // Offset of the agent from the log, and the part of it that is to remain.
        let offset = motion_between(log, from);
        let remains = noise.as_ref().map_or(0.0, |(n, _)| n.remains);
        let kept = Pose { position: offset.position * remains, heading: offset.heading * remains };
        let target = motion_between(from, moved(goal, kept));
        let nearest = vocabulary.nearest(class, target);
        *label = Some(nearest);
        let mut chosen = match braked {
            Some(goal) => vocabulary.nearest(class, motion_between(from, moved(goal, kept))),
            None => nearest,
        };
        if braked.is_none()
            && let Some((noise, stream)) = &mut noise
            && stream.random::<f64>() < noise.wrong
        {
            let near = vocabulary.nearest_k(class, target, noise.among);
            if !near.is_empty() {
                chosen = near[stream.random_range(0..near.len())].0;
            }
        }
        executor.execute(agent, class, vocabulary.poses(class, chosen), &mut driven.track);
    }
    // Frames after the last whole step are not used.
    driven.track.resize(FRAMES, None);
    driven
}
