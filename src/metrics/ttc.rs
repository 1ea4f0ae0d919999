//! Risky approaches of vehicles to the AV: time to collision below half a second (ReactSim-Bench, "Metric Computation
//! Details"; front-object filter as in the Waymo sim-agents metrics).

use super::boxes::av_overlap;
use super::options::TtcSpeed;
use super::{Case, Event, Metric, MetricSpec, Score, Unit};
use crate::geometry::{OrientedBox, math, wrap};
use crate::scene::DT;

/// Time to collision where nothing is closing, seconds.
const NO_RISK: f64 = 5.0;
/// A vehicle is risky below this time to collision, seconds.
const RISKY: f64 = 0.5;
/// Largest heading difference of a front object, degrees.
const FRONT_DEGREES: f64 = 75.0;
/// Heading difference up to which any lateral overlap is enough, degrees.
const ALIGNED_DEGREES: f64 = 10.0;
/// Lateral overlap that is enough at larger heading differences, metres.
const LATERAL_OVERLAP: f64 = 0.5;

/// The smallest time to collision of a vehicle with the AV.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Approach {
    /// Smallest time to collision over all steps, seconds; 5 where nothing closes, 0 where the boxes overlap.
    pub min_ttc: f64,
    /// First step with that value, 1 to 80; `None` where it is 5.
    pub step: Option<usize>,
    /// First and last step at which the time is below the bound.
    pub risky: Option<(usize, usize)>,
}

/// The approach of every object to the AV; `None` for those that are no evaluated vehicles.
pub(super) fn approaches<'c>(case: &'c Case<'_>) -> &'c [Option<Approach>] {
    case.cache.approaches.get_or_init(|| {
        let mut approaches = vec![None; case.objects.len()];
        for i in case.vehicles() {
            approaches[i] = Some(approach(case, i));
        }
        approaches
    })
}

fn approach(case: &Case<'_>, agent: usize) -> Approach {
    let mut found = Approach { min_ttc: NO_RISK, step: None, risky: None };
    if !case.present(case.av) {
        return found;
    }
    for f in case.future() {
        let ttc = time_to_collision(case, agent, f);
        let step = f - case.current;
        if ttc < found.min_ttc {
            (found.min_ttc, found.step) = (ttc, Some(step));
        }
        if ttc < RISKY {
            found.risky = Some((found.risky.map_or(step, |r| r.0), step));
        }
    }
    found
}

fn time_to_collision(case: &Case<'_>, agent: usize, frame: usize) -> f64 {
    let motion = &case.motion;
    let (me, av) = (motion.at(agent, frame), motion.at(case.av, frame));
    if motion.x[me].is_nan() || motion.x[av].is_nan() {
        return NO_RISK;
    }
    if av_overlap(case)[me] {
        return 0.0;
    }
    let closing = speed(case, agent, frame) - speed(case, case.av, frame);
    if !(closing > 0.0) {
        return NO_RISK;
    }
    let (mine, other) = (motion.footprint(agent, frame), motion.footprint(case.av, frame));
    let (gap, beside) = placement(&mine, &other);
    if !(gap > 0.0 && beside < 0.0) {
        return NO_RISK;
    }
    let difference = motion.heading[av] - motion.heading[me];
    let turned = if case.options.ttc_wrap_heading { wrap(difference) } else { difference }.abs();
    if is_front(gap, beside, turned) { (gap / closing).min(NO_RISK) } else { NO_RISK }
}

/// How `other` lies as seen from `me`, metres: how far its nearest extent lies ahead of the front of `me`, and how far beside its side
/// (negative: they overlap laterally).
#[inline]
pub fn placement(me: &OrientedBox, other: &OrientedBox) -> (f64, f64) {
    let d = other.center - me.center;
    let (dx, dy) = (d.dot(&me.axis), me.axis.perp(&d));
    let cos = me.axis.dot(&other.axis).abs();
    let sin = me.axis.perp(&other.axis).abs();
    let gap = dx - me.half_length - (other.half_length * cos + other.half_width * sin);
    let beside = dy.abs() - me.half_width - (other.half_length * sin + other.half_width * cos);
    (gap, beside)
}

/// Whether something that lies there ([`placement`]) is a front object: ahead, not turned away too far (`turned`: difference of the
/// headings, radians, not negative), and enough in the way (Waymo sim-agents metrics).
#[inline]
pub fn is_front(gap: f64, beside: f64, turned: f64) -> bool {
    gap > 0.0
        && beside < 0.0
        && turned <= FRONT_DEGREES.to_radians()
        && (beside < -LATERAL_OVERLAP || turned <= ALIGNED_DEGREES.to_radians())
}

fn speed(case: &Case<'_>, object: usize, frame: usize) -> f64 {
    let motion = &case.motion;
    match case.options.ttc_speed {
        TtcSpeed::State => motion.speed[motion.at(object, frame)],
        TtcSpeed::Central if frame == 0 || frame + 1 >= motion.frames => f64::NAN,
        TtcSpeed::Central => {
            let d = motion.position(object, frame + 1) - motion.position(object, frame - 1);
            math::hypot(d.x, d.y) / (2.0 * DT)
        }
    }
}

/// Vehicles with a risky approach to the AV.
#[derive(Debug)]
pub(super) struct Risky;

impl Metric for Risky {
    fn spec(&self) -> &'static MetricSpec {
        &MetricSpec {
            id: "aav-ttc",
            title: "A-AV risky",
            unit: Unit::Count,
            lower_is_better: true,
            source: "ReactSim-Bench, Metric Computation Details: agent-AV risky TTC count",
        }
    }

    fn score(&self, case: &Case<'_>, events: &mut Vec<Event>) -> Option<Score> {
        let mut count = 0;
        for (i, approach) in approaches(case).iter().enumerate() {
            let Some((approach, (first, last))) = approach.and_then(|a| Some((a, a.risky?))) else {
                continue;
            };
            count += 1;
            let at = approach.step.unwrap_or(first);
            events.push(Event {
                metric: self.spec().id,
                step: first,
                last_step: last,
                agent: case.id(i),
                partner: Some(case.id(case.av)),
                reason: None,
                counted: true,
                values: vec![("ttc", approach.min_ttc), ("ttc_step", at as f64)],
            });
        }
        Some(Score::Count(count))
    }
}
