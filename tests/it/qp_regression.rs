//! The motion predictor: names of its tensors, independence from the frame of reference, required input,
//! refusals.

use std::collections::BTreeMap;

use burn::module::Module;
use burn::tensor::Device;
use rand_chacha::rand_core::SeedableRng;
use reactsim::geometry::{Vec2, direction};
use reactsim::models;
use reactsim::models::learning::Intentions;
use reactsim::models::nn::weights::{Tables, save_tables};
use reactsim::models::nn::{Tensors, device};
use reactsim::models::qp::{self, Ending};
use reactsim::models::qp_regression::learn::{Recipe, Regression};
use reactsim::models::qp_regression::network::{Attributes, Config, Norms, suppress};
use reactsim::models::qp_regression::{
    Driving, PlanningParameters, Policy, Prediction, QpRegressionSimulator, RegressionSimulator,
};
use reactsim::rollout::{Controller, NOT_FINITE, Settings};
use reactsim::scene::{AgentKind, CURRENT, DT, Frame, MapParts, Scenario};
use reactsim::training::{Stream, Task};

use crate::model_weights::{check_refusals, loss, replaced};
use crate::ntp_reactive::{lights, moved, reverse_agents, scenarios, tracks};
use crate::program::words;
use crate::scenes::{agent, arc, car, coasting, join, lane, line, mini, roll, scene, state, straight};
use reactsim::models::perception::KnownMotion;

/// Returns small sizes that differ wherever they can.
fn small() -> Config {
    Config { agent_hidden: 8, encoder_layers: 1, decoder_width: 16, ..sized(Config::default()) }
}

/// Returns the published structure with small sizes.
fn small_mtr() -> Config {
    Config { agent_hidden: 16, encoder_layers: 2, decoder_width: 32, ..sized(Config::mtr()) }
}

fn sized(structure: Config) -> Config {
    Config {
        agents: 6,
        lines: 12,
        width: 16,
        line_hidden: 8,
        heads: 2,
        neighbours: 4,
        map_width: 16,
        decoder_layers: 2,
        base_lines: 4,
        way_lines: 4,
        ..structure
    }
}

fn task(network: Config) -> Regression {
    Regression::new(Recipe { network, ..Recipe::default() }, Intentions::fan(), &device())
}

fn bytes(network: Config) -> Vec<u8> {
    let task = task(network);
    task.file(&task.init(7), &BTreeMap::new()).unwrap()
}

pub(crate) fn untrained() -> Vec<u8> {
    bytes(small())
}

/// Returns a recipe with sizes that learn in a moment.
pub(crate) fn small_recipe() -> String {
    toml::to_string(&Recipe { network: small(), agents: 4, ..Recipe::default() }).unwrap()
}

fn policy(network: Config) -> Policy {
    Policy::read(&bytes(network), &device()).unwrap()
}

fn predictions(policy: &Policy, scenario: &Scenario, tracks: &[Vec<Frame>], now: usize) -> Vec<Prediction> {
    let lights = lights(scenario);
    let known = KnownMotion { start: &scenario.start, tracks, lights: &lights, av_lookahead: true };
    let slots: Vec<usize> = (0..scenario.start.agents.len()).collect();
    policy.predict_known(&known, now, &slots, &device())
}

/// Returns the largest distance of two predictions, metres; `there` maps positions of the first one to those
/// of the second.
fn farthest(a: &[Prediction], b: &[Prediction], there: impl Fn(Vec2) -> Vec2) -> f64 {
    assert_eq!(a.len(), b.len());
    let mut farthest = 0.0f64;
    for (a, b) in a.iter().zip(b) {
        assert_eq!(a.slot, b.slot);
        assert_eq!(a.modes.len(), b.modes.len());
        for (a, b) in a.modes.iter().zip(&b.modes) {
            farthest = farthest.max(10.0 * (a.probability - b.probability).abs());
            for (a, b) in a.points.iter().zip(&b.points) {
                farthest = farthest.max((there(a.position) - b.position).norm());
            }
        }
    }
    farthest
}

