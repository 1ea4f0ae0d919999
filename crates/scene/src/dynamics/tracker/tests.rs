use std::f64::consts::PI;

use proptest::prelude::*;

use super::*;

fn start(speed: f64) -> VehicleMotion {
    VehicleMotion { pose: Pose { position: Vec2::new(31.0, -7.0), heading: 0.9 }, speed, acceleration: 0.0 }
}

/// Returns a pose given in the frame of another.
fn placed(from: Pose, x: f64, y: f64, heading: f64) -> Pose {
    let ahead = direction(from.heading);
    Pose { position: from.position + ahead * x + left(ahead) * y, heading: wrap(from.heading + heading) }
}

fn track(limits: MotionLimits, now: VehicleMotion, poses: &[Pose]) -> Vec<VehicleMotion> {
    let mut driven = Vec::new();
    Tracker::new(limits).track(now, poses, &mut driven);
    assert_eq!(driven.len(), poses.len());
    driven
}

/// Returns the largest acceleration and curvature by the formulas of the metrics. Checks that
/// speeds match the positions.
fn peaks(now: VehicleMotion, driven: &[VehicleMotion]) -> (f64, f64) {
    let (mut acceleration, mut curvature) = (0.0_f64, 0.0_f64);
    let mut before = now;
    for m in driven {
        let v1 = (m.pose.position - before.pose.position).norm() / DT;
        assert!((v1 - m.speed.abs()).abs() < 1e-9, "{v1} is stated as {}", m.speed);
        let v0 = before.speed.abs();
        let a = (v1 - v0) / DT;
        acceleration = acceleration.max(a.abs());
        if v0 >= 0.6 && v1 >= 0.6 {
            let distance = v0 * DT + 0.5 * a * DT * DT;
            curvature = curvature.max((wrap(m.pose.heading - before.pose.heading) / distance).abs());
        }
        before = *m;
    }
    (acceleration, curvature)
}

fn feasible(now: VehicleMotion, driven: &[VehicleMotion]) {
    let (acceleration, curvature) = peaks(now, driven);
    assert!(acceleration <= 5.5 + 1e-6, "{acceleration} m/s²");
    assert!(curvature <= 0.27 + 1e-6, "{curvature} 1/m");
}

fn error(driven: &[VehicleMotion], poses: &[Pose]) -> f64 {
    driven.iter().zip(poses).map(|(m, p)| (m.pose.position - p.position).norm()).fold(0.0, f64::max)
}

fn end_error(driven: &[VehicleMotion], poses: &[Pose]) -> f64 {
    (driven[driven.len() - 1].pose.position - poses[poses.len() - 1].position).norm()
}

/// Returns poses of a vehicle whose centre (`rear` = 0) or rear axle follows arcs, given the speed
/// of that point and the curvature at each step.
fn drive(from: Pose, rear: f64, speeds: &[f64], curvature: impl Fn(usize) -> f64) -> Vec<Pose> {
    let mut axle = Pose { position: from.position - direction(from.heading) * rear, heading: from.heading };
    let mut poses = Vec::new();
    for (k, v) in speeds.iter().enumerate() {
        axle = axle.advance(v * DT, curvature(k));
        poses.push(Pose { position: axle.position + direction(axle.heading) * rear, heading: axle.heading });
    }
    poses
}

#[test]
fn any_plan_is_brought_within_the_limits() {
    for speed in [-3.0, 0.0, 0.3, 1.0, 3.0, 7.0, 12.0, 20.0, 35.0] {
        for rear in [0.0, 1.3, 4.0] {
            for x in [-20.0, -3.0, -0.2, 0.0, 0.05, 0.5, 2.0, 6.0, 12.0, 30.0] {
                for y in [-9.0, -1.0, -0.1, 0.0, 0.3, 4.0] {
                    for turn in [-PI, -1.5, -0.3, 0.0, 0.1, 0.8, 2.5] {
                        for n in [1, 2, 5, 10] {
                            let now = start(speed);
                            let share = |k: usize| (k + 1) as f64 / n as f64;
                            let poses: Vec<Pose> = (0..n)
                                .map(|k| placed(now.pose, x * share(k), y * share(k), turn * share(k)))
                                .collect();
                            feasible(now, &track(MotionLimits::of_vehicle(rear), now, &poses));
                            // The whole displacement in the first step.
                            let poses = vec![placed(now.pose, x, y, turn); n];
                            feasible(now, &track(MotionLimits::of_vehicle(rear), now, &poses));
                        }
                    }
                }
            }
        }
    }
}

