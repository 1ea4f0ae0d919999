//! Agents that are or will be in the corridor that a vehicle's box sweeps along its path.

use reactsim_geometry::OrientedBox;
use reactsim_scene::dynamics::DrivenPath;
use reactsim_scene::{Road, Start};

use super::actor::Actor;
use super::driver::PathFollower;
use super::forecast::Forecast;
use super::heights::PathHeights;
use super::parameters::Conflict;
use super::strip::Strip;

/// A leader: an agent or obstacle ahead in the corridor that stands or moves along it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Leader {
    /// Arc length of its rear, metres.
    pub(super) rear: f64,
    /// Speed along the path, m/s; negative if it reverses towards the vehicle.
    pub(super) speed: f64,
    /// Acceleration along the path, m/s².
    pub(super) acceleration: f64,
}

/// A part of the path that an agent covers at a time from now.
#[derive(Clone, Copy, Debug)]
pub(super) struct CoveredPart {
    /// Time from now, s.
    pub(super) t: f64,
    /// Smallest arc length, metres.
    pub(super) low: f64,
    /// Largest arc length, metres.
    pub(super) high: f64,
}

/// An agent that enters the corridor, or comes up from behind.
#[derive(Clone, Debug)]
pub(super) struct Crossing {
    /// Index of the actor.
    pub(super) actor: usize,
    /// Whether it comes up from behind in the vehicle's own direction.
    pub(super) from_behind: bool,
    /// Covered parts of the path, in order of time.
    pub(super) covered: Vec<CoveredPart>,
}

/// Agents that a vehicle has to consider.
#[derive(Clone, Debug, Default)]
pub(super) struct Corridor {
    pub(super) leaders: Vec<Leader>,
    pub(super) crossings: Vec<Crossing>,
}

/// Lateral clearance of the box, metres: an agent within it is in the way.
const LATERAL_CLEARANCE: f64 = 0.25;
/// Smallest cosine of the angle at which an agent goes in the same direction.
const ALIGNED_COSINE: f64 = 0.5;

/// Smallest cosine of the angle at which a box counts as parallel to the path.
const PARALLEL_COSINE: f64 = 0.995;
/// Curvature below which the path counts as straight, 1/m.
const STRAIGHT_CURVATURE: f64 = 0.01;

/// Returns the part of a curved path on which the vehicle's box would touch `other`, searched metre by
/// metre around `middle`: the arc length that the front may not pass, and the one that the rear must
/// have passed.
fn touched(own: &Actor, path: &DrivenPath, middle: f64, other: &OrientedBox) -> Option<(f64, f64)> {
    let reach = own.half_length + other.half_length + 1.0;
    let (first, last) = (path.index(middle - reach), path.index(middle + reach));
    let touches = |i: &usize| {
        let point = &path.points()[*i];
        let room = (0.5 * DrivenPath::STEP, LATERAL_CLEARANCE);
        own.box_at(point.pose.position, point.axis, room).separation(other) < 0.0
    };
    let low = (first..=last).find(touches)?;
    let high = (low..=last).rev().find(touches)?;
    // The box is clear half a step before the first point that touches, and half a step after the last.
    let (low, high) = (low as f64 - 0.5, high as f64 + 0.5);
    Some((low * DrivenPath::STEP + own.half_length, high * DrivenPath::STEP - own.half_length))
}

/// Returns the length, metres, that a moving box sweeps on each side of a sample: half an interval before it
/// and half after.
fn swept(k: usize, speed: f64, settings: &Conflict) -> f64 {
    if k == 0 { 0.0 } else { 0.5 * settings.sample * speed.abs() }
}

/// Returns the arc lengths, metres, between which a vehicle looks for others.
fn section(own: &Actor, driver: &PathFollower) -> (f64, f64) {
    let reach = own.half_length + 15.0 + 4.5 * own.speed;
    (driver.s - own.half_length, driver.s + reach)
}

/// Returns the same arc lengths, with what it drives in `horizon` seconds at its largest acceleration.
fn driven_section(own: &Actor, driver: &PathFollower, horizon: f64) -> (f64, f64) {
    let (from, to) = section(own, driver);
    let driven = horizon * (own.speed + 0.5 * driver.style.acceleration * horizon);
    (from, to.max(driver.s + driven))
}

/// Bounds the section of the path in which a vehicle looks for others, and what it drives in `horizon`
/// seconds at its largest acceleration.
pub(super) fn strip(own: &Actor, driver: &PathFollower, horizon: f64) -> Option<Strip> {
    let (from, to) = driven_section(own, driver, horizon);
    Strip::of(&driver.path, driver.path.index(from), driver.path.index(to + DrivenPath::STEP))
}

