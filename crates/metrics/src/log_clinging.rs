//! Log clinging: vehicles that collide with the AV because they replay their log.

use super::collision::log_distance;
use super::{Case, Event, MetricSpec, OfBenchmark, Scope, Score, Unit};

/// Distance between a vehicle and its logged position, in metres, up to which it is on its log.
const ON_LOG_DISTANCE: f64 = 1.0;

/// Share of the vehicles with an at-fault collision that are on their log at the step of contact.
///
/// This metric has no events of its own: those of `aav-collision` include the distance (`log_distance`).
pub(super) const LOG_CLINGING: &OfBenchmark = &OfBenchmark {
    spec: MetricSpec {
        id: "log-clinging",
        title: "On log",
        unit: Unit::Rate,
        scope: Scope::Rollout,
        lower_is_better: true,
        source: "reactsim: share of at-fault A-AV collisions within 1 m of the vehicle's logged \
                 position at that step",
    },
    has_events: false,
    score,
};

fn score(case: &Case<'_>, _: &mut Vec<Event>) -> Option<Score> {
    let at_fault =
        case.contacts().iter().enumerate().filter_map(|(i, c)| Some((i, c.filter(|c| c.fault.at_fault())?)));
    let distances: Vec<f64> = at_fault.filter_map(|(i, contact)| log_distance(case, i, &contact)).collect();
    let hits = distances.iter().filter(|d| **d <= ON_LOG_DISTANCE).count() as u64;
    let valid = distances.len() as u64;
    (valid > 0).then_some(Score::Rate { hits, valid })
}
