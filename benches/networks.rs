//! Speed of the networks on one thread, with random weights on made-up scenes, next to the rate of the
//! machine's matrix products.
//!
//! `cargo bench --bench networks`. Best and median are by the wall clock; the best by the processor time of
//! the measuring thread is less disturbed by other programs on the machine.
#![expect(clippy::print_stdout, reason = "the table is what this program is for")]
#![expect(clippy::disallowed_methods, reason = "speed does not hang on last bits")]

use std::collections::BTreeMap;
use std::fs;
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context, Result};
use burn::module::Module;
use burn::tensor::{Device, Distribution, Tensor};
use mimalloc::MiMalloc;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use reactsim::formats;
use reactsim::metrics::{Case, Options, score_case};
use reactsim::models::ctg::learn::{CtgLearning, Recipe as CtgRecipe};
use reactsim::models::ctg::{CtgParameters, CtgSimulator, Rules};
use reactsim::models::learning::Intentions;
use reactsim::models::nn::{Initializer, Noise, Tensors, device};
use reactsim::models::ntp::learn::{NextToken, Recipe};
use reactsim::models::ntp::reactive::{Policy, ReactiveSimulator};
use reactsim::models::ntp::smart::{
    Agents, Batch, Edges, Links, MapTokens, Scene, Smart, SmartConfig, Step, TokenShapes,
};
use reactsim::models::ntp::tokens::Kinematic;
use reactsim::models::ntp::{Driving, Sampling};
use reactsim::models::perception::KnownMotion;
use reactsim::models::qp_regression::Policy as Predictor;
use reactsim::models::qp_regression::learn::{Recipe as RegressionRecipe, Regression};
use reactsim::models::vbd::learn::{Denoising, Recipe as VbdRecipe};
use reactsim::models::vbd::{VbdParameters, VbdSimulator};
use reactsim::rollout::{Controller, LogAv, Request, Rollout, Settings, Simulator, roll_out};
use reactsim::scene::{CURRENT, Frame, LightState, Scenario};
use reactsim::training::Task;

// As in the program.
#[global_allocator]
static ALLOCATOR: MiMalloc = MiMalloc;

/// Number of rounds of every measurement.
const ROUNDS: usize = 15;
const AGENTS: usize = 64;
const PIECES: usize = 300;

/// The published network of 7 million parameters.
const TINY: &str = r#"{"hidden_dim": 128, "num_freq_bands": 64, "num_heads": 8, "head_dim": 16, "dropout": 0.1,
    "num_map_layers": 3, "num_agent_layers": 6, "pl2pl_radius": 10, "pl2a_radius": 30, "a2a_radius": 60, "time_span": 30,
    "n_token_agent": 2048, "n_params": 7001024}"#;

/// A network of the sizes of the default recipe, 1 million parameters.
const SMALL: &str = r#"{"hidden_dim": 64, "num_freq_bands": 16, "num_heads": 4, "head_dim": 16, "dropout": 0.0,
    "num_map_layers": 1, "num_agent_layers": 3, "pl2pl_radius": 10.5, "pl2a_radius": 30, "a2a_radius": 60,
    "time_span": 20, "nearest_pl2a": 32, "ahead_pl2a": 12, "nearest_a2a": 12, "n_token_agent": 768,
    "mlp_embedding_first_width": 128}"#;

fn main() -> Result<()> {
    // Runs compute plans on threads, whose memory the allocator keeps; that of the first thread is returned
    // to the system whenever much of it is free.
    let measuring = std::thread::spawn(measure);
    measuring.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
}

fn measure() -> Result<()> {
    let device = device();
    println!("| what | best | median | best by CPU time | aim |\n|---|--:|--:|--:|--:|");
    let peak = products(&device);
    published(&device, peak, "7 M", TINY, "60 ms")?;
    published(&device, peak, "1 M", SMALL, "5 ms")?;
    reactive(&device, peak)?;
    guarded()?;
    regression(&device, peak)?;
    diffusion(&device)
}

/// Wall-clock and processor time of some work, seconds.
#[derive(Clone, Copy)]
struct Time {
    wall: f64,
    cpu: f64,
}

