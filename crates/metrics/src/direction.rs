//! Driving against the direction of the lane (ReactSim-Bench, "Metric Computation Details"; lane tracking of
//! nuPlan).

pub(super) mod lane_tracking;

use reactsim_geometry::wrap;

use self::lane_tracking::{LanePosition, Tracker};
use super::options::{DirCandidate, DirTracking};
use super::{Case, Event, Judgement, MetricSpec, OfBenchmark, Scope, Score, Unit};

/// Speed in m/s up to which a vehicle does not drive against its lane.
const MOVING_SPEED: f64 = 1.0;
/// Heading error beyond which a vehicle points against its lane, degrees.
const AGAINST_DEGREES: f64 = 75.0;
/// Progress along the lane within the window, in metres, below which a vehicle drives backwards.
const BACKWARD_PROGRESS: f64 = -2.0;
/// Number of increments in the progress window: 1.0 s.
const WINDOW: usize = 10;
/// Number of consecutive frames for which all conditions must hold: 0.5 s.
const PERSISTENCE: usize = 5;

/// The driving direction of a vehicle relative to its lanes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct WrongWay {
    /// Whether the vehicle was on a lane at any step and can therefore be evaluated.
    pub candidate: bool,
    /// Intervals of driving against the lane that last long enough.
    pub intervals: Vec<WrongWayInterval>,
}

/// An interval of driving against the lane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WrongWayInterval {
    /// First step, from 1.
    pub first: usize,
    /// Last step.
    pub last: usize,
    /// Lane at the first step (index in the map).
    pub lane: usize,
    /// Heading error at the first step, radians.
    pub heading_error: f64,
    /// Smallest progress in the window over the interval, metres.
    pub progress: f64,
}

impl Judgement for Vec<WrongWay> {
    fn compute(case: &Case<'_>) -> Self {
        if case.road.map.lanes.is_empty() {
            return vec![WrongWay::default(); case.objects.len()];
        }
        let mut evaluator = Evaluator { case, tracker: Tracker::new(case), placed: Vec::new() };
        case.of_vehicles(|i| evaluator.vehicle(i))
    }
}

/// Returns the driving direction of every object; defaults for objects that are not evaluated vehicles.
pub(super) fn directions<'c>(case: &'c Case<'_>) -> &'c [WrongWay] {
    case.judgement::<Vec<WrongWay>>()
}

struct Evaluator<'c, 'a> {
    case: &'c Case<'a>,
    tracker: Tracker<'c>,
    placed: Vec<Option<LanePosition>>,
}

impl Evaluator<'_, '_> {
    /// Evaluates each run of consecutive valid frames from the current frame on.
    fn vehicle(&mut self, agent: usize) -> WrongWay {
        let mut found = WrongWay::default();
        let mut f = self.case.current;
        while f < self.case.frames() {
            let start = f;
            while f < self.case.frames() && self.case.motion.valid(agent, f) {
                f += 1;
            }
            if f > start && f > self.case.current + 1 {
                self.run(agent, start..f, &mut found);
            }
            f += 1;
        }
        found
    }

    fn run(&mut self, agent: usize, run: std::ops::Range<usize>, found: &mut WrongWay) {
        let case = self.case;
        let options = &case.options;
        let first = run.start.max(case.current + 1);
        let moving = |f: usize| case.motion.speed[case.motion.at(agent, f)] > MOVING_SPEED;
        if options.dir_tracking != DirTracking::Route && self.harmless(agent, first..run.end, &moving, found)
        {
            return;
        }
        match options.dir_tracking {
            DirTracking::Route => self.tracker.route(case, agent, run.clone(), &mut self.placed),
            _ => self.tracker.pointwise(case, agent, run.clone(), &mut self.placed),
        }
        let candidate = |f: usize| match options.dir_candidate {
            DirCandidate::Lane => true,
            DirCandidate::Moving => moving(f),
        };
        found.candidate |= (first..run.end).any(|f| self.placed[f - run.start].is_some() && candidate(f));
        let window = WINDOW + usize::from(options.dir_window_extra);
        let mut open: Option<WrongWayInterval> = None;
        for f in first..run.end {
            let against = moving(f)
                .then(|| self.placed[f - run.start])
                .flatten()
                .and_then(|placed| self.against(agent, f, f - run.start, placed, window));
            let step = f - case.current;
            match (against, &mut open) {
                (Some((_, progress)), Some(interval)) => {
                    interval.last = step;
                    interval.progress = interval.progress.min(progress);
                }
                (Some((error, progress)), None) => {
                    let lane = self.placed[f - run.start].map_or(0, |p| p.lane);
                    open = Some(WrongWayInterval {
                        first: step,
                        last: step,
                        lane,
                        heading_error: error,
                        progress,
                    });
                }
                (None, _) => add_persistent(open.take(), found),
            }
        }
        add_persistent(open, found);
    }

