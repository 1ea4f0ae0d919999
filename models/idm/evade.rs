//! Getting out of the AV's way: when braking and speeding up along the own path do not help, a swerve may.
//!
//! The AV may come from behind, from the side or head on. A few lateral offsets are tried with a few accelerations against the
//! forecasts; what stays clear of the AV, of the others and of the road edge at the least effort is done.

use reactsim::dynamics::{DrivenPath, Pursuit};
use reactsim::geometry::{Bounds, OrientedBox, Vec2, direction, left, math};
use reactsim::scene::{LaneHit, Road};

use super::actor::Actor;
use super::driver::OnPath;
use super::forecast::Forecast;
use super::parameters::{Class, Conflict};
use super::signals::MustStop;

/// Offsets from the present course that are tried, metres.
const OFFSETS: [f64; 9] = [0.0, 0.8, -0.8, 1.6, -1.6, 2.4, -2.4, 3.4, -3.4];
/// Accelerations that are tried besides the present one.
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
/// Time until a profile changes, s: aside first, where there is room to, then brake.
const SWITCH: f64 = 1.2;
/// Room that must stay to the AV and to others, metres.
const AV_ROOM: f64 = 0.3;
const ROOM: f64 = 0.15;
/// By how much the AV's box grows in thought per second, along and aside, m/s.
const AV_DOUBT_ALONG: f64 = 0.8;
const AV_DOUBT_ASIDE: f64 = 0.1;
/// For how long it grows, s.
const DOUBT_GROWS: f64 = 4.0;
/// Contacts later than this may resolve themselves, s.
const SOON: f64 = 6.0;
/// Time in which the price of a contact falls by e, s.
const PATIENCE: f64 = 2.5;
/// Share of the worst way, against the mean of all, in what the AV threatens.
const DOUBT: f64 = 0.5;
/// What effort costs: a swerve at all, each metre beside the own course, each m/s² of change.
const SWERVE_PRICE: f64 = 4.0;
const OFFSET_PRICE: f64 = 2.0;
const CHANGE_PRICE: f64 = 0.6;
/// What it costs to leave the drivable ground with a wheel or with the middle of the car, and to drive in a lane against its direction.
const WHEEL_PRICE: f64 = 10.0;
const OFFROAD_PRICE: f64 = 60.0;
const AGAINST_PRICE: f64 = 12.0;
/// What it costs to have crossed a line at which one must stop (a red light, a stop sign), after so many seconds.
const RED_PRICE: f64 = 25.0;
const SIGN_PRICE: f64 = 5.0;
const CROSSED: f64 = 3.0;
/// Slower vehicles stand, m/s.
const STANDING: f64 = 0.5;
/// Lateral acceleration of a swerve, m/s².
const SWERVE: f64 = 4.0;

/// An acceleration now and another one after a while, m/s². Only the first part is done before it is thought about again.
#[derive(Clone, Copy, Debug)]
struct Profile {
    now: f64,
    then: f64,
}

impl Profile {
    const fn steady(a: f64) -> Self {
        Self { now: a, then: a }
    }

    /// Way after `t` seconds from `speed`.
    fn way(&self, speed: f64, t: f64) -> f64 {
        let (first, between) = rolled(speed, self.now, t.min(SWITCH));
        if t <= SWITCH { first } else { first + rolled(between, self.then, t - SWITCH).0 }
    }
}

/// What to do.
pub(super) struct Escape {
    /// m/s².
    pub(super) acceleration: f64,
    /// A new course: the offset from the home line, and the path onto it.
    pub(super) course: Option<(f64, DrivenPath)>,
}

/// What a swerve is judged against.
pub(super) struct Surroundings<'a> {
    pub(super) index: usize,
    pub(super) actors: &'a [Actor],
    pub(super) forecasts: &'a [Forecast],
    pub(super) road: Road<'a>,
    pub(super) settings: &'a Conflict,
}

