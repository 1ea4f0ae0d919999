//! What agents would have done with tokens along the log: states to learn from, and what to choose in each.
//!
//! Every agent follows its logged track by tokens, as a simulator executes them, with errors put in on purpose: some tokens are not the
//! nearest, some starts are off. What is to be learnt in each state leads half of the way back to the log, so that errors die out without
//! swerving.

use rand::RngExt;
use reactsim::dynamics::Pose;
use reactsim::scene::{Agent, FRAMES, Frame};
use reactsim::training::Stream;
use serde::{Deserialize, Serialize};

use super::super::execute::Executor;
use super::super::tokens::{Class, TOKEN_FRAMES, Vocabulary, motion_between, moved};

/// Errors that are put in.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Noise {
    /// How often an agent does not do what is nearest to the log.
    pub wrong: f64,
    /// Among how many of the nearest tokens it then chooses.
    pub among: usize,
    /// Which part of the distance to the log remains after a token that does right.
    pub remains: f64,
}

/// The track of an agent as executed, and per step what it should choose.
#[derive(Clone, Debug)]
pub(crate) struct Driven {
    /// 91 frames.
    pub track: Vec<Frame>,
    /// Per step the nearest token; `None` where there is nothing to learn.
    pub labels: Vec<Option<usize>>,
}

/// Drives an agent along its log from `first` on in steps of half a second. Without noise it follows the log as well as tokens can.
pub(crate) fn drive(
    agent: &Agent,
    logged: &[Frame],
    first: usize,
    vocabulary: &Vocabulary,
    executor: &mut Executor,
    mut noise: Option<(&Noise, &mut Stream)>,
) -> Driven {
    let steps = (FRAMES - 1 - first) / TOKEN_FRAMES;
    let mut driven = Driven { track: logged[..=first].to_vec(), labels: vec![None; steps] };
    let Some(class) = Class::of(agent.kind) else {
        driven.track.extend_from_slice(&logged[first + 1..]);
        return driven;
    };
    for (step, label) in driven.labels.iter_mut().enumerate() {
        let at = first + step * TOKEN_FRAMES;
        let next = at + TOKEN_FRAMES;
        let here = driven.track[at];
        let (Some(state), Some(log), Some(goal)) = (here, logged[at], logged[next]) else {
            // Who comes and goes is shown as recorded.
            driven.track.extend_from_slice(&logged[at + 1..=next]);
            continue;
        };
        let (from, log, goal) = (Pose::from(state), Pose::from(log), Pose::from(goal));
        // Where the agent would be if it kept its distance to the log, and how much of that is to remain.
        let off = motion_between(log, from);
        let remains = noise.as_ref().map_or(0.0, |(n, _)| n.remains);
        let kept = Pose { position: off.position * remains, heading: off.heading * remains };
        let target = motion_between(from, moved(goal, kept));
        let nearest = vocabulary.nearest(class, target);
        *label = Some(nearest);
        let mut chosen = nearest;
        if let Some((noise, stream)) = &mut noise
            && stream.random::<f64>() < noise.wrong
        {
            let near = vocabulary.nearest_k(class, target, noise.among);
            if !near.is_empty() {
                chosen = near[stream.random_range(0..near.len())].0;
            }
        }
        executor.execute(agent, class, vocabulary.poses(class, chosen), &mut driven.track);
    }
    // Frames after the last whole step are of no use.
    driven.track.resize(FRAMES, None);
    driven
}
