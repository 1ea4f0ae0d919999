//! Forecasts of all agents over the next four seconds.

use reactsim_geometry::{Bounds, Vec2, direction, math};
use reactsim_scene::dynamics::{DrivenPath, STANDSTILL_SPEED};

use super::actor::Actor;
use super::driver::AgentBehaviour;
use super::parameters::Conflict;

/// One forecast box.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sample {
    pub(super) center: Vec2,
    /// Unit vector along the heading.
    pub(super) axis: Vec2,
    /// Speed, m/s, negative in reverse.
    pub(super) speed: f64,
    /// Height of the road there, metres; NaN if unknown, and in scenarios of one level.
    pub(super) height: f64,
}

/// One possible motion of an agent. The AV, whose intent is unknown, may have several.
#[derive(Clone, Debug)]
pub(super) struct Forecast {
    /// Index of the actor.
    pub(super) actor: usize,
    /// One sample now and one after every sampling interval; a single one for a standing agent.
    pub(super) samples: Vec<Sample>,
    /// Bounds of all boxes.
    pub(super) bounds: Bounds,
    /// Straight band around the samples.
    pub(super) band: Band,
}

/// A straight band around the centres of samples.
#[derive(Clone, Copy, Debug)]
pub(super) struct Band {
    /// Beginning of the band, on its axis.
    pub(super) origin: Vec2,
    /// Unit vector along the band: from the first sample to the last, or along the heading of an agent that
    /// stands.
    pub(super) axis: Vec2,
    /// Length, metres.
    pub(super) length: f64,
    /// Smallest and largest position of a centre across the axis, metres, left positive.
    pub(super) low: f64,
    pub(super) high: f64,
    /// Largest sine of the angle between a sample and the axis.
    pub(super) sine: f64,
    /// Largest speed of a sample, m/s.
    pub(super) speed: f64,
}

impl Band {
    fn around(samples: &[Sample]) -> Self {
        let (first, last) = (&samples[0], &samples[samples.len() - 1]);
        let chord = last.center - first.center;
        let distance = chord.norm();
        let axis = if distance > 0.1 { chord / distance } else { first.axis };
        let mut band =
            Self { origin: first.center, axis, length: 0.0, low: 0.0, high: 0.0, sine: 0.0, speed: 0.0 };
        let mut start = 0.0_f64;
        for sample in samples {
            let from_first = sample.center - first.center;
            let (along, across) = (axis.dot(&from_first), axis.perp(&from_first));
            start = start.min(along);
            band.length = band.length.max(along);
            band.low = band.low.min(across);
            band.high = band.high.max(across);
            band.sine = band.sine.max(axis.perp(&sample.axis).abs());
            band.speed = band.speed.max(sample.speed.abs());
        }
        band.origin += axis * start;
        band.length -= start;
        band
    }
}

/// Duration for which an acceleration is kept, seconds.
const ACCELERATION_DURATION: f64 = 1.0;
/// Speed in m/s below which an accelerating agent counts as setting off.
const START_SPEED: f64 = 3.0;
/// Duration for which the acceleration of setting off is kept, seconds.
const START_DURATION: f64 = 3.0;
/// Acceleration assumed for a vehicle that may set off at any time, m/s².
const SET_OFF_ACCELERATION: f64 = 1.0;

impl Forecast {
    /// Forecasts motion along a path from arc length `s`.
    fn along(index: usize, actor: &Actor, path: &DrivenPath, s: f64, settings: &Conflict) -> Self {
        Self::of(index, actor, settings, |distance| {
            let point = path.point_at(s + distance);
            (point.pose.position, point.axis)
        })
    }

    /// Forecasts motion with the present curvature, which decays over 10 m, ahead or in reverse.
    fn turning(index: usize, actor: &Actor, curvature: f64, settings: &Conflict) -> Self {
        let (mut pose, mut gone) = (actor.pose, 0.0);
        Self::of(index, actor, settings, |distance| {
            let middle = 0.5 * (gone + distance).abs();
            pose = pose.advance(distance - gone, curvature * math::exp(-middle / 10.0));
            gone = distance;
            (pose.position, direction(pose.heading))
        })
    }

    /// Forecasts straight motion at a velocity that need not point along the heading (pedestrians).
    fn drifting(index: usize, actor: &Actor, velocity: Vec2, settings: &Conflict) -> Self {
        let speed = velocity.norm();
        let unit = if speed > 0.0 { velocity / speed } else { Vec2::zeros() };
        let moving = Actor { speed, ..*actor };
        let axis = direction(actor.pose.heading);
        Self::of(index, &moving, settings, |distance| (actor.pose.position + unit * distance, axis))
    }

