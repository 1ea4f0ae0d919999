//! The published network as a simulator: its file, its view of an episode, its memory.

use std::collections::BTreeMap;

use burn::module::{Module, ModuleMapper, Param};
use burn::tensor::{Device, Tensor};
use reactsim::dynamics::Pose;
use reactsim::geometry::Vec2;
use reactsim::models::nn::{Initializer, Noise, device};
use reactsim::models::ntp::Sampling;
use reactsim::models::ntp::smart::{
    Agents, Batch, MapTokens, Scene, Smart, SmartConfig, SmartParameters, SmartPolicy, SmartSimulator, Step,
};
use reactsim::models::ntp::tokens::{
    ArcGrid, Band, Kinematic, MapVocabulary, PolarGrid, PreparedTrack, TOKEN_FRAMES, Vocabulary,
    curve_pieces, fill_gaps, moved, token_of_motion,
};
use reactsim::models::{WeightsFile, find};
use reactsim::rollout::{Controller, Rollout, Settings, roll_out};
use reactsim::scene::{CURRENT, FRAMES, Frame, HISTORY, Scenario};
use serde_json::Value;

use crate::networks::values;
use crate::ntp_reactive::scenarios;
use crate::scenes::{coasting, real, request};
use reactsim::models::learning::Provenance;
use reactsim::models::perception::Class;

/// Returns settings with few tokens of every class.
pub(crate) fn coarse() -> Kinematic {
    let all = Kinematic::default();
    let band = |to, step, turns| Band { to, step, turns };
    Kinematic {
        vehicle: ArcGrid { bands: vec![band(20.0, 2.0, 3)], reverse: Vec::new(), ..all.vehicle },
        pedestrian: PolarGrid {
            bands: vec![band(2.0, 0.5, 8)],
            walking_turns: vec![0.3],
            standing_turns: vec![0.8],
        },
        cyclist: ArcGrid { bands: vec![band(8.0, 1.0, 3)], ..all.cyclist },
    }
}

/// Returns arcs of 5 m.
fn arcs() -> MapVocabulary {
    let arc = |i: i32| {
        std::array::from_fn(|k| Vec2::new(0.5 * k as f64, 0.01 * f64::from(i) * (0.5 * k as f64).powi(2)))
    };
    MapVocabulary::new(&(-2..=2).map(arc).collect::<Vec<_>>(), Provenance::default()).unwrap()
}

/// Multiplies weights, so that differences in the input matter.
struct Loud(f32);

impl ModuleMapper for Loud {
    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        param.map(|old| old * self.0)
    }
}

pub(crate) fn policy(device: &Device) -> SmartPolicy {
    let vocabulary = coarse().build().unwrap();
    let [veh, ped, cyc] = Class::ALL.map(|c| vocabulary.tokens(c));
    let config = format!(
        r#"{{"hidden_dim": 16, "num_freq_bands": 4, "num_heads": 2, "head_dim": 4, "dropout": 0.1, "num_map_layers": 1,
        "num_agent_layers": 2, "pl2pl_radius": 6, "pl2a_radius": 12, "a2a_radius": 30, "time_span": 15, "n_token_map": 5,
        "mlp_embedding_first_width": 16, "n_token_agent": {{"veh": {veh}, "ped": {ped}, "cyc": {cyc}}}}}"#
    );
    let config = SmartConfig::from_json(&config).unwrap();
    let network = Smart::init(&config, &mut Initializer::new(5, device)).unwrap().map(&mut Loud(2.0));
    SmartPolicy::new(network, vocabulary, arcs(), device).unwrap()
}

pub(crate) fn untrained() -> Vec<u8> {
    policy(&device()).write(&BTreeMap::new()).unwrap()
}

fn greedy(projection: bool) -> SmartParameters {
    let sampling = Sampling { top_k: 1, temperature: 1.0 };
    SmartParameters { projection, map_radius: 60.0, height: 1.8, sampling }
}

fn controller(parameters: SmartParameters) -> Controller {
    Controller::Fair(Box::new(SmartSimulator::new("smart", policy(&device()), parameters)))
}

fn run(controller: &Controller, batch: &[&Scenario]) -> Vec<Rollout> {
    let requests = batch.iter().map(|s| request(s, coasting(s), 0)).collect();
    roll_out(requests, controller, &Settings::default()).into_iter().map(Result::unwrap).collect()
}

/// Returns the bytes with another header.
fn edited(bytes: &[u8], edit: impl Fn(&mut serde_json::Map<String, Value>)) -> Vec<u8> {
    let length = 8 + u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
    let mut header: serde_json::Map<String, Value> = serde_json::from_slice(&bytes[8..length]).unwrap();
    edit(&mut header);
    let mut text = Value::Object(header).to_string().into_bytes();
    text.resize(text.len().next_multiple_of(8), b' ');
    [&(text.len() as u64).to_le_bytes(), text.as_slice(), &bytes[length..]].concat()
}

