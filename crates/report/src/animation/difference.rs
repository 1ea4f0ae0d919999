//! Difference between two consecutive pictures.

use super::palette::TRANSPARENT;

/// Changed rectangle of a picture.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Change {
    /// Left edge, pixels.
    pub(super) left: usize,
    /// Upper edge, pixels.
    pub(super) top: usize,
    /// Width in pixels, at least 1.
    pub(super) width: usize,
    /// Height in pixels, at least 1.
    pub(super) height: usize,
    /// Pixels in row-major order; [`TRANSPARENT`] if unchanged.
    pub(super) pixels: Vec<u8>,
}

/// Returns the smallest rectangle with all changes in a picture of this width: one transparent pixel if
/// there are none, since a frame must not be empty, and the whole picture if there is none before it.
pub(super) fn change(before: Option<&[u8]>, after: &[u8], width: usize) -> Change {
    let Some(before) = before else {
        let height = after.len() / width.max(1);
        return Change { left: 0, top: 0, width, height, pixels: after.to_vec() };
    };
    let (mut left, mut right, mut top, mut bottom) = (usize::MAX, 0, usize::MAX, 0);
    for (y, (old, new)) in before.chunks_exact(width).zip(after.chunks_exact(width)).enumerate() {
        let differs = |x: &usize| old[*x] != new[*x];
        let (Some(first), Some(last)) = ((0..width).find(differs), (0..width).rfind(differs)) else {
            continue;
        };
        (left, right) = (left.min(first), right.max(last));
        (top, bottom) = (top.min(y), y);
    }
    if left > right {
        return Change { left: 0, top: 0, width: 1, height: 1, pixels: vec![TRANSPARENT] };
    }
    let mut pixels = Vec::with_capacity((right - left + 1) * (bottom - top + 1));
    for y in top..=bottom {
        let row = y * width + left..=y * width + right;
        let pairs = before[row.clone()].iter().zip(&after[row]);
        pixels.extend(pairs.map(|(old, new)| if old == new { TRANSPARENT } else { *new }));
    }
    Change { left, top, width: right - left + 1, height: bottom - top + 1, pixels }
}
