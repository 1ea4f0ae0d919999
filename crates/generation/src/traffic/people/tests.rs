use reactsim_geometry::{OrientedBox, Polyline, direction, rounded_distance};
use reactsim_rollout::{Purpose, stream};
use reactsim_scene::{LaneParts, LightState, MapParts};

use super::*;
use crate::{Footway, SignalPlan};

const DT: f64 = 0.1;

/// Returns the vehicles that approach crossings if all drive straight on, computed from their boxes alone.
fn straight_approaches(layout: &Layout, crossings: &[Crossing], vehicles: &[Vehicle]) -> Vec<Approach> {
    let mut found = Vec::new();
    for (i, crossing) in crossings.iter().enumerate() {
        let footway = &layout.footways[crossing.footway];
        for v in vehicles {
            let ahead = direction(v.heading);
            let at = footway.line.project(v.position);
            if at.distance > 60.0 || (at.distance > 8.0 && v.speed < 0.4) {
                continue;
            }
            for k in 0..footway.line.segments() {
                let (a, b) = footway.line.segment(k);
                let (ab, cross) = (b - a, ahead.perp(&(b - a)));
                if cross.abs() < 1e-3 * ab.norm() {
                    continue;
                }
                let (far, t) = ((a - v.position).perp(&ab) / cross, (a - v.position).perp(&ahead) / cross);
                if !(0.0..=1.0).contains(&t) || far < -0.5 * v.length {
                    continue;
                }
                found.push(Approach {
                    crossing: i,
                    at: footway.line.arc()[k] + t * ab.norm(),
                    distance: far - 0.5 * v.length - 0.5 * footway.width,
                    speed: v.speed,
                    acceleration: v.acceleration,
                    length: v.length,
                    width: v.width,
                });
            }
        }
    }
    found
}

/// Returns a street along x with one lane per direction, a pavement on either side, and a crossing at x = 0
/// that joins them.
pub(super) fn street(light: bool) -> Layout {
    let line =
        |a: (f64, f64), b: (f64, f64)| Polyline::new(&[Vec2::new(a.0, a.1), Vec2::new(b.0, b.1)]).unwrap();
    let lane = |id: &str, y: f64, x: f64| LaneParts {
        id: id.into(),
        speed_limit: Some(11.0),
        points: vec![Vec2::new(-x, y), Vec2::new(x, y)],
        ..LaneParts::default()
    };
    let pavement = |a: f64, b: f64, y: f64| Footway {
        line: line((a, y), (b, y)),
        heights: Vec::new(),
        width: 2.4,
        crossing: false,
        crosses: Vec::new(),
        waits_for: Vec::new(),
    };
    let phases = vec![(LightState::Go, 18.0), (LightState::Caution, 3.0), (LightState::Stop, 19.0)];
    let signal =
        |lane: &str| SignalPlan { lane: lane.into(), stop_point: Vec2::zeros(), phases: phases.clone() };
    Layout {
        map: MapParts {
            lanes: vec![lane("east", -1.75, 60.0), lane("west", 1.75, -60.0)],
            ..MapParts::default()
        },
        signals: if light { vec![signal("east"), signal("west")] } else { Vec::new() },
        footways: vec![
            pavement(-60.0, 0.0, -5.2),
            pavement(0.0, 60.0, -5.2),
            // The other side is a single piece, with the crossing in its middle.
            pavement(-60.0, 60.0, 5.2),
            Footway {
                line: line((0.0, -5.2), (0.0, 5.2)),
                heights: Vec::new(),
                width: 3.5,
                crossing: true,
                crosses: vec!["east".into(), "west".into()],
                waits_for: if light { vec!["east".into(), "west".into()] } else { Vec::new() },
            },
        ],
        ..Layout::default()
    }
}

/// Draws crowds until one has at least `wanted` people.
pub(super) fn crowd(layout: &Layout, number: u32, wanted: usize) -> Crowd {
    let mut rng = stream(0, "people", number, Purpose::Traffic);
    loop {
        let crowd = Crowd::new(layout, 4.0, &mut rng);
        if crowd.walkers.len() >= wanted {
            return crowd;
        }
    }
}

