//! Rollouts of a group, and what is learned from them.

use reactsim_nn::training::Stream;
use reactsim_scene::DT;

use super::super::super::super::policy_loss::Choice;
use super::super::super::super::token_loss::Target;
use super::super::super::super::tokens::{ORIGIN, TOKEN_FRAMES, Vocabulary, moved};
use super::super::super::{CachedScene, InputError, Scene, Smart, Step, TokenTables};
use super::super::closed_loop::{AV, ClosedLoopSample, HISTORY};
use super::GrpoRecipe;
use super::reward::{Outcome, Paths, judge};

/// A rollout and its judgement.
#[derive(Debug)]
pub(super) struct Rollout {
    /// The scene with all steps.
    pub(super) scene: Scene,
    drawn: Vec<Drawn>,
    pub(super) outcome: Outcome,
}

/// A token that an agent drew.
#[derive(Clone, Copy, Debug)]
pub(super) struct Drawn {
    agent: usize,
    step: usize,
    target: Target,
}

/// Drives a sample several times. Draws come from the stream in order.
///
/// # Errors
/// [`InputError`] if the network cannot read the sample.
pub(super) fn group(
    network: &Smart,
    tables: &TokenTables,
    sample: &ClosedLoopSample,
    recipe: &GrpoRecipe,
    vocabulary: &Vocabulary,
    stream: &mut Stream,
) -> Result<Vec<Rollout>, InputError> {
    let cached = sample.begin(network, tables)?;
    (0..recipe.rollouts)
        .map(|_| drive(network, tables, cached.clone(), sample, recipe, vocabulary, stream))
        .collect()
}

/// Drives a sample once, from a scene that has all of the history but its last step.
fn drive(
    network: &Smart,
    tables: &TokenTables,
    mut cached: CachedScene,
    sample: &ClosedLoopSample,
    recipe: &GrpoRecipe,
    vocabulary: &Vocabulary,
    stream: &mut Stream,
) -> Result<Rollout, InputError> {
    let mut scene = sample.scene.clone();
    let mut drawn = Vec::new();
    let mut paths: Paths = sample.agents.iter().map(|agent| vec![agent.pose]).collect();
    for step in 0..recipe.excerpt.steps {
        let now = HISTORY - 1 + step;
        let scores = network.step(tables, &mut cached, scene.steps[now].clone())?;
        let width = scores.dims()[1];
        let scores: Vec<f32> = scores.into_data().iter::<f32>().collect();
        let mut next = Step::default();
        for (number, agent) in sample.agents.iter().enumerate() {
            let class = agent.class;
            let path = &mut paths[number];
            let Some(pose) = path.last().copied().flatten() else {
                path.extend([None; TOKEN_FRAMES]);
                next.push(ORIGIN, 0, false);
                continue;
            };
            let (end, token) = if number == AV && recipe.excerpt.external_av {
                agent.follow(pose, step, vocabulary)
            } else {
                let own = &scores[number * width..][..vocabulary.tokens(class)];
                // Scores that are no numbers end the training by their loss.
                let token = recipe.sampling.draw(own, stream).unwrap_or(0);
                let row = number * (HISTORY + recipe.excerpt.steps) + now;
                let target = Target { row, class, token, weight: agent.weight };
                drawn.push(Drawn { agent: number, step, target });
                (Some(moved(pose, vocabulary.end(class, token))), token)
            };
            let between = &vocabulary.poses(class, token)[1..TOKEN_FRAMES];
            path.extend(between.iter().map(|motion| end.map(|_| moved(pose, *motion))));
            path.push(end);
            next.push(end.unwrap_or(ORIGIN), token, end.is_some());
        }
        scene.steps.push(next);
    }
    let outcome = judge(&sample.agents, &paths, recipe.excerpt.steps, TOKEN_FRAMES, DT, &recipe.rewards);
    Ok(Rollout { scene, drawn, outcome })
}

/// Returns the tokens drawn in each rollout of a group, with how much better the agent fared from there on
/// than in the other rollouts. The mean of these is the baseline, so that the gradient is unbiased.
pub(super) fn choices(group: &[Rollout]) -> Vec<Vec<Choice>> {
    let others = (group.len() - 1) as f64;
    let compared = |rollout: &Rollout| {
        let choice = |drawn: &Drawn| {
            let value = |rollout: &Rollout| rollout.outcome.returns[drawn.agent][drawn.step];
            let (own, all) = (value(rollout), group.iter().map(value).sum::<f64>());
            Choice { drawn: drawn.target, advantage: (own - (all - own) / others) as f32 }
        };
        rollout.drawn.iter().map(choice).collect()
    };
    group.iter().map(compared).collect()
}