/// Follows the road under the part of the path that [`strip`] bounds, and returns the heights, which the
/// driver keeps for the next decision; none in scenarios of one level.
pub(super) fn heights(start: &Start, own: &Actor, driver: &mut PathFollower, horizon: f64) -> PathHeights {
    if start.has_levels() {
        let (from, to) = driven_section(own, driver, horizon);
        driver.heights.follow(&start.road(), own, &driver.path, from, to);
    }
    driver.heights.clone()
}

/// What is known of the path in which a vehicle looks for others.
pub(super) struct View<'a> {
    /// Bounds of the path, if it bends little.
    pub(super) strip: Option<&'a Strip>,
    pub(super) heights: &'a PathHeights,
    pub(super) road: &'a Road<'a>,
}

/// Finds leaders and crossing agents in the corridor of the vehicle `own` (index `index`).
pub(super) fn look(
    index: usize,
    own: &Actor,
    driver: &PathFollower,
    actors: &[Actor],
    forecasts: &[Forecast],
    view: &View<'_>,
    settings: &Conflict,
) -> Corridor {
    let mut corridor = Corridor::default();
    let path = &driver.path;
    let (from, to) = section(own, driver);
    let bounds =
        path.bounds(from, to).inflated(own.half_width + own.half_length.min(3.0) + LATERAL_CLEARANCE);
    let (first, last) = (path.index(from), path.index(to));
    let samples = 1 + (settings.horizon / settings.sample).round() as usize;
    for forecast in forecasts {
        if forecast.actor == index || !bounds.intersects(&forecast.bounds) {
            continue;
        }
        let other = &actors[forecast.actor];
        let known = &forecast.samples[..samples.min(forecast.samples.len())];
        let beside = |strip: &Strip| {
            let half_length = other.half_length + swept(1, forecast.band.speed, settings);
            let extent = strip.half_extent_at_most(&forecast.band, half_length, other.half_width);
            strip.offset_at_least(path, &forecast.band, last) > own.half_width + extent + LATERAL_CLEARANCE
        };
        if view.strip.is_some_and(beside) {
            continue;
        }
        let mut covered: Vec<CoveredPart> = Vec::new();
        let mut near = None;
        let mut from_behind = false;
        for (k, sample) in known.iter().enumerate() {
            let at = path.project(sample.center, first, last, near);
            near = Some(at.index);
            if view.heights.is_apart(view.road, at.index, sample.center, sample.height) {
                continue;
            }
            let axis = path.points()[at.index].axis;
            let (cos, sin) = (axis.dot(&sample.axis), axis.perp(&sample.axis).abs());
            let swept = swept(k, sample.speed, settings);
            let along = (other.half_length + swept) * cos.abs() + other.half_width * sin;
            let across = (other.half_length + swept) * sin + other.half_width * cos.abs();
            let moves_along = if sample.speed < 0.0 { -cos } else { cos };
            if k == 0 && at.s < driver.s && moves_along > ALIGNED_COSINE {
                from_behind = true;
            }
            if at.offset.abs() > own.half_width + across + LATERAL_CLEARANCE {
                continue;
            }
            let straight =
                cos.abs() > PARALLEL_COSINE && path.points()[at.index].curvature.abs() < STRAIGHT_CURVATURE;
            let (low, high) = if straight {
                (at.s - along, at.s + along)
            } else {
                match touched(own, path, at.s, &other.box_at(sample.center, sample.axis, (swept, 0.0))) {
                    Some(stretch) => stretch,
                    None => continue,
                }
            };
            if k == 0 {
                if at.s <= driver.s {
                    if !from_behind {
                        covered.push(CoveredPart { t: 0.0, low, high });
                    }
                    continue;
                }
                let speed = sample.speed * cos;
                let leads = forecast.samples.len() == 1 || moves_along > ALIGNED_COSINE;
                if leads {
                    let acceleration = other.acceleration * cos;
                    corridor.leaders.push(Leader { rear: low, speed: speed.max(0.0), acceleration });
                    covered.clear();
                    break;
                }
                // It has to be waited for as one that stands, and meets the vehicle as one that crosses.
                if sample.speed < 0.0 && moves_along < -ALIGNED_COSINE {
                    corridor.leaders.push(Leader { rear: low, speed, acceleration: 0.0 });
                }
            }
            if low < to {
                covered.push(CoveredPart { t: k as f64 * settings.sample, low, high });
            }
        }
        if !covered.is_empty() {
            corridor.crossings.push(Crossing { actor: forecast.actor, from_behind, covered });
        }
    }
    corridor
}
