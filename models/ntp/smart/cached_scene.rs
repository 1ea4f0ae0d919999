//! Step-by-step evaluation: earlier steps are cached and only the newest is computed.

use std::collections::VecDeque;

use burn::tensor::Tensor;
use reactsim_nn::SharedRows;

use super::relation::Pose;
use super::{Agents, Edges, InputError, MapTokens, Smart, SmartConfig, Step, TokenTables};

/// An encoded map, computed once. Cloning is cheap.
#[derive(Clone, Debug)]
pub struct EncodedMap {
    pub(super) poses: Vec<Pose>,
    /// Features [P, h] for each block, normalized as its sources.
    pub(super) sources: SharedRows,
}

/// A scene that is evaluated step by step. Cloning is cheap, so that several rollouts can share a
/// beginning.
#[derive(Clone, Debug)]
pub struct CachedScene {
    pub(super) map: EncodedMap,
    pub(super) agents: Agents,
    /// Features of class and shape, [A, h].
    pub(super) identities: SharedRows,
    /// The last steps, as many as agents see of their past.
    pub(super) steps: VecDeque<Step>,
    /// Input features [A, h] of each of those steps for each block, normalized as its sources.
    pub(super) pasts: VecDeque<SharedRows>,
}

impl Smart {
    /// Encodes a map.
    ///
    /// # Errors
    /// [`InputError`] if the network cannot read it.
    pub fn encode_map(&self, tables: &TokenTables, map: &MapTokens) -> Result<EncodedMap, InputError> {
        map.check(self.config())?;
        Ok(self.encode_map_with(tables, map, &Edges::among_map(self.config(), map)))
    }

    /// Like [`Smart::encode_map`], with given pairs of map tokens. The map must have been checked.
    pub fn encode_map_with(&self, tables: &TokenTables, map: &MapTokens, edges: &Edges) -> EncodedMap {
        let mut encoded = self.encode_maps_with(tables, &[map], edges);
        encoded.remove(0)
    }

    /// Starts a scene without steps.
    ///
    /// # Errors
    /// [`InputError`] if the network cannot read the agents.
    pub fn begin(
        &self,
        tables: &TokenTables,
        map: EncodedMap,
        agents: Agents,
    ) -> Result<CachedScene, InputError> {
        agents.check()?;
        let mut begun = self.begin_all(tables, vec![(map, agents)]);
        Ok(begun.remove(0))
    }

    /// Adds the next step of a scene and returns the scores of its next tokens, [A, tokens], as in
    /// [`Smart::forward`]. Neither other scenes nor threads affect a single bit.
    ///
    /// # Errors
    /// [`InputError`] if the network cannot read the step; the scene is then unchanged.
    pub fn step(
        &self,
        tables: &TokenTables,
        scene: &mut CachedScene,
        step: Step,
    ) -> Result<Tensor<2>, InputError> {
        scene.check(self.config(), &step)?;
        Ok(self.step_all(tables, vec![(scene, step)]))
    }

    /// Adds the next step of a scene and returns its features, [A, h], without scores. Used for steps of
    /// the history.
    ///
    /// # Errors
    /// [`InputError`] if the network cannot read the step; the scene is then unchanged.
    pub fn advance(
        &self,
        tables: &TokenTables,
        scene: &mut CachedScene,
        step: Step,
    ) -> Result<Tensor<2>, InputError> {
        scene.check(self.config(), &step)?;
        Ok(self.advance_all(tables, vec![(scene, step)]))
    }
}

impl CachedScene {
    /// Returns the agents.
    pub fn agents(&self) -> &Agents {
        &self.agents
    }

    /// Returns the newest step.
    pub fn newest(&self) -> Option<&Step> {
        self.steps.back()
    }

    /// Checks that a network with this configuration can read a step of this scene.
    ///
    /// # Errors
    /// [`InputError`] naming the list and entry.
    pub(super) fn check(&self, config: &SmartConfig, step: &Step) -> Result<(), InputError> {
        step.check(config, &self.agents)
    }
}