/// Returns the processor time of this thread so far, seconds; `None` if the system does not report it.
fn cpu_time() -> Option<f64> {
    let text = fs::read_to_string("/proc/thread-self/schedstat").ok()?;
    Some(text.split_ascii_whitespace().next()?.parse::<f64>().ok()? * 1e-9)
}

/// Measures some work in several rounds, after an unmeasured one.
fn measured(mut work: impl FnMut()) -> Vec<Time> {
    work();
    let round = |_| {
        let (wall, cpu) = (Instant::now(), cpu_time());
        work();
        let wall = wall.elapsed().as_secs_f64();
        // The system counts in ticks: short work may seem to take none.
        let cpu = cpu.and_then(|before| Some(cpu_time()? - before)).filter(|c| *c > 0.5 * wall);
        Time { wall, cpu: cpu.unwrap_or(wall) }
    };
    (0..ROUNDS).map(round).collect()
}

/// Prints a row and returns the best time by the wall clock: some systems count processor time in ticks.
fn row(what: &str, rounds: &[Time], aim: &str, shown: impl Fn(f64) -> String) -> f64 {
    let mut wall: Vec<f64> = rounds.iter().map(|t| t.wall).collect();
    wall.sort_by(f64::total_cmp);
    let cpu = rounds.iter().map(|t| t.cpu).fold(f64::INFINITY, f64::min);
    println!("| {what} | {} | {} | {} | {aim} |", shown(wall[0]), shown(wall[wall.len() / 2]), shown(cpu));
    wall[0]
}

fn milliseconds(seconds: f64) -> String {
    format!("{:.2} ms", seconds * 1e3)
}

/// Measures the backend's matrix products and returns their rate, GFLOP/s.
fn products(device: &Device) -> f64 {
    let mut best = 0.0;
    for [m, k, n] in [[1024, 1024, 1024], [8192, 128, 128], [64, 128, 512]] {
        let uniform =
            |shape: [usize; 2]| Tensor::<2>::random(shape, Distribution::Uniform(-1.0, 1.0), device);
        let (a, b) = (uniform([m, k]), uniform([k, n]));
        let times = measured(|| drop(std::hint::black_box(a.clone().matmul(b.clone()))));
        let operations = 2.0 * (m * k * n) as f64;
        let rate = |seconds: f64| operations / seconds * 1e-9;
        let time =
            row(&format!("product {m} × {k} × {n}"), &times, "", |s| format!("{:.0} GFLOP/s", rate(s)));
        best = f64::max(best, rate(time));
    }
    best
}

/// Returns a scene with the shape of a crowded junction: every agent sees about a third of the map.
fn scene(config: &SmartConfig, stream: &mut ChaCha8Rng, steps: usize) -> Scene {
    let mut place = |radius: f32| {
        loop {
            let [x, y] = [0, 1].map(|_| stream.random_range(-radius..radius));
            if x * x + y * y < radius * radius {
                return [x, y];
            }
        }
    };
    let starts: Vec<[f32; 2]> = (0..AGENTS).map(|_| place(40.0)).collect();
    let pieces: Vec<[f32; 2]> = (0..PIECES).map(|_| place(50.0)).collect();
    let headings: Vec<f32> = (0..AGENTS).map(|_| stream.random_range(-3.1..3.1)).collect();
    let tokens = config.n_token_agent.of_classes()[0] as u32;
    let step = |t: usize, stream: &mut ChaCha8Rng| Step {
        position: starts
            .iter()
            .zip(&headings)
            .map(|(p, h)| [p[0] + t as f32 * h.cos(), p[1] + t as f32 * h.sin()])
            .collect(),
        heading: headings.clone(),
        valid: vec![true; AGENTS],
        token: (0..AGENTS).map(|_| stream.random_range(0..tokens)).collect(),
    };
    Scene {
        map: MapTokens {
            orientation: pieces.iter().map(|_| stream.random_range(-3.1..3.1)).collect(),
            token: pieces.iter().map(|_| stream.random_range(0..config.n_token_map as u32)).collect(),
            kind: vec![1; PIECES],
            polygon: vec![0; PIECES],
            light: vec![0; PIECES],
            position: pieces,
        },
        agents: Agents { class: vec![0; AGENTS], shape: vec![[4.8, 2.0, 1.6]; AGENTS] },
        steps: (0..steps).map(|t| step(t, stream)).collect(),
    }
}

