//! Hashes as numbers.

/// Returns the first 64 bits of a hash, the first byte highest.
pub fn leading_bits(hash: &blake3::Hash) -> u64 {
    hash.as_bytes()[..8].iter().fold(0, |bits, byte| bits << 8 | u64::from(*byte))
}

/// Returns 64 uniformly distributed bits as a number from 0 to below 1.
pub fn unit_interval(bits: u64) -> f64 {
    (bits >> 11) as f64 / (1_u64 << 53) as f64
}
