use std::f64::consts::FRAC_PI_2;
use std::ops::Range;

use reactsim_geometry::{Vec2, direction};
use reactsim_scene::{AgentKind, AgentState, CURRENT, DT, FUTURE, Frame};

use super::{CheckedMotion, CheckedScene, RolloutCheck, Subject};

/// Position and heading at the current frame, and speed, of the agents of the tests.
const AGENTS: [(f64, f64, f64, f64, AgentKind); 8] = [
    (12.0, -3.5, 0.4, 8.0, AgentKind::Vehicle),
    (-25.0, 4.0, 3.0, 11.0, AgentKind::Vehicle),
    (30.0, 22.0, -1.3, 6.0, AgentKind::Vehicle),
    (-8.0, -31.0, 1.7, 9.0, AgentKind::Vehicle),
    (45.0, -12.0, 0.9, 0.0, AgentKind::Vehicle),
    (-40.0, -18.0, 2.2, 13.0, AgentKind::Vehicle),
    (16.0, 9.0, -2.4, 1.4, AgentKind::Pedestrian),
    (-14.0, 17.0, -0.7, 4.5, AgentKind::Cyclist),
];

/// State of an agent at a time after the current frame, s, with its velocity kept.
fn state(agent: usize, t: f64) -> AgentState {
    let (x, y, heading, speed, _) = AGENTS[agent];
    let v = direction(heading) * speed;
    AgentState { x: x + v.x * t, y: y + v.y * t, heading, vx: v.x, vy: v.y }
}

fn steps(of: impl Fn(usize, usize) -> AgentState) -> Vec<Vec<Frame>> {
    (0..AGENTS.len()).map(|i| (1..=FUTURE).map(|k| Some(of(i, k))).collect()).collect()
}

fn kept(agent: usize, k: usize) -> AgentState {
    state(agent, k as f64 * DT)
}

/// Returns the checks that motion fails, with their texts, in a scenario with this origin.
fn found_at(origin: Vec2, future: &[Vec<Frame>]) -> Vec<(RolloutCheck, String)> {
    found_of(0..AGENTS.len(), Subject::Agents, origin, future)
}

/// Returns the same for some agents.
fn found_of(
    agents: Range<usize>,
    subject: Subject,
    origin: Vec2,
    future: &[Vec<Frame>],
) -> Vec<(RolloutCheck, String)> {
    let history: Vec<Vec<Frame>> = (0..AGENTS.len())
        .map(|i| (0..=CURRENT).map(|f| Some(state(i, (f as f64 - CURRENT as f64) * DT))).collect())
        .collect();
    let names: Vec<String> = (0..AGENTS.len()).map(|i| format!("a{i}")).collect();
    let agents = agents.map(|i| CheckedMotion {
        id: &names[i],
        kind: AGENTS[i].4,
        length: 4.0 + 0.2 * i as f64,
        now: state(i, 0.0),
        velocity: state(i, 0.0).velocity(),
        history: &history[i],
        entry0: None,
        future: &future[i],
    });
    let av = AgentState { x: 0.0, y: 0.0, heading: 0.6, vx: 5.0, vy: 0.0 };
    let scene = CheckedScene {
        agents: agents.collect(),
        entered: Vec::new(),
        replayed: Vec::new(),
        origin,
        av,
        subject,
    };
    scene.findings().into_iter().map(|finding| (finding.check, finding.text)).collect()
}

/// Asserts that motion fails this check first, with this text.
#[track_caller]
fn assert_found(future: &[Vec<Frame>], check: RolloutCheck, part: &str) {
    let found = found_at(Vec2::zeros(), future);
    let first = found.first().expect("a finding");
    assert_eq!(first.0, check, "{found:?}");
    assert!(first.1.contains(part), "{found:?}");
}

fn placed(map: impl Fn(usize, Vec2) -> Vec2) -> Vec<Vec<Frame>> {
    steps(|i, k| {
        let s = kept(i, k);
        let p = map(i, s.position());
        AgentState { x: p.x, y: p.y, ..s }
    })
}

fn turned(map: impl Fn(f64) -> f64) -> Vec<Vec<Frame>> {
    steps(|i, k| {
        let s = kept(i, k);
        AgentState { heading: map(s.heading), ..s }
    })
}

#[test]
fn motion_that_continues_passes() {
    assert_eq!(found_at(Vec2::zeros(), &steps(kept)), []);
    assert_eq!(found_at(Vec2::new(664_000.0, 3_998_000.0), &steps(kept)), []);
    // The hardest braking of a road user, to a halt.
    let braked = steps(|i, k| {
        let (speed, t) = (AGENTS[i].3, k as f64 * DT);
        let t = t.min(speed / 9.0);
        let way = speed * t - 4.5 * t * t;
        let at = state(i, 0.0).position() + direction(AGENTS[i].2) * way;
        AgentState { x: at.x, y: at.y, vx: f64::NAN, vy: f64::NAN, ..state(i, 0.0) }
    });
    assert_eq!(found_at(Vec2::zeros(), &braked), []);
}

