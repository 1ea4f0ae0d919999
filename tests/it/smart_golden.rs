//! The published network against values of its original: every folder of golden data with a `config.json`,
//! all of its scenes.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use burn::tensor::{Device, Tensor, TensorData};
use reactsim::models::nn::Noise;
use reactsim::models::ntp::smart::{
    Agents, Batch, Edges, MapTokens, Scene, Smart, SmartConfig, Stage, Step, TokenShapes, TokenTables,
};
use safetensors::SafeTensors;
use safetensors::tensor::Dtype;

use super::networks::{values, worst};

/// Limit of the largest differences. The original's own 32 and 64-bit runs differ by up to 2.2e-5 in logits,
/// 1.9e-5 in features.
const CLOSE: f32 = 1e-4;

struct File(Vec<u8>);

impl File {
    fn open(path: &Path) -> Self {
        Self(fs::read(path).unwrap())
    }

    fn get(&self, name: &str) -> Option<(Vec<usize>, Dtype, Vec<u8>)> {
        let file = SafeTensors::deserialize(&self.0).unwrap();
        let view = file.tensor(name).ok()?;
        Some((view.shape().to_vec(), view.dtype(), view.data().to_vec()))
    }

    fn has_floats(&self, name: &str) -> Option<Vec<f32>> {
        let (_, dtype, data) = self.get(name)?;
        assert_eq!(dtype, Dtype::F32, "{name}");
        Some(data.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect())
    }

    fn floats(&self, name: &str) -> Vec<f32> {
        self.has_floats(name).unwrap_or_else(|| panic!("no {name}"))
    }

    fn has_ints(&self, name: &str) -> Option<Vec<usize>> {
        let (_, dtype, data) = self.get(name)?;
        Some(match dtype {
            Dtype::U8 => data.iter().map(|b| usize::from(*b)).collect(),
            Dtype::I16 => data.as_chunks::<2>().0.iter().map(|b| i16::from_le_bytes(*b) as usize).collect(),
            Dtype::I32 => data.as_chunks::<4>().0.iter().map(|b| i32::from_le_bytes(*b) as usize).collect(),
            other => panic!("{name}: {other:?}"),
        })
    }

    fn ints(&self, name: &str) -> Vec<usize> {
        self.has_ints(name).unwrap_or_else(|| panic!("no {name}"))
    }

    fn pairs(&self, name: &str) -> Vec<[f32; 2]> {
        self.floats(name).as_chunks::<2>().0.to_vec()
    }

    fn bytes(&self, name: &str) -> Vec<u8> {
        self.ints(name).into_iter().map(|v| v as u8).collect()
    }

    fn numbers(&self, name: &str) -> Vec<u32> {
        self.ints(name).into_iter().map(|v| v as u32).collect()
    }

    fn scene(&self) -> Scene {
        let class = self.bytes("in.agent.type");
        let count = class.len();
        let (positions, headings) = (self.pairs("in.agent.position"), self.floats("in.agent.heading"));
        let (valid, tokens) = (self.ints("in.agent.valid"), self.numbers("in.agent.token_idx"));
        let steps = headings.len() / count;
        let at = |t: usize| (0..count).map(move |a| a * steps + t);
        Scene {
            map: MapTokens {
                position: self.pairs("in.map.position"),
                orientation: self.floats("in.map.orientation"),
                token: self.numbers("in.map.token_idx"),
                kind: self.bytes("in.map.type"),
                polygon: self.bytes("in.map.polygon_type"),
                light: self.bytes("in.map.light_type"),
            },
            agents: Agents { class, shape: self.floats("in.agent.shape_lwh").as_chunks::<3>().0.to_vec() },
            steps: (0..steps)
                .map(|t| Step {
                    position: at(t).map(|i| positions[i]).collect(),
                    heading: at(t).map(|i| headings[i]).collect(),
                    valid: at(t).map(|i| valid[i] == 1).collect(),
                    token: at(t).map(|i| tokens[i]).collect(),
                })
                .collect(),
        }
    }

    /// Returns a list of edges with its relations, if both are stored.
    fn edges(&self, kind: &str) -> Option<Edges> {
        let ends = self.numbers_of(&format!("edges.{kind}"))?;
        let relations = self.has_floats(&format!("rel.{kind}"))?;
        let (sources, targets) = ends.split_at(ends.len() / 2);
        let width = relations.len() / sources.len();
        Some(Edges { sources: sources.to_vec(), targets: targets.to_vec(), relations, width })
    }

    fn numbers_of(&self, name: &str) -> Option<Vec<u32>> {
        Some(self.has_ints(name)?.into_iter().map(|v| v as u32).collect())
    }
}

