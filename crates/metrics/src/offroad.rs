//! Vehicles off the drivable ground (ReactSim-Bench, "Metric Computation Details": off-road rate).

use super::{Case, Event, Judgement, MetricSpec, OfBenchmark, Scope, Score, Unit};

/// Steps of a vehicle off the drivable ground.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OffRoadSteps {
    /// Number of steps with the centre off the road, or a corner with the option `offroad_corners`.
    pub hits: u64,
    /// Number of evaluated steps; 0 for vehicles off the road at the current frame, and in maps that do not
    /// record their drivable area.
    pub valid: u64,
    /// First and last step of each interval off the road.
    pub intervals: Vec<(usize, usize)>,
}

impl Judgement for Vec<OffRoadSteps> {
    fn compute(case: &Case<'_>) -> Self {
        if !case.road.has_drivable_area() {
            return vec![OffRoadSteps::default(); case.objects.len()];
        }
        case.of_vehicles(|i| steps_of(case, i))
    }
}

/// Returns the off-road steps of every object; zeros for objects that are not evaluated vehicles.
pub(super) fn off_road_steps<'c>(case: &'c Case<'_>) -> &'c [OffRoadSteps] {
    case.judgement::<Vec<OffRoadSteps>>()
}

fn steps_of(case: &Case<'_>, agent: usize) -> OffRoadSteps {
    let mut steps = OffRoadSteps::default();
    let mut near = [None; 4];
    let first = case.first_frame(agent);
    if first.and_then(|first| is_on_road(case, agent, first, &mut near)) != Some(true) {
        return steps;
    }
    let mut open: Option<(usize, usize)> = None;
    let mut is_off = false;
    for f in case.future() {
        if !case.motion.valid(agent, f) {
            continue;
        }
        steps.valid += 1;
        let step = f - case.current;
        if !case.motion.rests(agent, f) {
            is_off = is_on_road(case, agent, f, &mut near) == Some(false);
        }
        if is_off {
            steps.hits += 1;
            open = Some((open.map_or(step, |o| o.0), step));
        } else {
            steps.intervals.extend(open.take());
        }
    }
    steps.intervals.extend(open);
    steps
}

/// Returns whether the centre of a vehicle is on the road, or all corners with the option `offroad_corners`.
/// `near` carries the nearest edges from one frame to the next.
fn is_on_road(case: &Case<'_>, agent: usize, frame: usize, near: &mut [Option<u32>; 4]) -> Option<bool> {
    let road = case.road_under(agent, frame);
    if !case.options.offroad_corners {
        return road.drivable(case.motion.position(agent, frame), &mut near[0]);
    }
    let mut all = true;
    for (corner, near) in case.motion.footprint(agent, frame).corners().into_iter().zip(near) {
        all &= road.drivable(corner, near)?;
    }
    Some(all)
}

/// Share of vehicle-steps off the road.
pub(super) const OFF_ROAD: &OfBenchmark = &OfBenchmark {
    spec: MetricSpec {
        id: "offroad",
        title: "Offroad",
        unit: Unit::Rate,
        scope: Scope::Rollout,
        lower_is_better: true,
        source: "ReactSim-Bench, Metric Computation Details: off-road rate",
    },
    has_events: true,
    score,
};

fn score(case: &Case<'_>, events: &mut Vec<Event>) -> Option<Score> {
    let (mut hits, mut valid) = (0, 0);
    for (i, steps) in off_road_steps(case).iter().enumerate() {
        (hits, valid) = (hits + steps.hits, valid + steps.valid);
        for &(first, last) in &steps.intervals {
            let p = case.motion.position(i, case.current + first);
            events.push(Event { values: vec![("x", p.x), ("y", p.y)], ..Event::of(case, i, first, last) });
        }
    }
    (valid > 0).then_some(Score::Rate { hits, valid })
}