#[test]
fn wrong_headings_are_named() {
    use RolloutCheck::Headings;
    assert_found(&turned(f64::to_degrees), Headings, "look like degrees; give radians");
    assert_found(&turned(|h| -h), Headings, "look clockwise;");
    assert_found(&turned(|h| FRAC_PI_2 - h), Headings, "clockwise from the y axis");
    assert_found(&turned(|h| h + FRAC_PI_2), Headings, "turned by a constant 90°");
    assert_found(&turned(|h| 90.0 - h.to_degrees()), Headings, "degrees that increase clockwise");
    assert_found(&turned(|h| 2.7 * h + 1.0), Headings, "radians counter-clockwise from the x axis");
}

#[test]
fn wrong_frames_are_named() {
    use RolloutCheck::{Coordinates, Units};
    assert_found(&placed(|_, p| Vec2::new(p.y, p.x)), Coordinates, "x and y look swapped");
    assert_found(&placed(|_, p| Vec2::new(p.x, -p.y)), Coordinates, "y looks mirrored");
    assert_found(&placed(|_, p| p + Vec2::new(3.0, -40.0)), Coordinates, "moved by (3.0, -40.0) m");
    assert_found(
        &placed(|i, p| p - state(i, 0.0).position()),
        Coordinates,
        "relative to each agent's own position",
    );
    let own = |i: usize, p: Vec2| {
        let (by, ahead) = (p - state(i, 0.0).position(), direction(AGENTS[i].2));
        Vec2::new(by.dot(&ahead), by.y * ahead.x - by.x * ahead.y)
    };
    // Near zero, where both are the same within the tolerance.
    assert_found(&placed(own), Coordinates, "each agent's own");
    assert_found(&placed(|_, p| p * 3.281), Units, "feet in place of metres");
    assert_found(&placed(|_, p| p * 100.0), Units, "centimetres in place of metres");
}

#[test]
fn other_points_units_times_and_orders_are_named() {
    use RolloutCheck::{Order, RearAxle, Time, Units};
    let rear = placed(|i, p| p - direction(AGENTS[i].2) * (0.28 * (4.0 + 0.2 * i as f64)));
    assert_found(&rear, RearAxle, "poses of the rear axle: 6 of 6 vehicles are");
    assert_found(&steps(|i, k| state(i, 3.6 * k as f64 * DT)), Units, "km/h read as m/s");
    assert_found(&steps(|i, k| state(i, 3.281 * k as f64 * DT)), Units, "feet");
    assert_found(&steps(|i, k| state(i, k as f64)), Units, "motion of 1 s in place of 0.1 s");
    assert_found(&steps(|i, k| state(i, (k as f64 - 1.0) * DT)), Time, "late by one step");
    assert_found(&steps(|i, k| state(i, k as f64 * DT - 1.0)), Time, "1.0 s behind at step 1");
    let again = steps(|i, k| state(i, ((k - 1) % 5 + 1) as f64 * DT));
    assert_found(&again, Time, "the same 5 frames occur again");
    let reversed = steps(|i, k| kept(AGENTS.len() - 1 - i, k));
    assert_found(&reversed, Order, "the agents look exchanged: 8 of 8 agents");
}

#[test]
fn impossible_motion_is_named() {
    use RolloutCheck::{Continuity, Freeze, Teleports};
    let teleport = steps(|i, k| state(i, k as f64 * DT + if i == 1 && k >= 30 { 3.0 } else { 0.0 }));
    assert_found(
        &teleport,
        Teleports,
        "1 of 8 agents teleport, the first: `a1` (vehicle) moves 34.1 m from step 29",
    );
    let jump = steps(|i, k| state(i, k as f64 * DT + if i == 1 { 3.0 } else { 0.0 }));
    assert_found(&jump, Continuity, "agent `a1` is 33.0 m from where its velocity leads at step 1");
    for from in [0, 20] {
        let frozen = steps(|i, k| state(i, if k > from { from as f64 } else { k as f64 } * DT));
        let part = format!("after step {from}; this looks like a fallback");
        assert_found(&frozen, Freeze, &part);
    }
}

