//! Plans of single vehicles, checked by their poses alone.

use proptest::prelude::*;
use reactsim_geometry::{OrientedBox, Vec2, direction, left, wrap};
use reactsim_scene::DT;
use reactsim_scene::dynamics::{Pose, VehicleMotion};

use super::ending::Ending;
use super::mode::Mode;
use super::obstacle::{Extent, Obstacle};
use super::planned_vehicle::PlannedVehicle;
use super::speed::STEPS;
use super::vehicle::Planner;

const LENGTH: f64 = 4.6;
const WIDTH: f64 = 1.9;
const REAR: f64 = 0.28 * LENGTH;

fn planner() -> Planner {
    Planner::new(&super::settings().unwrap()).unwrap()
}

fn vehicle(speed: f64, acceleration: f64, curvature: Option<f64>) -> PlannedVehicle<'static> {
    let pose = Pose { position: Vec2::new(3.0, -2.0), heading: 0.4 };
    PlannedVehicle {
        now: VehicleMotion { pose, speed, acceleration },
        rear: REAR,
        extent: Extent { length: 0.5 * LENGTH, width: 0.5 * WIDTH },
        curvature,
        road: None,
        keeps_corners: false,
    }
}

/// Returns the largest acceleration and curvature of all steps as the metrics take them: from centres
/// and headings alone.
fn judged(now: &VehicleMotion, moves: &[VehicleMotion]) -> (f64, f64) {
    let (mut acceleration, mut curvature) = (0.0_f64, 0.0_f64);
    let (mut before, mut v0) = (now.pose, now.speed.abs());
    for moving in moves {
        let v1 = (moving.pose.position - before.position).norm() / DT;
        acceleration = acceleration.max(((v1 - v0) / DT).abs());
        if v0 >= 0.6 && v1 >= 0.6 {
            let turn = wrap(moving.pose.heading - before.heading).abs();
            curvature = curvature.max(turn / (0.5 * (v0 + v1) * DT));
        }
        (before, v0) = (moving.pose, v1);
    }
    (acceleration, curvature)
}

fn check(vehicle: &PlannedVehicle<'_>, moves: &[VehicleMotion]) {
    assert_eq!(moves.len(), STEPS);
    let (acceleration, curvature) = judged(&vehicle.now, moves);
    assert!(acceleration <= 5.5 + 1e-6, "{acceleration} m/s2");
    assert!(curvature <= 0.27 + 1e-6, "{curvature} 1/m");
    for m in moves {
        assert!(m.pose.position.x.is_finite() && m.pose.position.y.is_finite() && m.pose.heading.is_finite());
    }
}

/// Returns a feasible mode that starts from a vehicle with these accelerations and curvatures of the
/// axle's path.
fn driven(
    vehicle: &PlannedVehicle<'_>,
    acceleration: impl Fn(f64) -> f64,
    curvature: impl Fn(f64) -> f64,
) -> Mode {
    let mut moving = vehicle.now;
    let points = (0..STEPS).map(|k| {
        let t = (k as f64 + 0.5) * DT;
        let next = (moving.speed + acceleration(t) * DT).max(0.0);
        let c = curvature(t);
        let turn = c * next * DT / (1.0 + (REAR * c) * (REAR * c)).sqrt();
        moving = moving.moved(next, turn, REAR);
        moving.pose.position
    });
    Mode::of(points.collect())
}

fn farthest(mode: &Mode, moves: &[VehicleMotion]) -> f64 {
    let apart = moves.iter().zip(&mode.points).map(|(m, p)| (m.pose.position - p).norm());
    apart.fold(0.0, f64::max)
}

#[test]
fn without_others_a_feasible_mode_is_what_comes_out() {
    let mut planner = planner();
    let ramp = |t: f64, most: f64| most * (t / 0.8).min(1.0);
    let mut apart = Vec::new();
    for (speed, a, c) in [
        (10.0, 0.0, 0.0),
        (13.0, -1.5, 0.0),
        (2.0, 1.2, 0.0),
        (8.0, 0.0, 0.03),
        (5.0, 0.2, -0.08),
        (25.0, -0.5, 0.004),
    ] {
        let vehicle = vehicle(speed, 0.0, Some(0.0));
        let mode = driven(&vehicle, |t| ramp(t, a), |t| ramp(t, c));
        let moves = planner.plan(&vehicle, std::slice::from_ref(&mode), &[]);
        check(&vehicle, &moves);
        apart.push((farthest(&mode, &moves[..5]), farthest(&mode, &moves)));
    }
    // The part driven before the next plan, and the whole 5 s, whose end has a standard deviation of
    // 1.5 m.
    assert!(apart.iter().all(|a| a.0 < 0.05 && a.1 < 0.5), "{apart:?} m");
    assert!(apart[0].1 < 0.01, "{apart:?} m");
}

#[test]
fn a_standing_vehicle_whose_mode_stays_keeps_its_pose() {
    let mut planner = planner();
    let vehicle = vehicle(0.0, 0.0, None);
    let here = vehicle.now.pose.position;
    let moves = planner.plan(&vehicle, &[Mode::of(vec![here + Vec2::new(0.01, 0.0); STEPS])], &[]);
    assert!(moves.iter().all(|m| m.pose == vehicle.now.pose && m.speed == 0.0));
    assert_eq!(planner.endings.plans.get(&Ending::Standing), Some(&1));
}

