//! The whole network, pair by pair in loops of f64, after the published text: golden data that anyone can
//! reproduce.

use std::collections::BTreeMap;

use burn::tensor::Device;
use reactsim::models::nn::{Tensors, save};
use reactsim::models::ntp::smart::{Scene, SmartConfig, TokenShapes};

use super::naive::{Naive, Rows, add, relu};
use super::smart::{forward, network, scene, shared_head, token_shapes};
use super::worst;

/// Pairs (source, target) and the scalars of their relations.
type Pairs = (Vec<(usize, usize)>, Rows);

#[derive(Clone, Copy)]
struct Pose(f64, f64, f64);

fn wrap(angle: f64) -> f64 {
    (angle + std::f64::consts::PI).rem_euclid(std::f64::consts::TAU) - std::f64::consts::PI
}

fn bearing(heading: f64, x: f64, y: f64) -> f64 {
    (heading.cos() * y - heading.sin() * x).atan2(heading.cos() * x + heading.sin() * y + 0.0)
}

fn relation(source: Pose, target: Pose) -> Vec<f64> {
    let (x, y) = (source.0 - target.0, source.1 - target.1);
    vec![x.hypot(y), bearing(target.2, x, y), wrap(source.2 - target.2)]
}

fn within(a: Pose, b: Pose, radius: f32) -> bool {
    (a.0 - b.0).hypot(a.1 - b.1) < f64::from(radius)
}

struct Literal<'a> {
    weights: &'a Tensors<'a>,
    config: &'a SmartConfig,
    scene: &'a Scene,
}

