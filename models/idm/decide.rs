//! Yield or go: the acceleration that fits between what the others will do.

use reactsim::scene::AgentKind;

use super::actor::Actor;
use super::corridor::{Corridor, Crossing};
use super::driver::{Driver, OnPath};
use super::evade::rolled;
use super::parameters::Parameters;

/// Accelerations that are weighed besides the one that car following asks for, m/s².
const CHOICES: [f64; 9] = [1.0, 0.0, -0.8, -1.6, -2.5, -3.5, -4.5, -5.5, 2.5];
/// Everybody brakes for a crash this close, whoever has the right of way, s.
const IMMINENT: f64 = 1.3;
/// Who comes earlier by more than this goes first; otherwise the order of the agents decides, s.
const CLEARLY: f64 = 0.5;
/// How far two drivers may be apart in what they make of the same two times of arrival, s.
const UNSURE: f64 = 0.4;
/// Curvature of a path that turns, 1/m, and how far ahead it counts, in points of the path.
const TURNING: f64 = 0.05;
const TURN_AHEAD: usize = 25;

/// Chooses an acceleration for the coming interval, or `None` when nobody is in the way of what car following asks for.
pub(super) fn decide(
    index: usize,
    own: &Actor,
    driver: &OnPath,
    corridor: &Corridor,
    following: f64,
    actors: &[Actor],
    drivers: &[Driver],
    parameters: &Parameters,
) -> Option<f64> {
    let weights: Vec<(f64, &Crossing)> = corridor
        .crossings
        .iter()
        .filter_map(|c| Some((weight(index, own, driver, c, actors, drivers, parameters)?, c)))
        .collect();
    if weights.is_empty() {
        return None;
    }
    let cost = |a: f64| -> f64 {
        let mut worst = 0.0_f64;
        for &(weight, crossing) in &weights {
            let av = actors[crossing.actor].is_av;
            let settings = &parameters.conflict;
            let room = if av {
                settings.av_margin + settings.av_time_margin * own.speed * 0.5
            } else {
                settings.margin
            };
            for c in &crossing.covered {
                let (way, speed) = rolled(own.speed, a, c.t);
                let (front, rear) = (driver.s + way + own.half_length, driver.s + way - own.half_length);
                if front + room > c.low && rear - room < c.high {
                    worst = worst.max(weight * harm(c.t, speed));
                    break;
                }
            }
        }
        if a > following {
            worst = worst.max(0.9 * rams(own, driver, corridor, a));
        }
        worst * 100.0 + (a - following).abs()
    };
    let stay = cost(following);
    if stay == 0.0 {
        return None;
    }
    // Who has to yield brakes: to speed up and slip through is for the AV, which may not yield, and for what can no longer be
    // braked for. Two drivers who both speed up meet in the middle.
    let soon = |c: &Crossing| c.covered.first().is_some_and(|f| f.t < IMMINENT);
    let hurry = weights.iter().any(|(_, c)| actors[c.actor].is_av || soon(c));
    let mut best = (stay, following);
    for a in CHOICES.into_iter().filter(|&a| a <= following || hurry) {
        let c = cost(a);
        if c < best.0 {
            best = (c, a);
        }
    }
    Some(best.1)
}

/// How bad a contact is, up to 1: one that is later leaves more time to do better, one at lower speed does less.
fn harm(t: f64, speed: f64) -> f64 {
    (1.0 - 0.15 * t) * (0.6 + 0.4 * (speed / 10.0).min(1.0))
}

/// How bad it would be for the leaders ahead to speed up by `a`.
fn rams(own: &Actor, driver: &OnPath, corridor: &Corridor, a: f64) -> f64 {
    let mut worst = 0.0_f64;
    for leader in &corridor.leaders {
        for k in 1..=5 {
            let t = 0.5 * f64::from(k);
            let (way, speed) = rolled(own.speed, a, t);
            let (lead, _) = rolled(leader.speed, leader.acceleration.min(0.0), t);
            if driver.s + own.half_length + way + 1.0 > leader.rear + lead {
                worst = worst.max(harm(t, (speed - leader.speed).max(0.0)));
                break;
            }
        }
    }
    worst
}

/// How much a crossing counts: 1 where we must yield, less where the other must, nothing where it is not our business.
fn weight(
    index: usize,
    own: &Actor,
    driver: &OnPath,
    crossing: &Crossing,
    actors: &[Actor],
    drivers: &[Driver],
    parameters: &Parameters,
) -> Option<f64> {
    let other = &actors[crossing.actor];
    let first = crossing.covered.first()?;
    if crossing.from_behind {
        // Who comes from behind must look out, but the AV may not.
        return other.is_av.then_some(0.5);
    }
    if other.is_av || other.kind == AgentKind::Pedestrian || first.t == 0.0 {
        return Some(1.0);
    }
    if first.t < IMMINENT {
        return Some(0.8);
    }
    let handicap = |driver: &OnPath| {
        let from = driver.path.index(driver.s);
        let ahead = driver.path.points()[from..].iter().take(TURN_AHEAD);
        let turning = ahead.clone().any(|p| p.curvature.abs() > TURNING);
        let signed =
            driver.stops.iter().any(|s| s.kind != reactsim::scene::StopKind::Light && s.s < driver.s + 30.0);
        f64::from(u8::from(turning)) * parameters.conflict.turn_penalty
            + f64::from(u8::from(signed)) * parameters.conflict.stop_penalty
    };
    let ours = (first.low - driver.s - own.half_length).max(0.0) / own.speed.max(1.5) + handicap(driver);
    let theirs = first.t
        + match &drivers[crossing.actor] {
            Driver::OnPath(d) => handicap(d),
            _ => 0.0,
        };
    // Both sides judge from samples. Where they may not agree who comes first both yield, never neither.
    let we_yield =
        if crossing.actor < index { ours > theirs - CLEARLY - UNSURE } else { ours > theirs + CLEARLY };
    we_yield.then_some(0.9)
}