/// Returns names and shapes of the public code's state dict, written down from its modules.
fn published(c: &Config) -> BTreeMap<String, Vec<usize>> {
    let mut all = BTreeMap::new();
    let mut put = |name: String, shape: &[usize]| assert!(all.insert(name, shape.to_vec()).is_none());
    let mut linear = |name: &str, inputs: usize, outputs: usize, bias: bool| {
        put(format!("{name}.weight"), &[outputs, inputs]);
        if bias {
            put(format!("{name}.bias"), &[outputs]);
        }
    };
    let mut norms: Vec<(String, usize)> = Vec::new();
    let mut layers: Vec<(String, usize)> = Vec::new();
    // Perceptrons: hidden layers are linear, batch norm, ReLU; or linear, ReLU.
    let mut mlp = |name: &str,
                   inputs: usize,
                   widths: &[usize],
                   open: bool,
                   normed: bool,
                   linear: &mut dyn FnMut(&str, usize, usize, bool)| {
        let mut last = inputs;
        for (i, &width) in widths.iter().enumerate() {
            let hidden = !open || i + 1 < widths.len();
            let at = if normed { 3 * i } else { 2 * i };
            linear(&format!("{name}.{at}"), last, width, !(hidden && normed));
            if hidden && normed {
                norms.push((format!("{name}.{}", at + 1), width));
            }
            last = width;
        }
    };
    let e = "context_encoder";
    for (name, inputs, hidden, pre) in [("agent", 30, c.agent_hidden, 1), ("map", 9, c.line_hidden, 3)] {
        let name = format!("{e}.{name}_polyline_encoder");
        mlp(&format!("{name}.pre_mlps"), inputs, &vec![hidden; pre], false, true, &mut linear);
        mlp(&format!("{name}.mlps"), 2 * hidden, &[hidden; 2], false, true, &mut linear);
        mlp(&format!("{name}.out_mlps"), hidden, &[hidden, c.width], true, false, &mut linear);
    }
    for i in 0..c.encoder_layers {
        let name = format!("{e}.self_attn_layers.{i}");
        linear(&format!("{name}.self_attn.out_proj"), c.width, c.width, true);
        linear(&format!("{name}.linear1"), c.width, 4 * c.width, true);
        linear(&format!("{name}.linear2"), 4 * c.width, c.width, true);
        layers.extend([(format!("{name}.norm1"), c.width), (format!("{name}.norm2"), c.width)]);
    }
    let (d, m, w) = (c.decoder_width, c.map_width, c.width);
    let dec = |name: &str| format!("motion_decoder.{name}");
    for (name, to) in [("in_proj_center_obj", d), ("in_proj_obj", d), ("in_proj_map", m)] {
        mlp(&dec(name), w, &[to, to], true, false, &mut linear);
    }
    for (kind, width) in [("obj", d), ("map", m)] {
        for i in 0..c.decoder_layers {
            let name = dec(&format!("{kind}_decoder_layers.{i}"));
            let parts = "sa_qcontent_proj sa_qpos_proj sa_kcontent_proj sa_kpos_proj sa_v_proj \
                         self_attn.out_proj ca_qcontent_proj ca_qpos_proj ca_kcontent_proj ca_kpos_proj \
                         ca_v_proj ca_qpos_sine_proj cross_attn.out_proj";
            for part in words(parts) {
                linear(&format!("{name}.{part}"), width, width, true);
            }
            linear(&format!("{name}.linear1"), width, 4 * width, true);
            linear(&format!("{name}.linear2"), 4 * width, width, true);
            layers.extend((1..=3).map(|k| (format!("{name}.norm{k}"), width)));
        }
    }
    linear(&dec("map_query_embed_mlps"), d, m, true);
    let out = 80 * 7;
    mlp(&dec("obj_pos_encoding_layer"), 2, &[d; 3], true, false, &mut linear);
    mlp(&dec("dense_future_head"), 2 * d, &[d, d, out], true, true, &mut linear);
    mlp(&dec("future_traj_mlps"), 4 * 80, &[d; 3], true, false, &mut linear);
    mlp(&dec("traj_fusion_mlps"), 2 * d, &[d; 3], true, false, &mut linear);
    mlp(&dec("intention_query_mlps"), d, &[d, d], true, true, &mut linear);
    for i in 0..c.decoder_layers {
        linear(&dec(&format!("map_query_content_mlps.{i}")), d, m, true);
        mlp(&dec(&format!("query_feature_fusion_layers.{i}")), 2 * d + m, &[d, d], true, true, &mut linear);
        mlp(&dec(&format!("motion_reg_heads.{i}")), d, &[d, d, out], true, true, &mut linear);
        mlp(&dec(&format!("motion_cls_heads.{i}")), d, &[d, d, 1], true, true, &mut linear);
    }
    for i in 0..c.encoder_layers {
        let name = format!("{e}.self_attn_layers.{i}.self_attn");
        put(format!("{name}.in_proj_weight"), &[3 * c.width, c.width]);
        put(format!("{name}.in_proj_bias"), &[3 * c.width]);
    }
    for (name, width) in layers {
        put(format!("{name}.weight"), &[width]);
        put(format!("{name}.bias"), &[width]);
    }
    for (name, width) in norms {
        for part in ["weight", "bias", "running_mean", "running_var"] {
            put(format!("{name}.{part}"), &[width]);
        }
    }
    all
}