#[test]
fn an_av_that_stands_at_once_is_frozen_and_not_called_otherwise() {
    // At 13 m/s it is 1.3 m behind where its velocity leads, as its rear axle is.
    let (av, frozen) = (5..6, steps(|i, _| state(i, 0.0)));
    let found = found_of(av.clone(), Subject::OneAgent, Vec2::zeros(), &frozen);
    assert!(matches!(&found[..], [(RolloutCheck::Freeze, _)]), "{found:?}");
    let late = steps(|i, k| state(i, (k as f64 - 1.0) * DT));
    let found = found_of(av.clone(), Subject::OneAgent, Vec2::zeros(), &late);
    assert!(matches!(&found[..], [(RolloutCheck::Time, _)]), "{found:?}");
    // Not by one step of 1.3 m.
    let rear = placed(|i, p| p - direction(AGENTS[i].2) * 1.45);
    let found = found_of(av, Subject::OneAgent, Vec2::zeros(), &rear);
    assert!(matches!(&found[..], [(RolloutCheck::RearAxle, _)]), "{found:?}");
}

#[test]
fn coarse_coordinates_are_named() {
    let origin = Vec2::new(664_000.3, 3_998_000.7);
    let stored = placed(|_, p| {
        let coarse = |v: f64| f64::from(v as f32);
        let world = p + origin;
        Vec2::new(coarse(world.x), coarse(world.y)) - origin
    });
    let found = found_at(origin, &stored);
    assert!(
        found.iter().any(|(check, text)| *check == RolloutCheck::Float32 && text.contains("0.0625 m")),
        "{found:?}"
    );
    // Close to the origin of the world they resolve the motion.
    let fine = placed(|_, p| Vec2::new(f64::from(p.x as f32), f64::from(p.y as f32)));
    assert_eq!(found_at(Vec2::zeros(), &fine), []);
}

#[test]
fn velocities_against_positions_are_named() {
    use RolloutCheck::Velocities;
    let stated = |of: fn(Vec2, f64) -> Vec2| {
        steps(move |i, k| {
            let s = kept(i, k);
            let v = of(s.velocity().unwrap(), s.heading);
            AgentState { vx: v.x, vy: v.y, ..s }
        })
    };
    assert_found(
        &stated(|v, _| v * 3.6),
        Velocities,
        "velocities of 7 of 8 agents contradict their positions",
    );
    assert_found(&stated(|v, _| v * 3.6), Velocities, "in km/h");
    assert_found(
        &stated(|v, h| Vec2::new(v.norm(), 0.0) * h.signum().abs()),
        Velocities,
        "the frame of each agent",
    );
    assert_found(&stated(|_, _| Vec2::zeros()), Velocities, "all velocities are zero");
    assert_eq!(found_at(Vec2::zeros(), &stated(|_, _| Vec2::new(f64::NAN, f64::NAN))), []);
}

/// Cuts a number off after this many significant bits.
fn bits(v: f64, bits: u32) -> f64 {
    let dropped = f64::MANTISSA_DIGITS - bits;
    f64::from_bits((v.to_bits() >> dropped) << dropped)
}

#[test]
fn rounded_numbers_are_named() {
    use RolloutCheck::Resolution;
    let origin = Vec2::new(664_000.3, 3_998_000.7);
    let multiples = |unit: f64| move |v: f64| (v / unit).round() * unit;
    // Speeds change, as in traffic.
    let drive = |round: &dyn Fn(f64) -> f64, shift: Vec2| {
        steps(|i, k| {
            let t = k as f64 * DT;
            let s = state(i, t + 0.01 * t * t);
            AgentState { x: round(s.x + shift.x) - shift.x, y: round(s.y + shift.y) - shift.y, ..s }
        })
    };
    let cases: [(&dyn Fn(f64) -> f64, &str); 5] = [
        (&|v| bits(v, 11), "rounded as in float16"),
        (&|v| bits(v, 8), "rounded as in bfloat16"),
        (&multiples(0.1), "to a grid of 0.1"),
        (&multiples(0.05), "to a grid of 0.05"),
        (&multiples(0.3048), "to a grid of 0.3048"),
    ];
    for (round, part) in cases {
        assert_found(&drive(round, Vec2::zeros()), Resolution, part);
    }
    // Rounded in world coordinates, stored in 32 bits.
    let world = drive(&|v| f64::from(multiples(0.1)(v) as f32), Vec2::new(12.34, -56.78));
    assert_found(&world, Resolution, "to a grid of 0.1");
    for fine in [&multiples(0.01) as &dyn Fn(f64) -> f64, &|v| f64::from(v as f32), &|v| v] {
        assert_eq!(found_at(Vec2::zeros(), &drive(fine, Vec2::zeros())), []);
        assert_eq!(found_at(origin, &drive(fine, Vec2::zeros())), []);
    }
    let headings = steps(|i, k| {
        let s = kept(i, k);
        AgentState { heading: multiples(0.02)(s.heading + 0.015 * (7 * k % 5) as f64), ..s }
    });
    assert_found(&headings, Resolution, "the headings look rounded");
}
