//! Vocabularies: search, files, and the kinematic one.

use std::collections::HashMap;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use reactsim::dynamics::Pose;
use reactsim::geometry::Vec2;
use reactsim::models::learning::Provenance;
use reactsim::models::nn::{WeightsError, device};
use reactsim::models::ntp::reactive::Policy;
use reactsim::models::ntp::tokens::{Kinematic, ORIGIN, TokenPoses, Vocabulary, motion_between, moved};
use reactsim::models::perception::Class;
use safetensors::Dtype;
use safetensors::tensor::TensorView;

fn pose(x: f64, y: f64, heading: f64) -> Pose {
    Pose { position: Vec2::new(x, y), heading }
}

pub(super) fn kinematic() -> Vocabulary {
    Kinematic::default().build().unwrap()
}

/// Searches exhaustively; returns tokens by distance, then index.
fn brute_force(vocabulary: &Vocabulary, class: Class, motion: Pose) -> Vec<(usize, f64)> {
    let distance = |t| vocabulary.distance(class, t, motion);
    let mut all: Vec<_> = (0..vocabulary.tokens(class)).map(|t| (t, distance(t))).collect();
    all.sort_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)));
    all
}

#[test]
fn the_search_finds_what_comparing_all_finds() {
    let vocabulary = kinematic();
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    for class in Class::ALL {
        for i in 0..400 {
            let motion = match i % 4 {
                // Among dense tokens, anywhere, far away, and on a token.
                0 => pose(
                    rng.random_range(-0.3..0.3),
                    rng.random_range(-0.1..0.1),
                    rng.random_range(-3.2..3.2),
                ),
                1 => pose(
                    rng.random_range(-2.0..18.0),
                    rng.random_range(-2.0..2.0),
                    rng.random_range(-1.0..1.0),
                ),
                2 => pose(
                    rng.random_range(-1e4..1e4),
                    rng.random_range(-1e4..1e4),
                    rng.random_range(-9.0..9.0),
                ),
                _ => vocabulary.end(class, rng.random_range(0..vocabulary.tokens(class))),
            };
            let all = brute_force(&vocabulary, class, motion);
            assert_eq!(vocabulary.nearest_with_distance(class, motion), all[0], "{class} {motion:?}");
            for k in [1, 5, 64] {
                assert_eq!(vocabulary.nearest_k(class, motion, k), all[..k], "{class} {motion:?}");
            }
        }
        assert_eq!(vocabulary.nearest_k(class, ORIGIN, 10_000).len(), vocabulary.tokens(class));
        assert!(vocabulary.nearest_k(class, ORIGIN, 0).is_empty());
        let nowhere = pose(f64::NAN, 0.0, 0.0);
        assert_eq!(vocabulary.nearest_with_distance(class, nowhere), (0, f64::INFINITY));
    }
}

#[test]
fn of_equal_tokens_the_first_is_the_nearest() {
    let ahead = |x: f64| [0.0, 0.2, 0.4, 0.6, 0.8, 1.0].map(|u| pose(u * x, 0.0, 0.0));
    let tokens = vec![ahead(2.0), ahead(1.0), ahead(1.0), ahead(3.0), ahead(1.0)];
    let vocabulary =
        Vocabulary::new([tokens.clone(), tokens.clone(), tokens], Provenance::default()).unwrap();
    assert_eq!(vocabulary.nearest(Class::Vehicle, pose(1.0, 0.0, 0.0)), 1);
    assert_eq!(vocabulary.nearest(Class::Cyclist, pose(2.5, 0.0, 0.0)), 0);
    let three: Vec<usize> =
        vocabulary.nearest_k(Class::Vehicle, pose(1.0, 0.0, 0.0), 3).into_iter().map(|t| t.0).collect();
    assert_eq!(three, [1, 2, 4]);
}

