#![allow(clippy::unwrap_used, reason = "tests stop at what they did not expect")]

use reactsim_geometry::Vec2;
use reactsim_scene::{CURRENT, Length};

use super::motion;
use super::raw::{RawMotion, RawPast, RawPath, RawPiece};

fn motion(pieces: Vec<RawPiece>) -> RawMotion {
    RawMotion { at: [5.0, 2.0], heading: 0.0, speed: 10.0, past: RawPast::default(), pieces, frames: None }
}

fn piece(seconds: f64) -> RawPiece {
    RawPiece { seconds, acceleration: 0.0, curvature: 0.0, shift: 0.0 }
}

#[test]
fn goes_straight_without_pieces() {
    let track = motion::track("m", &motion(vec![]), Length::BENCHMARK).unwrap();
    assert_eq!(track.len(), 91);
    for (f, state) in track.iter().enumerate() {
        let state = state.unwrap();
        assert!((state.x - (5.0 + f as f64 - CURRENT as f64)).abs() < 1e-9, "{f}: {}", state.x);
        assert_eq!((state.y, state.heading.abs() < 1e-12), (2.0, true));
        assert!((state.vx - 10.0).abs() < 1e-9);
    }
}

#[test]
fn brakes_to_a_halt_and_stays() {
    let mut raw = motion(vec![RawPiece { acceleration: -4.0, ..piece(5.0) }]);
    raw.past.acceleration = 2.0;
    let track = motion::track("m", &raw, Length::BENCHMARK).unwrap();
    assert!((track[0].unwrap().speed() - 8.0).abs() < 1e-9);
    assert!((track[0].unwrap().x - (5.0 - 9.0)).abs() < 1e-9);
    // 10 m/s at 4 m/s² is 12.5 m.
    let end = track[90].unwrap();
    assert!((end.x - 17.5).abs() < 1e-9);
    assert_eq!(end.speed(), 0.0);
}

#[test]
fn shifts_sideways_and_drives_on_parallel() {
    let track = motion::track(
        "m",
        &motion(vec![piece(1.0), RawPiece { shift: 3.5, ..piece(3.0) }]),
        Length::BENCHMARK,
    )
    .unwrap();
    assert_eq!(track[20].unwrap().y, 2.0);
    let end = track[50].unwrap();
    assert!((end.y - 5.5).abs() < 1e-9 && end.heading.abs() < 1e-9);
    let half = track[35].unwrap();
    assert!((half.y - 3.75).abs() < 1e-9 && half.heading > 0.1);
    assert!((half.heading - half.vy.atan2(half.vx)).abs() < 1e-9);
}

#[test]
fn draws_quarter_circles() {
    let radius = 20.0;
    let arc = super::raw::RawArc { length: radius * std::f64::consts::FRAC_PI_2, curvature: 1.0 / radius };
    let path = RawPath { at: [0.0, 0.0], heading: 0.0, pieces: vec![arc] };
    let points = motion::line("p", &path, &mut 1000).unwrap();
    let end = points[points.len() - 1];
    assert!((end - Vec2::new(20.0, 20.0)).norm() < 1e-9);
    assert!(points.iter().all(|p| ((p - Vec2::new(0.0, 20.0)).norm() - radius).abs() < 1e-9));
}

#[test]
fn refused_durations_are_named() {
    let error = motion::track("agents[1].motion", &motion(vec![piece(0.25)]), Length::BENCHMARK)
        .unwrap_err()
        .to_string();
    assert_eq!(error, "agents[1].motion.pieces[0].seconds is 0.25, expected a positive multiple of 0.1 s");
    let error = motion::track("m", &motion(vec![piece(8.1)]), Length::BENCHMARK).unwrap_err().to_string();
    assert_eq!(error, "m.pieces[0] is an end after more than 8 s, expected pieces of at most 8 s in total");
}
