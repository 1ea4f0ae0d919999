//! Where everybody will be in the next four seconds, as far as anybody can tell.

use reactsim::dynamics::DrivenPath;
use reactsim::geometry::{Bounds, Vec2, direction, math};

use super::actor::Actor;
use super::driver::Driver;
use super::parameters::Conflict;

/// One predicted box.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sample {
    pub(super) center: Vec2,
    /// Unit vector along the heading.
    pub(super) axis: Vec2,
    /// m/s.
    pub(super) speed: f64,
}

/// One way that an actor may move. The AV, whose intent is unknown, may have several.
#[derive(Clone, Debug)]
pub(super) struct Forecast {
    /// Index of the actor.
    pub(super) actor: usize,
    /// One sample now and one after every sampling interval; a single one for what stands.
    pub(super) samples: Vec<Sample>,
    /// Bounds of all boxes.
    pub(super) bounds: Bounds,
}

/// How long an acceleration is taken to last, s.
const ACCELERATION_LASTS: f64 = 1.0;
/// Who speeds up from less than this is setting off, m/s, and goes on with it for so long, s.
const STARTING: f64 = 3.0;
const START_LASTS: f64 = 3.0;
/// Acceleration that is expected of who may set off at any time, m/s².
const SETTING_OFF: f64 = 1.0;
/// Slower actors stand, m/s.
const STANDING: f64 = 0.1;

impl Forecast {
    /// Along a path from arc length `s`.
    pub(super) fn along(index: usize, actor: &Actor, path: &DrivenPath, s: f64, settings: &Conflict) -> Self {
        Self::of(index, actor, settings, |way| {
            let point = path.point_at(s + way);
            (point.pose.position, point.axis)
        })
    }

    /// At constant curvature, which fades over 10 m.
    pub(super) fn turning(index: usize, actor: &Actor, curvature: f64, settings: &Conflict) -> Self {
        let (mut pose, mut gone) = (actor.pose, 0.0);
        Self::of(index, actor, settings, |way| {
            let middle = 0.5 * (gone + way);
            pose = pose.advance(way - gone, curvature * math::exp(-middle / 10.0));
            gone = way;
            (pose.position, direction(pose.heading))
        })
    }

    /// Straight on at a velocity that need not point along the heading (walkers, reversing vehicles).
    pub(super) fn drifting(index: usize, actor: &Actor, velocity: Vec2, settings: &Conflict) -> Self {
        let speed = velocity.norm();
        let unit = if speed > 0.0 { velocity / speed } else { Vec2::zeros() };
        let moving = Actor { speed, ..*actor };
        let axis = direction(actor.pose.heading);
        Self::of(index, &moving, settings, |way| (actor.pose.position + unit * way, axis))
    }

    fn of(index: usize, actor: &Actor, settings: &Conflict, mut at: impl FnMut(f64) -> (Vec2, Vec2)) -> Self {
        let now =
            Sample { center: actor.pose.position, axis: direction(actor.pose.heading), speed: actor.speed };
        let radius = math::hypot(actor.half_length, actor.half_width);
        let starting = actor.acceleration > 0.3;
        if actor.speed.abs() < STANDING && !starting {
            let bounds = Bounds::around(now.center, radius);
            return Self { actor: index, samples: vec![now], bounds };
        }
        let horizon = if actor.is_av { settings.av_horizon } else { settings.horizon };
        let count = (horizon / settings.sample).round() as usize;
        let mut samples = Vec::with_capacity(count + 1);
        samples.push(now);
        let mut bounds = Bounds::around(now.center, radius);
        for k in 1..=count {
            let t = k as f64 * settings.sample;
            let (way, speed) = travel(actor.speed, actor.acceleration.clamp(-6.0, 1.5), t);
            let (center, axis) = at(way);
            samples.push(Sample { center, axis, speed });
            bounds = bounds.union(&Bounds::around(center, radius + 0.5 * settings.sample * speed));
        }
        Self { actor: index, samples, bounds }
    }
}

/// Way and speed after `t` seconds of an acceleration that lasts a while; nobody rolls back.
fn travel(speed: f64, acceleration: f64, t: f64) -> (f64, f64) {
    let starting = acceleration > 0.0 && speed < STARTING;
    let mut lasting = t.min(if starting { START_LASTS } else { ACCELERATION_LASTS });
    if speed + acceleration * lasting < 0.0 {
        lasting = -speed / acceleration;
        return (speed * lasting + 0.5 * acceleration * lasting * lasting, 0.0);
    }
    let after = speed + acceleration * lasting;
    let way = 0.5 * (speed + after) * lasting + after * (t - lasting);
    (way, after)
}

/// Forecasts of all actors. `av_rails` are ways along lanes that the AV may take, from where it is.
pub(super) fn forecast_all(
    actors: &[Actor],
    drivers: &[Driver],
    av_curvature: f64,
    av_rails: &[DrivenPath],
    settings: &Conflict,
) -> Vec<Forecast> {
    let mut all = Vec::with_capacity(actors.len() + 1);
    for (i, actor) in actors.iter().enumerate() {
        match drivers.get(i) {
            Some(Driver::OnPath(driver)) if driver.waits => {
                let setting_off = Actor { acceleration: SETTING_OFF, ..*actor };
                all.push(Forecast::along(i, &setting_off, &driver.path, driver.s, settings));
            }
            Some(Driver::OnPath(driver)) => {
                all.push(Forecast::along(i, actor, &driver.path, driver.s, settings))
            }
            Some(Driver::Walking { velocity }) => {
                let now = *velocity * actor.speed / velocity.norm().max(1e-9);
                all.push(Forecast::drifting(i, actor, now, settings));
            }
            Some(Driver::Leaving { velocity, .. }) => {
                all.push(Forecast::drifting(i, actor, *velocity * 0.5, settings));
            }
            Some(Driver::Reversing) => {
                let backwards = direction(actor.pose.heading) * actor.speed;
                all.push(Forecast::drifting(i, actor, backwards, settings));
            }
            Some(Driver::External) => {
                all.push(Forecast::turning(i, actor, av_curvature, settings));
                for rail in av_rails {
                    let s = rail.project(actor.pose.position, 0, usize::MAX, None).s;
                    all.push(Forecast::along(i, actor, rail, s, settings));
                }
            }
            Some(Driver::Parked) | None => {
                let standing = Actor { speed: 0.0, acceleration: 0.0, ..*actor };
                all.push(Forecast::drifting(i, &standing, Vec2::zeros(), settings));
            }
        }
    }
    all
}