#[test]
fn a_file_gives_the_same_policy_and_what_is_none_is_refused_by_name() {
    let device = device();
    let good = untrained();
    assert_eq!(SmartPolicy::read(&good, &device).unwrap().write(&BTreeMap::new()).unwrap(), good);

    let refusal = |bytes: &[u8], part: &str| {
        let text = SmartPolicy::read(bytes, &device).unwrap_err().to_string();
        assert!(text.contains(part), "{part}: {text}");
    };
    refusal(&good[..good.len() - 8], "cut short");
    refusal(b"", "cut short");
    refusal(&crate::ntp_reactive::untrained(), "kind `reactive`, expected `smart`");
    let config = |from: &'static str, to: &'static str| {
        edited(&good, move |header| {
            let text = header["__metadata__"]["config"].as_str().unwrap();
            assert!(text.contains(from), "{text}");
            header["__metadata__"]["config"] = text.replace(from, to).into();
        })
    };
    refusal(&config("\"n_token_map\":5", "\"n_token_map\":6"), "5 tokens of the map, expected 6");
    refusal(&config("\"ped\":", "\"ped\":1"), "tokens of pedestrians, expected 1");
    refusal(
        &config("\"shift_frames\":5", "\"shift_frames\":2"),
        "`shift_frames` of the network's configuration is 2",
    );
    refusal(&config("\"num_heads\":2", "\"num_heads\":0"), "`num_heads`");
    refusal(&config("\"num_agent_layers\":2", "\"num_agent_layers\":1"), "has no place in the network");
    refusal(&config("\"num_agent_layers\":2", "\"num_agent_layers\":3"), "layers.2");
    refusal(&config("\"hidden_dim\":16,", ""), "hidden_dim");
    let renamed = |from: &'static str, to: &'static str| {
        edited(&good, move |header| {
            let entry = header.remove(from).unwrap();
            header.insert(to.to_owned(), entry);
        })
    };
    refusal(
        &renamed("agent_encoder.type_a_emb.weight", "other"),
        "`agent_encoder.type_a_emb.weight` is missing",
    );
    refusal(
        &renamed("map_vocabulary.curves", "map_vocabulary.x"),
        "expected the tensors `map_vocabulary.curves`",
    );
    refusal(&renamed("vocabulary.vehicle", "vocabulary.car"), "`vocabulary.vehicle`");
    let shaped = |name: &'static str, shape: &'static [usize]| {
        edited(&good, move |header| header[name]["shape"] = serde_json::json!(shape))
    };
    refusal(&shaped("agent_encoder.type_a_emb.weight", &[16, 3]), "is [16, 3], expected [3, 16]");
    refusal(&shaped("map_vocabulary.curves", &[11, 5, 2]), "expected [tokens, 11, 2]");
    // Tokens of two poses.
    let tokens = coarse().build().unwrap().tokens(Class::Vehicle);
    let two =
        edited(&good, |header| header["vocabulary.vehicle"]["shape"] = serde_json::json!([tokens * 3, 2, 3]));
    refusal(&two, "expected [tokens, 6, 3]");
    let header = 8 + u64::from_le_bytes(good[..8].try_into().unwrap()) as usize;
    for (at, part) in [(header, "agent_encoder.a2a"), (good.len() - 4, "vocabulary.vehicle")] {
        let mut bytes = good.clone();
        bytes[at..at + 4].copy_from_slice(&f32::NAN.to_le_bytes());
        refusal(&bytes, part);
    }
}

/// Returns the scene of a rollout, computed from its tracks: the agents, and the steps up to frame 85.
fn told(policy: &SmartPolicy, scenario: &Scenario, tracks: &[Vec<Frame>], radius: f64) -> Scene {
    let start = &scenario.start;
    let mut map = MapTokens::default();
    for piece in curve_pieces(start) {
        if (piece.start() - start.now(0).position()).norm() < radius {
            map.position.push([piece.start().x as f32, piece.start().y as f32]);
            map.orientation.push(piece.heading() as f32);
            map.token.push(policy.map_vocabulary.nearest(&piece) as u32);
            map.kind.push(piece.kind.code() as u8);
            map.polygon.push(piece.kind.line_code() as u8);
            map.light.push(piece.light.code() as u8);
        }
    }
    let class = |a: usize| Class::of(start.agents[a].kind).unwrap();
    let agents: Vec<usize> = (0..start.agents.len()).collect();
    let prepared: Vec<PreparedTrack> = agents
        .iter()
        .map(|&a| {
            let mut track = tracks[a][..HISTORY].to_vec();
            fill_gaps(&mut track);
            PreparedTrack::new(&track)
        })
        .collect();
    let steps = (TOKEN_FRAMES..FRAMES - 1).step_by(TOKEN_FRAMES).map(|frame| {
        let mut step = Step::default();
        for &a in &agents {
            let pose = |f: usize| {
                if f <= CURRENT {
                    return prepared[a].pose(f);
                }
                tracks[a][f].map(|s| Pose { position: s.position(), heading: s.heading })
            };
            let (from, to) = (pose(frame - TOKEN_FRAMES), pose(frame).unwrap());
            let rolling = prepared[a].nearest_tokens(&policy.vocabulary, class(a));
            let (pose, token) = match from {
                Some(_) if frame <= CURRENT => {
                    let step = frame / TOKEN_FRAMES - 1;
                    (rolling.poses[step], rolling.tokens[step])
                }
                Some(from) => (to, token_of_motion(&policy.vocabulary, class(a), from, to).0),
                None => (to, 0),
            };
            step.position.push([pose.position.x as f32, pose.position.y as f32]);
            step.heading.push(pose.heading as f32);
            step.valid.push(from.is_some());
            step.token.push(token as u32);
        }
        step
    });
    Scene {
        map,
        steps: steps.collect(),
        agents: Agents {
            class: agents.iter().map(|&a| class(a).index() as u8).collect(),
            shape: start.agents.iter().map(|a| [a.length as f32, a.width as f32, 1.8]).collect(),
        },
    }
}