proptest! {
    #[test]
    fn any_noise_is_brought_within_the_limits(
        speed in -5.0..40.0_f64,
        acceleration in -40.0..40.0_f64,
        rear in 0.0..6.0_f64,
        steps in prop::collection::vec((-4.0..5.0_f64, -2.0..2.0_f64, -1.0..1.0_f64), 1..45),
    ) {
        let now = VehicleMotion { acceleration, ..start(speed) };
        let mut pose = now.pose;
        let poses: Vec<Pose> = steps
            .iter()
            .map(|&(x, y, turn)| {
                pose = placed(pose, x, y, turn);
                pose
            })
            .collect();
        feasible(now, &track(MotionLimits::of_vehicle(rear), now, &poses));
    }
}

#[test]
fn arcs_are_followed() {
    for n in [1, 2, 5, 10, 20, 40] {
        for speed in [-2.0, -0.8, 0.8, 3.0, 8.0, 15.0, 25.0] {
            for curvature in [0.0, 0.01, -0.05, 0.1, -0.2, 0.25] {
                for rear in [0.0, 1.3] {
                    let lateral: f64 = curvature * speed * speed;
                    if lateral.abs() > 6.0 {
                        continue;
                    }
                    // A centre ahead of the axle travels farther than the axle.
                    let slip: f64 = rear * curvature;
                    let now = start(speed * (1.0 + slip * slip).sqrt());
                    let poses = drive(now.pose, rear, &vec![speed; n], |_| curvature);
                    let driven = track(MotionLimits::of_vehicle(rear), now, &poses);
                    feasible(now, &driven);
                    let most = error(&driven, &poses);
                    assert!(most < 0.025, "{most} m: {n} steps, {speed} m/s, {curvature} 1/m, {rear} m");
                    let (m, p) = (driven[n - 1], poses[n - 1]);
                    assert!(wrap(m.pose.heading - p.heading).abs() < 0.03);
                }
            }
        }
    }
}

#[test]
fn braking_ends_where_it_should() {
    for speed in [1.0, 3.0, 8.0, 15.0] {
        for braking in [1.0, 2.5, 4.0, 5.0] {
            for window in [1, 2, 5, 10, 40] {
                let now = start(speed);
                let mut v: f64 = speed;
                let speeds: Vec<f64> = (0..200)
                    .map(|_| {
                        v = (v - braking * DT).max(0.0);
                        v
                    })
                    .collect();
                let poses = drive(now.pose, 0.0, &speeds, |_| 0.0);
                let mut moving = now;
                let mut all = Vec::new();
                for piece in poses.chunks(window) {
                    let driven = track(MotionLimits::of_vehicle(0.0), moving, piece);
                    moving = driven[driven.len() - 1];
                    all.extend(driven);
                }
                feasible(now, &all);
                assert!(error(&all, &poses) < 0.1, "{speed} m/s, {braking} m/s², {window} steps");
                assert!(end_error(&all, &poses) < 0.02 && moving.speed == 0.0);
            }
        }
    }
}

#[test]
fn staircases_are_followed() {
    for first in [2.0_f64, 6.0, 12.0] {
        for rise in [0.4, -0.4] {
            let (mut moving, mut speed) = (start(first), first);
            for _ in 0..4 {
                speed += rise;
                let poses = drive(moving.pose, 0.0, &[speed; 5], |_| 0.0);
                let driven = track(MotionLimits::of_vehicle(0.0), moving, &poses);
                feasible(moving, &driven);
                assert!(error(&driven, &poses) < 0.02 && end_error(&driven, &poses) < 0.01);
                moving = driven[4];
            }
        }
    }
}

