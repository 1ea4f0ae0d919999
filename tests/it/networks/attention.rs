//! Gathers and reassociated products against plain loops over edges.

use std::collections::BTreeMap;

use burn::module::{Module, ModuleMapper, Param};
use burn::tensor::{Device, Tensor, TensorData};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use reactsim::models::nn::{
    AttentionConfig, FeedForwardConfig, FourierEmbedding, Initializer, Neighbors, Noise, RelationalAttention,
    Relations, Tensors, normalize, save,
};

use super::naive::{Naive, Rows};
use super::{devices, values, worst};

/// Changes every weight, so that biases are not 0 and gains not 1.
pub(super) struct Shaken(pub(super) ChaCha8Rng);

impl ModuleMapper for Shaken {
    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        param.map(|old| {
            let shape = old.dims();
            let moved = old
                .to_data()
                .iter::<f32>()
                .map(|v| v + self.0.random_range(-0.3f32..0.3))
                .collect::<Vec<_>>();
            let new = Tensor::from_data(TensorData::new(moved, shape), &old.device());
            new.set_require_grad(old.is_require_grad())
        })
    }
}

fn config() -> AttentionConfig {
    AttentionConfig {
        width: 24,
        heads: 3,
        head_dim: 6,
        relation_width: 10,
        feed_forward: FeedForwardConfig::Relu(40),
        bipartite: true,
        relation_norm: true,
        dropout: 0.1,
    }
}

fn layer(config: &AttentionConfig, device: &Device) -> RelationalAttention {
    let layer = config.init(&mut Initializer::new(7, device));
    layer.map(&mut Shaken(ChaCha8Rng::seed_from_u64(3)))
}

fn rows(stream: &mut ChaCha8Rng, count: usize, width: usize) -> Vec<f32> {
    (0..count * width).map(|_| stream.random_range(-2.0f32..2.0)).collect()
}

fn tensor(rows: &[f32], width: usize, device: &Device) -> Tensor<2> {
    Tensor::from_data(TensorData::new(rows.to_vec(), [rows.len() / width, width]), device)
}

fn plain(rows: &[f32], width: usize) -> Rows {
    rows.chunks(width).map(|r| r.iter().map(|v| f64::from(*v)).collect()).collect()
}

struct Case {
    dst: Vec<f32>,
    src: Vec<f32>,
    relations: Vec<f32>,
    edges: Vec<(usize, usize)>,
}

impl Case {
    /// Creates 9 destinations and 13 sources; destination 4 has no neighbours.
    fn new(config: &AttentionConfig) -> Self {
        let stream = &mut ChaCha8Rng::seed_from_u64(11);
        let mut edges = Vec::new();
        for src in 0..13 {
            for dst in (0..9).filter(|d| *d != 4) {
                if stream.random_range(0..3) > 0 {
                    edges.push((src, dst));
                }
            }
        }
        Self {
            dst: rows(stream, 9, config.width),
            src: rows(stream, 13, config.width),
            relations: rows(stream, edges.len(), config.relation_width),
            edges,
        }
    }

    fn output(
        &self,
        config: &AttentionConfig,
        layer: &RelationalAttention,
        device: &Device,
        mut noise: Noise,
    ) -> Tensor<2> {
        let (sources, targets): (Vec<u32>, Vec<u32>) =
            self.edges.iter().map(|e| (e.0 as u32, e.1 as u32)).unzip();
        let neighbors = Neighbors::from_edges(9, &sources, &targets, device);
        let mut relations = tensor(&self.relations, config.relation_width, device);
        if config.relation_norm {
            relations = normalize(relations);
        }
        layer.forward(
            tensor(&self.dst, config.width, device),
            layer.sources(tensor(&self.src, config.width, device)),
            &neighbors,
            &Relations::new(neighbors.relations(relations)),
            &mut noise,
        )
    }

    fn forward(&self, config: &AttentionConfig, layer: &RelationalAttention, device: &Device) -> Vec<f32> {
        values(self.output(config, layer, device, Noise::none()))
    }

    fn naive(&self, config: &AttentionConfig, layer: &RelationalAttention) -> Vec<f32> {
        let bytes = save(layer, &BTreeMap::new());
        let weights = Tensors::read(&bytes).unwrap();
        let (dst, src) = (plain(&self.dst, config.width), plain(&self.src, config.width));
        let relations = plain(&self.relations, config.relation_width);
        let out = Naive::new(&weights, "").attention(config.heads, &dst, &src, &self.edges, &relations);
        out.concat().into_iter().map(|v| v as f32).collect()
    }
}

