//! The published next-token network on made-up scenes.

use std::collections::BTreeMap;

use burn::module::Module;
use burn::tensor::Device;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use reactsim::models::nn::{Initializer, Noise, Tensors, save};
use reactsim::models::ntp::smart::{
    Agents, Batch, MapTokens, Scene, Smart, SmartConfig, Step, TokenShapes, TokenTables,
};

use super::attention::Shaken;
use super::{values, worst};

const TOKENS: usize = 12;

fn config(more: &str) -> SmartConfig {
    let text = format!(
        r#"{{"hidden_dim": 24, "num_freq_bands": 6, "num_heads": 3, "head_dim": 6, "dropout": 0.1, "num_map_layers": 2,
        "num_agent_layers": 2, "pl2pl_radius": 12, "pl2a_radius": 15, "a2a_radius": 20, "time_span": 15,
        "n_token_map": 9, "mlp_embedding_first_width": 16 {more}}}"#
    );
    SmartConfig::from_json(&text).unwrap()
}

fn shared_head() -> SmartConfig {
    config(r#", "n_token_agent": 12"#)
}

fn trajtok() -> SmartConfig {
    config(r#", "n_token_agent": {"veh": 12, "ped": 5, "cyc": 7}, "feed_forward": "swiglu""#)
}

fn network(config: &SmartConfig, device: &Device) -> Smart {
    let network = Smart::init(config, &mut Initializer::new(3, device)).unwrap();
    network.map(&mut Shaken(ChaCha8Rng::seed_from_u64(9)))
}

fn token_shapes(config: &SmartConfig) -> TokenShapes {
    let stream = &mut ChaCha8Rng::seed_from_u64(21);
    let counts = config.n_token_agent.of_classes();
    TokenShapes {
        agents: counts
            .map(|n| (0..n).map(|_| std::array::from_fn(|_| stream.random_range(-3.0..6.0))).collect()),
        map: (0..config.n_token_map)
            .map(|_| std::array::from_fn(|_| stream.random_range(-1.0..5.0)))
            .collect(),
    }
}

/// Returns a scene of some agents on some pieces of map; with `gaps`, agents come and go.
fn scene(config: &SmartConfig, seed: u64, agents: usize, pieces: usize, gaps: bool) -> Scene {
    let stream = &mut ChaCha8Rng::seed_from_u64(seed);
    let counts = config.n_token_agent.of_classes();
    let place = |stream: &mut ChaCha8Rng| [0, 1].map(|_| stream.random_range(-16.0f32..16.0));
    let class: Vec<u8> = (0..agents).map(|_| stream.random_range(0..3)).collect();
    let map = MapTokens {
        position: (0..pieces).map(|_| place(stream)).collect(),
        orientation: (0..pieces).map(|_| stream.random_range(-3.1..3.1)).collect(),
        token: (0..pieces).map(|_| stream.random_range(0..config.n_token_map as u32)).collect(),
        kind: (0..pieces).map(|_| stream.random_range(0..10)).collect(),
        polygon: (0..pieces).map(|_| stream.random_range(0..4)).collect(),
        light: (0..pieces).map(|_| stream.random_range(0..5)).collect(),
    };
    let mut at: Vec<[f32; 2]> = (0..agents).map(|_| place(stream)).collect();
    let mut heading: Vec<f32> = (0..agents).map(|_| stream.random_range(-3.0..3.0)).collect();
    let mut steps = Vec::new();
    for _ in 0..6 {
        let valid: Vec<bool> = (0..agents).map(|_| !gaps || stream.random_range(0..5) > 0).collect();
        for a in 0..agents {
            heading[a] = heading[a].clamp(-2.9, 2.9) + stream.random_range(-0.2f32..0.2);
            at[a] = [0, 1].map(|d| {
                at[a][d] + [heading[a].cos(), heading[a].sin()][d] + stream.random_range(-0.1f32..0.1)
            });
        }
        let token = class.iter().map(|c| stream.random_range(0..counts[usize::from(*c)] as u32)).collect();
        let shown = |values: [f32; 2], valid: bool| if valid { values } else { [0.0; 2] };
        steps.push(Step {
            position: (0..agents).map(|a| shown(at[a], valid[a])).collect(),
            heading: (0..agents).map(|a| if valid[a] { heading[a] } else { 0.0 }).collect(),
            valid,
            token,
        });
    }
    let shape =
        (0..agents).map(|_| [stream.random_range(0.5..5.0), stream.random_range(0.5..2.0), 1.6]).collect();
    Scene { map, agents: Agents { class, shape }, steps }
}

/// Returns the scores of all nodes, [agents · steps, tokens].
fn forward(network: &Smart, tables: &TokenTables, scenes: &[&Scene]) -> Vec<f32> {
    let batch = Batch::new(network.config(), scenes.iter().copied(), &mut Noise::none()).unwrap();
    values(network.forward(tables, &batch, &mut Noise::none()))
}

/// As [`forward`], step by step.
fn stepwise(network: &Smart, tables: &TokenTables, scene: &Scene) -> Vec<f32> {
    let map = network.encode_map(tables, &scene.map).unwrap();
    let mut episode = network.begin(tables, map, scene.agents.clone()).unwrap();
    let steps: Vec<Vec<f32>> = scene
        .steps
        .iter()
        .map(|step| values(network.step(tables, &mut episode, step.clone()).unwrap()))
        .collect();
    let width = steps[0].len() / scene.agents.len();
    (0..scene.agents.len())
        .flat_map(|a| steps.iter().flat_map(move |s| s[a * width..][..width].to_vec()))
        .collect()
}

struct Made {
    network: Smart,
    tables: TokenTables,
}

fn made(config: &SmartConfig, device: &Device) -> Made {
    let network = network(config, device);
    let tables = network.tables(&token_shapes(config), device).unwrap();
    Made { network, tables }
}

#[test]
fn step_by_step_equals_all_at_once() {
    for config in [shared_head(), trajtok()] {
        let Made { network, tables } = made(&config, &Device::flex());
        let scene = scene(&config, 1, 9, 40, true);
        let (all, steps) = (forward(&network, &tables, &[&scene]), stepwise(&network, &tables, &scene));
        let gap = worst(&all, &steps);
        assert!(gap < 1e-4, "{gap}");
        assert!(
            all.iter().filter(|v| **v > -1e8).map(|v| v.abs()).fold(0.0, f32::max) > 0.5,
            "scores differ at all"
        );
    }
}

#[test]
fn moving_and_turning_everything_changes_nothing() {
    let config = shared_head();
    let Made { network, tables } = made(&config, &Device::flex());
    let scene = scene(&config, 3, 8, 30, false);
    let before = forward(&network, &tables, &[&scene]);
    for (turn, shift) in [(0.7f32, [3.0f32, -8.0]), (-2.2, [-40.0, 25.0])] {
        let (sin, cos) = turn.sin_cos();
        let moved =
            |p: &mut [f32; 2]| *p = [p[0] * cos - p[1] * sin + shift[0], p[0] * sin + p[1] * cos + shift[1]];
        let mut other = scene.clone();
        other.map.position.iter_mut().for_each(moved);
        other.map.orientation.iter_mut().for_each(|o| *o += turn);
        for step in &mut other.steps {
            step.position.iter_mut().for_each(moved);
            step.heading.iter_mut().for_each(|h| *h += turn);
        }
        let gap = worst(&forward(&network, &tables, &[&other]), &before);
        assert!(gap < 1e-4, "{turn}: {gap}");
    }
}

#[test]
fn the_order_of_agents_and_map_is_of_no_concern() {
    let config = shared_head();
    let Made { network, tables } = made(&config, &Device::flex());
    let scene = scene(&config, 4, 7, 25, true);
    let order = [3, 0, 6, 2, 5, 1, 4];
    fn taken<T: Clone>(list: &[T], order: &[usize]) -> Vec<T> {
        order.iter().map(|i| list[*i].clone()).collect()
    }
    let back: Vec<usize> = (0..25).rev().collect();
    let map = &scene.map;
    let other = Scene {
        map: MapTokens {
            position: taken(&map.position, &back),
            orientation: taken(&map.orientation, &back),
            token: taken(&map.token, &back),
            kind: taken(&map.kind, &back),
            polygon: taken(&map.polygon, &back),
            light: taken(&map.light, &back),
        },
        agents: Agents {
            class: taken(&scene.agents.class, &order),
            shape: taken(&scene.agents.shape, &order),
        },
        steps: scene
            .steps
            .iter()
            .map(|s| Step {
                position: taken(&s.position, &order),
                heading: taken(&s.heading, &order),
                valid: taken(&s.valid, &order),
                token: taken(&s.token, &order),
            })
            .collect(),
    };
    let (before, after) = (forward(&network, &tables, &[&scene]), forward(&network, &tables, &[&other]));
    let width = before.len() / 7;
    for (at, from) in order.iter().enumerate() {
        let gap = worst(&after[at * width..][..width], &before[from * width..][..width]);
        assert!(gap < 1e-4, "{gap}");
    }
}

#[test]
fn what_happens_later_or_elsewhere_is_not_seen() {
    let config = shared_head();
    let Made { network, tables } = made(&config, &Device::flex());
    let scene = scene(&config, 5, 6, 20, false);
    let before = stepwise(&network, &tables, &scene);
    let mut other = scene.clone();
    for step in &mut other.steps[3..] {
        step.position[0][0] += 1.5;
        step.heading[0] += 0.4;
        step.token[0] = (step.token[0] + 1) % 5;
    }
    let after = stepwise(&network, &tables, &other);
    let nodes = before.chunks(TOKENS).zip(after.chunks(TOKENS)).enumerate();
    for (node, (a, b)) in nodes.clone().filter(|(n, _)| n % 6 < 3) {
        assert_eq!(a, b, "node {node}");
    }
    assert!(nodes.filter(|(n, (a, b))| n % 6 >= 3 && n / 6 > 0 && a != b).count() > 0, "agents react");

    let far = |scene: &Scene| {
        let mut far = scene.clone();
        far.steps.iter_mut().for_each(|s| s.position[0][1] += 900.0);
        stepwise(&network, &tables, &far)
    };
    let mut turned = scene.clone();
    turned.steps.iter_mut().for_each(|s| s.heading[0] += 0.4);
    assert_eq!(far(&scene)[6 * TOKENS..], far(&turned)[6 * TOKENS..], "who is far away does not matter");
}

#[test]
fn alone_in_the_void_is_finite() {
    for config in [shared_head(), trajtok()] {
        let Made { network, tables } = made(&config, &Device::flex());
        for (agents, pieces) in [(1, 0), (1, 1), (3, 0), (0, 4), (0, 0)] {
            let mut scene = scene(&config, 6, agents, pieces, false);
            let all = forward(&network, &tables, &[&scene]);
            assert_eq!(all.len(), agents * 6 * TOKENS);
            assert!(all.iter().all(|v| v.is_finite()));
            let map = network.encode_map(&tables, &scene.map).unwrap();
            let mut episode = network.begin(&tables, map, scene.agents.clone()).unwrap();
            for step in scene.steps.drain(..) {
                let scores = values(network.step(&tables, &mut episode, step).unwrap());
                assert_eq!(scores.len(), agents * TOKENS);
                assert!(scores.iter().all(|v| v.is_finite()));
            }
        }
    }
}

#[test]
fn scenes_of_a_batch_do_not_see_each_other() {
    let config = shared_head();
    let Made { network, tables } = made(&config, &Device::flex());
    let scenes = [(7, 5, 21), (8, 9, 40), (9, 2, 7)].map(|(s, a, p)| scene(&config, s, a, p, true));
    let together = forward(&network, &tables, &scenes.each_ref());
    let alone: Vec<f32> = scenes.iter().flat_map(|s| forward(&network, &tables, &[s])).collect();
    let gap = worst(&together, &alone);
    assert!(gap < 1e-5, "{gap}");
    // Step by step, every scene is computed by itself, and its bits do not depend on what was computed
    // before.
    let first = stepwise(&network, &tables, &scenes[0]);
    stepwise(&network, &tables, &scenes[1]);
    assert_eq!(first, stepwise(&network, &tables, &scenes[0]));
}

#[test]
fn classes_have_heads_of_their_own() {
    let config = trajtok();
    let Made { network, tables } = made(&config, &Device::flex());
    let scene = scene(&config, 10, 12, 20, false);
    let scores = forward(&network, &tables, &[&scene]);
    for (node, row) in scores.chunks(TOKENS).enumerate() {
        let count = config.n_token_agent.of_classes()[usize::from(scene.agents.class[node / 6])];
        assert!(row[..count].iter().all(|v| v.abs() < 100.0));
        assert!(row[count..].iter().all(|v| *v == -1e9));
    }
    let bytes = save(&network, &BTreeMap::new());
    let tensors = Tensors::read(&bytes).unwrap();
    let shapes: BTreeMap<&str, &[usize]> = tensors.shapes().collect();
    for (name, shape) in [
        ("agent_encoder.token_predict_head.ped.mlp.3.weight", [5, 24]),
        ("agent_encoder.a2a_attn_layers.1.ff_mlp.w12.weight", [128, 24]),
        ("map_encoder.pt2pt_layers.0.ff_mlp.w3.weight", [24, 64]),
    ] {
        assert_eq!(shapes[name], shape, "{name}");
    }
    let loaded = Smart::load(&config, &bytes, &Device::flex()).unwrap();
    let tables = loaded.tables(&token_shapes(&config), &Device::flex()).unwrap();
    assert_eq!(forward(&loaded, &tables, &[&scene]), scores);
}

/// Returns a state dict as PyTorch saves it: with a prefix, and with the shared norms under both names.
fn state_dict(network: &Smart, prefix: &str, twin: impl Fn(&mut Vec<u8>)) -> Vec<u8> {
    let bytes = save(network, &BTreeMap::new());
    let file = safetensors::SafeTensors::deserialize(&bytes).unwrap();
    let mut all: BTreeMap<String, (Vec<usize>, Vec<u8>)> = BTreeMap::new();
    for (name, view) in file.tensors() {
        let mut data = view.data().to_vec();
        all.insert(format!("{prefix}{name}"), (view.shape().to_vec(), data.clone()));
        if name.contains("attn_prenorm_x_src") && !name.contains("pt2a") {
            twin(&mut data);
            all.insert(format!("{prefix}{}", name.replace("_src", "_dst")), (view.shape().to_vec(), data));
        }
    }
    let views = all.iter().map(|(name, (shape, data))| {
        let view =
            safetensors::tensor::TensorView::new(safetensors::Dtype::F32, shape.clone(), data).unwrap();
        (name.clone(), view)
    });
    safetensors::serialize(views.collect::<Vec<_>>(), None).unwrap()
}

#[test]
fn state_dicts_are_loaded() {
    let (config, device) = (shared_head(), Device::flex());
    let Made { network, tables } = made(&config, &device);
    let scene = scene(&config, 11, 5, 15, true);
    let scores = forward(&network, &tables, &[&scene]);
    for prefix in ["", "encoder."] {
        let loaded = Smart::load(&config, &state_dict(&network, prefix, |_| {}), &device).unwrap();
        assert_eq!(forward(&loaded, &tables, &[&scene]), scores);
    }
    let error = Smart::load(&config, &state_dict(&network, "", |data| data[0] ^= 1), &device).unwrap_err();
    assert!(error.to_string().contains("attn_prenorm_x_dst.weight` and"), "{error}");

    let counted = SmartConfig { n_params: network.num_params() + 1, ..config.clone() };
    let error = Smart::load(&counted, &state_dict(&network, "", |_| {}), &device).unwrap_err();
    assert!(error.to_string().contains("it belongs to another network"), "{error}");
    let wider = SmartConfig { hidden_dim: 32, ..config.clone() };
    let error = Smart::load(&wider, &state_dict(&network, "", |_| {}), &device).unwrap_err();
    assert!(error.to_string().contains("expected [32]"), "{error}");
    let deeper = SmartConfig { num_map_layers: 3, ..config };
    let error = Smart::load(&deeper, &state_dict(&network, "", |_| {}), &device).unwrap_err();
    assert!(error.to_string().contains("`map_encoder.pt2pt_layers.2."), "{error}");
}

#[test]
fn the_published_sizes_are_those_of_the_papers() {
    let text = |h: usize, f: usize, heads: usize, dim: usize, map: usize, agent: usize, params: usize| {
        format!(
            r#"{{"hidden_dim": {h}, "num_freq_bands": {f}, "num_heads": {heads}, "head_dim": {dim}, "dropout": 0.1,
            "num_map_layers": {map}, "num_agent_layers": {agent}, "pl2pl_radius": 10, "pl2a_radius": 30, "a2a_radius": 60,
            "time_span": 30, "n_token_agent": 2048, "n_params": {params}}}"#
        )
    };
    let [tiny, mini, nano] = [
        text(128, 64, 8, 16, 3, 6, 7_001_024),
        text(128, 64, 4, 8, 2, 4, 3_433_984),
        text(64, 64, 4, 8, 2, 4, 1_161_344),
    ];
    for text in [tiny, mini, nano] {
        let config = SmartConfig::from_json(&text).unwrap();
        let network = Smart::init(&config, &mut Initializer::new(0, &Device::flex())).unwrap();
        assert_eq!(network.num_params(), config.n_params);
    }
}

