//! Infeasible accelerations and curvatures of vehicles (ReactSim-Bench, "Metric Computation Details"; the
//! inverse of Waymax's bicycle model).

use reactsim_geometry::{heading_of, wrap};
use reactsim_scene::DT;
use reactsim_scene::dynamics::{MAX_ACCELERATION, MAX_CURVATURE};

use super::options::CurvatureYaw;
use super::{Case, Event, Judgement, MetricSpec, OfBenchmark, Scope, Score, Unit};

/// Tolerance of both bounds: m/s² for accelerations, 1/m for curvatures.
const TOLERANCE: f64 = 1e-3;
/// Speed at either end of a transition, in m/s, below which its curvature counts as 0.
const LOW_SPEED: f64 = 0.6;

/// An interval of consecutive violating transitions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ViolationInterval {
    /// Step at the end of its first transition.
    pub first: usize,
    /// Step at the end of its last transition.
    pub last: usize,
    /// The value of greatest magnitude, signed.
    pub peak: f64,
}

/// The infeasible transitions of a vehicle.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct InfeasibleMotion {
    /// Number of evaluated transitions.
    pub valid: u64,
    /// Accelerations beyond the bound.
    pub acceleration: Violations,
    /// Curvatures beyond the bound, computed from heading minus heading.
    pub curvature: Violations,
    /// Curvatures beyond the bound, computed from velocity direction minus heading.
    pub curvature_velocity: Violations,
}

/// Transitions that violate one bound.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Violations {
    /// Number of violations.
    pub hits: u64,
    /// Intervals of consecutive violations.
    pub intervals: Vec<ViolationInterval>,
}

impl Violations {
    fn note(&mut self, value: f64, bound: f64, step: usize) {
        if !(value.abs() > bound + TOLERANCE) {
            return;
        }
        self.hits += 1;
        match self.intervals.last_mut() {
            Some(interval) if interval.last + 1 == step => {
                interval.last = step;
                if value.abs() > interval.peak.abs() {
                    interval.peak = value;
                }
            }
            _ => self.intervals.push(ViolationInterval { first: step, last: step, peak: value }),
        }
    }
}

impl InfeasibleMotion {
    /// Returns the curvature violations under an option.
    pub fn curvature_by(&self, yaw: CurvatureYaw) -> &Violations {
        match yaw {
            CurvatureYaw::Heading => &self.curvature,
            CurvatureYaw::Velocity => &self.curvature_velocity,
        }
    }
}

impl Judgement for Vec<InfeasibleMotion> {
    fn compute(case: &Case<'_>) -> Self {
        case.of_vehicles(|i| transitions(case, i))
    }
}

/// Returns the transitions of every object; zeros for objects that are not evaluated vehicles.
pub(super) fn infeasible<'c>(case: &'c Case<'_>) -> &'c [InfeasibleMotion] {
    case.judgement::<Vec<InfeasibleMotion>>()
}

fn transitions(case: &Case<'_>, agent: usize) -> InfeasibleMotion {
    let motion = &case.motion;
    let mut found = InfeasibleMotion::default();
    for f in case.current..case.frames() - 1 {
        let (k0, k1) = (motion.at(agent, f), motion.at(agent, f + 1));
        let (v0, v1) = (motion.speed[k0], motion.speed[k1]);
        // Speeds at absent frames are NaN too.
        if v0.is_nan() || v1.is_nan() {
            continue;
        }
        found.valid += 1;
        let step = f + 1 - case.current;
        let a = (v1 - v0) / DT;
        found.acceleration.note(a, MAX_ACCELERATION, step);
        if v0 < LOW_SPEED || v1 < LOW_SPEED {
            continue;
        }
        let d = v0 * DT + 0.5 * a * DT * DT;
        let curvature = |heading: f64| wrap(heading - motion.heading[k0]) / d;
        found.curvature.note(curvature(motion.heading[k1]), MAX_CURVATURE, step);
        let v = motion.velocity[k1];
        let towards = if v1 > LOW_SPEED { heading_of(v) } else { motion.heading[k1] };
        found.curvature_velocity.note(curvature(towards), MAX_CURVATURE, step);
    }
    found
}

fn rate<'c>(
    case: &'c Case<'_>,
    value: &'static str,
    of: impl Fn(&'c InfeasibleMotion) -> &'c Violations,
    events: &mut Vec<Event>,
) -> Option<Score> {
    let (mut hits, mut valid) = (0, 0);
    for (i, found) in infeasible(case).iter().enumerate() {
        let violations = of(found);
        (hits, valid) = (hits + violations.hits, valid + found.valid);
        for interval in &violations.intervals {
            events.push(Event {
                values: vec![(value, interval.peak)],
                ..Event::of(case, i, interval.first, interval.last)
            });
        }
    }
    (valid > 0).then_some(Score::Rate { hits, valid })
}

/// Share of transitions with an infeasible acceleration.
pub(super) const ACCELERATION: &OfBenchmark = &OfBenchmark {
    spec: MetricSpec {
        id: "acceleration",
        title: "Acc.",
        unit: Unit::Rate,
        scope: Scope::Rollout,
        lower_is_better: true,
        source: "ReactSim-Bench, Metric Computation Details: acceleration infeasibility",
    },
    has_events: true,
    score: |case, events| rate(case, "acceleration", |f| &f.acceleration, events),
};

/// Share of transitions with an infeasible curvature.
pub(super) const CURVATURE: &OfBenchmark = &OfBenchmark {
    spec: MetricSpec {
        id: "curvature",
        title: "Steer.",
        unit: Unit::Rate,
        scope: Scope::Rollout,
        lower_is_better: true,
        source: "ReactSim-Bench, Metric Computation Details: steering-curvature infeasibility",
    },
    has_events: true,
    score: |case, events| rate(case, "curvature", |f| f.curvature_by(case.options.curvature_yaw), events),
};

/// Share of transitions with an infeasible curvature, by the direction of the velocity.
pub(super) const CURVATURE_VELOCITY: &OfBenchmark = &OfBenchmark {
    spec: MetricSpec {
        id: "curvature-velocity",
        title: "Steer. (vel.)",
        unit: Unit::Rate,
        scope: Scope::Rollout,
        lower_is_better: true,
        source: "Waymax bicycle model, heading change by velocity direction; printed beside Steer.",
    },
    has_events: true,
    score: |case, events| rate(case, "curvature", |f| &f.curvature_velocity, events),
};
