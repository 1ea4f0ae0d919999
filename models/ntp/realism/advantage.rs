//! Advantages of agents in the rollouts of a group: by how much their tokens are to become likelier.

use std::collections::BTreeMap;

use reactsim_metrics::wosac::RolloutShare;
use reactsim_metrics::{Case, Options, metric};
use reactsim_scene::{FUTURE, Frame, Scenario};

use super::super::tokens::TOKEN_FRAMES;
use super::recipe::Features;

/// Number of tokens of a rollout.
pub(super) const STEPS: usize = FUTURE / TOKEN_FRAMES;
/// Fine for the first contact with the AV that an agent is at fault for.
const AV_CONTACT: f64 = 2.0;
/// Fine for the first contact with another agent.
const CONTACT: f64 = 1.0;
/// Fine per metre that an agent drives less than in its certificate.
const LOST: f64 = 0.05;
/// Path length, metres, above which that fine grows no more.
const MOST_LOST: f64 = 20.0;
/// Factor by which a contact counts less for every token that was drawn earlier.
const DISCOUNT: f64 = 0.9;

/// Values of the tokens of an agent, by step.
pub(super) type Steps = [f64; STEPS];

/// Returns the advantages of objects by rollout and object: their shares, times the numbers of rollouts and
/// of objects. The result is in units of the metametric: what all objects gained if all had done likewise in
/// all rollouts.
pub(super) fn of_shares(shares: &[Vec<RolloutShare>], features: Features) -> Vec<Vec<f64>> {
    let scale = |objects: usize| (shares.len() * objects) as f64;
    let of = |own: &Vec<RolloutShare>| {
        own.iter().map(|share| scale(own.len()) * features.part(share.likelihoods)).collect()
    };
    shares.iter().map(of).collect()
}

/// Returns values of rollouts, by rollout, agent and step, less their means over the other rollouts.
pub(super) fn compared(values: &[Vec<Steps>]) -> Vec<Vec<Steps>> {
    let others = (values.len() - 1) as f64;
    let agents = values.first().map_or(0, Vec::len);
    let compare = |rollout: &Vec<Steps>, agent: usize| -> Steps {
        std::array::from_fn(|step| {
            let (own, all) =
                (rollout[agent][step], values.iter().map(|other| other[agent][step]).sum::<f64>());
            own - (all - own) / others
        })
    };
    values.iter().map(|rollout| (0..agents).map(|agent| compare(rollout, agent)).collect()).collect()
}

/// Faults of agents in a rollout with an AV that leaves its log.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Fines {
    /// First step, from 1, of a contact with the AV that an agent is at fault for, by agent.
    pub(super) av_contacts: BTreeMap<usize, usize>,
    /// First step of a contact with another agent, by agent.
    pub(super) contacts: BTreeMap<usize, usize>,
    /// Path length, metres, that an agent drives less than in its certificate, by agent.
    pub(super) lost: BTreeMap<usize, f64>,
}

impl Fines {
    /// Judges a rollout by the metrics of the benchmark.
    pub(super) fn of(scenario: &Scenario, tracks: &[Vec<Frame>]) -> Self {
        let certificate = scenario.deviation.as_ref().and_then(|deviation| deviation.certificate.as_ref());
        let case = Case::of_rollout(scenario, tracks.iter().map(Vec::as_slice), Options::default())
            .with_certificate(certificate);
        let slot = |id: &String| scenario.start.agents.iter().position(|agent| agent.id == *id);
        let events = |id: &str| {
            let mut events = Vec::new();
            metric(id).and_then(|metric| metric.score(&case, &mut events));
            events
        };
        let mut fines = Self::default();
        let first = |contacts: &mut BTreeMap<usize, usize>, id: &String, step: usize| {
            if let Some(slot) = slot(id) {
                contacts.entry(slot).and_modify(|first| *first = step.min(*first)).or_insert(step);
            }
        };
        for event in events("aav-collision").iter().filter(|event| event.counted) {
            first(&mut fines.av_contacts, &event.agent, event.step);
        }
        for event in events("aa-collision").iter().filter(|event| event.counted) {
            for id in [Some(&event.agent), event.partner.as_ref()].into_iter().flatten() {
                first(&mut fines.contacts, id, event.step);
            }
        }
        // Also of agents that are risky: otherwise risk would be cheaper than over-reaction.
        for event in events("over-reaction") {
            let lost = event.values.iter().find(|(name, _)| *name == "lost");
            if let (Some(slot), Some((_, lost))) = (slot(&event.agent), lost) {
                fines.lost.insert(slot, lost.min(MOST_LOST));
            }
        }
        fines
    }

