//! Heights along lines that have a height per point, and levels.

use reactsim_geometry::Polyline;
use reactsim_scene::levels::apart;

/// Returns the height at arc length `s` of a line, metres; `None` if there are no heights of its points.
pub(crate) fn height_at(line: &Polyline, heights: &[f64], s: f64) -> Option<f64> {
    let i = line.segment_at(s);
    let &[a, b] = heights.get(i..i + 2)? else { return None };
    let (from, to) = (line.arc()[i], line.arc()[i + 1]);
    Some(a + (b - a) * ((s - from) / (to - from)).clamp(0.0, 1.0))
}

/// Returns whether two heights that are `distance` metres apart in the plane are on different levels. An
/// unknown height is on every level.
pub(crate) fn on_different_levels(a: Option<f64>, b: Option<f64>, distance: f64) -> bool {
    matches!((a, b), (Some(a), Some(b)) if apart(a, b, distance))
}

#[cfg(test)]
mod tests {
    use reactsim_geometry::Vec2;

    use super::*;

    #[test]
    fn heights_are_interpolated() {
        let line = Polyline::new(&[0.0, 10.0, 30.0].map(|x| Vec2::new(x, 0.0))).unwrap();
        let at = |s| height_at(&line, &[0.0, 1.0, 5.0], s);
        assert_eq!([-1.0, 5.0, 10.0, 25.0, 99.0].map(at), [0.0, 0.5, 1.0, 4.0, 5.0].map(Some));
        assert_eq!(height_at(&line, &[], 5.0), None);
    }

    #[test]
    fn unknown_heights_are_on_every_level() {
        assert!(on_different_levels(Some(0.0), Some(6.0), 0.0));
        assert!(!on_different_levels(Some(0.0), Some(6.0), 60.0));
        assert!(!on_different_levels(None, Some(6.0), 0.0));
    }
}
