//! Named random streams.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

/// A random stream. Its numbers depend only on its name, never on order, threads or other streams.
pub type Stream = ChaCha8Rng;

/// Returns the stream with this name: ChaCha8 keyed by the BLAKE3 digest of the parts of its name,
/// encoded unambiguously.
pub(super) fn stream(seed: u64, purpose: &str, number: u64, name: &str) -> Stream {
    let mut key = Vec::with_capacity(purpose.len() + name.len() + 40);
    key.extend_from_slice(b"reactsim-training");
    key.extend_from_slice(&seed.to_le_bytes());
    key.extend_from_slice(&number.to_le_bytes());
    key.extend_from_slice(&(purpose.len() as u64).to_le_bytes());
    key.extend_from_slice(purpose.as_bytes());
    key.extend_from_slice(name.as_bytes());
    ChaCha8Rng::from_seed(*blake3::hash(&key).as_bytes())
}

/// Draws an integer from 0 to below `end`, uniform to within 2⁻⁶⁴. `end` must not be 0.
pub(super) fn below(stream: &mut Stream, end: usize) -> usize {
    use rand_chacha::rand_core::Rng;
    ((u128::from(stream.next_u64()) * end as u128) >> 64) as usize
}

/// Draws a number from 0 to below 1, in steps of 2⁻²⁴.
pub(super) fn unit(stream: &mut Stream) -> f32 {
    use rand_chacha::rand_core::Rng;
    (stream.next_u32() >> 8) as f32 / (1u32 << 24) as f32
}

/// Shuffles a list (Fisher and Yates).
pub(super) fn shuffle<T>(stream: &mut Stream, list: &mut [T]) {
    for last in (1..list.len()).rev() {
        list.swap(last, below(stream, last + 1));
    }
}
