//! Named random streams.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

/// A random stream. Its numbers depend on its name only, never on execution order, threads or other
/// streams.
pub type Stream = ChaCha8Rng;

/// Purpose of a stream: part of its name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// Choices made once per episode (routes, driver parameters).
    Begin,
    /// Choices made while planning.
    Plan,
    /// Resampling of scenarios for confidence intervals.
    Bootstrap,
    /// Draws of a source of deviated AVs; the candidate number takes the place of the rollout.
    Candidate,
    /// Draws of a generated map; the attempt number takes the place of the rollout.
    Map,
    /// Draws of generated traffic.
    Traffic,
    /// Choices made once per episode by a simulator that moves the AV only.
    AvBegin,
    /// Choices made while planning by a simulator that moves the AV only.
    AvPlan,
}

/// Returns the stream named by seed, scenario, rollout and purpose: ChaCha8 keyed by the BLAKE3 digest
/// of the name.
pub fn stream(seed: u64, scenario: &str, rollout: u32, purpose: Purpose) -> Stream {
    let mut name = Vec::with_capacity(scenario.len() + 24);
    name.extend_from_slice(b"reactsim");
    name.extend_from_slice(&seed.to_le_bytes());
    name.extend_from_slice(&rollout.to_le_bytes());
    name.push(purpose as u8);
    name.extend_from_slice(scenario.as_bytes());
    ChaCha8Rng::from_seed(*blake3::hash(&name).as_bytes())
}

/// Number of the ChaCha stream, under the key of the stream of the beginning, from which simulators draw when
/// agents enter or leave for the first time. Each further time has the next number.
const FIRST_CHANGE_STREAM: u64 = 1 << 32;

/// Returns the stream of a beginning after agents entered or left this many times: agents that enter get
/// other draws than those that are there.
pub(crate) fn after_changes(mut stream: Stream, changes: usize) -> Stream {
    if changes > 0 {
        stream.set_stream(FIRST_CHANGE_STREAM + changes as u64);
    }
    stream
}

#[cfg(test)]
mod tests {
    use rand_chacha::rand_core::Rng;

    use super::*;

    #[test]
    fn names_decide() {
        let first = |seed, id, rollout, purpose| stream(seed, id, rollout, purpose).next_u64();
        let base = first(0, "a", 0, Purpose::Begin);
        assert_eq!(base, first(0, "a", 0, Purpose::Begin));
        for other in [
            first(1, "a", 0, Purpose::Begin),
            first(0, "b", 0, Purpose::Begin),
            first(0, "a", 1, Purpose::Begin),
            first(0, "a", 0, Purpose::Plan),
            first(0, "a", 0, Purpose::AvBegin),
        ] {
            assert_ne!(base, other);
        }
    }
}