#[test]
fn gathers_equal_the_list_of_edges() {
    let base = config();
    let swiglu = AttentionConfig { feed_forward: FeedForwardConfig::swiglu(40), bipartite: false, ..base };
    let plain = AttentionConfig { relation_norm: false, relation_width: 7, ..base };
    for config in [base, swiglu, plain] {
        for device in devices() {
            let case = Case::new(&config);
            let layer = layer(&config, &device);
            let far = worst(&case.forward(&config, &layer, &device), &case.naive(&config, &layer));
            assert!(far < 1e-5, "{config:?} {device:?}: {far}");
        }
    }
}

#[test]
fn nobody_near_is_no_trouble() {
    let (config, device) = (config(), Device::flex());
    let layer = layer(&config, &device);
    let mut case = Case::new(&config);
    case.edges.clear();
    case.relations.clear();
    let alone = case.forward(&config, &layer, &device);
    assert!(alone.iter().all(|v| v.is_finite()));
    assert!(worst(&alone, &case.naive(&config, &layer)) < 1e-5);
}

#[test]
fn closed_slots_count_for_nothing() {
    let (config, device) = (config(), Device::flex());
    let layer = layer(&config, &device);
    let case = Case::new(&config);
    let stream = &mut ChaCha8Rng::seed_from_u64(5);
    let sources: Vec<u32> = (0..9 * 6).map(|_| stream.random_range(0..13)).collect();
    let open: Vec<bool> = (0..9 * 6).map(|i| i / 6 != 2 && stream.random_range(0..3) > 0).collect();
    let mut relations = rows(stream, 9 * 6, config.relation_width);
    let run = |relations: &[f32]| {
        let neighbors = Neighbors::from_slots(9, 6, &sources, &open, &device);
        let vectors = neighbors.relations(normalize(tensor(relations, config.relation_width, &device)));
        let sources = layer.sources(tensor(&case.src, config.width, &device));
        let dst = tensor(&case.dst, config.width, &device);
        values(layer.forward(dst, sources, &neighbors, &Relations::new(vectors), &mut Noise::none()))
    };
    let before = run(&relations);
    for (slot, open) in open.iter().enumerate() {
        if !open {
            relations[slot * config.relation_width..][..config.relation_width].fill(9.5);
            relations[slot * config.relation_width] = -40.0;
        }
    }
    assert_eq!(before, run(&relations));
}

#[test]
fn dropout_is_what_its_stream_says() {
    let config = config();
    let case = Case::new(&config);
    let run_on =
        |device: &Device, noise: Noise| values(case.output(&config, &layer(&config, device), device, noise));
    let device = Device::flex();
    let run = |noise: Noise| run_on(&device, noise);
    let stream = |seed| Noise::new(ChaCha8Rng::seed_from_u64(seed));
    assert_eq!(run(stream(1)), run(stream(1)));
    assert_ne!(run(stream(1)), run(stream(2)));
    assert_ne!(run(stream(1)), run(Noise::none()));
    // Dropout is the same with and without gradients.
    assert!(worst(&run(stream(1)), &run_on(&device.clone().autodiff(), stream(1))) < 1e-5);
}

#[test]
fn fourier_embeddings_equal_the_formula() {
    let device = Device::flex();
    let embedding = FourierEmbedding::init(3, 8, 16, &mut Initializer::new(1, &device));
    let embedding = embedding.map(&mut Shaken(ChaCha8Rng::seed_from_u64(4)));
    let scalars = rows(&mut ChaCha8Rng::seed_from_u64(2), 5, 3);
    let found = values(embedding.forward(tensor(&scalars, 3, &device), None));
    let bytes = save(&embedding, &BTreeMap::new());
    let weights = Tensors::read(&bytes).unwrap();
    let naive = Naive::new(&weights, "");
    let expected: Vec<f32> =
        plain(&scalars, 3).iter().flat_map(|s| naive.fourier(s)).map(|v| v as f32).collect();
    assert!(worst(&found, &expected) < 1e-5);
}

#[test]
fn gradients_flow_through_every_weight() {
    let device = Device::flex().autodiff();
    let config = config();
    let bytes = save(&layer(&config, &device), &BTreeMap::new());
    // Loaded weights can be trained like any others.
    let layer = Tensors::read(&bytes).unwrap().load(layer(&config, &device)).unwrap();
    let case = Case::new(&config);
    let weights = tensor(&rows(&mut ChaCha8Rng::seed_from_u64(8), 9, config.width), config.width, &device);
    let out = case.output(&config, &layer, &device, Noise::none());
    let gradients = (out * weights).sum().backward();

    struct Check<'a>(&'a burn::tensor::Gradients, usize);
    impl burn::module::ModuleVisitor for Check<'_> {
        fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
            let gradient = param.val().grad(self.0).expect("a gradient");
            let size = values(gradient).iter().map(|g| g.abs()).fold(0.0, f32::max);
            assert!(size > 1e-6 && size.is_finite(), "{:?}: {size}", param.dims());
            self.1 += 1;
        }
    }
    let mut check = Check(&gradients, 0);
    layer.visit(&mut check);
    assert!(check.1 > 20);
}
