//! Overlap of rounded boxes, with a broad phase.

use reactsim_geometry::rounded_distance;

use super::{Case, Judgement};

/// Returns whether two objects overlap at a frame: the signed distance of the rounded boxes is below 0.
/// Absent objects overlap nothing, and objects on different levels do not overlap.
pub(super) fn overlap(case: &Case<'_>, a: usize, b: usize, frame: usize) -> bool {
    let (motion, rounding) = (&case.motion, case.options.corner_rounding);
    // NaN distances of absent objects fail the comparison.
    motion.distance2(a, b, frame) <= motion.reach2(a, b)
        && !case.is_apart(a, b, frame)
        && rounded_distance(&motion.footprint(a, frame), &motion.footprint(b, frame), rounding) < 0.0
}

/// Returns the frames from `first` on at which two objects overlap, in order.
pub(super) fn overlapping_frames(
    case: &Case<'_>,
    a: usize,
    b: usize,
    first: usize,
) -> impl Iterator<Item = usize> {
    let (motion, rounding) = (&case.motion, case.options.corner_rounding);
    let touches = move |f: &usize| {
        rounded_distance(&motion.footprint(a, *f), &motion.footprint(b, *f), rounding) < 0.0
            && !case.is_apart(a, b, *f)
    };
    motion.close_frames(a, b, first).filter(touches)
}

/// Returns whether a pair is left out of collisions and risky approaches because it overlaps at the first
/// frame of the one that appears later and the options exclude such pairs.
pub(super) fn excluded(case: &Case<'_>, a: usize, b: usize) -> bool {
    let later = || case.first_frame(a).max(case.first_frame(b));
    case.options.exclude_initial_overlap && later().is_some_and(|first| overlap(case, a, b, first))
}

/// Overlaps with the AV, per object × frame.
struct AvOverlaps(Vec<bool>);

impl Judgement for AvOverlaps {
    fn compute(case: &Case<'_>) -> Self {
        let mut hits = vec![false; case.objects.len() * case.frames()];
        if !case.present(case.av) {
            return Self(hits);
        }
        for i in case.vehicles().filter(|&i| !excluded(case, i, case.av)) {
            for f in overlapping_frames(case, i, case.av, case.current) {
                hits[case.motion.at(i, f)] = true;
            }
        }
        Self(hits)
    }
}

/// Returns whether an object overlaps the AV, per object × frame. Only evaluated vehicles from the current
/// frame on are filled in, and not those that are excluded.
pub(super) fn av_overlaps<'c>(case: &'c Case<'_>) -> &'c [bool] {
    &case.judgement::<AvOverlaps>().0
}
