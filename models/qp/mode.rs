//! Modes: the trajectories that a simulator proposes for an agent.

use reactsim_geometry::{Polyline, Vec2};
use reactsim_scene::DT;

use super::path::{Path, STATIONS};
use super::speed::{STEPS, default_sigma};

/// A proposed trajectory of an agent.
#[derive(Clone, Debug, PartialEq)]
pub struct Mode {
    /// Box centres in metres, 0.1 s apart, the first at 0.1 s. Beyond the last one the agent keeps its
    /// last velocity.
    pub points: Vec<Vec2>,
    /// Standard deviations of each point along and across the motion, metres; `None` for default
    /// values.
    pub sigmas: Option<Vec<[f64; 2]>>,
    /// Probability of the mode.
    pub probability: f64,
}

impl Mode {
    /// Returns a mode with probability 1.
    pub fn of(points: Vec<Vec2>) -> Self {
        Self { points, sigmas: None, probability: 1.0 }
    }

    /// Returns whether the mode has points, all its numbers are finite and its standard deviations
    /// positive.
    pub fn is_valid(&self) -> bool {
        let sigmas = self.sigmas.iter().flatten();
        !self.points.is_empty()
            && self.points.iter().all(|p| p.x.is_finite() && p.y.is_finite())
            && self.probability.is_finite()
            && self.sigmas.as_ref().is_none_or(|s| s.len() == self.points.len())
            && sigmas.flatten().all(|s| s.is_finite() && *s > 0.0)
    }

    /// Returns the centres after every planned step; `now` is the present centre.
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

    /// Returns the standard deviations of the centres along (0) or across (1) the motion, if the mode
    /// has any.
    fn uncertainties(&self, direction: usize) -> Option<[f64; STEPS]> {
        let sigmas = self.sigmas.as_ref()?;
        let last = sigmas.last()?[direction];
        Some(std::array::from_fn(|k| match sigmas.get(k) {
            Some(s) => s[direction].max(MIN_SIGMA),
            None => last.max(default_sigma(k + 1)),
        }))
    }
}

/// Smallest standard deviation of a mode, metres.
const MIN_SIGMA: f64 = 0.2;

/// A mode as a line in the plane with the arc length reached at each step.
pub(super) struct Reference {
    pub(super) centres: [Vec2; STEPS],
    /// Arc length of the centres at each step, metres.
    pub(super) arc: [f64; STEPS],
    /// Standard deviations of the centres along the motion, metres.
    pub(super) along: Option<[f64; STEPS]>,
    /// Standard deviations of the centres across the motion, metres.
    across: Option<[f64; STEPS]>,
}

/// Smallest distance between two points of a guide, metres.
const MIN_POINT_SPACING: f64 = 0.6;
/// Length of the straight extension of a guide beyond its last point, metres.
const GUIDE_EXTENSION: f64 = 60.0;

impl Reference {
    pub(super) fn new(mode: &Mode, now: Vec2) -> Self {
        let centres = mode.centres(now);
        let mut before = now;
        let mut distance = 0.0;
        let arc = centres.map(|p| {
            distance += (p - before).norm();
            before = p;
            distance
        });
        Self { centres, arc, along: mode.uncertainties(0), across: mode.uncertainties(1) }
    }

    /// Returns a line through the centres for a vehicle at `now` that points along `axis` and whose
    /// rear axle is `rear` metres behind.
    pub(super) fn guide(&self, now: Vec2, axis: Vec2, rear: f64) -> Option<Polyline> {
        let mut points = vec![now - axis * rear.max(1.0), now];
        let mut direction = axis;
        for &p in &self.centres {
            let step = p - points[points.len() - 1];
            let length = step.norm();
            // Points that lead backwards or sideways on the spot are noise.
            if length >= MIN_POINT_SPACING && step.dot(&direction) > 0.3 * length {
                direction = step / length;
                points.push(p);
            }
        }
        let from = points.len().saturating_sub(4).max(1);
        let chord = points[points.len() - 1] - points[from];
        if chord.norm() > 0.5 {
            direction = chord / chord.norm();
        }
        points.push(points[points.len() - 1] + direction * GUIDE_EXTENSION);
        Polyline::new(&points).ok()
    }

    /// Returns the step, counted from 1, at which this distance has been covered.
    pub(super) fn step_after(&self, distance: f64) -> usize {
        (self.arc.partition_point(|&a| a < distance) + 1).min(STEPS)
    }

    /// Returns the lateral standard deviation of the line at each station, metres.
    pub(super) fn lateral_sigma(&self, reach: f64) -> [f64; STATIONS + 1] {
        std::array::from_fn(|j| {
            let step = self.step_after(reach * j as f64 / STATIONS as f64);
            match &self.across {
                Some(sigma) => sigma[step - 1],
                None => 0.2 + 0.1 * DT * step as f64,
            }
        })
    }

    /// Returns the arc lengths of the centres projected onto a path, never decreasing.
    pub(super) fn arcs_along(&self, path: &Path) -> [f64; STEPS] {
        let (mut interval, mut before) = (0, 0.0_f64);
        self.centres.map(|p| {
            let (arc, found) = path.project(p, interval);
            interval = found;
            before = before.max(arc);
            before
        })
    }
}