/// Returns values without an obvious pattern.
fn noise(name: &str, len: usize) -> Vec<f32> {
    let seed = name.bytes().fold(7u32, |h, b| h.wrapping_mul(31).wrapping_add(u32::from(b)));
    let value = |i: usize| {
        let x = (seed.wrapping_add(i as u32)).wrapping_mul(2_654_435_761);
        let unit = f64::from(x >> 8) / f64::from(1u32 << 24);
        // Variances are positive.
        if name.ends_with("running_var") { (0.5 + unit) as f32 } else { (0.4 * (unit - 0.5)) as f32 }
    };
    (0..len).map(value).collect()
}

#[test]
fn an_exported_state_dict_loads_unchanged() {
    let config = small_mtr();
    let mut tables: Tables = published(&config)
        .into_iter()
        .map(|(name, shape)| {
            let values = noise(&name, shape.iter().product());
            (name, (shape, values))
        })
        .collect();
    let weights = tables.clone();
    // Values that PyTorch stores with batch norms, and the points, which the public code reads from a
    // separate file.
    tables.insert(
        "context_encoder.agent_polyline_encoder.mlps.1.num_batches_tracked".into(),
        (vec![], vec![7.0]),
    );
    tables.extend(Intentions::fan().tables().unwrap().0);
    let stored = serde_json::json!({ "kind": "motion-transformer", "network": config });
    let metadata = BTreeMap::from([("config".to_owned(), stored.to_string())]);
    let file = save_tables(&tables, &metadata);
    let policy = Policy::read(&file, &device()).unwrap();
    let written = policy.write(&BTreeMap::new()).unwrap();
    let back = Tensors::read(&written).unwrap();
    for (name, (shape, values)) in &weights {
        assert_eq!(back.floats(name).unwrap(), (shape.as_slice(), values.clone()), "{name}");
    }
    assert_eq!(back.shapes().count(), weights.len() + 3);
    for scenario in scenarios(1) {
        for prediction in predictions(&policy, &scenario, &tracks(&scenario), CURRENT) {
            assert!(!prediction.modes.is_empty() && prediction.modes.iter().all(|m| m.points.len() == 80));
        }
    }

    // A missing tensor, and a superfluous one.
    let mut less = tables.clone();
    less.remove("motion_decoder.dense_future_head.4.running_var");
    let text = Policy::read(&save_tables(&less, &metadata), &device()).unwrap_err().to_string();
    assert!(
        text.contains("`motion_decoder.dense_future_head.4.running_var`") && text.contains("missing"),
        "{text}"
    );
    tables.insert("motion_decoder.motion_vel_heads.0.0.weight".into(), (vec![1], vec![0.0]));
    let text = Policy::read(&save_tables(&tables, &metadata), &device()).unwrap_err().to_string();
    assert!(text.contains("motion_vel_heads") && text.contains("no place"), "{text}");
}

