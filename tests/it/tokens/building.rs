//! Vocabularies built from generated scenarios.

use std::sync::OnceLock;

use reactsim::dynamics::Pose;
use reactsim::formats;
use reactsim::generation::{GenerationSettings, Generator, Preset};
use reactsim::geometry::Vec2;
use reactsim::models::ntp::tokens::{
    BuildError, KDisks, Kinematic, MapVocabulary, MapVocabularyBuilder, MatchingErrors, ORIGIN, Segments,
    TokenPoses, Tokenizer, TrajTok, Vocabulary, curve_pieces,
};
use reactsim::scene::Scenario;

use super::vocabulary::is_symmetric;
use crate::shared;
use reactsim::models::perception::Class;

/// Returns a few generated logs.
pub(super) fn scenarios() -> &'static [Scenario] {
    static MADE: OnceLock<Vec<Scenario>> = OnceLock::new();
    MADE.get_or_init(|| {
        let settings = GenerationSettings { preset: Preset::Train, seed: 5, ..GenerationSettings::default() };
        let generator = Generator::new(settings).unwrap();
        (0..12).map(|n| generator.scenario(n).unwrap()).collect()
    })
}

fn segments() -> &'static Segments {
    static MADE: OnceLock<Segments> = OnceLock::new();
    MADE.get_or_init(|| {
        let mut segments = Segments::new(50_000, 1);
        scenarios().iter().for_each(|s| segments.add(s));
        segments
    })
}

fn errors(vocabulary: &Vocabulary) -> MatchingErrors {
    let mut errors = MatchingErrors::default();
    scenarios().iter().for_each(|s| errors.add(vocabulary, s));
    errors
}

#[test]
fn k_disks_follow_the_logs_they_were_made_of() {
    let vocabulary = KDisks::default().build_from(segments(), false).unwrap();
    for class in Class::ALL {
        assert_eq!(*vocabulary.poses(class, 0), [ORIGIN; 6]);
        let error = errors(&vocabulary).of(class).unwrap();
        assert!(error.mean <= 0.05, "{class}: {error:?}");
        // No two tokens coincide, except those that a mean moved.
        let near = 0.8 * KDisks::default().tolerance[class.index()];
        let twice = (1..vocabulary.tokens(class))
            .filter(|&t| vocabulary.nearest_k(class, vocabulary.end(class, t), 2)[1].1 < near)
            .count();
        assert!(twice * 20 < vocabulary.tokens(class), "{class}: {twice}");
    }
    assert_eq!(vocabulary.provenance().scenarios, 12);
    assert_eq!(Vocabulary::read(&vocabulary.write().unwrap()).unwrap(), vocabulary);
    let again = KDisks::default().build_from(segments(), false).unwrap();
    assert_eq!(again.write().unwrap(), vocabulary.write().unwrap());
}

#[test]
fn k_disks_follow_real_logs() {
    let Some(folder) = shared("data/womd/train") else { return };
    let (mut segments, mut errors) = (Segments::new(50_000, 1), MatchingErrors::default());
    let logs: Vec<Scenario> = formats::open(&folder).unwrap().map(Result::unwrap).collect();
    logs.iter().for_each(|s| segments.add(s));
    let vocabulary = KDisks::default().build_from(&segments, true).unwrap();
    logs.iter().for_each(|s| errors.add(&vocabulary, s));
    for class in Class::ALL {
        let error = errors.of(class).unwrap();
        assert!(error.mean <= 0.05, "{class}: {error:?}");
    }
}

#[test]
fn k_disks_can_be_symmetric_and_few() {
    let settings = KDisks { tokens: 200, symmetric: true, ..KDisks::default() };
    let vocabulary = settings.build_from(segments(), false).unwrap();
    for class in Class::ALL {
        assert!(vocabulary.tokens(class) <= 200);
        assert!(is_symmetric(&vocabulary, class), "{class}");
    }
    assert!(vocabulary.tokens(Class::Vehicle) >= 199);
}

#[test]
fn trajtok_is_symmetric_and_stands_still() {
    // So few logs leave most cells empty, so the threshold of supported cells is low.
    let mut settings = TrajTok { company: 3, ..TrajTok::default() };
    settings.grids[0].count = 1;
    let vocabulary = settings.build_from(segments(), true).unwrap();
    for class in Class::ALL {
        assert!(is_symmetric(&vocabulary, class), "{class}");
        assert_eq!(*vocabulary.poses(class, 0), [ORIGIN; 6]);
        let error = errors(&vocabulary).of(class).unwrap();
        assert!(error.p50 <= 0.1 && error.mean < 0.3, "{class}: {error:?}");
        // No agent turns round within half a second, and nothing jumps.
        let smooth = |t: usize| {
            let poses = vocabulary.poses(class, t);
            poses.windows(2).all(|w| (w[1].heading - w[0].heading).abs() < 0.7)
                && poses
                    .windows(3)
                    .all(|w| (w[0].position + w[2].position - w[1].position * 2.0).norm() < 0.2)
        };
        let rough = (0..vocabulary.tokens(class)).filter(|&t| !smooth(t)).count();
        assert_eq!(rough, 0, "{class} of {}", vocabulary.tokens(class));
    }
}

