//! Progress of vehicles that the AV does not affect: reveals simulators that avoid collisions by freezing.

use reactsim_geometry::{OrientedBox, Vec2};

use super::{Case, Event, LoggedTrack, MetricSpec, OfBenchmark, Scope, Score, Unit};

/// Minimum logged displacement from the current position, in metres, for a vehicle to count.
const MIN_DISPLACEMENT: f64 = 5.0;
/// Distance between a vehicle's logged box and the AV's box, in metres, below which the vehicle is in
/// conflict.
const CLEARANCE: f64 = 5.0;

/// Mean ratio of driven to logged path length, over the vehicles that move in the log and whose logged boxes
/// keep clear of the AV.
pub(super) const PROGRESS: &OfBenchmark = &OfBenchmark {
    spec: MetricSpec {
        id: "progress",
        title: "Progress",
        unit: Unit::Plain,
        scope: Scope::Rollout,
        lower_is_better: false,
        source: "reactsim: path length over the log's, at most 1, of vehicles not in conflict with \
                 the AV",
    },
    has_events: false,
    score,
};

fn score(case: &Case<'_>, _: &mut Vec<Event>) -> Option<Score> {
    let log = case.log.as_ref()?;
    let (mut sum, mut n) = (0.0, 0);
    for i in case.vehicles() {
        if let Some(logged) = free_path(case, &log[i], i) {
            let positions = (case.current..case.frames())
                .filter(|&f| case.motion.valid(i, f))
                .map(|f| case.motion.position(i, f));
            sum += (length(positions) / logged).min(1.0);
            n += 1;
        }
    }
    (n > 0).then_some(Score::Mean { sum, n })
}

/// Returns the length of the logged path from now on, metres, if the vehicle is in the log to its end, moves
/// there and its logged boxes keep clear of the AV. The path of a vehicle that leaves ends at its last step.
pub(super) fn free_path(case: &Case<'_>, log: &LoggedTrack<'_>, agent: usize) -> Option<f64> {
    if !case.future().all(|f| log.at(f).is_some()) {
        return None;
    }
    let (mut path, mut farthest) = (0.0, 0.0_f64);
    let first = log.at(case.current)?.position();
    let mut last = first;
    for f in case.path_frames(agent) {
        let p = log.at(f)?.position();
        path += (p - last).norm();
        farthest = farthest.max((p - first).norm());
        last = p;
    }
    let clear = |f: usize| {
        let Some(state) = log.at(f) else { return true };
        !(case.present(case.av) && case.motion.valid(case.av, f))
            || are_clear(&state.footprint(case.objects[agent].agent), &case.motion.footprint(case.av, f))
            || case.log_is_apart(agent, f, state.position())
    };
    (farthest >= MIN_DISPLACEMENT && case.path_frames(agent).all(clear)).then_some(path)
}

/// Returns whether two sharp boxes keep clear of one another.
fn are_clear(a: &OrientedBox, b: &OrientedBox) -> bool {
    let least = (a.center - b.center).norm() - a.radius() - b.radius();
    least > CLEARANCE || a.signed_distance(b) >= CLEARANCE
}

fn length(mut positions: impl Iterator<Item = Vec2>) -> f64 {
    let Some(mut last) = positions.next() else { return 0.0 };
    let mut sum = 0.0;
    for p in positions {
        sum += (p - last).norm();
        last = p;
    }
    sum
}