#[test]
fn sizes_are_those_that_are_told() {
    let count = |c: Config| {
        let all = Tensors::read(Box::leak(bytes(c).into_boxed_slice())).unwrap();
        let own = |name: &str| !name.starts_with("intention") && !name.contains("running");
        all.shapes().filter(|(n, _)| own(n)).map(|(_, s)| s.iter().product::<usize>()).sum::<usize>()
    };
    let small = count(Config::default());
    assert!((300_000..500_000).contains(&small), "{small}");
    assert!(bytes(Config::default()).len() <= 4 << 20);
    let mtr: usize = published(&Config::mtr())
        .iter()
        .filter(|(n, _)| !n.contains("running"))
        .map(|(_, s)| s.iter().product::<usize>())
        .sum();
    assert!((65_000_000..66_500_000).contains(&mtr), "{mtr}");
    let model = task(small_mtr()).init(0);
    assert!(model.num_params() > 0);
}

#[test]
fn a_scene_that_is_turned_and_moved_is_the_same() {
    for config in [Config::default(), small_mtr()] {
        let policy = policy(config);
        for scenario in scenarios(2) {
            let before = predictions(&policy, &scenario, &tracks(&scenario), 20);
            let (angle, shift) = (2.1f64, Vec2::new(13.0, -4.0));
            let turned = moved(scenario, angle, shift);
            let after = predictions(&policy, &turned, &tracks(&turned), 20);
            let (sin, cos) = angle.sin_cos();
            let there = |p: Vec2| Vec2::new(p.x * cos - p.y * sin, p.x * sin + p.y * cos) + shift;
            let farthest = farthest(&before, &after, there);
            assert!(farthest < 2e-2, "{farthest}");
        }
    }
}

#[test]
fn the_order_of_agents_and_their_company_do_not_matter() {
    let policy = policy(Config::default());
    let mut scenario = scenarios(1).remove(0);
    let before = predictions(&policy, &scenario, &tracks(&scenario), CURRENT);
    let n = scenario.start.agents.len();
    reverse_agents(&mut scenario);
    let mut after = predictions(&policy, &scenario, &tracks(&scenario), CURRENT);
    after.iter_mut().filter(|p| p.slot > 0).for_each(|p| p.slot = n - p.slot);
    after.sort_by_key(|p| p.slot);
    let farthest_of_all = farthest(&before, &after, |p| p);
    assert!(farthest_of_all < 1e-3, "{farthest_of_all}");

    let (tracks, lights) = (tracks(&scenario), lights(&scenario));
    let known = KnownMotion { start: &scenario.start, tracks: &tracks, lights: &lights, av_lookahead: true };
    let all = predictions(&policy, &scenario, &tracks, CURRENT);
    for one in &all {
        let alone = policy.predict_known(&known, CURRENT, &[one.slot], &device());
        let apart = farthest(std::slice::from_ref(one), &alone, |p| p);
        assert!(apart < 1e-4, "{}: {apart}", one.slot);
    }
}

#[test]
fn what_the_av_does_next_counts() {
    let policy = policy(Config::default());
    let scenario = scenarios(1).remove(0);
    let mut tracks = tracks(&scenario);
    let before = predictions(&policy, &scenario, &tracks, 20);
    for state in tracks[0][21..].iter_mut().flatten() {
        state.x += 1.0;
    }
    let after = predictions(&policy, &scenario, &tracks, 20);
    assert!(farthest(&before, &after, |p| p) > 0.0);
    // Later frames do not count.
    for state in tracks.iter_mut().flat_map(|t| &mut t[22..]).flatten() {
        state.x += 5.0;
    }
    assert_eq!(after, predictions(&policy, &scenario, &tracks, 20));
}