#[test]
fn the_kinematic_vocabulary_fits_generated_logs() {
    let vocabulary = Kinematic::default().build().unwrap();
    for class in Class::ALL {
        let error = errors(&vocabulary).of(class).unwrap();
        assert!(error.mean <= 0.12, "{class}: {error:?}");
    }
}

/// Returns half a second at constant speed.
fn straight(speed: f64) -> TokenPoses {
    std::array::from_fn(|i| Pose { position: Vec2::new(speed * 0.1 * i as f64, 0.0), heading: 0.0 })
}

#[test]
fn classes_without_data_are_named_or_filled() {
    let mut segments = Segments::new(100, 0);
    for i in 0..50 {
        segments.add_motion(Class::Vehicle, straight(0.25 * f64::from(i)));
    }
    let error = KDisks::default().build_from(&segments, false).unwrap_err();
    insta::assert_snapshot!(error, @"class `pedestrian`: 0 different motions are too few for `k-disks`, which needs at least one without recording faults; give more scenarios, or take kinematic tokens for it with --fill");
    let filled = KDisks::default().build_from(&segments, true).unwrap();
    let kinematic = Kinematic::default().build().unwrap();
    assert_eq!(filled.tokens(Class::Cyclist), kinematic.tokens(Class::Cyclist));
    let added = &filled.provenance().settings["filled_with_kinematic"];
    assert_eq!(added["cyclist"], kinematic.tokens(Class::Cyclist) - 1);
    assert_eq!(added["vehicle"], filled.tokens(Class::Vehicle) - 50);
    assert!((500..1073).contains(&filled.tokens(Class::Vehicle)));
    let error = TrajTok::default().build_from(&segments, false).unwrap_err();
    assert!(matches!(error, BuildError::NoData { class: Class::Vehicle, segments: 50, .. }), "{error}");
    let none = KDisks { tokens: 0, ..KDisks::default() }.build_from(&segments, true).unwrap_err();
    insta::assert_snapshot!(none, @"setting `tokens` of `k-disks` is 0, expected at least 1");
}

#[test]
fn samples_are_bounded_and_hold_nothing_twice() {
    let mut segments = Segments::new(10, 0);
    for round in 0..3 {
        for i in 0..100 {
            segments.add_motion(Class::Vehicle, straight(0.25 * f64::from(i)));
        }
        assert_eq!(segments.of(Class::Vehicle).len(), 10, "{round}");
    }
    let mut few = Segments::new(1000, 0);
    (0..300).for_each(|i| few.add_motion(Class::Vehicle, straight(0.25 * f64::from(i % 100))));
    assert_eq!((few.of(Class::Vehicle).len(), few.seen(Class::Vehicle)), (100, 100));
}

#[test]
fn motions_that_nobody_makes_are_left_out() {
    let mut segments = Segments::new(100, 0);
    let mut jump = straight(5.0);
    jump[3].position.x += 0.5;
    segments.add_motion(Class::Vehicle, jump);
    segments.add_motion(Class::Vehicle, straight(5.0));
    let settings = KDisks { stand_still: false, ..KDisks::default() };
    for class in [Class::Pedestrian, Class::Cyclist] {
        segments.add_motion(class, straight(1.0));
    }
    let vocabulary = settings.build_from(&segments, false).unwrap();
    assert_eq!(vocabulary.tokens(Class::Vehicle), 1);
    assert_eq!(vocabulary.end(Class::Vehicle, 0), straight(5.0)[5]);
    assert_eq!(settings.tokens, 2048);
}

#[test]
fn a_map_vocabulary_needs_no_foreign_file() {
    let mut builder = MapVocabularyBuilder::new(20_000, 1);
    scenarios().iter().for_each(|s| builder.add(s));
    let vocabulary = builder.build(256, 0.05).unwrap();
    assert!(vocabulary.tokens() > 50 && vocabulary.tokens() <= 256);
    assert_eq!(MapVocabulary::read(&vocabulary.write().unwrap()).unwrap(), vocabulary);
    let (mut far, mut n) = (0.0, 0.0);
    for piece in curve_pieces(&scenarios()[0].start) {
        let (own, token) = (piece.curve(), vocabulary.curve(vocabulary.nearest(&piece)));
        far += (own[10] - token[10]).norm();
        n += 1.0;
    }
    assert!(n > 100.0 && far / n < 0.3, "{}", far / n);
    let nothing = MapVocabularyBuilder::new(10, 0).build(10, 0.05).unwrap_err();
    insta::assert_snapshot!(nothing, @"the map vocabulary has no curves; give scenarios with maps");
    assert!(MapVocabulary::read(b"no safetensors").is_err());
}