#[test]
fn motions_lead_back() {
    let (a, b) = (pose(3.0, -2.0, 2.5), pose(-1.0, 4.0, -3.0));
    let there = moved(a, motion_between(a, b));
    assert!((there.position - b.position).norm() < 1e-12 && (there.heading - b.heading).abs() < 1e-12);
    assert_eq!(moved(a, ORIGIN), a);
    assert_eq!(moved(ORIGIN, b), b);
}

/// Returns whether a class has the mirror image of each of its tokens.
pub(super) fn is_symmetric(vocabulary: &Vocabulary, class: Class) -> bool {
    let tokens: Vec<&TokenPoses> =
        (0..vocabulary.tokens(class)).map(|t| vocabulary.poses(class, t)).collect();
    tokens.iter().all(|poses| {
        let mirrored = poses.map(|p| pose(p.position.x, -p.position.y, -p.heading));
        tokens.contains(&&mirrored)
    })
}

#[test]
fn the_kinematic_vocabulary_is_symmetric_feasible_and_stands_still() {
    let vocabulary = kinematic();
    let counts = Class::ALL.map(|c| vocabulary.tokens(c));
    assert!((900..=1024).contains(&counts[0]), "{counts:?}");
    assert!(counts[1] <= 1024 && counts[2] <= 1024, "{counts:?}");
    for class in Class::ALL {
        assert!(is_symmetric(&vocabulary, class), "{class}");
        assert_eq!(*vocabulary.poses(class, 0), [ORIGIN; 6]);
        assert_eq!(vocabulary.nearest(class, ORIGIN), 0);
    }
    for class in [Class::Vehicle, Class::Cyclist] {
        for t in 0..vocabulary.tokens(class) {
            let poses = vocabulary.poses(class, t);
            let steps: Vec<f64> = poses.windows(2).map(|w| (w[1].position - w[0].position).norm()).collect();
            let (least, most) =
                (steps.iter().copied().fold(9.0, f64::min), steps.iter().copied().fold(0.0, f64::max));
            assert!((most - least) / 0.01 < 0.1, "token {t} changes its speed: {steps:?}");
        }
    }
}

#[test]
fn a_file_holds_the_vocabulary_whole() {
    let vocabulary = kinematic();
    let bytes = vocabulary.write().unwrap();
    assert_eq!(bytes, vocabulary.write().unwrap());
    let read = Vocabulary::read(&bytes).unwrap();
    assert_eq!(read, vocabulary);
    assert_eq!(read.provenance().method, "kinematic");
    assert_eq!(read.write().unwrap(), bytes);
}

#[test]
fn foreign_files_are_read() {
    let Some(folder) = crate::shared("data/weights") else { return };
    let read = |path: &str| {
        let path = folder.join("..").join(path);
        Vocabulary::read(&std::fs::read(path).unwrap()).unwrap()
    };
    let smart = read("weights/smart_agent_vocab.safetensors");
    assert_eq!(Class::ALL.map(|c| smart.tokens(c)), [2048; 3]);
    let catk = read("weights/catk_agent_vocab_555_s2.safetensors");
    let contours = read("smart_golden/vocab.safetensors");
    for class in Class::ALL {
        for t in 0..2048 {
            for (a, b) in catk.poses(class, t).iter().zip(contours.poses(class, t)) {
                assert!((a.position - b.position).norm() < 1e-4, "{class} {t}: {a:?} {b:?}");
                assert!((a.heading - b.heading).abs() < 1e-4, "{class} {t}: {a:?} {b:?}");
            }
        }
    }
}