fn on_road(p: Vec2) -> bool {
    p.y.abs() < 3.5
}

fn bodies(crowd: &Crowd) -> Vec<OrientedBox> {
    crowd.people().map(|p| OrientedBox::new(p.position, p.heading, p.length, p.width)).collect()
}

/// Cars that arrive from both sides at 10 m/s every few seconds, and stop before the crossing if somebody
/// is on it or wants to be.
struct Cars {
    cars: Vec<(f64, f64, f64)>,
    time: f64,
    yields: bool,
}

impl Cars {
    fn step(&mut self, crossing: &Crossing) -> Vec<Vehicle> {
        self.time += DT;
        if self.time % 6.0 < DT {
            self.cars.push((-60.0, 10.0, 1.0));
        }
        if (self.time + 2.6) % 7.0 < DT {
            self.cars.push((-60.0, 10.0, -1.0));
        }
        self.cars.retain(|c| c.0 < 60.0);
        let wanted = crossing.people.iter().any(|c| c.intent != Intent::Waiting || self.yields);
        let fronts: Vec<(f64, f64)> = self.cars.iter().map(|c| (c.0, c.2)).collect();
        let mut boxes = Vec::new();
        for (x, speed, direction) in &mut self.cars {
            let stop = -2.2 - 1.75 - *x - 1.0;
            let needed = *speed * *speed / (2.0 * stop.max(0.1));
            let ahead = fronts.iter().filter(|f| f.1 == *direction && f.0 > *x).map(|f| f.0 - *x - 6.5);
            let gap = ahead.fold(f64::INFINITY, f64::min);
            let follow = (*speed * *speed / (2.0 * gap.max(0.1)) > 2.0) as i32 as f64;
            let braking = if wanted && stop > 0.0 && needed < 3.5 && stop < 30.0 {
                needed
            } else {
                follow * (*speed * *speed / (2.0 * gap.max(0.1))).min(6.0)
            };
            let held = wanted && (-1.5..=0.0).contains(&stop);
            let a = if held {
                -6.0
            } else if braking > 0.0 {
                -braking
            } else {
                (10.0 - *speed).clamp(0.0, 1.5)
            };
            *speed = (*speed + a * DT).max(0.0);
            *x += *speed * DT;
            boxes.push(Vehicle {
                position: Vec2::new(*x * *direction, -1.75 * *direction),
                heading: if *direction > 0.0 { 0.0 } else { std::f64::consts::PI },
                speed: *speed,
                acceleration: a,
                length: 4.6,
                width: 2.0,
            });
        }
        boxes
    }
}

#[test]
fn nobody_overlaps_strays_or_vanishes() {
    let layout = street(false);
    for number in 0..6 {
        let mut crowd = crowd(&layout, number, 4 + 4 * number as usize);
        let mut cars = Cars { cars: Vec::new(), time: 0.0, yields: true };
        let mut before: Vec<Person> = crowd.people().collect();
        let mut crossed = 0;
        for step in 0..600 {
            let vehicles = cars.step(&crowd.crossings()[0]);
            let approaches = straight_approaches(&layout, crowd.crossings(), &vehicles);
            crowd.step(DT, &Surroundings { vehicles: &vehicles, approaches: &approaches, lights: &[] });
            let now: Vec<Person> = crowd.people().collect();
            let boxes = bodies(&crowd);
            for (i, a) in boxes.iter().enumerate() {
                for (j, b) in boxes[..i].iter().enumerate() {
                    let d = rounded_distance(a, b, 0.7);
                    assert!(d > 0.0, "{number} {step}: {:?} and {:?}: {d}", now[i], now[j]);
                }
                for v in &vehicles {
                    let car = OrientedBox::new(v.position, v.heading, v.length, v.width);
                    assert!(rounded_distance(a, &car, 0.7) > 0.0, "{number} {step}: {:?} and {v:?}", now[i]);
                }
            }
            for p in &now {
                assert!(
                    !on_road(p.position) || p.position.x.abs() < 1.8,
                    "{number} {step}: on the road: {p:?}"
                );
                assert!(p.position.y.abs() < 6.5, "{number} {step}: off the pavement: {p:?}");
                crossed += usize::from(p.position.y.abs() < 0.2);
                match before.iter().find(|q| q.id == p.id) {
                    Some(q) => {
                        let moved = (p.position - q.position) / DT;
                        assert!((moved - p.velocity).norm() < 1e-9);
                        assert!(p.velocity.norm() < 4.3, "{p:?}");
                    }
                    None => assert!(p.position.x.abs() > 59.0, "came inside: {p:?}"),
                }
            }
            for q in &before {
                assert!(now.iter().any(|p| p.id == q.id) || q.position.x.abs() > 58.0, "vanished: {q:?}");
            }
            before = now;
        }
        assert!(number == 0 || crossed > 0, "{number}: nobody crossed");
    }
}