fn token_shapes(config: &SmartConfig, stream: &mut ChaCha8Rng) -> TokenShapes {
    let counts = config.n_token_agent.of_classes();
    TokenShapes {
        agents: counts
            .map(|n| (0..n).map(|_| std::array::from_fn(|_| stream.random_range(-3.0..8.0))).collect()),
        map: (0..config.n_token_map)
            .map(|_| std::array::from_fn(|_| stream.random_range(-1.0..5.0)))
            .collect(),
    }
}

/// Returns the additions and multiplications of one new step; `pairs` counts the pairs of agents' steps, of
/// map and agents, and of agents.
fn operations(config: &SmartConfig, pairs: [usize; 3]) -> f64 {
    let (h, a, f) = (config.hidden_dim, config.num_heads * config.head_dim, config.num_freq_bands);
    let (heads, hidden) = (config.num_heads, config.ffn_multiple * config.hidden_dim);
    let fourier = |scalars: usize| scalars * ((2 * f + 1) * h + h * h) + h * h;
    let embeddings = pairs[0] * fourier(4) + (pairs[1] + pairs[2]) * fourier(3);
    // Queries to sources and relations and back, values, gate and transform, output, feed-forward.
    let node = h * a + 4 * a * h + (a + h) * a + h * a + a * h + 2 * h * hidden;
    let pair = 4 * heads * h;
    let blocks = config.num_agent_layers * (3 * AGENTS * node + pairs.iter().sum::<usize>() * pair);
    let tokens = config.n_token_agent.of_classes()[0];
    2.0 * (embeddings + blocks + AGENTS * (h * h + h * tokens)) as f64
}

/// Prints the rate of a network whose products have this many additions and multiplications.
fn print_rate(operations: f64, time: f64, peak: f64) {
    let rate = operations / time * 1e-9;
    println!(
        "| – {:.0} MFLOP in its products: {rate:.0} GFLOP/s, {:.0} % of the best product | | | | |",
        operations * 1e-6,
        100.0 * rate / peak
    );
}

/// Returns the additions and multiplications of the products with the weights of a file, given how many rows
/// go through the weights of this name.
fn products_with_weights(file: &[u8], rows: impl Fn(&str) -> f64) -> Result<f64> {
    let tensors = Tensors::read(file)?;
    let of = |(name, shape): (&str, &[usize])| match shape {
        [outputs, inputs] => 2.0 * (outputs * inputs) as f64 * rows(name),
        _ => 0.0,
    };
    Ok(tensors.shapes().map(of).sum())
}