/// Returns a file of constant tensors: name, type, shape.
fn file(tensors: &[(&str, Dtype, &[usize])], value: f32) -> Vec<u8> {
    let data: Vec<Vec<u8>> = tensors
        .iter()
        .map(|(_, dtype, shape)| {
            let n = shape.iter().product::<usize>();
            match dtype {
                Dtype::F32 => (0..n).flat_map(|_| value.to_le_bytes()).collect(),
                _ => vec![0; n * dtype.bitsize() / 8],
            }
        })
        .collect();
    let views: Vec<_> = tensors
        .iter()
        .zip(&data)
        .map(|((name, dtype, shape), data)| (*name, TensorView::new(*dtype, shape.to_vec(), data).unwrap()))
        .collect();
    let made = serde_json::to_string(&Provenance::default()).unwrap();
    safetensors::serialize(views, Some(HashMap::from([("reactsim.vocabulary".to_owned(), made)]))).unwrap()
}

#[test]
fn vocabularies_are_read_from_the_weights_of_networks() {
    let weights = crate::ntp_reactive::untrained();
    let policy = Policy::read(&weights, &device()).unwrap();
    assert_eq!(Vocabulary::read(&weights).unwrap(), policy.vocabulary);
    assert_eq!(Vocabulary::read(&policy.vocabulary.write().unwrap()).unwrap(), policy.vocabulary);
    assert!(Vocabulary::read(&weights[..100]).is_err());
}

#[test]
fn what_is_no_vocabulary_is_refused_by_name() {
    let f = Dtype::F32;
    let own = |dtype, shape: &[usize], value| {
        let names = ["vocabulary.vehicle", "vocabulary.pedestrian", "vocabulary.cyclist"];
        Vocabulary::read(&file(&names.map(|n| (n, dtype, shape)), value)).map(|_| ())
    };
    let error = |result: Result<(), WeightsError>| result.unwrap_err().to_string();
    assert!(own(f, &[2, 6, 3], 0.0).is_ok());
    insta::assert_snapshot!(error(own(f, &[0, 6, 3], 0.0)), @"class `vehicle` has no tokens; every class needs at least one");
    insta::assert_snapshot!(error(own(f, &[2, 5, 3], 0.0)), @"tensor `vocabulary.vehicle` has the shape [2, 5, 3], expected [tokens, 6, 3]");
    insta::assert_snapshot!(error(own(f, &[36], 0.0)), @"tensor `vocabulary.vehicle` has the shape [36], expected [tokens, 6, 3]");
    insta::assert_snapshot!(error(own(Dtype::F64, &[2, 6, 3], 0.0)), @"tensor `vocabulary.vehicle` holds F64, expected F32: convert it when exporting");
    insta::assert_snapshot!(error(own(f, &[2, 6, 3], f32::NAN)), @"tensor `vocabulary.vehicle` holds NaN at 0: the weights are damaged, or training diverged");
    insta::assert_snapshot!(error(own(f, &[2, 6, 3], 0.5)), @"class `vehicle`, token 0 starts at [0.5, 0.5, 0.5] (x, y, heading), expected 0, 0, 0: poses are in the frame of the first one");
    let shape: &[usize] = &[1, 6, 3];
    let two = file(&[("vocabulary.vehicle", f, shape), ("vocabulary.cyclist", f, shape)], 0.0);
    insta::assert_snapshot!(error(Vocabulary::read(&two).map(|_| ())), @"the file holds no vocabulary: expected the tensors `vocabulary.vehicle`, `vocabulary.pedestrian`, `vocabulary.cyclist`, found `vocabulary.cyclist`, `vocabulary.vehicle`; `reactsim train vocabulary` makes vocabularies");
    let four = ["vocabulary.vehicle", "vocabulary.pedestrian", "vocabulary.cyclist", "vocabulary.horse"];
    let four = Vocabulary::read(&file(&four.map(|n| (n, f, shape)), 0.0)).map(|_| ());
    assert!(error(four).starts_with("the file holds no vocabulary: "));
    let whole = kinematic().write().unwrap();
    for cut in [0, 7, 100, whole.len() - 1] {
        let cut_short = error(Vocabulary::read(&whole[..cut]).map(|_| ()));
        assert!(cut_short.starts_with("the file is cut short or not safetensors "), "{cut}");
    }
}