#[test]
fn people_wait_at_red_and_are_across_in_time() {
    let layout = street(true);
    let mut crowd = crowd(&layout, 7, 25);
    let (mut waited, mut crossed) = (0, 0);
    for step in 0..1600 {
        let time = f64::from(step) * DT;
        let light = WalkLight::at(&layout, 3, time);
        assert_eq!(light.may_go, time.rem_euclid(40.0) >= 21.0, "{time}");
        crowd.step(DT, &Surroundings { lights: &[light], ..Surroundings::default() });
        let phase = time.rem_euclid(40.0);
        for p in crowd.people() {
            assert!(!(p.position.y.abs() < 3.0 && (3.0..21.0).contains(&phase)), "{time}: at red: {p:?}");
            let at_kerb = p.position.x.abs() < 2.0 && (3.5..4.6).contains(&p.position.y.abs());
            waited += usize::from(at_kerb && p.velocity.norm() == 0.0);
            crossed += usize::from(p.position.y.abs() < 0.1);
        }
        assert!(crowd.crossings()[0].people.iter().all(|c| c.intent != Intent::Waiting));
    }
    assert!(waited > 100 && crossed > 5, "{waited} {crossed}");
}

#[test]
fn people_yield_to_vehicles_that_cannot_stop() {
    let layout = street(false);
    let crossing = |distance, speed| Approach {
        crossing: 0,
        at: 3.45,
        distance,
        speed,
        acceleration: 0.0,
        length: 4.6,
        width: 2.0,
    };
    assert!(crossing(40.0, 10.0).can_stop() && !crossing(12.0, 10.0).can_stop());
    // A stream of cars that never yield, 2.5 s apart: too short a gap to cross a lane with a second to
    // spare.
    let mut crowd = crowd(&layout, 8, 20);
    for step in 0..600 {
        let phase = (f64::from(step) * DT * 10.0).rem_euclid(25.0);
        let approaches: Vec<Approach> = [crossing(25.0 - phase, 10.0), crossing(50.0 - phase, 10.0)]
            .into_iter()
            .flat_map(|a| [a, Approach { at: 6.95, ..a }])
            .map(|a| Approach { distance: a.distance.min(25.0), ..a })
            .collect();
        crowd.step(DT, &Surroundings { approaches: &approaches, ..Surroundings::default() });
        if step > 150 {
            let strayed = crowd.walkers.iter().find(|w| w.position.y.abs() <= 3.4);
            assert!(strayed.is_none(), "{step}: {strayed:?}");
        }
    }
    assert!(crowd.crossings()[0].people.iter().any(|c| c.intent == Intent::Waiting));
}

