//! The complete network.

use burn::module::Module;
use burn::tensor::{Device, Tensor};
use reactsim_nn::{Initializer, Noise, Tensors, WeightsError};

use super::tables::{pick, rows};
use super::{
    AgentEncoder, Batch, InputError, Links, MapEncoder, SmartConfig, Stage, TokenShapes, TokenTables,
};

/// The network: it maps scenes to a score for every token of every agent at every step. Its output is
/// invariant to translation and rotation of the scene as long as all steps are valid.
#[derive(Module, Debug)]
pub struct Smart {
    pub(super) map_encoder: MapEncoder,
    pub(super) agent_encoder: AgentEncoder,
    #[module(skip)]
    config: SmartConfig,
}

impl Smart {
    /// Builds a network with initial weights.
    ///
    /// # Errors
    /// [`WeightsError`] if the configuration is invalid.
    pub fn init(config: &SmartConfig, init: &mut Initializer) -> Result<Self, WeightsError> {
        config.check()?;
        Ok(Self {
            map_encoder: MapEncoder::init(config, init),
            agent_encoder: AgentEncoder::init(config, init),
            config: config.clone(),
        })
    }

    /// Loads a network from a safetensors file: the state dict of SMART, CATK or TrajTok, with or
    /// without the prefix `encoder.` of a complete training checkpoint, or a file saved by this program.
    ///
    /// # Errors
    /// [`WeightsError`] naming what does not fit.
    pub fn load(config: &SmartConfig, weights: &[u8], device: &Device) -> Result<Self, WeightsError> {
        Self::of_tensors(config, Tensors::read(weights)?, device)
    }

    /// Like [`Smart::load`], from tensors that were in a file with others.
    ///
    /// # Errors
    /// [`WeightsError`] naming what does not fit.
    pub fn of_tensors(
        config: &SmartConfig,
        tensors: Tensors<'_>,
        device: &Device,
    ) -> Result<Self, WeightsError> {
        let network = Self::init(config, &mut Initializer::blank(device))?;
        let found = network.num_params();
        if config.n_params != 0 && config.n_params != found {
            return Err(WeightsError::Refused(format!(
                "the configuration states {} parameters, its network has {found}: it belongs to another \
                 network",
                config.n_params
            )));
        }
        let mut tensors = tensors.without_prefix("encoder.");
        // One norm is stored under two names where sources and destinations are of one kind.
        for (layers, count) in [
            ("map_encoder.pt2pt_layers", config.num_map_layers),
            ("agent_encoder.t_attn_layers", config.num_agent_layers),
            ("agent_encoder.a2a_attn_layers", config.num_agent_layers),
        ] {
            for (i, part) in (0..count).flat_map(|i| [(i, "weight"), (i, "bias")]) {
                let norm = format!("{layers}.{i}.attn_prenorm_x");
                tensors.drop_twin(&format!("{norm}_dst.{part}"), &format!("{norm}_src.{part}"))?;
            }
        }
        tensors.load(network)
    }

    /// Returns the network with everything but the attention of agents and the token heads fixed, as CATK
    /// trains it: the encoder of the map, and the embeddings of tokens, motion, classes, shapes and
    /// relations.
    pub(super) fn with_frozen_embeddings(self) -> Self {
        let Self { map_encoder, agent_encoder, config } = self;
        Self {
            map_encoder: map_encoder.no_grad(),
            agent_encoder: agent_encoder.with_frozen_embeddings(),
            config,
        }
    }

    /// Returns the configuration.
    pub fn config(&self) -> &SmartConfig {
        &self.config
    }

    /// Returns the map half.
    pub fn map_encoder(&self) -> &MapEncoder {
        &self.map_encoder
    }

    /// Returns the agent half.
    pub fn agent_encoder(&self) -> &AgentEncoder {
        &self.agent_encoder
    }

    /// Returns the scores of the next tokens of every node, [nodes, tokens], including invalid nodes. If
    /// classes have different numbers of tokens, tokens that a class does not have score -1e9.
    ///
    /// For training and for complete recorded scenes. Scenes of a batch do not see each other, but the
    /// last bits of a scene's scores may depend on the rest of the batch; [`CachedScene`](super::CachedScene)
    /// evaluates one scene at a time.
    pub fn forward(&self, tables: &TokenTables, batch: &Batch, noise: &mut Noise) -> Tensor<2> {
        self.forward_watched(tables, batch, noise, &mut |_, _| {})
    }

    /// Like [`Smart::forward`], and passes intermediate features to `watch`.
    pub fn forward_watched(
        &self,
        tables: &TokenTables,
        batch: &Batch,
        noise: &mut Noise,
        watch: &mut dyn FnMut(Stage, &Tensor<2>),
    ) -> Tensor<2> {
        let map = self.map_encoder.forward(tables, &batch.map, &batch.map_edges, noise, watch);
        let (agents, nodes, device) = (&self.agent_encoder, batch.nodes(), map.device());
        let counts = self.config.n_token_agent.of_classes();
        if nodes == 0 {
            return Tensor::zeros([0, counts.into_iter().max().unwrap_or(0)], &device);
        }
        let identities = pick(&agents.identities(&batch.agents, &device), batch.agent.iter().copied());
        let tokens = tables.agents(batch.class.iter().copied().zip(batch.token.iter().copied()));
        let mut x = agents.embed(tokens, identities, &batch.motion);
        watch(Stage::Fused, &x);
        let over_time = Links::new(&batch.over_time, nodes, &agents.r_t_emb, &device);
        let from_map = Links::new(&batch.from_map, nodes, &agents.r_pt2a_emb, &device);
        let among = Links::new(&batch.among_agents, nodes, &agents.r_a2a_emb, &device);
        for i in 0..self.config.num_agent_layers {
            let layer = &agents.t_attn_layers[i];
            let sources = layer.sources(x.clone());
            x = layer.forward(x, sources, &over_time.neighbors, &over_time.relations, noise);
            watch(Stage::OverTime(i), &x);
            let layer = &agents.pt2a_attn_layers[i];
            let sources = layer.sources(map.clone());
            x = layer.forward(x, sources, &from_map.neighbors, &from_map.relations, noise);
            watch(Stage::FromMap(i), &x);
            let layer = &agents.a2a_attn_layers[i];
            let sources = layer.sources(x.clone());
            x = layer.forward(x, sources, &among.neighbors, &among.relations, noise);
            watch(Stage::AmongAgents(i), &x);
        }
        agents.token_predict_head.forward(x, &batch.class, counts)
    }

    /// Computes the vectors of all tokens.
    ///
    /// # Errors
    /// [`InputError`] if their number is not that of the network.
    pub fn tables(&self, shapes: &TokenShapes, device: &Device) -> Result<TokenTables, InputError> {
        shapes.check(self.config())?;
        let mut starts = [0; 3];
        let mut vectors = Vec::new();
        let mut count = 0;
        for (class, corners) in shapes.agents.iter().enumerate() {
            starts[class] = count;
            count += corners.len();
            vectors.push(self.agent_encoder.token_embedding(class).forward(rows(corners, device)));
        }
        let map = self.map_encoder.token_embedding().forward(rows(&shapes.map, device));
        Ok(TokenTables { agents: Tensor::cat(vectors, 0), starts, map })
    }
}