struct Golden {
    name: String,
    folder: PathBuf,
    network: Smart,
    tables: TokenTables,
    corners: [Vec<[[[f32; 2]; 4]; 6]>; 3],
}

impl Golden {
    fn scenes(&self) -> Vec<(String, File)> {
        let mut paths: Vec<PathBuf> =
            fs::read_dir(&self.folder).unwrap().map(|e| e.unwrap().path()).collect();
        paths.sort();
        paths.retain(|p| p.file_name().unwrap().to_string_lossy().starts_with("scene_"));
        assert!(!paths.is_empty());
        let name = |p: &Path| format!("{} {}", self.name, p.file_stem().unwrap().to_string_lossy());
        paths.iter().map(|p| (name(p), File::open(p))).collect()
    }
}

fn golden() -> Vec<Golden> {
    let Some(folder) = super::shared("data/smart_golden") else { return Vec::new() };
    let file = File::open(&folder.join("vocab.safetensors"));
    let corners = ["veh", "ped", "cyc"].map(|class| {
        let values = file.floats(&format!("agent_token_all_{class}"));
        values.as_chunks::<2>().0.as_chunks::<4>().0.as_chunks::<6>().0.to_vec()
    });
    let ends = |tokens: &Vec<[[[f32; 2]; 4]; 6]>| {
        tokens.iter().map(|t| std::array::from_fn(|i| t[5][i / 2][i % 2])).collect()
    };
    let shapes = TokenShapes {
        agents: [ends(&corners[0]), ends(&corners[1]), ends(&corners[2])],
        map: file.floats("map_token_traj_src").as_chunks::<22>().0.to_vec(),
    };
    let mut folders: Vec<PathBuf> = fs::read_dir(&folder).unwrap().map(|e| e.unwrap().path()).collect();
    folders.sort();
    folders.retain(|f| f.join("config.json").exists());
    assert!(!folders.is_empty());
    let load = |folder: &PathBuf| {
        let config =
            SmartConfig::from_json(&fs::read_to_string(folder.join("config.json")).unwrap()).unwrap();
        assert!(config.n_params > 0, "the number of parameters is compared in loading");
        let weights = fs::read(folder.join("weights.safetensors")).unwrap();
        let network = Smart::load(&config, &weights, &Device::flex()).unwrap();
        let tables = network.tables(&shapes, &Device::flex()).unwrap();
        let name = folder.file_name().unwrap().to_string_lossy().into_owned();
        Golden { name, folder: folder.clone(), network, tables, corners: corners.clone() }
    };
    folders.iter().map(load).collect()
}

/// Returns the relations of edges by target and source.
fn sorted(edges: &Edges) -> BTreeMap<(u32, u32), &[f32]> {
    let ends = edges.targets.iter().copied().zip(edges.sources.iter().copied());
    ends.zip(edges.relations.chunks(edges.width)).collect()
}

/// Returns the largest difference of relations: metres, angles modulo a turn, steps.
fn relation_gap(found: &[f32], expected: &[f32]) -> f32 {
    let turn = std::f32::consts::TAU;
    let gaps = found.iter().zip(expected).enumerate().map(|(i, (a, b))| match i {
        1 | 2 => ((a - b).abs()).min((turn - (a - b).abs()).abs()),
        _ => (a - b).abs(),
    });
    gaps.fold(0.0, f32::max)
}

#[test]
fn relations_are_those_of_the_original() {
    for golden in golden() {
        for (name, file) in golden.scenes() {
            let batch = Batch::new(golden.network.config(), [&file.scene()], &mut Noise::none()).unwrap();
            for (kind, own) in [
                ("pl2pl", &batch.map_edges),
                ("temporal", &batch.over_time),
                ("pl2a", &batch.from_map),
                ("a2a", &batch.among_agents),
            ] {
                let degrees = file.ints(&format!("edges.{kind}.degree"));
                let mut found = vec![0; degrees.len()];
                own.targets.iter().for_each(|t| found[*t as usize] += 1);
                assert_eq!(found, degrees, "{name} {kind}");
                let Some(expected) = file.edges(kind) else { continue };
                let (own, expected) = (sorted(own), sorted(&expected));
                assert!(own.keys().eq(expected.keys()), "{name} {kind}");
                let gap = own.iter().map(|(k, r)| relation_gap(r, expected[k])).fold(0.0, f32::max);
                assert!(gap < CLOSE, "{name} {kind}: {gap}");
            }
            let (motion, expected) = (batch.motion().as_flattened(), file.floats("rel.motion"));
            let gap = motion.chunks(2).zip(expected.chunks(2)).map(|(a, b)| {
                let turn = (a[1] - b[1]).abs();
                (a[0] - b[0]).abs().max(turn.min((std::f32::consts::TAU - turn).abs()))
            });
            assert!(gap.fold(0.0, f32::max) < CLOSE, "{name} motion");
        }
    }
}