#[test]
fn little_around_is_enough() {
    let alone = || vec![car("av", 0.0, 0.0, 0.0, 9.0)];
    let mut kinds = alone();
    kinds.push(agent("walker", AgentKind::Pedestrian, state(10.0, -4.0, 1.5, 1.3)));
    kinds.push(agent("rider", AgentKind::Cyclist, state(-12.0, -1.0, 0.0, 4.0)));
    let scenes = [
        scene("alone", alone(), straight()),
        scene("nothing", alone(), MapParts::default()),
        scene("kinds, no map", kinds, MapParts::default()),
    ];
    for config in [Config::default(), small_mtr()] {
        let policy = policy(config);
        for scenario in &scenes {
            let found = predictions(&policy, scenario, &tracks(scenario), CURRENT);
            assert_eq!(found.len(), scenario.start.agents.len());
            for prediction in found {
                let total: f64 = prediction.modes.iter().map(|m| m.probability).sum();
                assert!((total - 1.0).abs() < 1e-9, "{total}");
                assert_eq!(prediction.modes.len(), 6);
                for point in prediction.modes.iter().flat_map(|m| &m.points) {
                    assert!(point.position.norm().is_finite() && point.deviation(Vec2::x()) > 0.0);
                }
            }
        }
    }
}

#[test]
fn modes_begin_with_the_present_velocity() {
    let policy = policy(Config::default());
    let scenario = scenarios(1).remove(0);
    for prediction in predictions(&policy, &scenario, &tracks(&scenario), 20) {
        for mode in &prediction.modes {
            // The distance from constant velocity grows with the square of time at least: a motion that had
            // another velocity at once would have a fifth of it after a fifth of the time.
            let apart = |k: usize| {
                let moved = mode.points[k - 1].position - prediction.pose.position;
                (moved - prediction.velocity * (DT * k as f64)).norm()
            };
            assert!(apart(1) < 0.08 * apart(5) + 0.005, "{} after {}", apart(5), apart(1));
            assert!(mode.points[0].deviation(direction(0.3)) < mode.points[79].deviation(direction(0.3)));
        }
    }
}

/// Returns a simulator that plans along the modes of a policy.
fn smoothed(policy: Policy, agents: usize, keep_clear: bool) -> Controller {
    let settings = qp::settings().unwrap();
    let smooth = PlanningParameters { agents, keep_clear };
    Controller::Fair(Box::new(QpRegressionSimulator::new(policy, smooth, settings, device())))
}

#[test]
fn vehicles_keep_their_limits_whatever_is_predicted() {
    // The network is untrained, and only the nearest four agents are predicted.
    for keep_clear in [true, false] {
        let controller = smoothed(policy(small()), 4, keep_clear);
        for scenario in mini() {
            let rollout = roll(&scenario, coasting(&scenario), &controller, &Settings::default());
            crate::qp::check_limits(&scenario, &rollout);
            let vehicles = scenario.start.agents[1..].iter().filter(|a| a.kind == AgentKind::Vehicle).count();
            let plans = Ending::ALL.iter().filter_map(|e| rollout.outcomes.get(e.name())).sum::<u64>();
            assert_eq!(plans, 16 * vehicles as u64, "{:?}", rollout.outcomes);
        }
    }
}

#[test]
fn predictions_that_are_no_numbers_are_counted_and_lane_following_takes_over() {
    // Weights so large that the output of the network is infinite.
    let whole = bytes(small());
    let read = Tensors::read(&whole).unwrap();
    let mut tables = Tables::new();
    for (name, shape) in read.shapes() {
        let (_, mut values) = read.floats(name).unwrap();
        if name.starts_with("motion_decoder.motion_reg_heads.1") {
            values.fill(3e38);
        }
        tables.insert(name.to_owned(), (shape.to_vec(), values));
    }
    let stored = serde_json::json!({ "kind": "motion-transformer", "network": small() });
    let metadata = BTreeMap::from([("config".to_owned(), stored.to_string())]);
    let large = || Policy::read(&save_tables(&tables, &metadata), &device()).unwrap();
    let scenario = scenarios(1).remove(0);
    let driving = Driving { agents: 4, sample: false };
    let plain = Controller::Fair(Box::new(RegressionSimulator::new(large(), driving, device())));
    for controller in [plain, smoothed(large(), 4, true)] {
        let rollout = roll(&scenario, coasting(&scenario), &controller, &Settings::default());
        let counted = rollout.outcomes.get(NOT_FINITE);
        assert_eq!(counted, Some(&(4 * 16)), "{:?}", rollout.outcomes);
        let states = rollout.tracks.iter().flatten().flatten();
        assert!(states.into_iter().all(|s| s.x.is_finite() && s.y.is_finite() && s.heading.is_finite()));
    }
}

