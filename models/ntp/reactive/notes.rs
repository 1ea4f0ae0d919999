//! What a simulator notes of its rollouts, to learn from them.

use std::mem;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use burn::tensor::Tensor;
use reactsim_geometry::math;
use reactsim_nn::indices;
use reactsim_nn::perception::Class;

use super::batch::{NodeRows, NodeTensors};
use super::config::Config;
use super::network::{Network, Sources};

/// Probability that two draws of a token differ, below which it is not noted: neither its likelihood nor the
/// divergence has a gradient that counts. These are the tokens of parked agents, which are most of a scene.
const MIN_SPREAD: f64 = 0.01;
/// Tokens that are less likely than the likeliest one by this factor, as a logarithm, do not count for it.
const MAX_GAP: f64 = 12.0;

/// Notes of a simulator, and a reference network that sees the same rollouts. Clones share the notes.
#[derive(Clone, Debug)]
pub(crate) struct Notes {
    /// On the device of the simulator.
    pub(super) reference: Network,
    /// Agents in the slots from 1 up to this one, exclusively, are noted.
    agents: usize,
    steps: Arc<Mutex<Vec<NotedStep>>>,
}

/// Nodes of the episodes of a batch at one step, with the tokens that were drawn there.
#[derive(Debug)]
pub(crate) struct NotedStep {
    /// Input of the nodes. Links are to rows of the sources.
    pub(crate) nodes: NodeRows,
    /// What the nodes attended to.
    pub(crate) sources: Sources,
    /// Features of the nodes in the reference network, `[n, hidden]`.
    pub(crate) reference: Tensor<2>,
    /// The token of each node.
    pub(crate) drawn: Vec<Drawn>,
}

/// A token that an agent drew.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Drawn {
    /// Place of the episode in its batch.
    pub(crate) episode: usize,
    /// Slot of the agent.
    pub(crate) slot: usize,
    /// Frame from which the token leads on.
    pub(crate) frame: usize,
    /// Class of the agent.
    pub(crate) class: Class,
    /// The token.
    pub(crate) token: usize,
}

/// All nodes of a forward pass.
pub(super) struct Pass<'a> {
    pub(super) rows: NodeRows,
    pub(super) nodes: &'a NodeTensors,
    pub(super) sources: Sources,
    /// Logits of each node.
    pub(super) logits: &'a [Vec<f32>],
    /// Features of the nodes in the reference network, `[n, hidden]`.
    pub(super) reference: Tensor<2>,
}

impl Notes {
    /// Begins without notes.
    pub(crate) fn new(reference: Network, agents: usize) -> Self {
        Self { reference, agents, steps: Arc::default() }
    }

    /// Takes all steps that were noted so far, oldest first.
    pub(crate) fn take(&self) -> Vec<NotedStep> {
        mem::take(&mut self.steps())
    }

    fn steps(&self) -> MutexGuard<'_, Vec<NotedStep>> {
        self.steps.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Notes tokens that were drawn at this temperature in a forward pass, each with the row of its node.
    pub(super) fn add(&self, pass: Pass<'_>, drawn: &[(usize, Drawn)], temperature: f64, config: &Config) {
        let reference = self.reference.all_logits(pass.nodes, &pass.reference);
        let is_open = |logits: &[f32]| spread(logits, temperature) > MIN_SPREAD;
        let is_noted = |(row, drawn): &&(usize, Drawn)| {
            (1..self.agents).contains(&drawn.slot)
                && (is_open(&pass.logits[*row]) || is_open(&reference[*row]))
        };
        let (rows, drawn): (Vec<usize>, Vec<Drawn>) = drawn.iter().filter(is_noted).copied().unzip();
        if rows.is_empty() {
            return;
        }
        let index = indices(rows.iter().copied(), &pass.reference.device());
        self.steps().push(NotedStep {
            nodes: pass.rows.chosen(&rows, config),
            sources: pass.sources,
            reference: pass.reference.select(0, index),
            drawn,
        });
    }
}

/// Returns the probability that two draws of a token at this temperature differ.
fn spread(logits: &[f32], temperature: f64) -> f64 {
    let best = logits.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    let (mut sum, mut squares) = (0.0, 0.0);
    for logit in logits {
        let gap = f64::from(best - logit) / temperature;
        if gap < MAX_GAP {
            let weight = math::exp(-gap);
            sum += weight;
            squares += weight * weight;
        }
    }
    1.0 - squares / (sum * sum)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_spread_is_that_of_the_distribution() {
        // Probabilities 1/5 and 4/5.
        let two = spread(&[0.0, 2.0f32.ln(), -9.0], 0.5);
        assert!((two - (1.0 - 1.0 / 25.0 - 16.0 / 25.0)).abs() < 1e-6, "{two}");
        assert_eq!(spread(&[0.0, 9.0], 0.5), 0.0);
    }
}
