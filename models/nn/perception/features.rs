//! Writing of features.

/// Writes values to the first features of `out`.
pub fn put<const N: usize>(out: &mut [f32], values: [f64; N]) {
    for (slot, value) in out.iter_mut().zip(values) {
        *slot = value as f32;
    }
}
