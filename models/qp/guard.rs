//! The guard: proposed motion is executed as it is while a safe way out remains, and the cheapest maneuver
//! otherwise.
//!
//! A proposal is a motion of some seconds, of which the first steps, up to the next plan, are committed. The
//! guard asks whether after these steps the vehicle can still avoid the AV, whatever the AV is forecast to
//! do: by going on as proposed, by braking, or by going first. If so, it changes nothing. A vehicle therefore
//! reacts to the AV as the proposing network does, and late rather than early where the network does not.

mod course;
mod maneuver;
mod meeting;
mod proposal;

use serde::{Deserialize, Serialize};

use self::course::{Change, Course, Shift};
use self::maneuver::cheapest;
pub(super) use self::proposal::Proposal;
use super::forecast::AvForecast;
use super::mode::Mode;
use super::obstacle::Obstacle;
use super::planned_vehicle::PlannedVehicle;

/// Parameters of the guard.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GuardSettings {
    /// Number of steps of a proposal.
    pub steps: usize,
    /// Deceleration with which a vehicle can give way after the committed steps, m/s².
    pub brake: f64,
    /// Acceleration with which a vehicle can go first after the committed steps, m/s².
    pub accelerate: f64,
    /// Clearance to the AV, metres.
    pub av_clearance: f64,
    /// Clearance to other agents, metres.
    pub clearance: f64,
    /// Time to collision with an AV ahead below which an approach is risky, seconds.
    pub time_to_collision: f64,
    /// Weight of the forecast that the AV brakes, relative to that of the forecast that it goes on.
    pub braking_weight: f64,
    /// Weight of the forecast that the AV keeps its speed.
    pub steady_weight: f64,
    /// Weight of each forecast that the AV follows one of its lanes.
    pub lane_weight: f64,
    /// Whether all corners of a vehicle must stay on the road, as far as they are on it; otherwise only points near
    /// its centre.
    pub corners: bool,
    /// Part of the worst forecast in the cost of a maneuver, from 0 to 1; the weighted mean is the rest.
    pub worst_part: f64,
}

/// Motion of a vehicle until the next plan.
pub(super) enum Decision {
    /// The committed steps of the proposal.
    AsProposed,
    /// A plan along the proposal, because that leaves the road.
    AlongProposal,
    /// Another motion, to be planned along this mode clear of everybody but the AV, which it avoids already.
    Maneuver(Mode),
}

/// The surroundings of a vehicle.
#[derive(Clone, Copy)]
pub(super) struct Surroundings<'a> {
    /// Forecasts of the AV; empty if the AV is absent or planned like everybody else.
    pub(super) av: &'a [(AvForecast, Obstacle)],
    /// All other agents and objects nearby.
    pub(super) others: &'a [&'a Obstacle],
}

impl GuardSettings {
    /// Chooses the motion of a vehicle.
    pub(super) fn decide(
        &self,
        vehicle: &PlannedVehicle<'_>,
        proposal: &Proposal<'_>,
        around: Surroundings<'_>,
    ) -> Decision {
        let maneuver = match self.leaves_way_out(vehicle, proposal, around) {
            true => None,
            false => cheapest(self, vehicle, proposal, around),
        };
        match maneuver {
            Some(mode) => Decision::Maneuver(mode),
            None if proposal.stays_on_road(vehicle) => Decision::AsProposed,
            None => Decision::AlongProposal,
        }
    }

    /// Returns whether for every forecast of the AV some continuation of the committed steps keeps clear of
    /// the AV and of all others.
    fn leaves_way_out(
        &self,
        vehicle: &PlannedVehicle<'_>,
        proposal: &Proposal<'_>,
        around: Surroundings<'_>,
    ) -> bool {
        let after = |change| Course::of(vehicle, proposal, Shift::NONE, change);
        let ways_out = [
            after(Change::AsProposed),
            after(Change::AfterCommitted(-self.brake)),
            after(Change::AfterCommitted(self.accelerate)),
        ];
        let open = ways_out.map(|way| {
            let clear = around.others.iter().all(|o| self.first_meeting(&way, o).is_none());
            clear.then_some(way)
        });
        let mut open = open.iter().flatten().peekable();
        open.peek().is_some()
            && around.av.iter().all(|(_, av)| open.clone().any(|way| self.first_meeting(way, av).is_none()))
    }

    fn weight(&self, forecast: AvForecast) -> f64 {
        match forecast {
            AvForecast::GoesOn => 1.0,
            AvForecast::Brakes => self.braking_weight,
            AvForecast::KeepsSpeed => self.steady_weight,
            AvForecast::FollowsLane => self.lane_weight,
        }
    }
}
