//! Tokens of one class, and the search for the nearest.

use reactsim_geometry::Vec2;
use reactsim_nn::perception::Class;
use reactsim_scene::dynamics::Pose;

use super::{TOKEN_FRAMES, TokenPoses};

/// Tolerance of search bounds for rounding, metres: tokens within it are compared exactly.
const ROUNDING_TOLERANCE: f64 = 1e-9;

/// Tokens of one class.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct TokenSet {
    class: Class,
    pub(super) poses: Vec<TokenPoses>,
    /// Contour of each token at 0.5 s.
    pub(super) contours: Vec<[Vec2; 4]>,
    /// Tokens sorted by the x coordinate of their end.
    by_x: Vec<Entry>,
}

/// Data of a token that the search reads, in one place.
#[derive(Clone, Debug, PartialEq)]
struct Entry {
    /// End point.
    end: Vec2,
    contour: [Vec2; 4],
    token: usize,
}

impl TokenSet {
    /// Builds a set of tokens, whose poses must be finite.
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

    /// Returns the nearest token to a motion and its distance; the lower index of equally near ones.
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

    /// Returns the `k` nearest tokens (or all if there are fewer) with their distances, nearest first.
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

    /// Calls `visit` with tokens and their distances. `visit` returns the distance up to which tokens
    /// are of interest; all tokens within it are visited.
    ///
    /// The mean displacement of the corners equals that of the centres, so the sum of corner distances
    /// is at least four times the distance of the centres. Tokens are visited from the end of the motion
    /// outwards, ahead and behind in order of distance.
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
            if near == f64::INFINITY || 4.0 * near - ROUNDING_TOLERANCE > reach {
                return;
            }
            if i == ahead {
                ahead += 1;
            } else {
                back -= 1;
            }
            let entry = &self.by_x[i];
            let bound = reach + ROUNDING_TOLERANCE;
            if 16.0 * (entry.end - end).norm_squared() > bound * bound {
                continue;
            }
            reach = visit((entry.token, corner_distance(&entry.contour, &contour)));
        }
    }
}

/// Returns the sum of the distances of corresponding corners, metres.
pub(super) fn corner_distance(a: &[Vec2; 4], b: &[Vec2; 4]) -> f64 {
    (a[0] - b[0]).norm() + (a[1] - b[1]).norm() + (a[2] - b[2]).norm() + (a[3] - b[3]).norm()
}

/// Returns whether token `a` with its distance ranks before `b`.
fn is_nearer(a: (usize, f64), b: (usize, f64)) -> bool {
    a.1 < b.1 || (a.1 == b.1 && a.0 < b.0)
}
