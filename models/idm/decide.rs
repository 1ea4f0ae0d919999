//! Yield or go: the acceleration that fits between what the others will do.

use reactsim::scene::{AgentKind, StopKind};

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
/// How far ahead a stop sign counts, metres.
const SIGN_AHEAD: f64 = 30.0;

/// What a driver decides from.
pub(super) struct Situation<'a> {
    /// Index of the driver's agent.
    pub(super) index: usize,
    pub(super) own: &'a Actor,
    pub(super) driver: &'a OnPath,
    pub(super) corridor: &'a Corridor,
    pub(super) actors: &'a [Actor],
    pub(super) drivers: &'a [Driver],
    pub(super) parameters: &'a Parameters,
}

/// Chooses an acceleration for the coming interval, or `None` when nobody is in the way of what car following asks for.
pub(super) fn decide(at: &Situation<'_>, following: f64) -> Option<f64> {
    let crossings = at.corridor.crossings.iter();
    let weights: Vec<(f64, &Crossing)> = crossings.filter_map(|c| Some((at.weight(c)?, c))).collect();
    if weights.is_empty() {
        return None;
    }
    let settings = &at.parameters.conflict;
    let cost = |a: f64| -> f64 {
        let mut worst = 0.0_f64;
        for &(weight, crossing) in &weights {
            let room = if at.actors[crossing.actor].is_av {
                settings.av_margin + 0.5 * settings.av_time_margin * at.own.speed
            } else {
                settings.margin
            };
            for c in &crossing.covered {
                let (way, speed) = rolled(at.own.speed, a, c.t);
                let (front, rear) =
                    (at.driver.s + way + at.own.half_length, at.driver.s + way - at.own.half_length);
                if front + room > c.low && rear - room < c.high {
                    worst = worst.max(weight * harm(c.t, speed));
                    break;
                }
            }
        }
        if a > following {
            worst = worst.max(0.9 * at.rams(a));
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
    let hurry = weights.iter().any(|(_, c)| at.actors[c.actor].is_av || soon(c));
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

impl Situation<'_> {
    /// How bad it would be for the leaders ahead to speed up by `a`.
    fn rams(&self, a: f64) -> f64 {
        let mut worst = 0.0_f64;
        for leader in &self.corridor.leaders {
            for k in 1..=5 {
                let t = 0.5 * f64::from(k);
                let (way, speed) = rolled(self.own.speed, a, t);
                let (lead, _) = rolled(leader.speed, leader.acceleration.min(0.0), t);
                if self.driver.s + self.own.half_length + way + 1.0 > leader.rear + lead {
                    worst = worst.max(harm(t, (speed - leader.speed).max(0.0)));
                    break;
                }
            }
        }
        worst
    }

    /// How much a crossing counts: 1 where we must yield, less where the other must, nothing where it is not our business.
    fn weight(&self, crossing: &Crossing) -> Option<f64> {
        let other = &self.actors[crossing.actor];
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
        let gap = (first.low - self.driver.s - self.own.half_length).max(0.0);
        let ours = gap / self.own.speed.max(1.5) + self.handicap(self.driver);
        let theirs = match &self.drivers[crossing.actor] {
            Driver::OnPath(driver) => first.t + self.handicap(driver),
            _ => first.t,
        };
        // Both sides judge from samples. Where they may not agree who comes first both yield, never neither.
        let earlier = crossing.actor < self.index;
        let we_yield = if earlier { ours > theirs - CLEARLY - UNSURE } else { ours > theirs + CLEARLY };
        we_yield.then_some(0.9)
    }

    /// What a driver has to let others be ahead by, s: those who turn and those who come from a stop sign wait.
    fn handicap(&self, driver: &OnPath) -> f64 {
        let settings = &self.parameters.conflict;
        let from = driver.path.index(driver.s);
        let turns = driver.path.points()[from..].iter().take(TURN_AHEAD).any(|p| p.curvature.abs() > TURNING);
        let signed = driver.stops.iter().any(|s| s.kind != StopKind::Light && s.s < driver.s + SIGN_AHEAD);
        let turn = if turns { settings.turn_penalty } else { 0.0 };
        turn + if signed { settings.stop_penalty } else { 0.0 }
    }
}