impl Surroundings<'_> {
    fn is_av(&self, forecast: &Forecast) -> bool {
        self.actors[forecast.actor].is_av
    }

    /// Whether the AV may be met on a path at a constant acceleration, as far as can be seen.
    pub(super) fn meets_av(&self, own: &Actor, path: &DrivenPath, s: f64, a: f64) -> bool {
        self.first_contact(own, path, s, Profile::steady(a), |f| self.is_av(f), AV_ROOM).is_some()
    }

    /// What the AV threatens on a path: the mean price of a contact over the ways that it may go.
    fn threat(&self, own: &Actor, path: &DrivenPath, s: f64, a: Profile) -> f64 {
        let reach = self.reach(own);
        let (mut sum, mut worst, mut ways) = (0.0, 0.0_f64, 0);
        for forecast in self.forecasts.iter().filter(|f| self.is_av(f)) {
            ways += 1;
            if forecast.bounds.intersects(&reach) {
                let here = price(self.first_contact(own, path, s, a, |f| std::ptr::eq(f, forecast), AV_ROOM));
                sum += here;
                worst = worst.max(here);
            }
        }
        if ways == 0 { 0.0 } else { DOUBT * worst + (1.0 - DOUBT) * sum / f64::from(ways) }
    }

    fn first_contact(
        &self,
        own: &Actor,
        path: &DrivenPath,
        s: f64,
        profile: Profile,
        counts: impl Fn(&Forecast) -> bool,
        room: f64,
    ) -> Option<f64> {
        let reach = self.reach(own);
        let relevant = self
            .forecasts
            .iter()
            .filter(|f| f.actor != self.index && counts(f) && f.bounds.intersects(&reach));
        let relevant: Vec<&Forecast> = relevant
            // Who is touched already cannot be avoided any more.
            .filter(|f| self.actors[f.actor].footprint().separation(&own.footprint()) > 0.0)
            .collect();
        if relevant.is_empty() {
            return None;
        }
        let last = (SOON / self.settings.sample).round() as usize;
        for k in 1..=last {
            let t = k as f64 * self.settings.sample;
            let point = path.point_at(s + profile.way(own.speed, t));
            let ours = OrientedBox {
                center: point.pose.position,
                axis: point.axis,
                half_length: own.half_length,
                half_width: own.half_width,
            };
            for forecast in &relevant {
                let other = &self.actors[forecast.actor];
                let known = forecast.samples.len();
                if k >= known && known > 1 {
                    continue;
                }
                let sample = forecast.samples[k.min(known - 1)];
                // What the AV will do is less sure the later it is. Who stands reckons with that only towards the rear: others
                // pass by in front of queues all the time.
                let wary = other.is_av && (own.speed > STANDING || sample.axis.dot(&ours.axis) > 0.5);
                let lasting = if wary { t.min(DOUBT_GROWS) } else { 0.0 };
                let doubt = (AV_DOUBT_ALONG * lasting, AV_DOUBT_ASIDE * lasting);
                let theirs = OrientedBox {
                    center: sample.center,
                    axis: sample.axis,
                    half_length: other.half_length + doubt.0,
                    half_width: other.half_width + doubt.1,
                };
                if theirs.separation(&ours) < room {
                    return Some(t);
                }
            }
        }
        None
    }

    fn reach(&self, own: &Actor) -> Bounds {
        Bounds::around(own.pose.position, (own.speed + 4.0) * SOON + own.half_length + 5.0)
    }

    /// Looks for a way out of a contact with the AV that is foreseen at the acceleration `a`.
    pub(super) fn escape(
        &self,
        own: &Actor,
        driver: &OnPath,
        class: &Class,
        a: f64,
        stop: Option<MustStop>,
    ) -> Option<Escape> {
        let present = Profile::steady(a);
        let foreseen = self.threat(own, &driver.path, driver.s, present);
        if foreseen == 0.0 {
            return None;
        }
        let here = driver.home.project(own.pose.position).offset;
        let mut best = (foreseen, a, None);
        for offset in OFFSETS {
            let target = here + offset;
            let aside = OFFSET_PRICE * target.abs() + if offset == 0.0 { 0.0 } else { SWERVE_PRICE };
            if aside >= best.0 {
                continue;
            }
            let swerve = (offset != 0.0).then(|| self.course(own, driver, class, target, self.stretch(own)));
            let (path, s) = swerve.as_ref().map_or((&driver.path, driver.s), |p| (p, 0.0));
            let mut astray = None;
            for profile in std::iter::once(present).chain(PROFILES) {
                let mut cost = aside + CHANGE_PRICE * (profile.now - a).abs();
                let way = profile.way(own.speed, CROSSED);
                if let Some(stop) = stop.filter(|stop| driver.s + own.half_length + way > stop.s) {
                    cost += if stop.strict { RED_PRICE } else { SIGN_PRICE };
                }
                if cost < best.0 {
                    cost += self.threat(own, path, s, profile);
                }
                if cost < best.0 {
                    cost += price(self.first_contact(own, path, s, profile, |f| !self.is_av(f), ROOM));
                }
                if cost < best.0 && swerve.is_some() {
                    cost += *astray.get_or_insert_with(|| self.leads_astray(own, path));
                }
                if cost < best.0 {
                    best = (cost, profile.now, (offset != 0.0).then_some(target));
                }
            }
        }
        let course = best.2.map(|target| (target, self.course(own, driver, class, target, f64::INFINITY)));
        Some(Escape { acceleration: best.1, course })
    }

    /// As far as a vehicle comes while a swerve is judged, metres.
    fn stretch(&self, own: &Actor) -> f64 {
        (own.speed + 2.0) * SOON + 10.0
    }

    /// The path onto the home line moved aside by `target` metres, `longest` metres long at most.
    pub(super) fn course(
        &self,
        own: &Actor,
        driver: &OnPath,
        class: &Class,
        target: f64,
        longest: f64,
    ) -> DrivenPath {
        let fast = own.speed.max(3.0);
        let limit = class.max_curvature.min(SWERVE / (fast * fast));
        let pursuit = Pursuit {
            look_ahead: (0.7 * own.speed).clamp(4.0, 14.0),
            // A curve of the road itself must stay drivable.
            max_curvature: limit.max(driver.sharpest_ahead()).min(class.max_curvature),
            max_curvature_rate: class.curvature_rate.min(12.0 / (fast * fast)).max(0.01),
        };
        let line = driver.home.aside(target);
        let left = (driver.path.length() - driver.s).max(20.0).min(longest);
        let curvature = driver.path.points()[driver.path.index(driver.s)].curvature;
        DrivenPath::pursue(own.pose, curvature, &line, left, &pursuit)
    }

    /// The price of where a swerve leads within the next seconds: off the drivable ground (little for a wheel, much for the middle of
    /// the car) or against the traffic.
    fn leads_astray(&self, own: &Actor, path: &DrivenPath) -> f64 {
        let mut hint = None;
        let mut price = 0.0_f64;
        let mut lanes = Vec::new();
        for k in 1..=4 {
            let point = path.point_at(0.75 * f64::from(k) * own.speed.max(3.0));
            let center = point.pose.position;
            let left = left(point.axis) * own.half_width;
            for (side, here) in [(left, WHEEL_PRICE), (-left, WHEEL_PRICE), (Vec2::zeros(), OFFROAD_PRICE)] {
                if self.road.drivable(center + side, &mut hint) == Some(false) {
                    price = price.max(here);
                }
            }
            self.road.lanes_at(center, &mut lanes);
            let against = |hit: &LaneHit| {
                let lane = self.road.lane(hit.lane).baseline.heading(hit.projection.segment);
                direction(lane).dot(&point.axis) < -0.5
            };
            if !lanes.is_empty() && lanes.iter().all(against) {
                price = price.max(AGAINST_PRICE);
            }
        }
        price
    }
}

/// What a contact after so many seconds costs: the later, the likelier it is to resolve itself.
fn price(contact: Option<f64>) -> f64 {
    contact.map_or(0.0, |t| 100.0 * math::exp(-t / PATIENCE))
}

/// Way and speed after `t` seconds at a constant acceleration; nobody rolls back.
pub(super) fn rolled(speed: f64, a: f64, t: f64) -> (f64, f64) {
    let lasting = if a < 0.0 { t.min(speed / -a) } else { t };
    (speed * lasting + 0.5 * a * lasting * lasting, (speed + a * lasting).max(0.0))
}
