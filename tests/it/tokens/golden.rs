//! Tokens of recorded tracks and of the map, as CATK's own code found them.

use std::path::Path;

use reactsim::geometry::{Vec2, wrap};
use reactsim::models::ntp::tokens::{
    CurvePiece, MapVocabulary, PreparedTrack, TOKEN_FRAMES, TOKEN_STEPS, Vocabulary, curve_pieces,
};
use reactsim::models::perception::Class;
use reactsim::scene::{AgentState, CURRENT, FRAMES, Frame};
use safetensors::SafeTensors;

const SCENES: [&str; 3] = ["1f27be97d892e8ac", "7a17b9e1b2ba281e", "776b950752587100"];

/// Returns the values of a tensor of 32-bit numbers, or of bytes.
fn values(file: &SafeTensors<'_>, name: &str) -> Vec<f64> {
    let tensor = file.tensor(name).unwrap();
    let words = tensor.data().chunks_exact(4).map(|b| <[u8; 4]>::try_from(b).unwrap());
    match tensor.dtype() {
        safetensors::Dtype::F32 => words.map(|b| f64::from(f32::from_le_bytes(b))).collect(),
        safetensors::Dtype::I32 => words.map(|b| f64::from(i32::from_le_bytes(b))).collect(),
        safetensors::Dtype::U8 => tensor.data().iter().map(|b| f64::from(*b)).collect(),
        other => panic!("{name}: {other:?}"),
    }
}

fn point(values: &[f64], i: usize) -> Vec2 {
    Vec2::new(values[2 * i], values[2 * i + 1])
}

fn scene(folder: &Path, id: &str) -> Vec<u8> {
    std::fs::read(folder.join(format!("A_nano/scene_{id}.safetensors"))).unwrap()
}

#[test]
fn tracks_become_the_same_tokens() {
    let Some(folder) = crate::shared("data/smart_golden") else { return };
    let vocabulary = Vocabulary::read(&std::fs::read(folder.join("vocab.safetensors")).unwrap()).unwrap();
    let mut compared = 0;
    for id in SCENES {
        let bytes = scene(&folder, id);
        let file = SafeTensors::deserialize(&bytes).unwrap();
        let get = |name: &str| values(&file, name);
        let (valid, position, heading, velocity) =
            (get("raw.valid"), get("raw.position"), get("raw.heading"), get("raw.velocity"));
        let (tokens, at, toward, token_valid) = (
            get("in.agent.token_idx"),
            get("in.agent.position"),
            get("in.agent.heading"),
            get("in.agent.valid"),
        );
        let (raw_at, raw_toward, raw_valid) =
            (get("aux.gt_pos_raw"), get("aux.gt_head_raw"), get("aux.gt_valid_raw"));
        for (agent, kind) in get("in.agent.type").into_iter().enumerate() {
            let class = Class::ALL[kind as usize];
            let frame = |f: usize| -> Frame {
                let i = agent * FRAMES + f;
                let (p, v) = (point(&position, i), point(&velocity, i));
                (valid[i] > 0.0).then_some(AgentState {
                    x: p.x,
                    y: p.y,
                    heading: heading[i],
                    vx: v.x,
                    vy: v.y,
                })
            };
            let track = PreparedTrack::new(&(0..FRAMES).map(frame).collect::<Vec<_>>());
            let found = track.nearest_tokens(&vocabulary, class);
            for step in 0..TOKEN_STEPS {
                let i = agent * TOKEN_STEPS + step;
                let place = format!("{id}, agent {agent}, step {step}");
                let recorded = track.pose((step + 1) * TOKEN_FRAMES);
                assert_eq!(recorded.is_some(), raw_valid[i] > 0.0, "{place}");
                if let Some(pose) = recorded {
                    assert!((pose.position - point(&raw_at, i)).norm() < 1e-3, "{place}");
                    assert!(wrap(pose.heading - raw_toward[i]).abs() < 1e-4, "{place}");
                }
                assert_eq!(found.valid[step], token_valid[i] > 0.0, "{place}");
                if !found.valid[step] {
                    continue;
                }
                compared += 1;
                assert_eq!(found.tokens[step], tokens[i] as usize, "{place}");
                assert!((found.poses[step].position - point(&at, i)).norm() < 1e-3, "{place}");
                assert!(wrap(found.poses[step].heading - toward[i]).abs() < 1e-4, "{place}");
            }
        }
    }
    assert_eq!(compared, 239 + 248 + 467);
}