#[test]
fn configurations_that_cannot_be_are_refused() {
    let good = serde_json::to_value(shared_head()).unwrap();
    for (name, value, expected) in [
        ("hidden_dim", serde_json::json!(0), "`hidden_dim`"),
        ("n_token_agent", serde_json::json!(0), "`n_token_agent`"),
        ("a2a_radius", serde_json::json!(-3.0), "`a2a_radius`"),
        ("dropout", serde_json::json!(1.0), "`dropout`"),
        ("layer_norm_eps", serde_json::json!(1e-6), "`layer_norm_eps`"),
        ("agent_types", serde_json::json!(4), "`agent_types`"),
        ("num_heads", serde_json::json!("eight"), "not usable"),
        ("feed_forward", serde_json::json!("gelu"), "not usable"),
    ] {
        let mut bad = good.clone();
        bad[name] = value;
        let error = SmartConfig::from_json(&bad.to_string()).unwrap_err();
        assert!(error.to_string().contains(expected), "{error}");
    }
    let error = SmartConfig::from_json("{\"hidden_dim\": 64").unwrap_err();
    assert!(error.to_string().contains("not usable"), "{error}");
}

#[test]
fn inputs_that_cannot_be_are_refused() {
    let config = shared_head();
    let good = scene(&config, 12, 4, 10, false);
    type Change = (&'static str, fn(&mut Scene));
    let changes: [Change; 10] = [
        ("`map.token` 3 is 9, expected a number below 9", |s| s.map.token[3] = 9),
        ("`map.light` 2 is 5", |s| s.map.light[2] = 5),
        ("`map.orientation` 0 is not finite", |s| s.map.orientation[0] = f32::NAN),
        ("`map.kind` has 9 entries, expected 10", |s| s.map.kind.truncate(9)),
        ("`agents.class` 1 is 3", |s| s.agents.class[1] = 3),
        ("`agents.shape` has 5 entries", |s| s.agents.shape.push([1.0; 3])),
        ("`step.token` 0 is 12", |s| s.steps[2].token[0] = 12),
        ("`step.position` 3 is not finite", |s| s.steps[5].position[3][1] = f32::INFINITY),
        ("`step.valid` has 3 entries", |s| s.steps[1].valid.truncate(3)),
        ("`step.heading` has 0 entries", |s| s.steps[1].heading.clear()),
    ];
    for (expected, change) in changes {
        let mut bad = good.clone();
        change(&mut bad);
        let error = Batch::new(&config, [&bad], &mut Noise::none()).unwrap_err();
        assert!(error.to_string().contains(expected), "{error}");
    }
    let Made { network, .. } = made(&config, &Device::flex());
    let mut short = token_shapes(&config);
    short.agents[2].pop();
    let error = network.tables(&short, &Device::flex()).unwrap_err();
    assert!(error.to_string().contains("has 11 tokens of cyclists, expected 12"), "{error}");
}

#[test]
fn a_refused_step_leaves_the_episode_as_it_was() {
    let config = shared_head();
    let Made { network, tables } = made(&config, &Device::flex());
    let scene = scene(&config, 13, 4, 10, false);
    let map = network.encode_map(&tables, &scene.map).unwrap();
    let mut episode = network.begin(&tables, map, scene.agents.clone()).unwrap();
    network.step(&tables, &mut episode, scene.steps[0].clone()).unwrap();
    let mut other = episode.clone();
    let bad = Step { token: vec![99; 4], ..scene.steps[1].clone() };
    assert!(network.step(&tables, &mut episode, bad).is_err());
    let [a, b] =
        [&mut episode, &mut other].map(|e| values(network.step(&tables, e, scene.steps[1].clone()).unwrap()));
    assert_eq!(a, b);
    assert_eq!(episode.newest(), Some(&scene.steps[1]));
}
