//! Evasion of the AV: when braking and speeding up along the own path do not help, a swerve may.
//!
//! The AV may come from behind, from the side or head on. A few lateral offsets are combined with a few
//! accelerations and checked against the forecasts. The cheapest combination that stays clear of the
//! AV, of other agents and of the road edge is chosen.

use reactsim_geometry::{Bounds, OrientedBox, Vec2, direction, left, math};
use reactsim_scene::dynamics::DrivenPath;
use reactsim_scene::{LaneHit, Road};

use super::actor::Actor;
use super::driver::PathFollower;
use super::forecast::Forecast;
use super::heights::PathHeights;
use super::own_motion::{OwnMotion, Profile};
use super::parameters::{Class, Conflict};
use super::signals::RequiredStop;
use super::strip::Strip;

/// Candidate offsets from the present lateral position, metres.
const OFFSETS: [f64; 9] = [0.0, 0.8, -0.8, 1.6, -1.6, 2.4, -2.4, 3.4, -3.4];
/// Candidate acceleration profiles, in addition to the present acceleration.
const PROFILES: [Profile; 8] = [
    Profile::steady(3.5),
    Profile::steady(1.5),
    Profile::steady(0.0),
    Profile { now: 1.5, then: -3.0 },
    Profile { now: 0.0, then: -4.0 },
    Profile { now: -2.0, then: -4.0 },
    Profile::steady(-2.5),
    Profile::steady(-5.5),
];
/// Clearance to the AV, metres.
const AV_CLEARANCE: f64 = 0.3;
/// Clearance to other agents, metres.
const CLEARANCE: f64 = 0.15;
/// Largest distance of two boxes per metre of their separation, slightly more than √2: the separating axis
/// that is nearest to the direction from box to box is at most 45° away.
const DISTANCE_PER_SEPARATION: f64 = 1.415;
/// Margin for rounding, metres.
const GAP_MARGIN: f64 = 1e-6;
/// Growth of the half length of the AV's forecast box per second, m/s.
const AV_GROWTH_ALONG: f64 = 0.8;
/// Growth of the half width of the AV's forecast box per second, m/s.
const AV_GROWTH_ACROSS: f64 = 0.1;
/// Duration of this growth, seconds.
const GROWTH_DURATION: f64 = 4.0;
/// Horizon of contacts, seconds: later ones may resolve themselves.
pub(super) const CONTACT_HORIZON: f64 = 6.0;
/// Time constant, in seconds, with which the cost of a later contact decays.
const CONTACT_DECAY_TIME: f64 = 2.5;
/// Weight of the worst forecast of the AV; the mean over all its forecasts has the rest.
const WORST_CASE_WEIGHT: f64 = 0.5;
/// Cost of any swerve.
const SWERVE_COST: f64 = 4.0;
/// Cost per metre of offset from the home line.
const OFFSET_COST: f64 = 2.0;
/// Cost per m/s² of change of the acceleration.
const CHANGE_COST: f64 = 0.6;
/// Cost of leaving the drivable area with a wheel.
const WHEEL_COST: f64 = 10.0;
/// Cost of leaving the drivable area with the middle of the vehicle.
const OFFROAD_COST: f64 = 60.0;
/// Cost of driving in a lane against its direction.
const WRONG_WAY_COST: f64 = 12.0;
/// Cost of crossing the stop line of a red light, or the end of the drivable area.
const RED_COST: f64 = 25.0;
/// Cost of crossing the line of a stop sign without stopping.
const SIGN_COST: f64 = 5.0;
/// Time after which the crossing of a stop line is judged, seconds.
const CROSSING_TIME: f64 = 3.0;
/// Speed in m/s below which a vehicle stands.
const STANDSTILL_SPEED: f64 = 0.5;

