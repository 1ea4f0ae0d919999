//! The noise that plans start from.

use std::collections::BTreeMap;

use reactsim_rollout::Stream;

use crate::normal_values;

/// Numbers of an action.
const ACTION: usize = 2;

/// Noise of the actions of agents, by slot. An action that keeps its noise from plan to plan stays what it
/// was planned to be, unless the scene has changed.
#[derive(Debug, Default)]
pub(super) struct Noise(BTreeMap<usize, AgentNoise>);

/// Noise of the actions of one agent that are not over.
#[derive(Debug, Default)]
struct AgentNoise {
    /// Index of the first value among those since the beginning of the episode.
    first: usize,
    values: Vec<f32>,
}

impl Noise {
    /// Returns the noise of `count` actions of these agents, `[agents, count, 2]`; the first of them is the
    /// action of this number since the beginning, and that of earlier ones is forgotten. What is not known
    /// yet is drawn from the stream.
    pub(super) fn of(
        &mut self,
        slots: &[usize],
        first: usize,
        count: usize,
        stream: &mut Stream,
    ) -> Vec<f32> {
        let (from, to) = (ACTION * first, ACTION * (first + count));
        let mut found = Vec::with_capacity(slots.len() * ACTION * count);
        for slot in slots {
            let own = self.0.entry(*slot).or_default();
            let known = own.first + own.values.len();
            own.values.extend(normal_values(stream, to.saturating_sub(known)));
            own.values.drain(..from - own.first);
            own.first = from;
            found.extend(&own.values[..to - from]);
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use rand_chacha::rand_core::SeedableRng;

    use super::*;

    #[test]
    fn actions_keep_their_noise() {
        let mut stream = Stream::seed_from_u64(1);
        let mut noise = Noise::default();
        let first = noise.of(&[0, 7], 0, 3, &mut stream);
        let next = noise.of(&[7, 4], 1, 3, &mut stream);
        assert_eq!((first.len(), next.len()), (12, 12));
        // The last two of three actions of agent 7 are the first two of the next plan.
        assert_eq!(first[8..], next[..4]);
        assert!(next[..6] != next[6..]);
        assert_eq!(noise.of(&[7, 4], 1, 3, &mut stream), next);
    }

    #[test]
    fn the_noise_of_past_actions_is_forgotten() {
        let mut stream = Stream::seed_from_u64(1);
        let mut noise = Noise::default();
        for first in 0..1200 {
            assert_eq!(noise.of(&[0, 1 + first % 2], first, 16, &mut stream).len(), 64);
            assert!(noise.0.values().all(|own| own.values.len() <= 2 * 17));
        }
        // An agent that is planned for the first time late draws the numbers of all actions before.
        let late = noise.of(&[5], 1200, 16, &mut Stream::seed_from_u64(2));
        let all = normal_values(&mut Stream::seed_from_u64(2), 2 * 1216);
        assert_eq!(late, all.into_iter().skip(2 * 1200).collect::<Vec<_>>());
    }
}
