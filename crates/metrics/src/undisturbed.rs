//! Path length lost by vehicles that have no reason to react (`docs/over-reaction.md`).

use super::progress::free_path;
use super::responders::excess;
use super::{Case, Event, MetricSpec, OfBenchmark, Scope, Score, Unit};

/// Mean path length, in metres, that vehicles drive less than in the log. It covers the vehicles without a
/// response in the certificate that move in the log and whose logged boxes keep clear of the AV.
pub(super) const UNDISTURBED_LOSS: &OfBenchmark = &OfBenchmark {
    spec: MetricSpec {
        id: "undisturbed-loss",
        title: "Way lost",
        unit: Unit::Metres,
        scope: Scope::Rollout,
        lower_is_better: true,
        source: "reactsim, docs/over-reaction.md: path length lost against the log by vehicles that \
                 need not answer the AV",
    },
    has_events: true,
    score,
};

fn score(case: &Case<'_>, events: &mut Vec<Event>) -> Option<Score> {
    let (log, responses) = (case.log.as_ref()?, &case.certificate?.responses);
    let (mut sum, mut n) = (0.0, 0);
    let last = case.future().len();
    let responds = |&i: &usize| responses.iter().any(|r| r.agent == case.objects[i].agent.id);
    for i in case.vehicles().filter(|i| !responds(i)) {
        let Some(logged) = free_path(case, &log[i], i) else { continue };
        let driven = case.motion.path_length(i, case.current);
        let lost = excess(logged, driven);
        sum += lost;
        n += 1;
        if lost > 0.0 {
            events.push(Event {
                values: vec![("lost", lost), ("driven", driven), ("reference", logged)],
                ..Event::of(case, i, last, last)
            });
        }
    }
    (n > 0).then_some(Score::Mean { sum, n })
}
