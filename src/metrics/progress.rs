//! Progress of vehicles that the AV does not concern: shows simulators that win on collisions by freezing.

use super::boxes::sharp_distance;
use super::{Case, Event, LoggedTrack, Metric, MetricSpec, Score, Unit};
use crate::geometry::Vec2;

/// A vehicle counts where its log gets this far from its current position, metres.
const MOVED: f64 = 5.0;
/// A vehicle is in conflict where its logged box comes closer than this to the AV's box, metres.
const CLEARANCE: f64 = 5.0;

/// Mean, over the vehicles that drive in the log and keep clear of the AV there, of driven over logged path length.
#[derive(Debug)]
pub(super) struct Progress;

impl Metric for Progress {
    fn spec(&self) -> &'static MetricSpec {
        &MetricSpec {
            id: "progress",
            title: "Progress",
            unit: Unit::Plain,
            lower_is_better: false,
            source: "reactsim: path length over the log's, at most 1, of vehicles not in conflict with the AV",
        }
    }

    fn score(&self, case: &Case<'_>, _: &mut Vec<Event>) -> Option<Score> {
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
}

/// Length of the logged path from now on, metres, if the vehicle drives there and keeps clear of the AV.
pub(super) fn free_path(case: &Case<'_>, log: &LoggedTrack<'_>, agent: usize) -> Option<f64> {
    let (mut path, mut farthest) = (0.0, 0.0_f64);
    let first = log.at(case.current)?.position();
    let mut last = first;
    for f in case.future() {
        let p = log.at(f)?.position();
        path += (p - last).norm();
        farthest = farthest.max((p - first).norm());
        last = p;
    }
    let clear = |f: usize| {
        let Some(state) = log.at(f) else { return true };
        !(case.present(case.av) && case.motion.valid(case.av, f))
            || sharp_distance(
                &state.footprint(case.objects[agent].agent),
                &case.motion.footprint(case.av, f),
                CLEARANCE,
            ) >= CLEARANCE
    };
    (farthest >= MOVED && case.future().all(clear)).then_some(path)
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