impl Literal<'_> {
    fn at(&self, name: impl Into<String>) -> Naive<'_> {
        Naive::new(self.weights, name)
    }

    /// Computes a perceptron: `layers` linear layers with a norm and ReLU between them.
    fn mlp(&self, name: &str, layers: usize, x: &[f64]) -> Vec<f64> {
        let naive = self.at(name);
        let mut x = x.to_vec();
        for i in 0..layers - 1 {
            x = relu(naive.norm(&format!("mlp.{}", 3 * i + 1), &naive.linear(&format!("mlp.{}", 3 * i), &x)));
        }
        naive.linear(&format!("mlp.{}", 3 * (layers - 1)), &x)
    }

    fn row(&self, table: &str, row: usize) -> Vec<f64> {
        let (shape, values) = self.weights.floats(table).unwrap();
        values[row * shape[1]..][..shape[1]].iter().map(|v| f64::from(*v)).collect()
    }

    fn embedded(&self, name: &str, pairs: &Pairs) -> Rows {
        pairs.1.iter().map(|r| self.at(name).fourier(r)).collect()
    }

    fn piece(&self, i: usize) -> Pose {
        let map = &self.scene.map;
        Pose(map.position[i][0].into(), map.position[i][1].into(), map.orientation[i].into())
    }

    fn pose(&self, agent: usize, step: usize) -> Pose {
        let step = &self.scene.steps[step];
        Pose(step.position[agent][0].into(), step.position[agent][1].into(), step.heading[agent].into())
    }

    fn map(&self, shapes: &TokenShapes) -> Rows {
        let map = &self.scene.map;
        let mut x = Rows::new();
        for i in 0..map.len() {
            let curve: Vec<f64> = shapes.map[map.token[i] as usize].iter().map(|v| f64::from(*v)).collect();
            let mut row = self.mlp("map_encoder.token_emb", 3, &curve);
            add(&mut row, &self.row("map_encoder.type_pt_emb.weight", map.kind[i].into()));
            add(&mut row, &self.row("map_encoder.polygon_type_emb.weight", map.polygon[i].into()));
            add(&mut row, &self.row("map_encoder.light_pl_emb.weight", map.light[i].into()));
            x.push(row);
        }
        let mut pairs = Pairs::default();
        for (s, t) in (0..map.len()).flat_map(|t| (0..map.len()).map(move |s| (s, t))) {
            if s != t && within(self.piece(s), self.piece(t), self.config.pl2pl_radius) {
                pairs.0.push((s, t));
                pairs.1.push(relation(self.piece(s), self.piece(t)));
            }
        }
        let relations = self.embedded("map_encoder.r_pt2pt_emb", &pairs);
        for i in 0..self.config.num_map_layers {
            let layer = self.at(format!("map_encoder.pt2pt_layers.{i}"));
            x = layer.attention(self.config.num_heads, &x, &x, &pairs.0, &relations);
        }
        x
    }

    fn fused(&self, shapes: &TokenShapes) -> Rows {
        let agents = &self.scene.agents;
        let mut x = Rows::new();
        for (agent, class) in agents.class.iter().enumerate() {
            for (t, step) in self.scene.steps.iter().enumerate() {
                let class = usize::from(*class);
                let corners = shapes.agents[class][step.token[agent] as usize].map(f64::from);
                let name = ["veh", "ped", "cyc"][class];
                let token = self.mlp(&format!("agent_encoder.token_emb_{name}"), 3, &corners);
                let mut identity = self.row("agent_encoder.type_a_emb.weight", class);
                add(
                    &mut identity,
                    &self.mlp("agent_encoder.shape_emb", 2, &agents.shape[agent].map(f64::from)),
                );
                let mut motion = vec![0.0, 0.0];
                if t > 0 {
                    let (now, then) = (self.pose(agent, t), self.pose(agent, t - 1));
                    let (x, y) = (now.0 - then.0, now.1 - then.1);
                    motion = vec![x.hypot(y), bearing(now.2, x, y)];
                }
                let motion = self.at("agent_encoder.x_a_emb").fourier_with(&motion, &identity);
                x.push(self.mlp("agent_encoder.fusion_emb", 3, &[token, motion].concat()));
            }
        }
        x
    }

    fn logits(&self, shapes: &TokenShapes) -> Rows {
        let (map, mut x) = (self.map(shapes), self.fused(shapes));
        let (agents, steps) = (self.scene.agents.len(), self.scene.steps.len());
        let valid = |agent: usize, step: usize| self.scene.steps[step].valid[agent];
        let [mut past, mut seen, mut others] = [Pairs::default(), Pairs::default(), Pairs::default()];
        for (agent, t) in
            (0..agents).flat_map(|a| (0..steps).map(move |t| (a, t))).filter(|(a, t)| valid(*a, *t))
        {
            let (own, node) = (self.pose(agent, t), agent * steps + t);
            for then in (0..t).filter(|then| t - then <= self.config.time_span / 5 && valid(agent, *then)) {
                let mut scalars = relation(self.pose(agent, then), own);
                scalars.push(then as f64 - t as f64);
                past.0.push((agent * steps + then, node));
                past.1.push(scalars);
            }
            for piece in (0..map.len()).filter(|p| within(self.piece(*p), own, self.config.pl2a_radius)) {
                seen.0.push((piece, node));
                seen.1.push(relation(self.piece(piece), own));
            }
            for other in (0..agents).filter(|o| *o != agent && valid(*o, t)) {
                if within(self.pose(other, t), own, self.config.a2a_radius) {
                    others.0.push((other * steps + t, node));
                    others.1.push(relation(self.pose(other, t), own));
                }
            }
        }
        let heads = self.config.num_heads;
        let [of_past, of_map, of_others] =
            [("r_t_emb", &past), ("r_pt2a_emb", &seen), ("r_a2a_emb", &others)]
                .map(|(name, pairs)| self.embedded(&format!("agent_encoder.{name}"), pairs));
        for i in 0..self.config.num_agent_layers {
            let layer = |kind: &str| self.at(format!("agent_encoder.{kind}_attn_layers.{i}"));
            x = layer("t").attention(heads, &x, &x, &past.0, &of_past);
            x = layer("pt2a").attention(heads, &x, &map, &seen.0, &of_map);
            x = layer("a2a").attention(heads, &x, &x, &others.0, &of_others);
        }
        x.iter().map(|row| self.mlp("agent_encoder.token_predict_head", 2, row)).collect()
    }
}

#[test]
fn the_network_is_what_the_text_says() {
    let (config, device) = (shared_head(), Device::flex());
    let network = network(&config, &device);
    let (shapes, scene) = (token_shapes(&config), scene(&config, 14, 5, 14, true));
    let tables = network.tables(&shapes, &device).unwrap();
    let bytes = save(&network, &BTreeMap::new());
    let weights = Tensors::read(&bytes).unwrap();
    let literal = Literal { weights: &weights, config: &config, scene: &scene };
    let expected: Vec<f32> = literal.logits(&shapes).concat().into_iter().map(|v| v as f32).collect();
    let gap = worst(&forward(&network, &tables, &[&scene]), &expected);
    assert!(gap < 1e-4, "{gap}");
}
