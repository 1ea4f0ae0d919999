//! Vehicles that run a red light (`docs/metrics.md`).

use reactsim_geometry::{Vec2, direction, wrap};
use reactsim_scene::LightState;

use super::direction::lane_tracking::Tracker;
use super::{Case, Event, MetricSpec, ObservedLight, OfBenchmark, Scope, Score, Unit};

/// Largest lateral distance from the stop point at which a vehicle crosses its stop line, metres.
const CROSSING_OFFSET: f64 = 2.5;
/// Largest angle between a vehicle and its lane, degrees.
const ALONG_DEGREES: f64 = 45.0;
/// Distance driven beyond the stop line, in metres, at which the lane of a vehicle is determined: lanes that
/// begin at the same line overlap before. At most half of the lane behind the line.
const LANE_CHECK_DISTANCE: f64 = 8.0;

/// The crossing of a stop line under a red light.
#[derive(Clone, Copy, Debug, PartialEq)]
struct RedCrossing {
    /// Frame at which the front crosses.
    first: usize,
    /// Frame at which the centre crosses.
    last: usize,
    /// State of the light at the first frame: red or a red arrow.
    state: LightState,
}

/// The stop line of a light that is red at some step.
struct StopLine<'a> {
    light: &'a ObservedLight<'a>,
    /// Heading of the lane at the line, radians.
    heading: f64,
    ahead: Vec2,
    /// Distance driven beyond the line at which the lane is determined, metres; `None` for a lane that ends
    /// at its line, which is determined before the line.
    check_distance: Option<f64>,
}

impl<'a> StopLine<'a> {
    /// Returns the stop line of a light; `None` if the light is never red after the current frame.
    fn new(case: &Case<'_>, light: &'a ObservedLight<'a>) -> Option<Self> {
        case.future().find(|&f| light.at(f).is_some_and(LightState::is_red))?;
        let line = &case.road.lane(light.lane).baseline;
        let on = line.project(light.stop_point);
        let heading = line.heading(on.segment);
        let rest = line.length() - on.s;
        let ends = rest < LANE_CHECK_DISTANCE && rest < on.s;
        let check_distance = (!ends).then(|| LANE_CHECK_DISTANCE.min(0.5 * rest));
        Some(Self { light, heading, ahead: direction(heading), check_distance })
    }

    /// Returns the distance of a point beyond the line, metres; negative before it.
    fn beyond(&self, p: Vec2) -> f64 {
        (p - self.light.stop_point).dot(&self.ahead)
    }

    /// Returns the first crossing of a vehicle under red.
    fn crossing<'r>(&self, case: &Case<'r>, agent: usize, tracker: &mut Tracker<'r>) -> Option<RedCrossing> {
        let motion = &case.motion;
        let mut before = self.beyond(motion.position(agent, case.current));
        for f in case.future() {
            let p = motion.position(agent, f);
            let here = self.beyond(p);
            // NaN distances of absent vehicles fail the comparisons.
            let crosses = before < 0.0 && here >= 0.0;
            before = here;
            if !crosses
                || self.ahead.perp(&(p - self.light.stop_point)).abs() > CROSSING_OFFSET
                || !is_along(motion.heading[motion.at(agent, f)], self.heading)
            {
                continue;
            }
            let Some(first) = self.front_crossing(case, agent, f) else { continue };
            let red = |f: usize| self.light.at(f).filter(|s| s.is_red());
            let Some(state) = red(first).filter(|_| (first..=f).all(|f| red(f).is_some())) else { continue };
            if self.is_on_lane(case, agent, f, tracker) {
                return Some(RedCrossing { first, last: f, state });
            }
        }
        None
    }

    /// Returns the frame at which the front of a vehicle crosses whose centre crosses at `frame`; `None` if
    /// the front is past the line at the current frame, or the vehicle was absent in between.
    fn front_crossing(&self, case: &Case<'_>, agent: usize, frame: usize) -> Option<usize> {
        for f in (case.current + 1..=frame).rev() {
            let [front_left, front_right, ..] = case.motion.footprint(agent, f - 1).corners();
            let before = self.beyond(0.5 * (front_left + front_right));
            if before < 0.0 {
                return Some(f);
            }
            if before.is_nan() {
                return None;
            }
        }
        None
    }

    /// Returns whether a vehicle whose centre crosses the line at `frame` drives the lane of the line.
    fn is_on_lane<'r>(&self, case: &Case<'r>, agent: usize, frame: usize, tracker: &mut Tracker<'r>) -> bool {
        let Some(at) = self.check_frame(case, agent, frame) else { return false };
        let placed = tracker.pointwise_at(case, agent, at);
        placed.is_some_and(|placed| {
            placed.lane == self.light.lane
                && is_along(case.motion.heading[case.motion.at(agent, at)], placed.theta)
        })
    }

    /// Returns the frame at which the lane is determined; `None` if the vehicle does not get there.
    fn check_frame(&self, case: &Case<'_>, agent: usize, frame: usize) -> Option<usize> {
        let Some(distance) = self.check_distance else { return Some(frame - 1) };
        let position = |f: usize| case.motion.position(agent, f);
        let (mut at, mut driven) = (frame, self.beyond(position(frame)));
        while driven < distance {
            at += 1;
            if at >= case.frames() || !case.motion.valid(agent, at) {
                return None;
            }
            driven += (position(at) - position(at - 1)).norm();
        }
        Some(at)
    }
}

fn is_along(heading: f64, lane: f64) -> bool {
    wrap(heading - lane).abs() < ALONG_DEGREES.to_radians()
}

/// Share of vehicles that run a red light.
pub(super) const RED_LIGHT: &OfBenchmark = &OfBenchmark {
    spec: MetricSpec {
        id: "red-light",
        title: "Red light",
        unit: Unit::Rate,
        scope: Scope::Rollout,
        lower_is_better: true,
        source: "reactsim, docs/metrics.md: vehicles that cross the stop line of their lane under an \
                 observed red light",
    },
    has_events: true,
    score,
};

fn score(case: &Case<'_>, events: &mut Vec<Event>) -> Option<Score> {
    let known = |light: &ObservedLight<'_>| case.future().any(|f| light.at(f).is_some());
    if !case.lights.iter().any(known) {
        return None;
    }
    let lines: Vec<StopLine<'_>> = case.lights.iter().filter_map(|l| StopLine::new(case, l)).collect();
    let mut tracker = Tracker::new(case);
    let (mut hits, mut valid) = (0, 0);
    for i in case.vehicles() {
        let mut runs = false;
        for line in &lines {
            let Some(crossing) = line.crossing(case, i, &mut tracker) else { continue };
            runs = true;
            events.push(Event {
                reason: Some(crossing.state.name()),
                values: vec![
                    ("lane", line.light.lane as f64),
                    ("speed", case.motion.speed(i, crossing.first)),
                    ("x", line.light.stop_point.x),
                    ("y", line.light.stop_point.y),
                ],
                ..Event::of(case, i, crossing.first - case.current, crossing.last - case.current)
            });
        }
        hits += u64::from(runs);
        valid += 1;
    }
    (valid > 0).then_some(Score::Rate { hits, valid })
}

#[cfg(test)]
mod tests;