#[test]
fn a_change_of_lanes_is_followed() {
    for (speed, n) in [(6.0, 40), (12.0, 30), (20.0, 40)] {
        let now = start(speed);
        let most = 2.0 / (speed * speed);
        let bends = |k: usize| if k < n / 2 { most } else { -most };
        let poses = drive(now.pose, 1.3, &vec![speed; n], bends);
        let driven = track(MotionLimits::of_vehicle(1.3), now, &poses);
        feasible(now, &driven);
        assert!(error(&driven, &poses) < 0.1, "{}", error(&driven, &poses));
    }
}

#[test]
fn setting_off_and_reversing_are_followed() {
    // Stands, accelerates at 2 m/s², comes to a halt, and reverses.
    let mut speeds = vec![0.0; 10];
    speeds.extend((1..=10).map(|k| 0.2 * f64::from(k)));
    speeds.extend((0..10).rev().map(|k| 0.2 * f64::from(k)));
    speeds.extend((1..=10).map(|k| -0.1 * f64::from(k)));
    let now = start(0.0);
    let poses = drive(now.pose, 1.3, &speeds, |_| 0.1);
    let driven = track(MotionLimits::of_vehicle(1.3), now, &poses);
    feasible(now, &driven);
    assert!(error(&driven, &poses) < 0.1, "{}", error(&driven, &poses));
    assert!(driven[..5].iter().all(|m| m.pose == now.pose));
    assert!(driven[39].speed < -0.8, "{}", driven[39].speed);
}

#[test]
fn a_stationary_vehicle_stays_exactly_still() {
    for speed in [0.0, 0.05, 0.3, -0.2] {
        for n in [1, 5, 40] {
            let now = start(speed);
            let driven = track(MotionLimits::of_vehicle(1.3), now, &vec![now.pose; n]);
            assert!(driven.iter().all(|m| m.pose == now.pose && m.speed == 0.0));
        }
    }
    // A plan with millimetre jitter moves nothing.
    let now = start(0.0);
    let poses: Vec<Pose> = (0..40).map(|k| placed(now.pose, 1e-3 * f64::from(k % 2), 1e-3, 0.01)).collect();
    assert!(track(MotionLimits::of_vehicle(1.3), now, &poses).iter().all(|m| m.pose == now.pose));
}

#[test]
fn a_wrong_initial_speed_is_corrected() {
    for (stated, actual) in [(14.0, 10.0), (6.0, 10.0), (0.0, 5.0)] {
        let now = VehicleMotion { acceleration: (stated - actual) / DT, ..start(stated) };
        let poses = drive(now.pose, 0.0, &[actual; 40], |_| 0.0);
        let driven = track(MotionLimits::of_vehicle(0.0), now, &poses);
        feasible(now, &driven);
        assert!((driven[39].speed - actual).abs() < 0.05 && end_error(&driven, &poses) < 0.05);
    }
}

#[test]
fn motion_is_read_from_states() {
    let state = |x: f64, vx: f64, vy: f64| Some(AgentState { x, y: 0.0, heading: 0.0, vx, vy });
    let moving = VehicleMotion::after(&[state(0.0, 3.0, 4.0), state(0.4, 4.0, 0.0)]).unwrap();
    assert_eq!((moving.speed, moving.acceleration), (4.0, (4.0 - 5.0) / DT));
    let nan = f64::NAN;
    let moving = VehicleMotion::after(&[state(0.0, nan, nan), state(-0.2, nan, nan)]).unwrap();
    assert_eq!((moving.speed, moving.acceleration), (-2.0, 0.0));
    assert_eq!(VehicleMotion::after(&[None, state(1.0, nan, nan)]).unwrap().speed, 0.0);
    assert!(VehicleMotion::after(&[state(0.0, 1.0, 0.0), None]).is_none());
    assert!(VehicleMotion::after(&[]).is_none());
}
