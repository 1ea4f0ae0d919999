//! The problem of one agent's response: its state, its bounds, and the bodies that it must keep clear of.

use reactsim_metrics::pair_counts;
use reactsim_scene::{AgentKind, DT};

use super::AvoidanceSettings;
use super::profile::{Profile, extreme_profile};
use super::responder::Responder;
use super::traffic::{LoggedPair, Traffic, distance};

/// A body that an agent must keep clear of, and by how much.
pub(super) struct OtherBody {
    pub(super) slot: usize,
    pub(super) clearance: f64,
    pub(super) pair: LoggedPair,
}

/// The problem of one agent's response: its state, and the bodies that it must keep clear of.
pub(super) struct Problem<'t> {
    pub(super) traffic: &'t Traffic<'t>,
    pub(super) responder: &'t Responder,
    pub(super) settings: &'t AvoidanceSettings,
    /// Clearance to the AV, metres.
    pub(super) to_av: f64,
    pub(super) slowest: Profile,
    pub(super) fastest: Profile,
    pub(super) desired: Vec<f64>,
    pub(super) others: Vec<OtherBody>,
}

impl<'t> Problem<'t> {
    pub(super) fn new(
        traffic: &'t Traffic<'t>,
        responder: &'t Responder,
        settings: &'t AvoidanceSettings,
    ) -> Self {
        let steps = responder.steps;
        let slowest = extreme_profile(responder.motion, &responder.limits, steps, true);
        let mut fastest = extreme_profile(responder.motion, &responder.limits, steps, false);
        // An agent that cannot stop before that continues to where it can.
        let furthest = responder.furthest.max(slowest.s[steps] + STOP_SLACK);
        fastest.s.iter_mut().for_each(|s| *s = s.min(furthest));
        // An agent that is already closer to the AV than that need not move away.
        let now = distance(&responder.path.footprint(0.0), &traffic.av_box(responder.reaction));
        let to_av = settings.clearance.min(now - 2.0 * INTERVAL_MARGIN).max(0.0);
        let kinds = |i: usize| traffic.scenario.start.agents.get(i).map_or(AgentKind::Other, |a| a.kind);
        // Pairs that the metric ignores are not kept apart.
        let judged = |i: usize| pair_counts(kinds(responder.agent), kinds(i));
        let other = |i: usize| {
            let pair = traffic.pair(responder.agent, i);
            OtherBody {
                slot: i,
                clearance: settings.clearance_to_others.min(pair.closest - CLEARANCE_TOLERANCE),
                pair,
            }
        };
        let others = (1..traffic.bodies())
            .filter(|&i| i != responder.agent && judged(i) && !traffic.never_meet(responder.agent, i))
            .map(other)
            .collect();
        Self {
            traffic,
            responder,
            settings,
            to_av,
            slowest,
            fastest,
            desired: responder.desired_speeds(),
            others,
        }
    }

    /// Returns the name of an agent in messages.
    pub(super) fn name(&self, slot: usize) -> String {
        match slot {
            0 => "the AV".to_owned(),
            _ if slot >= self.traffic.len() => "an obstacle".to_owned(),
            _ => format!("agent `{}`", self.id(slot)),
        }
    }

    pub(super) fn kind(&self) -> AgentKind {
        self.traffic.scenario.start.agents[self.responder.agent].kind
    }

    pub(super) fn id(&self, slot: usize) -> String {
        self.traffic.scenario.start.agents[slot].id.clone()
    }

    /// Returns the speed of the AV at a step, m/s.
    pub(super) fn av_speed(&self, step: usize) -> f64 {
        let v = self.traffic.av[step].speed();
        if v.is_nan() && step > 0 {
            (self.traffic.av[step].position() - self.traffic.av[step - 1].position()).norm() / DT
        } else {
            v
        }
    }
}

/// Assumption about which other agents yield to this one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum YieldAssumption {
    /// Followers yield.
    Followers,
    /// Followers yield, and so do agents that cross the path of this agent after it in the log.
    FollowersAndLaterCrossers,
}

/// Margin added to the clearance when blocked intervals are computed, metres.
pub(super) const INTERVAL_MARGIN: f64 = 0.01;

/// Distance by which two bodies may come closer than in the log if the log brings them close, metres.
const CLEARANCE_TOLERANCE: f64 = 0.03;

/// Extra distance for a halt, metres, so that it need not be the hardest one.
pub(super) const STOP_SLACK: f64 = 0.5;
