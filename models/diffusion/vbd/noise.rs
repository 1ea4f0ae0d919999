//! The noise that plans start from.

use std::collections::BTreeMap;

use reactsim_rollout::Stream;

use crate::normal_values;

/// Numbers of an action.
const ACTION: usize = 2;

/// Noise of the actions of agents since the beginning of an episode, by slot. An action that keeps its noise
/// from plan to plan stays what it was planned to be, unless the scene has changed.
#[derive(Debug, Default)]
pub(super) struct Noise(BTreeMap<usize, Vec<f32>>);

impl Noise {
    /// Returns the noise of `count` actions of these agents, `[agents, count, 2]`; the first of them is the
    /// action of this number since the beginning. What is not known yet is drawn from the stream.
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
            own.extend(normal_values(stream, to.saturating_sub(own.len())));
            found.extend(&own[from..to]);
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
}
