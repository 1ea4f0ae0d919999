//! Map half of the network.

use burn::module::Module;
use burn::nn::Embedding;
use burn::tensor::Tensor;
use reactsim_nn::{FourierEmbedding, Initializer, Noise, Perceptron, PerceptronKind, RelationalAttention};

use super::tables::pick;
use super::{Edges, Links, MapTokens, SmartConfig, Stage, TokenTables};

/// Encoder of the map: tokens attend to nearby tokens.
#[derive(Module, Debug)]
pub struct MapEncoder {
    token_emb: Perceptron,
    type_pt_emb: Embedding,
    polygon_type_emb: Embedding,
    light_pl_emb: Embedding,
    r_pt2pt_emb: FourierEmbedding,
    pt2pt_layers: Vec<RelationalAttention>,
}

impl MapEncoder {
    pub(super) fn init(config: &SmartConfig, init: &mut Initializer) -> Self {
        let h = config.hidden_dim;
        Self {
            token_emb: PerceptronKind::SMART.init(&[22, config.mlp_embedding_first_width, h, h], init),
            type_pt_emb: init.embedding(config.map_point_types, h),
            polygon_type_emb: init.embedding(config.map_polygon_types, h),
            light_pl_emb: init.embedding(config.map_light_types, h),
            r_pt2pt_emb: FourierEmbedding::init(3, config.num_freq_bands, h, init),
            pt2pt_layers: (0..config.num_map_layers).map(|_| config.attention(false).init(init)).collect(),
        }
    }

    pub(super) fn token_embedding(&self) -> &Perceptron {
        &self.token_emb
    }

    /// Returns the relation embedding of pairs of map tokens.
    pub fn relation_embedding(&self) -> &FourierEmbedding {
        &self.r_pt2pt_emb
    }

    /// Returns the features of map tokens, [P, h].
    pub(super) fn forward(
        &self,
        tables: &TokenTables,
        map: &MapTokens,
        edges: &Edges,
        noise: &mut Noise,
        watch: &mut dyn FnMut(Stage, &Tensor<2>),
    ) -> Tensor<2> {
        let of =
            |table: &Embedding, rows: &[u8]| pick(&table.weight.val(), rows.iter().map(|r| usize::from(*r)));
        let mut x = tables.map(&map.token);
        if map.is_empty() {
            return x;
        }
        x = x + of(&self.type_pt_emb, &map.kind);
        x = x + of(&self.polygon_type_emb, &map.polygon);
        x = x + of(&self.light_pl_emb, &map.light);
        watch(Stage::MapInput, &x);
        let links = Links::new(edges, map.len(), &self.r_pt2pt_emb, &x.device());
        for (i, layer) in self.pt2pt_layers.iter().enumerate() {
            let sources = layer.sources(x.clone());
            x = layer.forward(x, sources, &links.neighbors, &links.relations, noise);
            watch(Stage::Map(i), &x);
        }
        x
    }
}