/// Measures the published network with random weights, of a size and with this aim for one replan.
fn published(device: &Device, peak: f64, size: &str, config: &str, aim: &'static str) -> Result<()> {
    let config = SmartConfig::from_json(config)?;
    let stream = &mut ChaCha8Rng::seed_from_u64(1);
    let network = Smart::init(&config, &mut Initializer::new(1, device))?;
    let tables = network.tables(&token_shapes(&config, stream), device)?;
    let scene = scene(&config, stream, 8);
    let map = network.encode_map(&tables, &scene.map)?;
    let window = config.window();
    let mut before = network.begin(&tables, map.clone(), scene.agents.clone())?;
    for step in &scene.steps[..window] {
        network.advance(&tables, &mut before, step.clone())?;
    }
    let newest = &scene.steps[window];
    let one = Scene { steps: vec![newest.clone()], ..scene.clone() };
    let one = Batch::new(&config, [&one], &mut Noise::none())?;
    let past = Batch::new(&config, [&scene], &mut Noise::none())?;
    let kept: Vec<usize> = (0..past.over_time.len())
        .filter(|e| past.over_time.targets[*e] as usize % scene.steps.len() == window)
        .collect();
    let mut over_time = Edges::new(4);
    for e in kept {
        over_time.sources.push(0);
        over_time.targets.push(past.over_time.targets[e] / scene.steps.len() as u32);
        over_time.relations.extend_from_slice(&past.over_time.relations[4 * e..4 * e + 4]);
    }
    let pairs = [over_time.len(), one.from_map.len(), one.among_agents.len()];
    let name = format!("`smart` {size}, {AGENTS} agents, {PIECES} map tokens");

    let times = measured(|| {
        let logits = network.step(&tables, &mut before.clone(), newest.clone()).expect("a step");
        std::hint::black_box(logits.into_data());
    });
    let time = row(&format!("{name}: one replan, {pairs:?} pairs"), &times, aim, milliseconds);
    print_rate(operations(&config, pairs), time, peak);

    let embeddings = network.agent_encoder().relation_embeddings();
    for (what, edges, embedding) in [
        ("over time", &over_time, embeddings[0]),
        ("from map", &one.from_map, embeddings[1]),
        ("among agents", &one.among_agents, embeddings[2]),
    ] {
        let times = measured(|| drop(std::hint::black_box(Links::new(edges, AGENTS, embedding, device))));
        row(&format!("– of it relations {what}"), &times, "", milliseconds);
    }
    let times = measured(|| {
        drop(std::hint::black_box(network.encode_map(&tables, &scene.map).expect("a map")));
    });
    row(&format!("{name}: the map, once per scene"), &times, "", milliseconds);
    let times = measured(|| {
        let mut episode = network.begin(&tables, map.clone(), scene.agents.clone()).expect("agents");
        for step in &scene.steps[1..window] {
            network.advance(&tables, &mut episode, step.clone()).expect("a step");
        }
        let logits = network.step(&tables, &mut episode, newest.clone()).expect("a step");
        std::hint::black_box(logits.into_data());
    });
    row(&format!("{name}: one replan with the {window} last steps anew"), &times, "", milliseconds);
    Ok(())
}

/// Returns the shipped scenario with the most agents.
fn crowded() -> Result<Scenario> {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/scenarios/bench.parquet");
    let all = formats::open(std::path::Path::new(path))?.collect::<Result<Vec<_>, _>>()?;
    all.into_iter().max_by_key(|s| s.start.agents.len()).context("no scenarios ship")
}

/// Rolls a scenario out several times in one batch: 16 plans and 80 steps.
fn rolled(scenario: &Scenario, controller: &Controller, count: usize) -> Result<Vec<Rollout>> {
    let av = Arc::new(LogAv::new(scenario)?);
    let batch = (0..count).map(|i| Request { scenario, av: Some(av.clone()), rollout: i as u32 }).collect();
    let rollouts = roll_out(batch, controller, &Settings::default());
    Ok(rollouts.into_iter().collect::<Result<Vec<_>, _>>()?)
}

/// Measures the reactive network with random weights, on the shipped scenario with the most agents: 16 plans
/// and 80 steps.
fn reactive(device: &Device, peak: f64) -> Result<()> {
    let scenario = crowded()?;
    reactive_step(&scenario, device, peak)?;
    let task = NextToken::new(Recipe::default(), Kinematic::default().build()?, device);
    let file = task.file(&task.init(0), &BTreeMap::new()).context("weights can be written")?;
    let driving =
        Driving { projection: true, keep_clear: true, sampling: Sampling { top_k: 8, temperature: 1.0 } };
    let simulator = ReactiveSimulator::new(Policy::read(&file, device)?, driving, device.clone());
    let controller = Controller::Fair(Box::new(simulator));
    let roll = |count| rolled(&scenario, &controller, count);
    roll(1)?;
    let agents = scenario.start.agents.len();
    for (count, aim) in [(1usize, "6 ms"), (16, "5 ms")] {
        let times = measured(|| drop(std::hint::black_box(roll(count))));
        row(&format!("reactive: a plan of {agents} agents, {count} at a time"), &times, aim, |s| {
            milliseconds(s / (16 * count) as f64)
        });
    }
    let times = measured(|| {
        if let Ok(rollouts) = roll(1) {
            for rollout in rollouts {
                let case = Case::of_rollout(&scenario, rollout.tracks, Options::default());
                std::hint::black_box(score_case(&case));
            }
        }
    });
    row(&format!("reactive: a rollout of {agents} agents with all metrics"), &times, "120 ms", milliseconds);
    Ok(())
}