    fn of(index: usize, actor: &Actor, settings: &Conflict, mut at: impl FnMut(f64) -> (Vec2, Vec2)) -> Self {
        let now = Sample {
            center: actor.pose.position,
            axis: direction(actor.pose.heading),
            speed: actor.speed,
            height: f64::NAN,
        };
        let radius = math::hypot(actor.half_length, actor.half_width);
        let starting = actor.acceleration > 0.3;
        if actor.speed.abs() < STANDSTILL_SPEED && !starting {
            let bounds = Bounds::around(now.center, radius);
            let samples = vec![now];
            return Self { actor: index, band: Band::around(&samples), samples, bounds };
        }
        let horizon = if actor.is_av { settings.av_horizon } else { settings.horizon };
        let count = (horizon / settings.sample).round() as usize;
        let mut samples = Vec::with_capacity(count + 1);
        samples.push(now);
        let mut bounds = Bounds::around(now.center, radius);
        for k in 1..=count {
            let t = k as f64 * settings.sample;
            let (distance, speed) = travel(actor.speed, actor.acceleration, t);
            let (center, axis) = at(distance);
            samples.push(Sample { center, axis, speed, height: f64::NAN });
            bounds = bounds.union(&Bounds::around(center, radius + 0.5 * settings.sample * speed.abs()));
        }
        Self { actor: index, band: Band::around(&samples), samples, bounds }
    }
}

/// Returns distance and speed after `t` seconds with an acceleration of limited duration; vehicles do
/// not change between driving ahead and in reverse.
fn travel(speed: f64, acceleration: f64, t: f64) -> (f64, f64) {
    if speed < 0.0 {
        let (distance, speed) = travel(-speed, -acceleration, t);
        return (-distance, -speed);
    }
    let acceleration = acceleration.clamp(-6.0, 1.5);
    let starting = acceleration > 0.0 && speed < START_SPEED;
    let mut lasting = t.min(if starting { START_DURATION } else { ACCELERATION_DURATION });
    if speed + acceleration * lasting < 0.0 {
        lasting = -speed / acceleration;
        return (speed * lasting + 0.5 * acceleration * lasting * lasting, 0.0);
    }
    let after = speed + acceleration * lasting;
    let distance = 0.5 * (speed + after) * lasting + after * (t - lasting);
    (distance, after)
}

/// Forecasts all agents and obstacles. `av_paths` are paths along lanes that the AV may take.
pub(super) fn forecast_all(
    actors: &[Actor],
    behaviours: &[AgentBehaviour],
    av_curvature: f64,
    av_paths: &[DrivenPath],
    settings: &Conflict,
) -> Vec<Forecast> {
    let mut all = Vec::with_capacity(actors.len() + 1);
    for (i, actor) in actors.iter().enumerate() {
        match behaviours.get(i) {
            Some(AgentBehaviour::OnPath(driver)) => {
                let acceleration = if driver.waits { SET_OFF_ACCELERATION } else { actor.acceleration };
                let driving = Actor { acceleration, ..*actor };
                all.push(Forecast::along(i, &driving, &driver.path, driver.s, settings));
            }
            Some(AgentBehaviour::Walking { velocity }) => {
                let now = *velocity * actor.speed / velocity.norm().max(1e-9);
                all.push(Forecast::drifting(i, actor, now, settings));
            }
            Some(AgentBehaviour::Leaving { velocity, .. }) => {
                all.push(Forecast::drifting(i, actor, *velocity * 0.5, settings));
            }
            Some(AgentBehaviour::Reversing) => all.push(Forecast::turning(i, actor, 0.0, settings)),
            Some(AgentBehaviour::External) => {
                all.push(Forecast::turning(i, actor, av_curvature, settings));
                for path in av_paths {
                    let s = path.project(actor.pose.position, 0, usize::MAX, None).s;
                    all.push(Forecast::along(i, actor, path, s, settings));
                }
            }
            Some(AgentBehaviour::Absent) => {}
            Some(AgentBehaviour::Parked) | None => {
                let standing = Actor { speed: 0.0, acceleration: 0.0, ..*actor };
                all.push(Forecast::drifting(i, &standing, Vec2::zeros(), settings));
            }
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reversing_mirrors_driving_ahead() {
        for (speed, acceleration) in [(4.0, -2.0), (2.0, 1.0), (0.5, 3.0), (6.0, -9.0)] {
            for t in [0.5, 1.5, 4.0] {
                let (distance, after) = travel(speed, acceleration, t);
                assert_eq!(travel(-speed, -acceleration, t), (-distance, -after));
                assert!(distance > 0.0 && after >= 0.0);
            }
        }
    }
}