#[test]
fn what_ships_follows_a_bend() {
    // A quarter circle to the left.
    let mut lanes = vec![
        lane("in", line((-60.0, 0.0), (0.0, 0.0)), None),
        lane("bend", arc((0.0, 0.0), 0.0, 25.0, 1.5), None),
        lane("out", line((24.9, 23.2), (28.0, 67.0)), None),
    ];
    join(&mut lanes, "in", "bend");
    join(&mut lanes, "bend", "out");
    let map = MapParts { lanes, ..MapParts::default() };
    let scenario =
        scene("bend", vec![car("av", -40.0, 0.0, 0.0, 6.0), car("turns", -6.0, 0.0, 0.0, 6.0)], map);
    let weights = models::weights::shipped("regression").unwrap().unwrap();
    let policy = Policy::read(&weights.bytes, &device()).unwrap();
    let found = predictions(&policy, &scenario, &tracks(&scenario), CURRENT);
    let likeliest = &found.iter().find(|p| p.slot == 1).unwrap().modes[0];
    let at = |k: usize| likeliest.points[k].position;
    assert!(at(79).y > 10.0, "{}", at(79));
    for (k, p) in (0..80).map(at).enumerate().filter(|(_, p)| p.x > 0.0 && p.y < 23.0) {
        let aside = (p - Vec2::new(0.0, 25.0)).norm() - 25.0;
        // Beyond four seconds it may cut the corner by less than a lane.
        let most = if k < 40 { 1.5 } else { 3.5 };
        assert!(aside.abs() < most, "{p}: {aside} m aside");
    }
}

#[test]
#[expect(deprecated, reason = "ndarray is deprecated by its authors; here it is what flex is compared with")]
fn the_other_backend_agrees() {
    let scenario = scenarios(1).remove(0);
    let bytes = bytes(Config::default());
    let (tracks, lights) = (tracks(&scenario), lights(&scenario));
    let known = KnownMotion { start: &scenario.start, tracks: &tracks, lights: &lights, av_lookahead: true };
    let run = |device: &Device| {
        Policy::read(&bytes, device).unwrap().predict_known(&known, CURRENT, &[1, 2, 3], device)
    };
    let apart = farthest(&run(&Device::flex()), &run(&Device::ndarray()), |p| p);
    assert!(apart < 5e-3, "{apart}");
}

#[test]
fn every_part_that_is_used_learns() {
    check_learning(small());
}

#[test]
fn every_part_of_the_published_structure_learns_with_the_statistics_of_batches() {
    check_learning(small_mtr());
}

fn check_learning(config: Config) {
    let task = task(config);
    let model = task.init(3);
    let scenarios = scenarios(2);
    let samples: Vec<_> = scenarios.iter().filter_map(|s| task.prepare(s, None)).collect();
    let output = task.loss(&model, &samples, Some(&mut Stream::seed_from_u64(1)));
    let learning = loss(&output);
    assert!(learning.is_finite() && output.items >= 2.0, "{learning}");
    let mut still = without_gradient(&model, output.loss);
    // Averages follow what passes observe, not gradients.
    still.retain(|name| !name.contains(".running_"));
    // After the first layer, intentions are not added to the features that are compared with tokens; in the
    // first layer, queries have no information to exchange yet.
    still.retain(|name| !name.contains("layers.1.ca_qpos_proj") && !name.contains("layers.0.sa_"));
    // The content of queries is zero before the first layer.
    still.retain(|name| !name.contains("map_query_content_mlps.0.weight"));
    // A constant that is added to all scores changes nothing.
    still.retain(|name| !(name.contains("motion_cls_heads") && name.ends_with("third.bias")));
    assert!(still.is_empty(), "{still:?}");
    // Validation without autodiff gives the same loss as with it.
    let with = loss(&task.loss(&model, &samples, None));
    let without = loss(&task.validate(&model.valid(), &samples));
    assert!((without - with).abs() < 1e-3 * with.abs(), "{without} {with}");
}

