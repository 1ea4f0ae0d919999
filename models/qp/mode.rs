//! What an agent would like to do.

use reactsim::geometry::{Polyline, Vec2};
use reactsim::scene::DT;

use super::speed::{STEPS, usual_sigma};
use super::way::{STATIONS, Way};

/// One way that an agent may like to move.
#[derive(Clone, Debug, PartialEq)]
pub struct Mode {
    /// Box centres, 0.1 s apart, the first one after 0.1 s, metres. Beyond the last one it goes on as it ended.
    pub points: Vec<Vec2>,
    /// How uncertain each point is along and across the motion, metres; `None` for what is usual.
    pub sigmas: Option<Vec<[f64; 2]>>,
    /// How probable it is.
    pub probability: f64,
}

impl Mode {
    /// A mode that is certain.
    pub fn of(points: Vec<Vec2>) -> Self {
        Self { points, sigmas: None, probability: 1.0 }
    }

    /// Whether it has points, and all numbers are finite and uncertainties positive.
    pub fn is_valid(&self) -> bool {
        let sigmas = self.sigmas.iter().flatten();
        !self.points.is_empty()
            && self.points.iter().all(|p| p.x.is_finite() && p.y.is_finite())
            && self.probability.is_finite()
            && self.sigmas.as_ref().is_none_or(|s| s.len() == self.points.len())
            && sigmas.flatten().all(|s| s.is_finite() && *s > 0.0)
    }

    /// The centres after every planned step, from a centre now.
    pub(super) fn centres(&self, now: Vec2) -> [Vec2; STEPS] {
        let Some(&last) = self.points.last() else { return [now; STEPS] };
        let known = self.points.len();
        let back = known.min(3);
        let before = if known > back { self.points[known - 1 - back] } else { now };
        let velocity = (last - before) / (DT * back as f64);
        std::array::from_fn(|k| match self.points.get(k) {
            Some(p) => *p,
            None => last + velocity * (DT * (k + 1 - known) as f64),
        })
    }

    /// The uncertainties of the centres, along (0) or across (1) the motion, where they are said.
    fn uncertainties(&self, direction: usize) -> Option<[f64; STEPS]> {
        let sigmas = self.sigmas.as_ref()?;
        let last = sigmas.last()?[direction];
        Some(std::array::from_fn(|k| match sigmas.get(k) {
            Some(s) => s[direction].max(LEAST_SIGMA),
            None => last.max(usual_sigma(k + 1)),
        }))
    }
}

/// Nobody is taken to be more certain, metres.
const LEAST_SIGMA: f64 = 0.2;

/// A mode as a line in the plane and the times at which it is passed.
pub(super) struct Wish {
    pub(super) centres: [Vec2; STEPS],
    /// Way of the centres up to each step.
    pub(super) arc: [f64; STEPS],
    /// How uncertain the centres are along the motion, and across it.
    pub(super) along: Option<[f64; STEPS]>,
    across: Option<[f64; STEPS]>,
}

/// Points of a guide are at least so far from each other, metres.
const APART: f64 = 0.6;
/// How far a guide goes on straight beyond its last point, metres.
const BEYOND: f64 = 60.0;

impl Wish {
    pub(super) fn new(mode: &Mode, now: Vec2) -> Self {
        let centres = mode.centres(now);
        let mut before = now;
        let mut way = 0.0;
        let arc = centres.map(|p| {
            way += (p - before).norm();
            before = p;
            way
        });
        Self { centres, arc, along: mode.uncertainties(0), across: mode.uncertainties(1) }
    }

    /// A line through the centres for a vehicle at `now` that points along `axis` and whose axle is `rear` metres behind.
    pub(super) fn guide(&self, now: Vec2, axis: Vec2, rear: f64) -> Option<Polyline> {
        let mut points = vec![now - axis * rear.max(1.0), now];
        let mut course = axis;
        for &p in &self.centres {
            let step = p - points[points.len() - 1];
            let length = step.norm();
            // What does not go on, but back or aside on the spot, is noise.
            if length >= APART && step.dot(&course) > 0.3 * length {
                course = step / length;
                points.push(p);
            }
        }
        let from = points.len().saturating_sub(4).max(1);
        let chord = points[points.len() - 1] - points[from];
        if chord.norm() > 0.5 {
            course = chord / chord.norm();
        }
        points.push(points[points.len() - 1] + course * BEYOND);
        Polyline::new(&points).ok()
    }

    /// The step, counted from 1, at which so long a way has been gone.
    pub(super) fn step_after(&self, way: f64) -> usize {
        (self.arc.partition_point(|&a| a < way) + 1).min(STEPS)
    }

    /// How uncertain the line is aside of each station, metres.
    pub(super) fn sigma_along(&self, reach: f64) -> [f64; STATIONS + 1] {
        std::array::from_fn(|j| {
            let step = self.step_after(reach * j as f64 / STATIONS as f64);
            match &self.across {
                Some(sigma) => sigma[step - 1],
                None => 0.2 + 0.1 * DT * step as f64,
            }
        })
    }

    /// The wish as ways along a path, never back.
    pub(super) fn along(&self, way: &Way) -> [f64; STEPS] {
        let (mut stretch, mut before) = (0, 0.0_f64);
        self.centres.map(|p| {
            let (arc, found) = way.project(p, stretch);
            stretch = found;
            before = before.max(arc);
            before
        })
    }
}