#[test]
fn pieces_of_the_map_become_the_same_tokens() {
    let Some(folder) = crate::shared("data/smart_golden") else { return };
    let vocabulary = MapVocabulary::read(&std::fs::read(folder.join("vocab.safetensors")).unwrap()).unwrap();
    for id in SCENES {
        let bytes = scene(&folder, id);
        let file = SafeTensors::deserialize(&bytes).unwrap();
        let points = values(&file, "raw.map_piece_points");
        let headings = values(&file, "raw.map_piece_heading");
        for (i, token) in values(&file, "in.map.token_idx").into_iter().enumerate() {
            let samples = [0, 1, 2].map(|k| point(&points, 3 * i + k));
            assert_eq!(vocabulary.nearest_to(samples, headings[i]), token as usize, "{id}, piece {i}");
        }
    }
}

/// Returns by how much a token fits a piece worse than the nearest one does, metres. Tokens of nearly
/// straight pieces hardly differ, and the first half metre, by which they are turned, is known to half a
/// millimetre only.
fn misses(vocabulary: &MapVocabulary, piece: &CurvePiece, token: usize) -> f64 {
    let own = piece.curve();
    let far = |token: usize| {
        let curve = vocabulary.curve(token);
        [0, 5, 10].map(|i| (curve[i] - own[i]).norm_squared()).iter().sum::<f64>().sqrt()
    };
    far(token) - far(vocabulary.nearest(piece))
}

#[test]
fn the_map_is_cut_into_the_same_pieces() {
    let (Some(folder), Some(recorded)) =
        (crate::shared("data/smart_golden"), crate::shared("data/womd/train"))
    else {
        return;
    };
    let vocabulary = MapVocabulary::read(&std::fs::read(folder.join("vocab.safetensors")).unwrap()).unwrap();
    let id = "7a17b9e1b2ba281e";
    let mut scenarios = reactsim::formats::open(&recorded).unwrap().filter_map(Result::ok);
    let scenario = scenarios.find(|s| s.id == id).unwrap();
    let ours = curve_pieces(&scenario.start);
    let bytes = scene(&folder, id);
    let file = SafeTensors::deserialize(&bytes).unwrap();
    let get = |name: &str| values(&file, name);
    let (points, headings, tokens) =
        (get("raw.map_piece_points"), get("raw.map_piece_heading"), get("in.map.token_idx"));
    let (kinds, lines, lights) = (get("in.map.type"), get("in.map.polygon_type"), get("in.map.light_type"));
    // Positions are known to half a millimetre, which adds up along a line. Their origin is the AV's position
    // to a millimetre or two, and the AV is their first agent.
    let av = point(&get("raw.position"), CURRENT);
    assert!(get("in.agent.ego_mask")[0] > 0.0 && av.norm() < 0.01);
    let mut missing = Vec::new();
    for i in 0..headings.len() {
        let samples = [0, 1, 2].map(|k| point(&points, 3 * i + k) - av);
        let same = |(a, b): (&Vec2, &Vec2)| (a - b).norm() < 5e-3;
        let found = ours.iter().any(|piece| {
            piece.samples().iter().zip(&samples).all(same)
                && wrap(piece.heading() - headings[i]).abs() < 1e-2
                && piece.kind.code() == kinds[i] as usize
                && piece.kind.line_code() == lines[i] as usize
                && piece.light.code() == lights[i] as usize
                && misses(&vocabulary, piece, tokens[i] as usize) < 0.02
        });
        if !found {
            let near = ours.iter().filter(|p| p.samples().iter().zip(&samples).all(same));
            let near: Vec<_> = near.map(|p| (p.kind, p.light, vocabulary.nearest(p))).collect();
            missing.push(format!(
                "{i}: {samples:?} kind {} light {} token {}; at the place: {near:?}",
                kinds[i], lights[i], tokens[i]
            ));
        }
    }
    assert!(missing.is_empty(), "{} of {}:\n{}", missing.len(), headings.len(), missing.join("\n"));
}
