//! The tokens of one class, and the search for the nearest.

use reactsim::dynamics::Pose;
use reactsim::geometry::Vec2;

use super::{Class, TOKEN_FRAMES, TokenPoses};

/// What bounds may be off by for rounding, metres: what lies within is compared in full.
const SLACK: f64 = 1e-9;

/// The tokens of one class.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct TokenSet {
    class: Class,
    pub(super) poses: Vec<TokenPoses>,
    /// Per token the contour at 0.5 s.
    pub(super) contours: Vec<[Vec2; 4]>,
    /// The tokens by how far ahead they end.
    by_x: Vec<Entry>,
}

/// What the search looks at of a token, in one place.
#[derive(Clone, Debug, PartialEq)]
struct Entry {
    /// Where it ends.
    end: Vec2,
    contour: [Vec2; 4],
    token: usize,
}

impl TokenSet {
    /// Tokens of finite poses.
    pub(super) fn new(class: Class, poses: Vec<TokenPoses>) -> Self {
        let contours: Vec<_> = poses.iter().map(|p| class.contour(p[TOKEN_FRAMES])).collect();
        let mut by_x: Vec<Entry> = poses
            .iter()
            .zip(&contours)
            .enumerate()
            .map(|(token, (p, &contour))| Entry { end: p[TOKEN_FRAMES].position, contour, token })
            .collect();
        by_x.sort_by(|a, b| a.end.x.total_cmp(&b.end.x));
        Self { class, poses, contours, by_x }
    }

    /// The nearest token to a motion; the lower index of equally near ones.
    pub(super) fn nearest(&self, motion: Pose) -> (usize, f64) {
        let mut best = (usize::MAX, f64::INFINITY);
        self.search(motion, |found| {
            if is_nearer(found, best) {
                best = found;
            }
            best.1
        });
        best
    }

    /// The `k` nearest tokens (or all there are), nearest first.
    pub(super) fn nearest_k(&self, motion: Pose, k: usize) -> Vec<(usize, f64)> {
        let mut best: Vec<(usize, f64)> = Vec::with_capacity(k + 1);
        if k == 0 {
            return best;
        }
        self.search(motion, |found| {
            let at = best.partition_point(|&other| is_nearer(other, found));
            if at < k {
                best.insert(at, found);
                best.truncate(k);
            }
            if best.len() < k { f64::INFINITY } else { best[k - 1].1 }
        });
        best
    }

    /// Shows tokens with their distances to `visit`, which says up to which distance they are of interest: all within it are shown.
    ///
    /// The mean of the corners' displacements is that of the centres, so the sum of their lengths is at least four times the distance of
    /// the centres. The tokens are walked through from where the motion ends, ahead and back by turns.
    fn search(&self, motion: Pose, mut visit: impl FnMut((usize, f64)) -> f64) {
        let end = motion.position;
        if !(end.x.is_finite() && end.y.is_finite() && motion.heading.is_finite()) {
            return;
        }
        let contour = self.class.contour(motion);
        let mut reach = f64::INFINITY;
        let mut ahead = self.by_x.partition_point(|e| e.end.x < end.x);
        let mut back = ahead;
        loop {
            let gap = |i: Option<usize>| {
                i.and_then(|i| self.by_x.get(i)).map_or(f64::INFINITY, |e| (e.end.x - end.x).abs())
            };
            let (gap_ahead, gap_back) = (gap(Some(ahead)), gap(back.checked_sub(1)));
            let (near, i) = if gap_ahead <= gap_back { (gap_ahead, ahead) } else { (gap_back, back - 1) };
            if near == f64::INFINITY || 4.0 * near - SLACK > reach {
                return;
            }
            if i == ahead {
                ahead += 1;
            } else {
                back -= 1;
            }
            let entry = &self.by_x[i];
            let bound = reach + SLACK;
            if 16.0 * (entry.end - end).norm_squared() > bound * bound {
                continue;
            }
            reach = visit((entry.token, corner_distance(&entry.contour, &contour)));
        }
    }
}

/// The sum of the distances of corresponding corners, metres.
pub(super) fn corner_distance(a: &[Vec2; 4], b: &[Vec2; 4]) -> f64 {
    (a[0] - b[0]).norm() + (a[1] - b[1]).norm() + (a[2] - b[2]).norm() + (a[3] - b[3]).norm()
}

/// Whether one token with its distance comes before another.
fn is_nearer(a: (usize, f64), b: (usize, f64)) -> bool {
    a.1 < b.1 || (a.1 == b.1 && a.0 < b.0)
}