    /// Returns the sum of the fines.
    pub(super) fn sum(&self) -> f64 {
        let contacts = AV_CONTACT * self.av_contacts.len() as f64 + CONTACT * self.contacts.len() as f64;
        contacts + LOST * self.lost.values().sum::<f64>()
    }

    /// Returns the negative fines of `agents` agents that count for the token of each step: later contacts,
    /// which are discounted, and over-reaction, to which all tokens contribute.
    pub(super) fn values(&self, agents: usize) -> Vec<Steps> {
        let mut values = vec![[0.0; STEPS]; agents];
        for (contacts, fine) in [(&self.av_contacts, AV_CONTACT), (&self.contacts, CONTACT)] {
            for (&agent, &step) in contacts {
                let token = ((step.max(1) - 1) / TOKEN_FRAMES).min(STEPS - 1);
                let mut fine = fine;
                for value in values[agent][..=token].iter_mut().rev() {
                    *value -= fine;
                    fine *= DISCOUNT;
                }
            }
        }
        for (&agent, lost) in &self.lost {
            values[agent].iter_mut().for_each(|value| *value -= LOST * lost);
        }
        values
    }
}

#[cfg(test)]
mod tests {
    use reactsim_metrics::wosac::Feature;

    use super::*;

    #[test]
    fn advantages_are_shares_in_units_of_the_metametric() {
        let share = |speed: f64, collision: f64| {
            let mut likelihoods = [Some(0.0); Feature::COUNT];
            likelihoods[Feature::LinearSpeed as usize] = Some(speed);
            likelihoods[Feature::CollisionIndication as usize] = Some(collision);
            RolloutShare { metametric: 0.05 * speed + 0.25 * collision, likelihoods }
        };
        // Two rollouts of three objects: the first object did well in the first rollout, the last one did
        // not.
        let shares = [
            vec![share(0.2, 0.0), share(0.0, 0.0), share(0.1, -0.1)],
            vec![share(-0.2, 0.0), share(0.0, 0.0), share(0.0, 0.1)],
        ];
        let near = |found: Vec<Vec<f64>>, expected: [[f64; 3]; 2]| {
            for (found, expected) in found.iter().flatten().zip(expected.as_flattened()) {
                assert!((found - 6.0 * expected).abs() < 1e-7, "{found}, {expected}");
            }
        };
        near(of_shares(&shares, Features::All), [[0.01, 0.0, -0.02], [-0.01, 0.0, 0.025]]);
        near(of_shares(&shares, Features::Kinematic), [[0.01, 0.0, 0.005], [-0.01, 0.0, 0.0]]);
    }

    #[test]
    fn fines_count_for_the_tokens_before_them() {
        // Step 8 is in the second token.
        let fines = Fines {
            av_contacts: BTreeMap::from([(1, 8)]),
            contacts: BTreeMap::from([(2, 80)]),
            lost: BTreeMap::from([(3, 10.0)]),
        };
        assert!((fines.sum() - 3.5).abs() < 1e-12);
        let values = fines.values(4);
        assert_eq!(values[0], [0.0; STEPS]);
        assert!((values[1][0] + 1.8).abs() < 1e-12);
        assert_eq!((values[1][1], values[1][2]), (-2.0, 0.0));
        assert_eq!(values[2][STEPS - 1], -1.0);
        assert_eq!(values[3], [-0.5; STEPS]);
        // Three rollouts: the first one has the fines, the others none.
        let none = Fines::default().values(4);
        let found = compared(&[values, none.clone(), none]);
        assert_eq!([found[0][1][1], found[1][1][1], found[2][1][1]], [-2.0, 1.0, 1.0]);
        assert_eq!(found[2][0], [0.0; STEPS]);
    }
}