/// Measures the network's part of a plan of the shipped reactive network, of which map and earlier steps are
/// cached.
fn reactive_step(scenario: &Scenario, device: &Device, peak: f64) -> Result<()> {
    let file = fs::read(concat!(env!("CARGO_MANIFEST_DIR"), "/weights/ntp-reactive.safetensors"))?;
    let policy = Policy::read(&file, device)?;
    let config = &policy.config;
    let (tracks, lights) = logged(scenario);
    let known = KnownMotion { start: &scenario.start, tracks: &tracks, lights: &lights, av_lookahead: true };
    let step = policy.cached_step(&known, &[20, 25, 30, 35, 40], device).context("a step")?;
    let input = step.input();
    let classes = step.classes();
    let of_class =
        |class: char| classes.iter().filter(|c| class.to_digit(10) == Some(c.index() as u32)).count() as f64;
    let nodes = classes.len() as f64;
    let rows = |name: &str| {
        let slots = |kind: &str| input[&format!("{kind}.relations")].dims()[0] as f64;
        match name.split('.').next().unwrap_or_default() {
            "past" => slots("past"),
            "to_place" => slots("places"),
            "pair" => slots("agents"),
            "heads" => name.chars().nth(6).map_or(0.0, of_class),
            "body" | "blocks" => nodes,
            // Encoded once per rollout.
            _ => 0.0,
        }
    };
    let open = |kind: &str| {
        let open = input[&format!("{kind}.open")].clone().into_data();
        open.iter::<f32>().map(f64::from).sum::<f64>()
    };
    let pairs = open("past") + open("places") + open("agents");
    let attention = 4 * config.agent_layers * config.heads * (config.hidden + config.relation);
    let operations = products_with_weights(&file, rows)? + pairs * attention as f64;
    let times = measured(|| drop(std::hint::black_box(step.logits())));
    let what = format!("reactive: the network for {nodes} agents, {pairs} pairs");
    let time = row(&what, &times, "-", milliseconds);
    print_rate(operations, time, peak);
    Ok(())
}

/// Returns the logged states of all agents and lights.
fn logged(scenario: &Scenario) -> (Vec<Vec<Frame>>, Vec<Vec<Option<LightState>>>) {
    let tracks = (0..scenario.start.agents.len()).map(|a| scenario.logged(a)).collect();
    let lights = (0..scenario.start.lights.len()).map(|l| scenario.light_states(l)).collect();
    (tracks, lights)
}

/// Measures the shipped network with its guard, on the shipped scenario with the most agents: 16 plans and 80
/// steps.
fn guarded() -> Result<()> {
    let scenario = crowded()?;
    let baseline = reactsim::models::find("ntp-guarded").context("a baseline")?;
    let controller = baseline.simulator()?;
    rolled(&scenario, &controller, 1)?;
    let times = measured(|| drop(std::hint::black_box(rolled(&scenario, &controller, 1))));
    let agents = scenario.start.agents.len();
    row(&format!("guarded: a plan of {agents} agents"), &times, "25 ms", |s| milliseconds(s / 16.0));
    Ok(())
}

