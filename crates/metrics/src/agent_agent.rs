//! Collisions between agents (ReactSim-Bench, "Metric Computation Details": agent-agent collision rate).

use reactsim_scene::AgentKind;

use super::boxes::{excluded, overlapping_frames};
use super::{Case, Event, Judgement, MetricSpec, OfBenchmark, Scope, Score, Unit};

/// Steps at which an agent overlaps another agent.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Overlaps {
    /// Number of steps with an overlap.
    pub hits: u64,
    /// Number of steps at which the agent is valid.
    pub valid: u64,
    /// Overlaps with partners of higher index, so that each pair is listed once: partner, first step, last
    /// step.
    pub intervals: Vec<(usize, usize, usize)>,
}

impl Judgement for Vec<Overlaps> {
    fn compute(case: &Case<'_>) -> Self {
        let n = case.objects.len();
        let (motion, options) = (&case.motion, &case.options);
        let mut found = vec![Overlaps::default(); n];
        let mut hit = vec![false; n * case.frames()];
        let partner =
            |i: usize| case.evaluated(i) || (options.aa_include_av && i == case.av && case.present(i));
        let partners: Vec<(usize, [f64; 4])> =
            (0..n).filter(|&i| partner(i)).map(|i| (i, extent(case, i))).collect();
        for (at, &(i, a)) in partners.iter().enumerate() {
            for &(j, b) in &partners[at + 1..] {
                let counts = pair_counts(case.objects[i].agent.kind, case.objects[j].agent.kind);
                if !counts || !(case.evaluated(i) || case.evaluated(j)) {
                    continue;
                }
                let reach = motion.radius[i] + motion.radius[j] + 1e-6;
                let apart =
                    a[0] > b[1] + reach || b[0] > a[1] + reach || a[2] > b[3] + reach || b[2] > a[3] + reach;
                if apart || excluded(case, i, j) {
                    continue;
                }
                let mut open: Option<(usize, usize)> = None;
                for f in overlapping_frames(case, i, j, case.current + 1) {
                    let step = f - case.current;
                    hit[motion.at(i, f)] = true;
                    hit[motion.at(j, f)] = true;
                    open = match open {
                        Some((first, last)) if last + 1 == step => Some((first, step)),
                        ended => {
                            found[i].intervals.extend(ended.map(|(first, last)| (j, first, last)));
                            Some((step, step))
                        }
                    };
                }
                found[i].intervals.extend(open.map(|(first, last)| (j, first, last)));
            }
        }
        for i in case.agents() {
            for f in case.future() {
                found[i].valid += u64::from(motion.valid(i, f));
                found[i].hits += u64::from(hit[motion.at(i, f)]);
            }
        }
        found
    }
}

/// Returns the overlaps of every object; zeros for objects that are not evaluated.
pub(super) fn overlaps<'c>(case: &'c Case<'_>) -> &'c [Overlaps] {
    case.judgement::<Vec<Overlaps>>()
}

/// Returns the bounds of a track over the scored frames: min x, max x, min y, max y.
fn extent(case: &Case<'_>, object: usize) -> [f64; 4] {
    let range = case.motion.at(object, case.current + 1)..case.motion.at(object, case.frames());
    let (x, y) = (&case.motion.x[range.clone()], &case.motion.y[range]);
    let mut e = [f64::INFINITY, f64::NEG_INFINITY, f64::INFINITY, f64::NEG_INFINITY];
    // `min` and `max` ignore the NaN of absent frames.
    for (&x, &y) in x.iter().zip(y) {
        e = [e[0].min(x), e[1].max(x), e[2].min(y), e[3].max(y)];
    }
    e
}

/// Returns whether overlaps between agents of these kinds count. Pedestrians move close to each other and to
/// cyclists, so such pairs do not count; two cyclists do.
pub const fn pair_counts(a: AgentKind, b: AgentKind) -> bool {
    use AgentKind::{Cyclist, Pedestrian};
    !matches!((a, b), (Pedestrian, Pedestrian) | (Pedestrian, Cyclist) | (Cyclist, Pedestrian))
}

/// Share of agent-steps with a collision.
pub(super) const AGENT_AGENT: &OfBenchmark = &OfBenchmark {
    spec: MetricSpec {
        id: "aa-collision",
        title: "A-A Coll.",
        unit: Unit::Rate,
        scope: Scope::Rollout,
        lower_is_better: true,
        source: "ReactSim-Bench, Metric Computation Details: agent-agent collision rate",
    },
    has_events: true,
    score,
};

fn score(case: &Case<'_>, events: &mut Vec<Event>) -> Option<Score> {
    let (mut hits, mut valid) = (0, 0);
    for (i, overlaps) in overlaps(case).iter().enumerate() {
        (hits, valid) = (hits + overlaps.hits, valid + overlaps.valid);
        for &(j, first, last) in &overlaps.intervals {
            events.push(Event { partner: Some(case.id(j)), ..Event::of(case, i, first, last) });
        }
    }
    (valid > 0).then_some(Score::Rate { hits, valid })
}