/// Chosen evasion.
pub(super) struct Escape {
    /// Acceleration, m/s².
    pub(super) acceleration: f64,
    /// Offset from the home line and path to it, if the driver swerves.
    pub(super) course: Option<(f64, DrivenPath)>,
}

/// Agents and road that a swerve is checked against.
pub(super) struct Surroundings<'a> {
    pub(super) index: usize,
    pub(super) actors: &'a [Actor],
    /// Present boxes of the actors.
    pub(super) footprints: &'a [OrientedBox],
    /// Forecasts of the AV.
    pub(super) of_av: &'a [Forecast],
    /// Forecasts of all other actors.
    pub(super) of_others: &'a [Forecast],
    pub(super) road: Road<'a>,
    /// Bounds of the path that the driver follows, if it bends little.
    pub(super) strip: Option<Strip>,
    /// Heights along the path that the driver follows.
    pub(super) heights: PathHeights,
    pub(super) settings: &'a Conflict,
}

impl Surroundings<'_> {
    /// Returns whether a path at a constant acceleration meets a forecast of the AV within the horizon.
    pub(super) fn meets_av(&self, own: &Actor, path: &DrivenPath, s: f64, a: f64) -> bool {
        let av = self.avoidable(own, self.of_av);
        self.first_contact(&mut self.motion(own, path, s, Profile::steady(a)), &av, AV_CLEARANCE).is_some()
    }

    /// Returns the motion along a path from arc length `s`.
    fn motion<'m>(&self, own: &'m Actor, path: &'m DrivenPath, s: f64, profile: Profile) -> OwnMotion<'m> {
        let count = (CONTACT_HORIZON / self.settings.sample).round() as usize;
        OwnMotion::new(own, path, s, profile, self.settings.sample, count)
    }

    /// Returns the forecasts within reach whose actors do not touch the vehicle yet: a contact that exists
    /// already cannot be avoided.
    fn avoidable<'f>(&self, own: &Actor, forecasts: &'f [Forecast]) -> Vec<&'f Forecast> {
        let reach = self.reach(own);
        let is_avoidable = |f: &&Forecast| {
            f.actor != self.index
                && f.bounds.intersects(&reach)
                && self.footprints[f.actor].separation(&self.footprints[self.index]) > 0.0
        };
        forecasts.iter().filter(is_avoidable).collect()
    }

    /// Returns the cost of contacts with the AV: a weighted sum of the worst and the mean over the AV's
    /// forecasts, of which `av` are avoidable.
    fn av_contact_cost(&self, motion: &mut OwnMotion<'_>, av: &[&Forecast]) -> f64 {
        let (mut sum, mut worst) = (0.0, 0.0_f64);
        for forecast in av {
            let here = contact_cost(self.first_contact(motion, std::slice::from_ref(forecast), AV_CLEARANCE));
            sum += here;
            worst = worst.max(here);
        }
        if self.of_av.is_empty() {
            0.0
        } else {
            WORST_CASE_WEIGHT * worst + (1.0 - WORST_CASE_WEIGHT) * sum / self.of_av.len() as f64
        }
    }

    /// Returns the time, in seconds, of the first contact with one of the forecasts.
    fn first_contact(
        &self,
        motion: &mut OwnMotion<'_>,
        forecasts: &[&Forecast],
        clearance: f64,
    ) -> Option<f64> {
        let swept = motion.bounds.map(|bounds| bounds.inflated(DISTANCE_PER_SEPARATION * clearance));
        let mut first: Option<usize> = None;
        for forecast in forecasts {
            let apart = swept.is_some_and(|swept| !swept.intersects(&self.widest(forecast)))
                || self.is_beside(motion, forecast, clearance);
            if !apart && let Some(k) = self.contact(motion, forecast, clearance) {
                first = Some(first.map_or(k, |first| first.min(k)));
            }
        }
        first.map(|k| k as f64 * self.settings.sample)
    }

    /// Returns whether all of a motion is farther than the clearance to the side of a forecast.
    fn is_beside(&self, motion: &OwnMotion<'_>, forecast: &Forecast, clearance: f64) -> bool {
        let (own, other) = (motion.own, &self.actors[forecast.actor]);
        let lasting = if other.is_av { GROWTH_DURATION } else { 0.0 };
        let other =
            (other.half_length + AV_GROWTH_ALONG * lasting, other.half_width + AV_GROWTH_ACROSS * lasting);
        let distance =
            |strip: &Strip| strip.distance_at_least((own.half_length, own.half_width), &forecast.band, other);
        motion.strip().is_some_and(|strip| distance(strip) > DISTANCE_PER_SEPARATION * clearance)
    }

    /// Returns bounds of a forecast with the growth of the AV's box.
    fn widest(&self, forecast: &Forecast) -> Bounds {
        let grows = if self.actors[forecast.actor].is_av { AV_GROWTH_ALONG + AV_GROWTH_ACROSS } else { 0.0 };
        forecast.bounds.inflated(grows * GROWTH_DURATION)
    }

    /// Returns the number of the first sample at which the vehicle is closer to a forecast than the
    /// clearance.
    fn contact(&self, motion: &mut OwnMotion<'_>, forecast: &Forecast, clearance: f64) -> Option<usize> {
        let (own, other) = (motion.own, &self.actors[forecast.actor]);
        let known = forecast.samples.len();
        let last = if known > 1 { motion.count.min(known - 1) } else { motion.count };
        let near = own.radius() + other.radius() + DISTANCE_PER_SEPARATION * clearance;
        let growing = if other.is_av { AV_GROWTH_ALONG + AV_GROWTH_ACROSS } else { 0.0 };
        // Length by which the boxes approach per sample at most. Samples at which they are too far apart for
        // that are passed over.
        let closing = (motion.top_speed + forecast.band.speed + growing) * self.settings.sample;
        let passed = |gap: f64| ((gap - GAP_MARGIN) / closing).min(last as f64) as usize;
        let mut k = 1;
        while k <= last {
            let sample = &forecast.samples[k.min(known - 1)];
            let lasting = (k as f64 * self.settings.sample).min(GROWTH_DURATION);
            let reach = near + growing * lasting;
            let gap = |p: Vec2, reach: f64| (sample.center - p).norm() - reach;
            let about = motion.about(k).map(|p| gap(p, reach + DrivenPath::STEP));
            if let Some(gap) = about.filter(|gap| *gap > GAP_MARGIN) {
                k += 1 + passed(gap);
                continue;
            }
            let ours = motion.at(k);
            let gap = gap(ours.center, reach);
            if gap > GAP_MARGIN {
                k += 1 + passed(gap);
                continue;
            }
            // The AV's forecast is less certain the later it is. A standing vehicle considers that only for
            // an AV in its own direction: others pass in front of queues all the time.
            let heads = if sample.speed < 0.0 { -sample.axis } else { sample.axis };
            let wary = other.is_av && (own.speed > STANDSTILL_SPEED || heads.dot(&ours.axis) > 0.5);
            let lasting = if wary { lasting } else { 0.0 };
            let growth = (AV_GROWTH_ALONG * lasting, AV_GROWTH_ACROSS * lasting);
            let theirs = other.box_at(sample.center, sample.axis, growth);
            if theirs.separation(&ours) < clearance && !self.heights.is_apart_at(ours.center, sample.height) {
                return Some(k);
            }
            k += 1;
        }
        None
    }

    fn reach(&self, own: &Actor) -> Bounds {
        Bounds::around(own.pose.position, (own.speed + 4.0) * CONTACT_HORIZON + own.half_length + 5.0)
    }

    /// Searches an evasion of a contact with the AV that is forecast at the acceleration `a`.
    pub(super) fn escape(
        &self,
        own: &Actor,
        driver: &PathFollower,
        class: &Class,
        a: f64,
        stop: Option<RequiredStop>,
    ) -> Option<Escape> {
        let present = Profile::steady(a);
        let av = self.avoidable(own, self.of_av);
        let kept_path = |profile| self.motion(own, &driver.path, driver.s, profile).with_strip(self.strip);
        let foreseen = self.av_contact_cost(&mut kept_path(present), &av);
        if foreseen == 0.0 {
            return None;
        }
        let others = self.avoidable(own, self.of_others);
        let here = driver.home.project(own.pose.position).offset;
        let mut best = (foreseen, a, None);
        for offset in OFFSETS {
            let target = here + offset;
            let aside = OFFSET_COST * target.abs() + if offset == 0.0 { 0.0 } else { SWERVE_COST };
            if aside >= best.0 {
                continue;
            }
            let swerve =
                (offset != 0.0).then(|| driver.path_at_offset(own, class, target, self.judged_length(own)));
            let mut off_lane = None;
            for profile in std::iter::once(present).chain(PROFILES) {
                let mut cost = aside + CHANGE_COST * (profile.now - a).abs();
                let distance = profile.distance(own.speed, CROSSING_TIME);
                if let Some(stop) = stop.filter(|stop| driver.s + own.half_length + distance > stop.s) {
                    cost += if stop.strict { RED_COST } else { SIGN_COST };
                }
                let mut motion = swerve
                    .as_ref()
                    .map_or_else(|| kept_path(profile), |path| self.motion(own, path, 0.0, profile));
                if cost < best.0 {
                    cost += self.av_contact_cost(&mut motion, &av);
                }
                if cost < best.0 {
                    cost += contact_cost(self.first_contact(&mut motion, &others, CLEARANCE));
                }
                if let Some(path) = swerve.as_ref().filter(|_| cost < best.0) {
                    cost += *off_lane.get_or_insert_with(|| self.cost_off_lane(own, path));
                }
                if cost < best.0 {
                    best = (cost, profile.now, (offset != 0.0).then_some(target));
                }
            }
        }
        let course = best.2.map(|target| (target, driver.path_at_offset(own, class, target, f64::INFINITY)));
        Some(Escape { acceleration: best.1, course })
    }

    /// Returns the length of path that is needed to judge a swerve, metres.
    fn judged_length(&self, own: &Actor) -> f64 {
        (own.speed + 2.0) * CONTACT_HORIZON + 10.0
    }

    /// Returns the cost of leaving the drivable area (low for a wheel, high for the middle of the
    /// vehicle) or of driving against the traffic within the next seconds of a swerve.
    fn cost_off_lane(&self, own: &Actor, path: &DrivenPath) -> f64 {
        let mut hint = None;
        let mut cost = 0.0_f64;
        let mut lanes = Vec::new();
        for k in 1..=4 {
            let point = path.point_at(0.75 * f64::from(k) * own.speed.max(3.0));
            let center = point.pose.position;
            let left = left(point.axis) * own.half_width;
            for (side, here) in [(left, WHEEL_COST), (-left, WHEEL_COST), (Vec2::zeros(), OFFROAD_COST)] {
                if self.road.drivable(center + side, &mut hint) == Some(false) {
                    cost = cost.max(here);
                }
            }
            self.road.lanes_at(center, &mut lanes);
            let against = |hit: &LaneHit| {
                let lane = self.road.lane(hit.lane).baseline.heading(hit.projection.segment);
                direction(lane).dot(&point.axis) < -0.5
            };
            if !lanes.is_empty() && lanes.iter().all(against) {
                cost = cost.max(WRONG_WAY_COST);
            }
        }
        cost
    }
}

/// Returns the cost of a contact at a time: a later one is more likely to resolve itself.
fn contact_cost(contact: Option<f64>) -> f64 {
    contact.map_or(0.0, |t| 100.0 * math::exp(-t / CONTACT_DECAY_TIME))
}
