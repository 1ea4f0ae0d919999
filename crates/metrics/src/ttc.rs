//! Risky approaches of vehicles to the AV: time to collision below half a second (ReactSim-Bench, "Metric
//! Computation Details"; front-object filter as in the Waymo sim-agents metrics).

use reactsim_geometry::{OrientedBox, wrap};

use super::boxes::{av_overlaps, excluded};
use super::{Case, Event, Judgement, MetricSpec, OfBenchmark, Scope, Score, Unit};

/// Time to collision if the vehicle is not closing in, and maximum value, seconds.
const MAX_TTC: f64 = 5.0;
/// Time to collision below which a vehicle is risky, seconds.
const RISKY_TTC: f64 = 0.5;
/// Maximum heading difference of a front object, degrees.
const FRONT_DEGREES: f64 = 75.0;
/// Heading difference up to which any lateral overlap is sufficient, degrees.
const ALIGNED_DEGREES: f64 = 10.0;
/// Required lateral overlap at larger heading differences, metres.
const LATERAL_OVERLAP: f64 = 0.5;

/// The smallest time to collision of a vehicle with the AV.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Approach {
    /// Smallest time to collision over all steps, seconds; 5 if the vehicle never closes in, 0 if the boxes
    /// overlap.
    pub min_ttc: f64,
    /// First step with that value, from 1; `None` if it is 5.
    pub step: Option<usize>,
    /// First and last step with a risky time to collision.
    pub risky: Option<(usize, usize)>,
}

impl Judgement for Vec<Option<Approach>> {
    fn compute(case: &Case<'_>) -> Self {
        let overlaps = av_overlaps(case);
        case.of_vehicles(|i| Some(approach(case, i, overlaps)))
    }
}

impl Case<'_> {
    /// Returns the approach of every object to the AV; `None` for objects that are not evaluated vehicles.
    pub fn approaches(&self) -> &[Option<Approach>] {
        self.judgement::<Vec<Option<Approach>>>()
    }
}

fn approach(case: &Case<'_>, agent: usize, overlaps: &[bool]) -> Approach {
    let mut found = Approach { min_ttc: MAX_TTC, step: None, risky: None };
    if !case.present(case.av) || excluded(case, agent, case.av) {
        return found;
    }
    for f in case.future() {
        let ttc = time_to_collision(case, agent, f, overlaps);
        let step = f - case.current;
        if ttc < found.min_ttc {
            (found.min_ttc, found.step) = (ttc, Some(step));
        }
        if ttc < RISKY_TTC {
            found.risky = Some((found.risky.map_or(step, |r| r.0), step));
        }
    }
    found
}

fn time_to_collision(case: &Case<'_>, agent: usize, frame: usize, overlaps: &[bool]) -> f64 {
    let motion = &case.motion;
    let (me, av) = (motion.at(agent, frame), motion.at(case.av, frame));
    if motion.x[me].is_nan() || motion.x[av].is_nan() {
        return MAX_TTC;
    }
    if overlaps[me] {
        return 0.0;
    }
    let closing = motion.speed[me] - motion.speed[av];
    if !(closing > 0.0) {
        return MAX_TTC;
    }
    let (mine, other) = (motion.footprint(agent, frame), motion.footprint(case.av, frame));
    let (gap, lateral_gap) = placement(&mine, &other);
    if !(gap > 0.0 && lateral_gap < 0.0) {
        return MAX_TTC;
    }
    let difference = motion.heading[av] - motion.heading[me];
    let turned = if case.options.ttc_wrap_heading { wrap(difference) } else { difference }.abs();
    let ttc = if is_front(gap, lateral_gap, turned) { (gap / closing).min(MAX_TTC) } else { MAX_TTC };
    if ttc < MAX_TTC && case.is_apart(agent, case.av, frame) { MAX_TTC } else { ttc }
}

/// Returns the gaps from `me` to `other`, metres: the longitudinal gap from the front of `me` to the nearest
/// extent of `other`, and the lateral gap between their sides (negative if they overlap laterally).
#[inline]
pub fn placement(me: &OrientedBox, other: &OrientedBox) -> (f64, f64) {
    let d = other.center - me.center;
    let (dx, dy) = (d.dot(&me.axis), me.axis.perp(&d));
    let cos = me.axis.dot(&other.axis).abs();
    let sin = me.axis.perp(&other.axis).abs();
    let gap = dx - me.half_length - (other.half_length * cos + other.half_width * sin);
    let lateral_gap = dy.abs() - me.half_width - (other.half_length * sin + other.half_width * cos);
    (gap, lateral_gap)
}

/// Returns whether an object with these gaps ([`placement`]) is a front object: ahead, with a limited heading
/// difference (`turned`, radians, not negative) and a sufficient lateral overlap (Waymo sim-agents metrics).
#[inline]
pub fn is_front(gap: f64, lateral_gap: f64, turned: f64) -> bool {
    gap > 0.0
        && lateral_gap < 0.0
        && turned <= FRONT_DEGREES.to_radians()
        && (lateral_gap < -LATERAL_OVERLAP || turned <= ALIGNED_DEGREES.to_radians())
}

/// Number of vehicles with a risky approach to the AV.
pub(super) const RISKY: &OfBenchmark = &OfBenchmark {
    spec: MetricSpec {
        id: "aav-ttc",
        title: "A-AV risky",
        unit: Unit::Count,
        scope: Scope::Rollout,
        lower_is_better: true,
        source: "ReactSim-Bench, Metric Computation Details: agent-AV risky TTC count",
    },
    has_events: true,
    score,
};

fn score(case: &Case<'_>, events: &mut Vec<Event>) -> Option<Score> {
    let mut count = 0;
    for (i, approach) in case.approaches().iter().enumerate() {
        let Some((approach, (first, last))) = approach.and_then(|a| Some((a, a.risky?))) else {
            continue;
        };
        count += 1;
        let at = approach.step.unwrap_or(first);
        events.push(Event {
            partner: Some(case.id(case.av)),
            values: vec![("ttc", approach.min_ttc), ("ttc_step", at as f64)],
            ..Event::of(case, i, first, last)
        });
    }
    Some(Score::Count(count))
}