#[test]
fn halts_behind_a_standing_vehicle() {
    let mut planner = planner();
    for (speed, room) in [(12.0, 30.0), (6.0, 12.0), (15.0, 60.0)] {
        let vehicle = vehicle(speed, 0.0, Some(0.0));
        let ahead = direction(vehicle.now.pose.heading);
        let mode = driven(&vehicle, |_| 0.0, |_| 0.0);
        let place = vehicle.now.pose.position + ahead * (room + LENGTH);
        let wall = Obstacle::standing(OrientedBox::new(place, 0.4, LENGTH, WIDTH));
        let moves = planner.plan(&vehicle, &[mode], &[&wall]);
        check(&vehicle, &moves);
        let distance = (moves[STEPS - 1].pose.position - vehicle.now.pose.position).dot(&ahead);
        assert!(distance <= room - 0.7, "{speed} m/s: {distance} of {room} m");
        if speed < 14.0 {
            assert!(
                distance > room - 4.0 && moves[STEPS - 1].speed < 1.0,
                "{speed} m/s: {distance} of {room} m"
            );
        }
        assert_eq!(planner.endings.failed, 0);
    }
}

#[test]
fn swerves_around_a_vehicle_that_half_blocks_the_lane() {
    let mut planner = planner();
    let vehicle = vehicle(8.0, 0.0, Some(0.0));
    let ahead = direction(vehicle.now.pose.heading);
    let mode = driven(&vehicle, |_| 0.0, |_| 0.0);
    let place = vehicle.now.pose.position + ahead * 28.0 + left(ahead) * 1.6;
    let parked = Obstacle::standing(OrientedBox::new(place, 0.4, LENGTH, WIDTH));
    let moves = planner.plan(&vehicle, &[mode], &[&parked]);
    check(&vehicle, &moves);
    for m in &moves {
        let mine = OrientedBox::new(m.pose.position, m.pose.heading, LENGTH, WIDTH);
        assert!(mine.signed_distance(&parked.boxes[0]) > 0.0);
    }
    let distance = (moves[STEPS - 1].pose.position - vehicle.now.pose.position).dot(&ahead);
    assert!(distance > 33.0, "it passes: {distance} m");
}

#[test]
fn starts_that_break_bounds_are_left_within_them() {
    let mut planner = planner();
    for speed in [0.0, 0.3, 5.0, 40.0] {
        for acceleration in [-9.0, 0.0, 9.0] {
            for curvature in [None, Some(0.5), Some(-0.9)] {
                let vehicle = vehicle(speed, acceleration, curvature);
                let axis = direction(vehicle.now.pose.heading);
                let now = vehicle.now.pose.position;
                // Straight ahead, sideways at once, backwards, and nowhere.
                let displacements = [axis * 10.0, left(axis) * 6.0, axis * -4.0, Vec2::zeros()];
                // Overlapping, in front, alongside.
                let others = [axis * 1.0, axis * 5.0, left(axis) * 1.5]
                    .map(|d| Obstacle::standing(OrientedBox::new(now + d, 1.2, LENGTH, WIDTH)));
                for displacement in displacements {
                    let points = (1..=STEPS).map(|k| now + displacement * (DT * k as f64)).collect();
                    let moves = planner.plan(&vehicle, &[Mode::of(points)], &others.each_ref());
                    check(&vehicle, &moves);
                }
            }
        }
    }
}

#[test]
fn the_next_mode_is_taken_if_the_most_probable_is_blocked() {
    let mut planner = planner();
    let vehicle = vehicle(10.0, 0.0, Some(0.0));
    let ahead = direction(vehicle.now.pose.heading);
    let straight = driven(&vehicle, |_| 0.0, |_| 0.0);
    // It is too late to brake, but not to turn away.
    let away = driven(&vehicle, |_| -1.0, |t| 0.12 * (t / 0.3).min(1.0));
    let place = vehicle.now.pose.position + ahead * 11.0 - left(ahead) * 1.0;
    let wall = Obstacle::standing(OrientedBox::new(place, 0.4, 4.0, 3.2));
    let moves = planner.plan(&vehicle, &[straight, away], &[&wall]);
    check(&vehicle, &moves);
    assert_eq!(planner.endings.plans.get(&Ending::OtherMode), Some(&1), "{:?}", planner.endings);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(50))]

    /// Limits hold whatever the mode and whatever the obstacles.
    #[test]
    fn limits_hold_for_any_mode(
        speed in 0.0..30.0_f64,
        acceleration in -6.0..6.0_f64,
        curvature in -0.3..0.3_f64,
        steps in prop::collection::vec((-3.0..6.0_f64, -2.0..2.0_f64), 1..STEPS),
        others in prop::collection::vec((-10.0..40.0_f64, -8.0..8.0_f64, 0.0..6.2_f64), 0..5),
    ) {
        let mut planner = planner();
        let vehicle = vehicle(speed, acceleration, Some(curvature));
        let mut at = vehicle.now.pose.position;
        let points = steps.iter().map(|(x, y)| {
            at += Vec2::new(*x, *y) * 0.5;
            at
        });
        let mode = Mode::of(points.collect());
        let others: Vec<Obstacle> = others
            .iter()
            .map(|(x, y, h)| Obstacle::standing(OrientedBox::new(Vec2::new(*x, *y), *h, LENGTH, WIDTH)))
            .collect();
        let moves = planner.plan(&vehicle, &[mode], &others.iter().collect::<Vec<_>>());
        check(&vehicle, &moves);
        // Earlier solves do not change the plan.
        let (stay, others) = ([Mode::of(vec![at; STEPS])], others.iter().collect::<Vec<_>>());
        let again = planner.plan(&vehicle, &stay, &others);
        let mut fresh = super::tests::planner();
        prop_assert_eq!(again, fresh.plan(&vehicle, &stay, &others));
    }
}
