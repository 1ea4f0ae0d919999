//! Over-reaction: progress and comfort that agents give up beyond what a deviated AV requires
//! (`docs/over-reaction.md`).

use super::responders::{Responder, responders};
use super::{Case, Event, MetricSpec, OfBenchmark, Scope, Score, Unit};

/// Mean path length, in metres, that the responders that count drive less than in the certificate.
pub(super) const OVER_REACTION: &OfBenchmark = &OfBenchmark {
    spec: MetricSpec {
        id: "over-reaction",
        title: "Over-r.",
        unit: Unit::Metres,
        scope: Scope::Rollout,
        lower_is_better: true,
        source: "reactsim, docs/over-reaction.md: path length lost against the certificate by \
                 agents that answer the AV",
    },
    has_events: true,
    score: over_reaction,
};

fn over_reaction(case: &Case<'_>, events: &mut Vec<Event>) -> Option<Score> {
    for responder in responders(case)? {
        let lost = responder.lost();
        if responder.under_reacts.is_none() && lost == 0.0 {
            continue;
        }
        let last = case.future().len();
        let (step, last_step) = responder.under_reacts.unwrap_or((last, last));
        let mut values =
            vec![("lost", lost), ("driven", responder.driven), ("reference", responder.reference)];
        values.extend([("peak", responder.peak), ("reference_peak", responder.reference_peak)]);
        events.push(Event {
            partner: Some(case.id(case.av)),
            reason: responder.under_reacts.map(|_| "under_reacted"),
            counted: responder.under_reacts.is_none(),
            values,
            ..Event::of(case, responder.agent, step, last_step)
        });
    }
    mean(case, Responder::lost)
}

/// Mean deceleration, in m/s², that the responders that count use beyond that of the certificate.
pub(super) const OVER_BRAKING: &OfBenchmark = &OfBenchmark {
    spec: MetricSpec {
        id: "over-braking",
        title: "Over-br.",
        unit: Unit::MetresPerSecondSquared,
        scope: Scope::Rollout,
        lower_is_better: true,
        source: "reactsim, docs/over-reaction.md: peak deceleration beyond the certificate's of \
                 agents that answer the AV",
    },
    has_events: true,
    score: over_braking,
};

fn over_braking(case: &Case<'_>, events: &mut Vec<Event>) -> Option<Score> {
    let last = case.future().len();
    for responder in responders(case)?.iter().filter(|r| r.under_reacts.is_none()) {
        let excess = responder.over_braking();
        if excess > 0.0 {
            events.push(Event {
                partner: Some(case.id(case.av)),
                values: vec![
                    ("excess", excess),
                    ("peak", responder.peak),
                    ("reference_peak", responder.reference_peak),
                ],
                ..Event::of(case, responder.agent, last, last)
            });
        }
    }
    mean(case, Responder::over_braking)
}

/// Returns the mean of a value over the responders that count, i.e. do not under-react; `None` without any.
fn mean(case: &Case<'_>, value: impl Fn(&Responder) -> f64) -> Option<Score> {
    let (mut sum, mut n) = (0.0, 0);
    for responder in responders(case)?.iter().filter(|r| r.under_reacts.is_none()) {
        sum += value(responder);
        n += 1;
    }
    (n > 0).then_some(Score::Mean { sum, n })
}

#[cfg(test)]
mod tests;
