//! Tracks as tokens: validity, resets, parked cars, noise.

use reactsim::dynamics::Pose;
use reactsim::geometry::Vec2;
use reactsim::models::ntp::tokens::{
    ORIGIN, PreparedTrack, TOKEN_STEPS, TokenNoise, fill_gaps, token_of_motion,
};
use reactsim::rollout::{Purpose, stream};
use reactsim::scene::{AgentState, FRAMES, Frame};

use super::vocabulary::kinematic;
use reactsim::models::perception::Class;

fn state(x: f64, y: f64, heading: f64, speed: f64) -> AgentState {
    AgentState { x, y, heading, vx: speed * heading.cos(), vy: speed * heading.sin() }
}

/// Returns a state that moves straight along x at 7 m/s.
fn driving(frame: usize) -> Frame {
    Some(state(0.7 * frame as f64, 3.0, 0.0, 7.0))
}

fn track(of: impl Fn(usize) -> Frame) -> PreparedTrack {
    PreparedTrack::new(&(0..FRAMES).map(of).collect::<Vec<_>>())
}

#[test]
fn parked_cars_do_not_drift() {
    let vocabulary = kinematic();
    for heading in [0.0, 0.7, -2.9] {
        let parked = track(|_| Some(state(812.25, -77.5, heading, 0.0)));
        let found = parked.nearest_tokens(&vocabulary, Class::Vehicle);
        assert_eq!(found.tokens, [0; TOKEN_STEPS]);
        for pose in found.poses {
            assert!((pose.position - Vec2::new(812.25, -77.5)).norm() < 1e-6);
            assert!((pose.heading - heading).abs() < 1e-6);
        }
    }
}

#[test]
fn errors_do_not_add_up() {
    let vocabulary = kinematic();
    let found = track(driving).nearest_tokens(&vocabulary, Class::Vehicle);
    assert!(found.valid.iter().all(|v| *v));
    for (step, pose) in found.poses.iter().enumerate() {
        let x = 3.5 * (step + 1) as f64;
        assert!((pose.position - Vec2::new(x, 3.0)).norm() < 0.11, "{step}: {pose:?}");
    }
}

#[test]
fn who_appears_late_gets_whole_tokens() {
    let vocabulary = kinematic();
    let from = |first: usize| track(|f| driving(f).filter(|_| f >= first));
    // Recorded from frame 7 on: extrapolation by two frames backwards gives a token from frame 5 on.
    let seven = from(7);
    assert!((seven.pose(5).unwrap().position - Vec2::new(3.5, 3.0)).norm() < 1e-12);
    assert_eq!(seven.pose(4), None);
    let found = seven.nearest_tokens(&vocabulary, Class::Vehicle);
    assert_eq!(found.valid[..3], [false, true, true]);
    assert_eq!(found.poses[0], ORIGIN);
    // An agent that appears at the current frame has a token that leads there; one that appears on a later
    // boundary has none.
    assert_eq!(from(10).nearest_tokens(&vocabulary, Class::Vehicle).valid[..3], [false, true, true]);
    assert_eq!(from(15).nearest_tokens(&vocabulary, Class::Vehicle).valid[..4], [false, false, false, true]);
    assert_eq!(from(FRAMES).nearest_tokens(&vocabulary, Class::Vehicle).valid, [false; TOKEN_STEPS]);
    // Without a recorded velocity, that of the following frames counts.
    let unknown = |f: usize| driving(f).filter(|_| f >= 7).map(|s| AgentState { vx: f64::NAN, ..s });
    assert!((track(unknown).pose(5).unwrap().position - Vec2::new(3.5, 3.0)).norm() < 1e-9);
    // A single frame without velocity, states that are not finite, and short tracks are accepted.
    let alone = |f: usize| (f == 10).then(|| AgentState { vx: f64::NAN, ..state(1.0, 2.0, 0.0, 0.0) });
    assert_eq!(track(alone).pose(5).unwrap().position, Vec2::new(1.0, 2.0));
    let broken = track(|f| driving(f).map(|s| if f == 30 { AgentState { x: f64::NAN, ..s } } else { s }));
    assert_eq!(broken.nearest_tokens(&vocabulary, Class::Vehicle).valid.iter().filter(|v| !**v).count(), 2);
    assert_eq!(
        PreparedTrack::new(&[]).nearest_tokens(&vocabulary, Class::Cyclist).valid,
        [false; TOKEN_STEPS]
    );
}