/// Measures the motion predictor: modes of the agents nearest to the AV, with the input.
fn regression(device: &Device, peak: f64) -> Result<()> {
    let scenario = crowded()?;
    let task = Regression::new(RegressionRecipe::default(), Intentions::fan(), device);
    let file = task.file(&task.init(0), &BTreeMap::new()).context("weights can be written")?;
    let policy = Predictor::read(&file, device)?;
    let (tracks, lights) = logged(&scenario);
    let known = KnownMotion { start: &scenario.start, tracks: &tracks, lights: &lights, av_lookahead: true };
    for (count, aim) in [(1, "-"), (12, "20 ms"), (32, "-")] {
        let slots: Vec<usize> = (1..=count).collect();
        let times =
            measured(|| drop(std::hint::black_box(policy.predict_known(&known, CURRENT, &slots, device))));
        let what = format!("regression: modes of {count} agents, map included");
        let time = row(&what, &times, aim, milliseconds);
        print_rate(count as f64 * prediction_operations(&file, &policy)?, time, peak);
    }
    Ok(())
}

/// Returns the additions and multiplications of the predictor for one agent, without intention queries, which
/// agents share.
fn prediction_operations(file: &[u8], policy: &Predictor) -> Result<f64> {
    let config = &policy.config;
    let [agents, lines, queries] = [config.agents, config.lines, policy.intentions.count()].map(|n| n as f64);
    let frames = (CURRENT + 1) as f64;
    let (agent_rows, line_rows) = (agents * frames, lines * config.points as f64);
    let rows = |name: &str| {
        let has = |part: &str| name.contains(part);
        let (one_by_one, points) =
            if has("agent_polyline") { (agents, agent_rows) } else { (lines, line_rows) };
        match name {
            _ if has("out_mlps") => one_by_one,
            // Half of these weights are applied to pooled values.
            _ if has("polyline_encoder.mlps.0") => 0.5 * (points + one_by_one),
            _ if has("polyline") => points,
            _ if has("self_attn_layers") => agents + lines,
            _ if has("in_proj_map") => lines,
            _ if has("obj_decoder") && (has("ca_k") || has("ca_v")) => agents,
            _ if has("map_decoder") && (has("ca_k") || has("ca_v")) => lines,
            _ if has("_decoder_layers") || has("fusion_layers") || has("_heads.") || has("guess") => queries,
            _ if has("outlook") => 1.0,
            _ if has("intention") => 0.0,
            _ => agents,
        }
    };
    let tokens = agents + lines;
    let encoder = (config.encoder_layers * config.width) as f64 * 4.0 * tokens * tokens;
    let decoder = |tokens: f64, width: usize| {
        (config.decoder_layers * width) as f64 * queries * (4.0 * queries + 6.0 * tokens)
    };
    let attention = encoder + decoder(agents, config.decoder_width) + decoder(lines, config.map_width);
    Ok(products_with_weights(file, rows)? + attention)
}

/// Measures networks of diffusion with random weights, on the shipped scenario with the most agents.
fn diffusion(device: &Device) -> Result<()> {
    let scenario = crowded()?;
    let agents = scenario.start.agents.len();
    let vbd = Denoising::new(VbdRecipe::default(), Intentions::fan(), device)?;
    let parameters = VbdParameters {
        agents: AGENTS,
        steps: 5,
        draws: false,
        temperature: 1.0,
        keeps_noise: true,
        inpainting: false,
    };
    let policy = vbd.policy(&vbd.init(0).valid());
    let vbd = VbdSimulator::new("vbd", policy, parameters, device.clone());
    let ctg = CtgLearning::new(CtgRecipe::default(), device)?;
    let policy = ctg.policy(&ctg.init(0).valid());
    let rules = Rules { collision: 1.0, road: 1.0, speed: 0.1 };
    let parameters = CtgParameters { agents: AGENTS, steps: 10, candidates: 1, rules };
    let ctg = CtgSimulator::new("ctg-guided", policy, parameters, device.clone());
    let all: [(&str, Box<dyn Simulator>, &str); 2] = [
        ("`vbd`: a plan by 5 steps", Box::new(vbd), "60 ms"),
        ("`ctg-guided`: a plan by 10 steps", Box::new(ctg), "-"),
    ];
    for (what, simulator, aim) in all {
        let controller = Controller::Fair(simulator);
        let times = measured(|| drop(std::hint::black_box(rolled(&scenario, &controller, 1))));
        row(&format!("{what}, {agents} agents"), &times, aim, |s| milliseconds(s / 16.0));
    }
    Ok(())
}
