//! Step-by-step evaluation: earlier steps are cached and only the newest is computed.

use std::collections::VecDeque;

use burn::tensor::Tensor;

use reactsim::models::nn::Noise;

use super::relation::Pose;
use super::{Agents, Edges, InputError, Links, MapTokens, Smart, Step, TokenTables};

/// An encoded map, computed once. Cloning is cheap.
#[derive(Clone, Debug)]
pub struct EncodedMap {
    poses: Vec<Pose>,
    /// Features [P, h] for each block, normalized as its sources.
    sources: Vec<Tensor<2>>,
}

/// A scene that is evaluated step by step. Cloning is cheap, so that several rollouts can share a
/// beginning.
#[derive(Clone, Debug)]
pub struct Episode {
    map: EncodedMap,
    agents: Agents,
    /// Features of class and shape, [A, h].
    identities: Tensor<2>,
    /// The last steps, as many as agents see of their past.
    steps: VecDeque<Step>,
    /// Input features [A, h] for each block and each of those steps, normalized as sources.
    pasts: Vec<VecDeque<Tensor<2>>>,
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
        let features = self.map_encoder.forward(tables, map, edges, &mut Noise::none(), &mut |_, _| {});
        let sources = self.agent_encoder.pt2a_attn_layers.iter();
        let sources = if map.is_empty() {
            sources.map(|_| features.clone()).collect()
        } else {
            sources.map(|layer| layer.sources(features.clone())).collect()
        };
        EncodedMap { poses: Pose::all(&map.position, &map.orientation), sources }
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
    ) -> Result<Episode, InputError> {
        agents.check()?;
        let identities = self.agent_encoder.identities(&agents, &tables.device());
        let pasts = vec![VecDeque::new(); self.config().num_agent_layers];
        Ok(Episode { map, agents, identities, steps: VecDeque::new(), pasts })
    }

    /// Adds the next step of a scene and returns the scores of its next tokens, [A, tokens], as in
    /// [`Smart::forward`]. Neither other scenes nor threads affect a single bit.
    ///
    /// # Errors
    /// [`InputError`] if the network cannot read the step; the episode is then unchanged.
    pub fn step(
        &self,
        tables: &TokenTables,
        episode: &mut Episode,
        step: Step,
    ) -> Result<Tensor<2>, InputError> {
        let x = self.advance(tables, episode, step)?;
        let counts = self.config().n_token_agent.of_classes();
        if episode.agents.is_empty() {
            return Ok(Tensor::zeros([0, counts.into_iter().max().unwrap_or(0)], &x.device()));
        }
        Ok(self.agent_encoder.token_predict_head.forward(x, &episode.agents.class, counts))
    }

    /// Adds the next step of a scene and returns its features, [A, h], without scores. Used for steps of
    /// the history.
    ///
    /// # Errors
    /// [`InputError`] if the network cannot read the step; the episode is then unchanged.
    pub fn advance(
        &self,
        tables: &TokenTables,
        episode: &mut Episode,
        step: Step,
    ) -> Result<Tensor<2>, InputError> {
        let (config, layers, count) = (self.config(), &self.agent_encoder, episode.agents.len());
        step.check(config, &episode.agents)?;
        let device = tables.device();
        let before = episode.steps.back();
        let motion: Vec<[f32; 2]> = (0..count)
            .map(|a| {
                let own = Pose::new(step.position[a], step.heading[a]);
                before.map_or([0.0; 2], |b| own.motion(b.position[a]))
            })
            .collect();
        let tokens = tables.agents(episode.agents.class.iter().copied().zip(step.token.iter().copied()));
        if count == 0 {
            return Ok(tokens);
        }
        let mut x = layers.embed(tokens, episode.identities.clone(), &motion);

        let (mut from_map, mut among) = (Edges::new(3), Edges::new(3));
        from_map.add_from_map(config, &episode.map.poses, &step, |agent| agent);
        among.among_agents(config, &step, |agent| agent);
        episode.steps.push_back(step);
        let steps = episode.steps.make_contiguous();
        let visible: Vec<Vec<bool>> = steps.iter().map(|s| s.valid.clone()).collect();
        let newest = steps.len() - 1;
        let own =
            Edges::over_time(config, steps, &visible, newest..newest + 1, |a, t| t * count + a, |a, _| a);
        let own = Links::new(&own, count, &layers.r_t_emb, &device);
        let from_map = Links::new(&from_map, count, &layers.r_pt2a_emb, &device);
        let among = Links::new(&among, count, &layers.r_a2a_emb, &device);

        let noise = &mut Noise::none();
        for i in 0..config.num_agent_layers {
            let layer = &layers.t_attn_layers[i];
            let past = &mut episode.pasts[i];
            let sources = layer.sources(x.clone());
            let earlier = if past.is_empty() {
                sources.clone()
            } else {
                Tensor::cat(past.iter().cloned().collect(), 0)
            };
            x = layer.forward_with(x, earlier, &own.neighbors, &own.relations, noise);
            past.push_back(sources);
            let layer = &layers.pt2a_attn_layers[i];
            x = layer.forward_with(
                x,
                episode.map.sources[i].clone(),
                &from_map.neighbors,
                &from_map.relations,
                noise,
            );
            let layer = &layers.a2a_attn_layers[i];
            let sources = layer.sources(x.clone());
            x = layer.forward_with(x, sources, &among.neighbors, &among.relations, noise);
        }
        if episode.steps.len() > config.window() {
            episode.steps.pop_front();
            episode.pasts.iter_mut().for_each(|past| drop(past.pop_front()));
        }
        Ok(x)
    }
}

impl Episode {
    /// Returns the agents.
    pub fn agents(&self) -> &Agents {
        &self.agents
    }

    /// Returns the newest step.
    pub fn newest(&self) -> Option<&Step> {
        self.steps.back()
    }
}
