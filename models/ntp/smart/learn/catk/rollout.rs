//! The rollout: the network drives, kept near the record.

use reactsim_scene::dynamics::Pose;

use super::super::super::super::token_loss::Target;
use super::super::super::super::tokens::{ORIGIN, Vocabulary, motion_between, moved};
use super::super::super::{InputError, Smart, Step, TokenTables};
use super::super::Sample;
use super::super::closed_loop::{AV, ClosedLoopSample, HISTORY, RecordedAgent};
use super::CatkRecipe;

/// Rolls a sample out with a network without gradients. Returns the scene with all steps, and the labels.
///
/// # Errors
/// [`InputError`] if the network cannot read the sample.
pub(super) fn roll_out(
    network: &Smart,
    tables: &TokenTables,
    sample: &ClosedLoopSample,
    recipe: &CatkRecipe,
    vocabulary: &Vocabulary,
) -> Result<Sample, InputError> {
    let mut cached = sample.begin(network, tables)?;
    let mut scene = sample.scene.clone();
    let (mut targets, steps) = (Vec::new(), HISTORY + recipe.excerpt.steps);
    let mut poses: Vec<Option<Pose>> = sample.agents.iter().map(|agent| agent.pose).collect();
    for step in 0..recipe.excerpt.steps {
        let now = HISTORY - 1 + step;
        let scores = network.step(tables, &mut cached, scene.steps[now].clone())?;
        let width = scores.dims()[1];
        let scores: Vec<f32> = scores.into_data().iter::<f32>().collect();
        let mut next = Step::default();
        for (number, agent) in sample.agents.iter().enumerate() {
            let (pose, token) = match poses[number] {
                None => (None, 0),
                // An external AV executes none of the network's tokens and has no labels.
                Some(pose) if number == AV && recipe.excerpt.external_av => {
                    agent.follow(pose, step, vocabulary)
                }
                Some(pose) => {
                    let goal = agent.record[step].map(|goal| motion_between(pose, goal));
                    if let Some(goal) = goal {
                        let token = vocabulary.nearest(agent.class, goal);
                        let row = number * steps + now;
                        targets.push(Target { row, class: agent.class, token, weight: agent.weight });
                    }
                    let own = &scores[number * width..][..vocabulary.tokens(agent.class)];
                    let token = match goal {
                        Some(goal) => nearest_of_likeliest(own, goal, agent, recipe.top_k, vocabulary),
                        None => likeliest(own, 1).first().copied(),
                    };
                    let token = token.unwrap_or(0);
                    (Some(moved(pose, vocabulary.end(agent.class, token))), token)
                }
            };
            poses[number] = pose;
            next.push(pose.unwrap_or(ORIGIN), token, pose.is_some());
        }
        scene.steps.push(next);
    }
    Ok(Sample { scene, targets })
}

/// Returns the likeliest tokens in ascending order. Of equal scores, the lower index counts.
fn likeliest(scores: &[f32], most: usize) -> Vec<usize> {
    let mut order: Vec<usize> = (0..scores.len()).collect();
    let likelier = |a: &usize, b: &usize| scores[*b].total_cmp(&scores[*a]).then(a.cmp(b));
    if most < order.len() {
        order.select_nth_unstable_by(most - 1, likelier);
        order.truncate(most);
    }
    order.sort_unstable();
    order
}

/// Returns the token among the likeliest whose end is nearest to the record. Of equal distances, the lower
/// index counts.
fn nearest_of_likeliest(
    scores: &[f32],
    goal: Pose,
    agent: &RecordedAgent,
    top_k: usize,
    vocabulary: &Vocabulary,
) -> Option<usize> {
    let distance = |token| (token, vocabulary.distance(agent.class, token, goal));
    let near = likeliest(scores, top_k).into_iter().map(distance);
    near.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(token, _)| token)
}