#[test]
fn after_a_gap_tokens_begin_anew_and_gaps_can_be_filled() {
    let vocabulary = kinematic();
    let gap = |f: usize| driving(f).filter(|_| !(22..38).contains(&f));
    let found = track(gap).nearest_tokens(&vocabulary, Class::Vehicle);
    let invalid: Vec<usize> = (0..TOKEN_STEPS).filter(|&s| !found.valid[s]).collect();
    // Frames 25, 30 and 35 are missing.
    assert_eq!(invalid, [4, 5, 6, 7]);
    assert!((found.poses[8].position - Vec2::new(31.5, 3.0)).norm() < 0.11);
    let mut frames: Vec<Frame> = (0..FRAMES).map(gap).collect();
    fill_gaps(&mut frames);
    assert!(frames.iter().all(Option::is_some));
    assert!((frames[30].unwrap().x - 21.0).abs() < 1e-9);
}

#[test]
fn headings_that_flip_are_turned_back() {
    let flipping =
        |f: usize| driving(f).map(|s| if f % 7 == 3 { AgentState { heading: 3.1, ..s } } else { s });
    let found = track(flipping).nearest_tokens(&kinematic(), Class::Vehicle);
    assert_eq!(found, track(driving).nearest_tokens(&kinematic(), Class::Vehicle));
}

#[test]
fn noise_takes_near_tokens_and_tracks_steer_back() {
    let vocabulary = kinematic();
    let track = track(driving);
    for noise in [TokenNoise::Uniform { k: 5 }, TokenNoise::Weighted { k: 5, temperature: 1.0 }] {
        let mut rng = stream(3, "noise", 0, Purpose::Begin);
        let noisy = track.noisy_tokens(&vocabulary, Class::Vehicle, noise, &mut rng);
        let nearest = track.nearest_tokens(&vocabulary, Class::Vehicle);
        assert_eq!(noisy.tokens[0], nearest.tokens[0]);
        assert_ne!(noisy.tokens, nearest.tokens);
        assert_eq!(noisy.valid, nearest.valid);
        for (step, pose) in noisy.poses.iter().enumerate() {
            let x = 3.5 * (step + 1) as f64;
            assert!((pose.position - Vec2::new(x, 3.0)).norm() < 0.6, "{step}: {pose:?}");
        }
        let mut again = stream(3, "noise", 0, Purpose::Begin);
        assert_eq!(noisy, track.noisy_tokens(&vocabulary, Class::Vehicle, noise, &mut again));
    }
    let only = TokenNoise::Uniform { k: 1 };
    let mut rng = stream(3, "noise", 0, Purpose::Begin);
    assert_eq!(
        track.noisy_tokens(&vocabulary, Class::Vehicle, only, &mut rng),
        track.nearest_tokens(&vocabulary, Class::Vehicle)
    );
}

#[test]
fn motions_that_were_carried_out_have_tokens() {
    let vocabulary = kinematic();
    let from = Pose { position: Vec2::new(5.0, 6.0), heading: 1.0 };
    let to = from.advance(0.0, 0.0);
    assert_eq!(token_of_motion(&vocabulary, Class::Vehicle, from, to), (0, 0.0));
    let (token, distance) = token_of_motion(&vocabulary, Class::Vehicle, from, from.advance(6.0, 0.01));
    assert!(distance < 0.5 && vocabulary.end(Class::Vehicle, token).position.x > 5.5);
}
