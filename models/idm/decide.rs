//! Yielding and gap acceptance: the acceleration that fits between the expected motions of other
//! agents.

use reactsim_scene::{AgentKind, StopKind};

use super::actor::Actor;
use super::corridor::{Corridor, Crossing};
use super::driver::{AgentBehaviour, PathFollower};
use super::own_motion::travelled;
use super::parameters::Parameters;

/// Candidate accelerations, m/s², in addition to that of car following.
const CANDIDATE_ACCELERATIONS: [f64; 9] = [1.0, 0.0, -0.8, -1.6, -2.5, -3.5, -4.5, -5.5, 2.5];
/// Time in seconds to a conflict within which every driver brakes, whoever has the right of way.
const IMMINENT_TIME: f64 = 1.3;
/// Difference in arrival times, in seconds, from which the earlier agent goes first; below it the order
/// of the agents decides.
const ARRIVAL_MARGIN: f64 = 0.5;
/// Largest difference, in seconds, between two drivers' estimates of the same pair of arrival times.
const ARRIVAL_UNCERTAINTY: f64 = 0.4;
/// Curvature from which a path counts as turning, 1/m.
const TURNING_CURVATURE: f64 = 0.05;
/// Number of path points ahead within which a turn counts.
const TURN_AHEAD: usize = 25;
/// Distance ahead within which a stop sign counts, metres.
const SIGN_DISTANCE: f64 = 30.0;

/// Input of a decision.
pub(super) struct Situation<'a> {
    /// Index of the driver's agent.
    pub(super) index: usize,
    pub(super) own: &'a Actor,
    pub(super) driver: &'a PathFollower,
    pub(super) corridor: &'a Corridor,
    pub(super) actors: &'a [Actor],
    pub(super) behaviours: &'a [AgentBehaviour],
    pub(super) parameters: &'a Parameters,
}

/// Chooses an acceleration for the coming interval; `None` if the acceleration of car following,
/// `following`, has no conflict.
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
            let margin = if at.actors[crossing.actor].is_av {
                settings.av_margin + 0.5 * settings.av_time_margin * at.own.speed
            } else {
                settings.margin
            };
            for c in &crossing.covered {
                let (distance, speed) = travelled(at.own.speed, a, c.t);
                let (front, rear) = (
                    at.driver.s + distance + at.own.half_length,
                    at.driver.s + distance - at.own.half_length,
                );
                if front + margin > c.low && rear - margin < c.high {
                    worst = worst.max(weight * severity(c.t, speed));
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
    // A driver who has to yield brakes. Speeding up to slip through is only for conflicts with the AV,
    // which may not yield, and for those too close to brake for. If both drivers sped up, they would
    // meet in the middle.
    let soon = |c: &Crossing| c.covered.first().is_some_and(|f| f.t < IMMINENT_TIME);
    let hurry = weights.iter().any(|(_, c)| at.actors[c.actor].is_av || soon(c));
    let mut best = (stay, following);
    for a in CANDIDATE_ACCELERATIONS.into_iter().filter(|&a| a <= following || hurry) {
        let c = cost(a);
        if c < best.0 {
            best = (c, a);
        }
    }
    Some(best.1)
}

/// Returns the severity of a contact, up to 1: a later one leaves more time to improve, and a slower
/// one does less harm.
fn severity(t: f64, speed: f64) -> f64 {
    (1.0 - 0.15 * t) * (0.6 + 0.4 * (speed / 10.0).min(1.0))
}

impl Situation<'_> {
    /// Returns the severity of the contact with a leader after speeding up by `a`.
    fn rams(&self, a: f64) -> f64 {
        let mut worst = 0.0_f64;
        for leader in &self.corridor.leaders {
            for k in 1..=5 {
                let t = 0.5 * f64::from(k);
                let (distance, speed) = travelled(self.own.speed, a, t);
                let (lead, _) = travelled(leader.speed, leader.acceleration.min(0.0), t);
                if self.driver.s + self.own.half_length + distance + 1.0 > leader.rear + lead {
                    worst = worst.max(severity(t, (speed - leader.speed).max(0.0)));
                    break;
                }
            }
        }
        worst
    }

    /// Returns the weight of a conflict: 1 where this driver must yield, less where the other must,
    /// `None` where it does not concern this driver.
    fn weight(&self, crossing: &Crossing) -> Option<f64> {
        let other = &self.actors[crossing.actor];
        let first = crossing.covered.first()?;
        if crossing.from_behind {
            // An agent from behind must yield, but the AV may not.
            return other.is_av.then_some(0.5);
        }
        if other.is_av || other.kind == AgentKind::Pedestrian || first.t == 0.0 {
            return Some(1.0);
        }
        if first.t < IMMINENT_TIME {
            return Some(0.8);
        }
        let gap = (first.low - self.driver.s - self.own.half_length).max(0.0);
        let ours = gap / self.own.speed.max(1.5) + self.handicap(self.driver);
        let theirs = match &self.behaviours[crossing.actor] {
            AgentBehaviour::OnPath(driver) => first.t + self.handicap(driver),
            _ => first.t,
        };
        // Both drivers judge from samples. Where they may disagree on who arrives first, both yield,
        // never neither.
        let earlier = crossing.actor < self.index;
        let we_yield = if earlier {
            ours > theirs - ARRIVAL_MARGIN - ARRIVAL_UNCERTAINTY
        } else {
            ours > theirs + ARRIVAL_MARGIN
        };
        we_yield.then_some(0.9)
    }

    /// Returns the handicap of a driver in arrival time, s: turning vehicles and those from a stop sign
    /// yield.
    fn handicap(&self, driver: &PathFollower) -> f64 {
        let settings = &self.parameters.conflict;
        let from = driver.path.index(driver.s);
        let turns = driver.path.points()[from..]
            .iter()
            .take(TURN_AHEAD)
            .any(|p| p.curvature.abs() > TURNING_CURVATURE);
        let signed = driver.stops.iter().any(|s| s.kind != StopKind::Light && s.s < driver.s + SIGN_DISTANCE);
        let turn = if turns { settings.turn_penalty } else { 0.0 };
        turn + if signed { settings.stop_penalty } else { 0.0 }
    }
}
