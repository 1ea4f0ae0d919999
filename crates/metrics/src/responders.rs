//! Responders: agents whose necessary reaction to a deviated AV is known from a certificate.

use reactsim_scene::{DT, Response};

use super::boxes::{excluded, overlap};
use super::{Case, Judgement};

/// A direct responder: an agent whose certificate response answers the AV itself, with its motion in the
/// rollout.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Responder {
    /// Index of the agent in the objects of the case.
    pub(super) agent: usize,
    /// Path length in the rollout, metres.
    pub(super) driven: f64,
    /// Path length in the certificate, metres.
    pub(super) reference: f64,
    /// Peak deceleration in the rollout, m/s², at least 0.
    pub(super) peak: f64,
    /// Peak deceleration in the certificate, m/s².
    pub(super) reference_peak: f64,
    /// First and last step at which the agent touches the AV or is risky; `None` for a responder that counts.
    pub(super) under_reacts: Option<(usize, usize)>,
}

impl Responder {
    /// Returns the path length that the agent drives less than in its certificate response, metres, at least
    /// 0.
    pub(super) fn lost(&self) -> f64 {
        excess(self.reference, self.driven)
    }

    /// Returns the peak deceleration beyond that of the certificate response, m/s², at least 0.
    pub(super) fn over_braking(&self) -> f64 {
        excess(self.peak, self.reference_peak)
    }
}

/// Difference up to which two path lengths (in metres) or two decelerations (in m/s²) are equal up to
/// rounding.
const ROUNDING: f64 = 1e-6;

/// Returns the amount by which a value exceeds another; 0 if it does not, or by no more than rounding.
pub(super) fn excess(value: f64, other: f64) -> f64 {
    let difference = value - other;
    if difference > ROUNDING { difference } else { 0.0 }
}

impl Judgement for Option<Vec<Responder>> {
    fn compute(case: &Case<'_>) -> Self {
        let direct = case.certificate?.responses.iter().filter(|r| r.leader.is_none());
        Some(direct.filter_map(|response| responder(case, response)).collect())
    }
}

/// Returns the direct responders of a case, in the order of the certificate; `None` without a certificate.
pub(super) fn responders<'c>(case: &'c Case<'_>) -> Option<&'c [Responder]> {
    case.judgement::<Option<Vec<Responder>>>().as_deref()
}

/// Builds the responder of a response; `None` for an agent that is not evaluated: unknown, absent at the
/// current frame, or the AV.
fn responder(case: &Case<'_>, response: &Response) -> Option<Responder> {
    let agent = case.agents().find(|&i| case.objects[i].agent.id == response.agent)?;
    let steps = case.path_frames(agent).len().min(response.track.len().saturating_sub(1));
    let track = response.track.get(..=steps)?;
    let logged = case.motion.speed[case.motion.at(agent, case.current)];
    // The response begins with the state at the current frame, whose velocity comes from the case as in all
    // metrics.
    let speeds = (0..=steps).map(|k| match track[k].velocity() {
        _ if k == 0 => logged,
        Some(velocity) => velocity.norm(),
        None => (track[k].position() - track[k - 1].position()).norm() / DT,
    });
    Some(Responder {
        agent,
        driven: case.motion.path_length(agent, case.current),
        reference: track.windows(2).map(|w| (w[1].position() - w[0].position()).norm()).sum(),
        peak: peak_deceleration(
            (case.current..case.frames()).map(|f| case.motion.speed[case.motion.at(agent, f)]),
        ),
        reference_peak: peak_deceleration(speeds).max(response.peak_deceleration),
        under_reacts: under_reaction(case, agent),
    })
}

/// Returns the peak deceleration over speeds at successive steps, m/s², at least 0. Steps with an unknown
/// speed (NaN) are skipped.
fn peak_deceleration(speeds: impl Iterator<Item = f64>) -> f64 {
    let (mut before, mut peak) = (f64::NAN, 0.0_f64);
    for speed in speeds {
        // `max` ignores NaN.
        peak = peak.max((before - speed) / DT);
        before = speed;
    }
    peak
}

/// Returns the first and last step at which an agent touches the AV (rounded boxes, regardless of fault) or,
/// if it is a vehicle, is risky.
fn under_reaction(case: &Case<'_>, agent: usize) -> Option<(usize, usize)> {
    if !case.present(case.av) || excluded(case, agent, case.av) {
        return None;
    }
    let touches = |&f: &usize| overlap(case, agent, case.av, f);
    let mut steps = case.future().filter(touches).map(|f| f - case.current);
    let contact = steps.next().map(|first| (first, steps.last().unwrap_or(first)));
    let risky = case.approaches()[agent].and_then(|a| a.risky);
    match (contact, risky) {
        (Some(a), Some(b)) => Some((a.0.min(b.0), a.1.max(b.1))),
        (one, other) => one.or(other),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unknown_speeds_have_no_deceleration() {
        assert_eq!(peak_deceleration([5.0, f64::NAN, 0.0, 1.0].into_iter()), 0.0);
        assert!((peak_deceleration([5.0, 4.9, f64::NAN, 3.0, 2.8, 2.9].into_iter()) - 2.0).abs() < 1e-9);
        assert_eq!(peak_deceleration(std::iter::empty()), 0.0);
    }
}