#[test]
fn only_predictions_that_are_executed_decide_which_network_is_the_best() {
    // The sample predicts the AV. Its neighbours are in the dense prediction.
    let recipe = Recipe { network: small(), agents: 1, ..Recipe::default() };
    let task = Regression::new(recipe, Intentions::fan(), &device());
    let model = task.init(3);
    let losses = |scenario: &Scenario| {
        let samples = [task.prepare(scenario, None).unwrap()];
        let trained = task.loss(&model, &samples, Some(&mut Stream::seed_from_u64(1)));
        [trained, task.validate(&model.valid(), &samples)].map(|output| output.loss.into_scalar::<f32>())
    };
    let scenario = scenarios(1).remove(0);
    let mut elsewhere = scenario.clone();
    for track in &mut elsewhere.log_future.tracks[1..] {
        for state in track.iter_mut().flatten() {
            state.x += 30.0;
        }
    }
    let ([trained, judged], [trained_elsewhere, judged_elsewhere]) = (losses(&scenario), losses(&elsewhere));
    assert_eq!(judged, judged_elsewhere);
    assert!(trained_elsewhere > trained, "{trained_elsewhere} {trained}");
}

/// Returns the parameters of a network to which a loss has no gradient.
pub(crate) fn without_gradient<M: Module>(model: &M, loss: burn::tensor::Tensor<1>) -> Vec<String> {
    let mut gradients = loss.backward();
    let mut visitor = Still { gradients: &mut gradients, path: Vec::new(), still: Vec::new() };
    model.visit(&mut visitor);
    visitor.still
}

/// Finds the parameters without a gradient.
struct Still<'a> {
    gradients: &'a mut burn::tensor::Gradients,
    path: Vec<String>,
    still: Vec<String>,
}

impl burn::module::ModuleVisitor for Still<'_> {
    fn enter_module(&mut self, name: &str, _: &str) {
        self.path.push(name.to_owned());
    }

    fn exit_module(&mut self, _: &str, _: &str) {
        self.path.pop();
    }

    fn visit_float<const D: usize>(&mut self, param: &burn::module::Param<burn::tensor::Tensor<D>>) {
        let tensor = param.val();
        let moves =
            tensor.grad_remove(self.gradients).is_some_and(|g| g.abs().max().into_scalar::<f32>() > 0.0);
        if tensor.is_require_grad() && !moves {
            self.still.push(self.path.join("."));
        }
    }
}

#[test]
fn foreign_and_damaged_policies_are_refused() {
    let good = bytes(small());
    let refusal = |bytes: &[u8]| Policy::read(bytes, &device()).unwrap_err().to_string();
    check_refusals(&good, refusal);
    let points = refusal(&replaced(&good, "intention_points.vehicle", "intention_points.vehicel"));
    assert!(points.contains("`intention_points.vehicle`"), "{points}");
    for (config, field) in [
        (Config { step: 3, ..small() }, "step"),
        (Config { line_layers: 2, ..small() }, "line_layers"),
        (Config { width: 18, ..small() }, "width"),
        (Config { apart: f64::NAN, ..small() }, "apart"),
        (Config { modes: 0, ..small() }, "modes"),
    ] {
        assert_eq!(config.check().unwrap_err().field, field);
    }
    assert_eq!(Config::mtr().check(), Ok(()));
    assert_eq!((Config::mtr().attributes, Config::mtr().norms), (Attributes::Published, Norms::Batch));
    assert_eq!(suppress(&[[0.0; 2]], &[1.0], 2.5, 6), [0]);
}