#[test]
fn embedded_relations_are_those_of_the_original() {
    for golden in golden() {
        let [over_time, from_map, among] = golden.network.agent_encoder().relation_embeddings();
        let among_map = golden.network.map_encoder().relation_embedding();
        for (name, file) in golden.scenes() {
            for (kind, embedding) in
                [("pl2pl", among_map), ("temporal", over_time), ("pl2a", from_map), ("a2a", among)]
            {
                let Some(expected) = file.has_floats(&format!("rel.{kind}.embedded_first64")) else {
                    continue;
                };
                let Some(scalars) = file.has_floats(&format!("rel.{kind}")) else { continue };
                let width = if kind == "temporal" { 4 } else { 3 };
                let rows = expected.len() / embedding.width();
                let scalars = TensorData::new(scalars[..rows * width].to_vec(), [rows, width]);
                let found = embedding.forward(Tensor::from_data(scalars, &Device::flex()), None);
                let gap = worst(&values(found), &expected);
                assert!(gap < 1e-5, "{name} {kind}: {gap}");
            }
        }
    }
}

#[test]
fn features_and_logits_are_those_of_the_original() {
    for golden in golden() {
        for (name, file) in golden.scenes() {
            let scene = file.scene();
            let mut batch = Batch::new(golden.network.config(), [&scene], &mut Noise::none()).unwrap();
            batch.map_edges = file.edges("pl2pl").unwrap();
            let mut checked = 0;
            let mut look = |stage: Stage, x: &Tensor<2>| {
                let (stored, limit) = match stage {
                    Stage::MapInput => ("out.map.input".to_owned(), CLOSE),
                    Stage::Map(i) => (format!("out.map.layer{i}"), CLOSE),
                    Stage::Fused => ("out.agent.fused".to_owned(), 5e-5),
                    Stage::OverTime(i) => (format!("out.agent.layer{i}.temporal"), CLOSE),
                    Stage::FromMap(i) => (format!("out.agent.layer{i}.map"), CLOSE),
                    Stage::AmongAgents(i) => (format!("out.agent.layer{i}.agents"), CLOSE),
                };
                if let Some(expected) = file.has_floats(&stored) {
                    let gap = worst(&values(x.clone()), &expected);
                    assert!(gap < limit, "{name} {stored}: {gap}");
                    checked += 1;
                }
            };
            let logits =
                golden.network.forward_watched(&golden.tables, &batch, &mut Noise::none(), &mut look);
            assert!(checked > 2, "{name}");
            check_logits(&name, &file, &scene, &values(logits));
        }
    }
}

/// Checks the logits of all nodes against the stored values, at valid steps.
fn check_logits(name: &str, file: &File, scene: &Scene, logits: &[f32]) {
    let (agents, steps) = (scene.agents.len(), scene.steps.len());
    let tokens = logits.len() / agents / steps;
    let (all, some) = (file.has_floats("out.logits"), file.has_floats("out.logits_every8"));
    let second = file.has_floats("out.logits_step1");
    let (tops, top_at) = (file.floats("out.logits_top8_value"), file.ints("out.logits_top8_idx"));
    let (sums, best) = (file.floats("out.logits_logsumexp"), file.ints("out.logits_argmax"));
    let mut gap = 0.0f32;
    for node in (0..agents * steps).filter(|n| scene.steps[n % steps].valid[n / steps]) {
        let row = &logits[node * tokens..][..tokens];
        if let Some(all) = &all {
            gap = gap.max(worst(row, &all[node * tokens..][..tokens]));
        }
        if let Some(some) = &some {
            let own: Vec<f32> = row.iter().step_by(8).copied().collect();
            gap = gap.max(worst(&own, &some[node * own.len()..][..own.len()]));
        }
        if let Some(second) = second.as_ref().filter(|_| node % steps == 1) {
            gap = gap.max(worst(row, &second[node / steps * tokens..][..tokens]));
        }
        for k in node * 8..node * 8 + 8 {
            gap = gap.max((row[top_at[k]] - tops[k]).abs());
        }
        let sum: f64 = row.iter().map(|v| f64::from(*v).exp()).sum();
        gap = gap.max((sum.ln() as f32 - sums[node]).abs());
        assert_eq!(argmax(row), best[node], "{name} node {node}");
    }
    assert!(gap < CLOSE, "{name} logits: {gap}");
}

fn argmax(row: &[f32]) -> usize {
    (1..row.len()).fold(0, |best, i| if row[i] > row[best] { i } else { best })
}