#[test]
fn speeds_are_those_of_people() {
    let layout = street(false);
    let (mut speeds, mut hard, mut steps, mut standing, mut all) = (Vec::new(), 0, 0, 0, 0);
    for number in 0..20 {
        let mut crowd = crowd(&layout, 100 + number, 6);
        let mut before: Vec<Person> = Vec::new();
        for step in 0..200 {
            crowd.step(DT, &Surroundings::default());
            let now: Vec<Person> = crowd.people().collect();
            if step > 50 {
                for p in &now {
                    all += 1;
                    let speed = p.velocity.norm();
                    if speed < 0.3 {
                        standing += 1;
                    } else {
                        speeds.push(speed);
                    }
                    if let Some(q) = before.iter().find(|q| q.id == p.id) {
                        steps += 1;
                        hard += usize::from((p.velocity - q.velocity).norm() / DT > 2.5);
                    }
                }
            }
            before = now;
        }
    }
    speeds.sort_by(f64::total_cmp);
    let at = |q: f64| speeds[(speeds.len() as f64 * q) as usize];
    assert!((0.55..1.0).contains(&at(0.1)), "{}", at(0.1));
    assert!((1.1..1.35).contains(&at(0.5)), "{}", at(0.5));
    assert!((1.4..1.8).contains(&at(0.9)), "{}", at(0.9));
    assert!(hard * 100 < steps, "{hard} of {steps} steps speed up or brake hard");
    let share = f64::from(standing) / f64::from(all);
    assert!((0.03..0.25).contains(&share), "{share}");
}

#[test]
fn the_stream_decides() {
    let layout = street(true);
    let run = |number| {
        let mut crowd = crowd(&layout, number, 5);
        for _ in 0..300 {
            crowd.step(DT, &Surroundings::default());
        }
        crowd.people().collect::<Vec<_>>()
    };
    assert_eq!(run(3), run(3));
    assert_ne!(run(3), run(4));
}

#[test]
fn numbers_stay_about_the_same_and_vary_between_days() {
    let layout = street(false);
    let mut crowd = crowd(&layout, 9, 15);
    let wanted = crowd.wanted;
    let mut counts = Vec::new();
    for _ in 0..1800 {
        crowd.step(DT, &Surroundings::default());
        counts.push(crowd.walkers.len());
    }
    let mean = counts.iter().sum::<usize>() as f64 / counts.len() as f64;
    assert!((mean / wanted as f64 - 1.0).abs() < 0.3, "{mean} of {wanted}");
    let days: Vec<usize> = (0..200)
        .map(|n| Crowd::new(&layout, 1.0, &mut stream(0, "days", n, Purpose::Traffic)).walkers.len())
        .collect();
    assert!(days.iter().filter(|&&n| n == 0).count() > 20 && days.iter().any(|&n| n >= 6), "{days:?}");
}

#[test]
fn a_map_without_footways_has_no_people() {
    let mut rng = stream(0, "none", 0, Purpose::Traffic);
    let mut crowd = Crowd::new(&Layout::default(), 1.0, &mut rng);
    crowd.step(DT, &Surroundings::default());
    assert_eq!(crowd.people().count(), 0);
}

#[test]
fn people_on_different_levels_ignore_each_other() {
    let mut layout = street(false);
    let heights = |z: f64| vec![z; 2];
    for (i, footway) in layout.footways.iter_mut().enumerate() {
        footway.heights = heights(if i == 2 { 6.0 } else { 0.0 });
    }
    let crowd = crowd(&layout, 3, 4);
    for person in crowd.people() {
        assert_eq!(person.height, Some(if person.position.y > 3.0 { 6.0 } else { 0.0 }));
    }
    let mut walkers = crowd.walkers.clone();
    walkers.truncate(2);
    walkers[1].position = walkers[0].position;
    let mut buffers = StepBuffers::default();
    for (height, pairs) in [(0.0, 1), (6.0, 0)] {
        buffers.heights = vec![Some(0.0), Some(height)];
        buffers.pair(&walkers);
        assert_eq!((buffers.pairs.len(), buffers.near.len()), (pairs, pairs), "{height} m");
    }
}