    /// Returns heading error and progress of a pose if both show that the vehicle drives against its lane.
    fn against(
        &self,
        agent: usize,
        f: usize,
        q: usize,
        placed: LanePosition,
        window: usize,
    ) -> Option<(f64, f64)> {
        let error = wrap(self.case.motion.heading[self.case.motion.at(agent, f)] - placed.theta);
        if !(error.abs() > AGAINST_DEGREES.to_radians()) {
            return None;
        }
        let progress: f64 = (q.saturating_sub(window - 1)..=q).map(|k| self.increment(k)).sum();
        (progress < BACKWARD_PROGRESS).then_some((error, progress))
    }

    /// Returns the progress from the previous pose to pose `q` of the run, metres; 0 across a change of lane.
    fn increment(&self, q: usize) -> f64 {
        match (q.checked_sub(1).and_then(|p| self.placed[p]), self.placed[q]) {
            (Some(a), Some(b)) if a.lane == b.lane => b.s - a.s,
            _ => 0.0,
        }
    }

    /// For pointwise tracking only: records whether the vehicle is a candidate, and returns whether no pose
    /// of the run can be against its lane because some lane points along every moving pose. Avoids the
    /// projections for nearly all vehicles.
    fn harmless(
        &mut self,
        agent: usize,
        frames: std::ops::Range<usize>,
        moving: &impl Fn(usize) -> bool,
        found: &mut WrongWay,
    ) -> bool {
        let case = self.case;
        let any_step = case.options.dir_candidate == DirCandidate::Lane;
        let mut hint = None;
        for f in frames.clone() {
            let fast = moving(f);
            // At rest, the answer for the frame before holds.
            let rests = || f > frames.start && case.motion.rests(agent, f);
            if !fast && (found.candidate || !any_step || rests()) {
                continue;
            }
            let k = case.motion.at(agent, f);
            self.tracker.road = case.road_under(agent, f);
            let (on_lane, along) = self.tracker.some_lane_along(
                case.motion.position(agent, f),
                case.motion.axis[k],
                AGAINST_DEGREES,
                &mut hint,
            );
            found.candidate |= on_lane;
            if fast && on_lane && !along {
                return false;
            }
        }
        true
    }
}

fn add_persistent(interval: Option<WrongWayInterval>, found: &mut WrongWay) {
    found.intervals.extend(interval.filter(|s| s.last + 1 - s.first >= PERSISTENCE));
}

/// Share of the vehicles on lanes that drive against a lane.
pub(super) const DIRECTION: &OfBenchmark = &OfBenchmark {
    spec: MetricSpec {
        id: "direction",
        title: "Dir.",
        unit: Unit::Rate,
        scope: Scope::Rollout,
        lower_is_better: true,
        source: "ReactSim-Bench, Metric Computation Details: driving-direction violation rate",
    },
    has_events: true,
    score,
};

fn score(case: &Case<'_>, events: &mut Vec<Event>) -> Option<Score> {
    let (mut hits, mut valid) = (0, 0);
    for (i, found) in directions(case).iter().enumerate() {
        valid += u64::from(found.candidate);
        hits += u64::from(!found.intervals.is_empty());
        for interval in &found.intervals {
            events.push(Event {
                values: vec![("heading_error", interval.heading_error), ("progress", interval.progress)],
                ..Event::of(case, i, interval.first, interval.last)
            });
        }
    }
    (valid > 0).then_some(Score::Rate { hits, valid })
}