#[test]
fn greedy_rollouts_take_the_same_tokens() {
    for golden in golden() {
        for (name, file) in golden.scenes() {
            roll_out(&golden, &name, &file);
        }
    }
}

fn roll_out(golden: &Golden, name: &str, file: &File) {
    let (network, tables) = (&golden.network, &golden.tables);
    let mut scene = file.scene();
    let count = scene.agents.len();
    let map = network.encode_map_with(tables, &scene.map, &file.edges("pl2pl").unwrap());
    let mut episode = network.begin(tables, map, scene.agents.clone()).unwrap();
    network.advance(tables, &mut episode, scene.steps.swap_remove(0)).unwrap();
    scene.steps.truncate(2);
    let mut step = file.scene().steps.swap_remove(1);
    let (tokens, gaps) = (file.ints("roll.token_idx"), file.floats("roll.top2_gap"));
    let (best, some) = (file.floats("roll.logits_max"), file.floats("roll.logits_every8"));
    let (positions, headings) = (file.pairs("roll.pos_10hz"), file.floats("roll.head_10hz"));
    let steps = tokens.len() / count;
    let mut smallest = f32::INFINITY;
    for t in 0..steps {
        let logits = values(network.step(tables, &mut episode, step.clone()).unwrap());
        let width = logits.len() / count;
        let mut next = step.clone();
        for a in 0..count {
            let row = &logits[a * width..][..width];
            let token = argmax(row);
            let at = a * steps + t;
            // The original's own 32 and 64-bit runs agree on every token, however close the second one is.
            assert_eq!(token, tokens[at], "{name} agent {a} step {t}, gap {}", gaps[at]);
            smallest = smallest.min(gaps[at]);
            assert!((row[token] - best[at]).abs() < 1e-3, "{name} agent {a} step {t}");
            let own: Vec<f32> = row.iter().step_by(8).copied().collect();
            assert!(worst(&own, &some[at * own.len()..][..own.len()]) < 2e-3, "{name} agent {a} step {t}");
            if t == 0
                && let Some(first) = file.has_floats("roll.logits_step0")
            {
                assert!(worst(row, &first[a * width..][..width]) < CLOSE, "{name} agent {a}");
            }
            let class = usize::from(scene.agents.class[a]);
            let (sin, cos) = step.heading[a].sin_cos();
            for (k, contour) in golden.corners[class][token].iter().enumerate().skip(1) {
                let [x, y] = step.position[a];
                let world = contour.map(|[u, v]| [x + u * cos - v * sin, y + u * sin + v * cos]);
                let middle = [0, 1].map(|d| world.iter().map(|c| c[d]).sum::<f32>() / 4.0);
                let heading = (world[0][1] - world[3][1]).atan2(world[0][0] - world[3][0]);
                let frame = a * steps * 5 + t * 5 + k - 1;
                assert!(worst(&middle, &positions[frame]) < 1e-3, "{name} agent {a} step {t}");
                let turn = (heading - headings[frame]).abs();
                assert!(turn.min((std::f32::consts::TAU - turn).abs()) < 1e-3, "{name} agent {a} step {t}");
                (next.position[a], next.heading[a]) = (middle, heading);
            }
            next.token[a] = token as u32;
        }
        step = next;
    }
    assert!(smallest < 0.1, "{name}: some choices are close");
}

/// Without the stored relations, angles at the cut at ±π fall on other sides: single logits change, most do
/// not.
#[test]
fn positions_alone_nearly_suffice() {
    for golden in golden() {
        for (name, file) in golden.scenes() {
            let scene = file.scene();
            let batch = Batch::new(golden.network.config(), [&scene], &mut Noise::none()).unwrap();
            let logits = values(golden.network.forward(&golden.tables, &batch, &mut Noise::none()));
            let steps = scene.steps.len();
            let width = logits.len() / batch.nodes();
            let (stored, stride) = match file.has_floats("out.logits") {
                Some(all) => (all, 1),
                None => (file.floats("out.logits_every8"), 8),
            };
            let best = file.ints("out.logits_argmax");
            let (mut squares, mut count, mut others) = (0.0f64, 0usize, 0usize);
            for node in (0..batch.nodes()).filter(|n| scene.steps[n % steps].valid[n / steps]) {
                let row = &logits[node * width..][..width];
                others += usize::from(argmax(row) != best[node]);
                let own: Vec<f32> = row.iter().step_by(stride).copied().collect();
                squares += own
                    .iter()
                    .zip(&stored[node * own.len()..])
                    .map(|(a, b)| f64::from(a - b).powi(2))
                    .sum::<f64>();
                count += own.len();
            }
            let rms = (squares / count as f64).sqrt();
            assert!(rms < 0.02, "{name}: {rms}");
            assert!(others <= 6, "{name}: {others} other choices");
        }
    }
}