/// The network sees the motion as driven: with the projection, vehicles do not end where their tokens do.
#[test]
fn what_is_kept_is_what_one_look_at_the_whole_rollout_gives() {
    let device = device();
    let policy = policy(&device);
    let (mut checked, mut chosen) = (0, std::collections::BTreeSet::new());
    for scenario in &scenarios(3) {
        for projection in [true, false] {
            let parameters = greedy(projection);
            let rollout = run(&controller(parameters), &[scenario]).remove(0);
            let scene = told(&policy, scenario, &rollout.tracks, parameters.map_radius);
            let batch = Batch::new(policy.network.config(), [&scene], &mut Noise::none()).unwrap();
            let logits = policy.network.forward(&policy.tables, &batch, &mut Noise::none());
            let (width, steps) = (logits.dims()[1], scene.steps.len());
            let logits = values(logits);
            for a in 1..scene.agents.len() {
                let class = Class::ALL[usize::from(scene.agents.class[a])];
                if projection && class == Class::Vehicle {
                    continue;
                }
                // From the step at the current frame on, which is the second one.
                for t in 1..steps {
                    let own = &logits[(a * steps + t) * width..][..policy.vocabulary.tokens(class)];
                    let best = (1..own.len()).fold(0, |b, i| if own[i] > own[b] { i } else { b });
                    let second =
                        (0..own.len()).filter(|i| *i != best).map(|i| own[i]).fold(f32::MIN, f32::max);
                    if own[best] - second < 1e-3 {
                        continue;
                    }
                    let frame = (t + 1) * TOKEN_FRAMES;
                    let (from, to) =
                        (rollout.tracks[a][frame].unwrap(), rollout.tracks[a][frame + 5].unwrap());
                    let from = Pose { position: from.position(), heading: from.heading };
                    let end = moved(from, policy.vocabulary.end(class, best));
                    assert!((end.position - to.position()).norm() < 1e-6, "{} {a} {frame}", scenario.id);
                    checked += 1;
                    chosen.insert((class, best));
                }
            }
        }
    }
    assert!(checked > 300 && chosen.len() > 4, "{checked} {chosen:?}");
}

#[test]
fn weights_of_others_drive_recorded_scenes() {
    let Some(folder) = crate::shared("data/smart_golden") else { return };
    let read = |name: &str| std::fs::read(folder.join(name)).unwrap();
    let (device, vocabularies) = (device(), read("vocab.safetensors"));
    let config = SmartConfig::from_json(&String::from_utf8(read("A_nano/config.json")).unwrap()).unwrap();
    let network = Smart::load(&config, &read("A_nano/weights.safetensors"), &device).unwrap();
    let vocabulary = Vocabulary::read(&vocabularies).unwrap();
    let map_vocabulary = MapVocabulary::read(&vocabularies).unwrap();
    let policy = SmartPolicy::new(network, vocabulary, map_vocabulary, &device).unwrap();
    let file = WeightsFile::new("golden.safetensors", policy.write(&BTreeMap::new()).unwrap());
    let scenarios = real(2);
    for id in ["smart", "smart-projected"] {
        let mut setup = find(id).unwrap().setup().unwrap();
        setup.weights = Some(file.clone());
        let controller = (find(id).unwrap().make)(setup).unwrap();
        for scenario in &scenarios {
            let rollout = run(&controller, &[scenario]).remove(0);
            assert!(rollout.outcomes.is_empty(), "{id}: {:?}", rollout.outcomes);
            for track in &rollout.tracks {
                assert!(track[CURRENT..].iter().all(|s| s.is_some_and(|s| s.is_finite())), "{}", scenario.id);
            }
        }
    }
}
