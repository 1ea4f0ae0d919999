//! The network as a whole.

use burn::module::Module;
use burn::tensor::{Device, Tensor};

use reactsim::models::nn::{Initializer, Noise, Tensors, WeightsError};

use super::vocabulary::pick;
use super::{AgentEncoder, Batch, ConfigError, Links, MapEncoder, SmartConfig, TokenTables};

/// The network: scenes in, a score for every token of every agent at every step out. What it computes does not change when the scene is
/// moved or turned, as long as all steps are valid.
#[derive(Module, Debug)]
pub struct Smart {
    pub(super) map_encoder: MapEncoder,
    pub(super) agent_encoder: AgentEncoder,
    #[module(skip)]
    config: SmartConfig,
}

/// Where within the network features are looked at.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Stage {
    /// Map tokens before the first layer.
    MapInput,
    /// Map tokens after this layer.
    Map(usize),
    /// Nodes before the first block.
    Fused,
    /// Nodes after they attended to their own past, in this block.
    OverTime(usize),
    /// Nodes after they attended to the map, in this block.
    FromMap(usize),
    /// Nodes after they attended to each other, in this block.
    AmongAgents(usize),
}

/// Why weights do not make a network.
#[derive(Debug, thiserror::Error)]
pub enum LoadError {
    /// The configuration.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The tensors.
    #[error(transparent)]
    Weights(#[from] WeightsError),
    /// The configuration states another number of parameters.
    #[error("the configuration says {stated} parameters, its network has {found}: it is of another network")]
    Size {
        /// What `n_params` says.
        stated: usize,
        /// What there are.
        found: usize,
    },
}

impl Smart {
    /// A network with initial weights.
    ///
    /// # Errors
    /// [`ConfigError`] if there is no such network.
    pub fn init(config: &SmartConfig, init: &mut Initializer) -> Result<Self, ConfigError> {
        config.check()?;
        Ok(Self {
            map_encoder: MapEncoder::init(config, init),
            agent_encoder: AgentEncoder::init(config, init),
            config: config.clone(),
        })
    }

    /// A network with the weights of a safetensors file: the state dict of SMART, CATK or TrajTok, with or without the prefix `encoder.`
    /// of a whole training checkpoint, or what was saved here.
    ///
    /// # Errors
    /// [`LoadError`] that names what does not fit.
    pub fn load(config: &SmartConfig, weights: &[u8], device: &Device) -> Result<Self, LoadError> {
        Self::of_tensors(config, Tensors::read(weights)?, device)
    }

    /// As [`Smart::load`], from tensors that lay in a file beside others.
    ///
    /// # Errors
    /// [`LoadError`] that names what does not fit.
    pub fn of_tensors(
        config: &SmartConfig,
        tensors: Tensors<'_>,
        device: &Device,
    ) -> Result<Self, LoadError> {
        let network = Self::init(config, &mut Initializer::new(0, device))?;
        let found = network.num_params();
        if config.n_params != 0 && config.n_params != found {
            return Err(LoadError::Size { stated: config.n_params, found });
        }
        let mut tensors = tensors.without_prefix("encoder.");
        // One norm under two names wherever sources and destinations are of one kind.
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
        Ok(tensors.load(network)?)
    }

    /// Its measures.
    pub fn config(&self) -> &SmartConfig {
        &self.config
    }

    /// Its map half.
    pub fn map_encoder(&self) -> &MapEncoder {
        &self.map_encoder
    }

    /// Its agent half.
    pub fn agent_encoder(&self) -> &AgentEncoder {
        &self.agent_encoder
    }

    /// The scores of the tokens that lead on from every node, [nodes, tokens]; also from nodes that are not valid. Where classes have
    /// different numbers of tokens, those that a class lacks score -1e9.
    ///
    /// For training, and for whole recorded scenes. Scenes of a batch do not see each other, but the last bits of a scene's scores may
    /// depend on what else is in the batch; [`Episode`](super::Episode) has one scene at a time.
    pub fn forward(&self, tables: &TokenTables, batch: &Batch, noise: &mut Noise) -> Tensor<2> {
        self.forward_watched(tables, batch, noise, &mut |_, _| {})
    }

    /// As [`Smart::forward`], with a look at the features on the way.
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
            x = layer.forward_with(x, sources, &over_time.neighbors, &over_time.relations, noise);
            watch(Stage::OverTime(i), &x);
            let layer = &agents.pt2a_attn_layers[i];
            let sources = layer.sources(map.clone());
            x = layer.forward_with(x, sources, &from_map.neighbors, &from_map.relations, noise);
            watch(Stage::FromMap(i), &x);
            let layer = &agents.a2a_attn_layers[i];
            let sources = layer.sources(x.clone());
            x = layer.forward_with(x, sources, &among.neighbors, &among.relations, noise);
            watch(Stage::AmongAgents(i), &x);
        }
        agents.token_predict_head.forward(x, &batch.class, counts)
    }
}
