//! Front objects: whether the AV is in front of a vehicle, by the filter of the metric `aav-ttc`.

use reactsim_geometry::{OrientedBox, signed_angle_between};
use reactsim_metrics::{is_front, placement};

/// Additional angle of the filter per metre of slack, rad/m.
const ANGLE_PER_SLACK: f64 = 0.1;

/// Returns the gap between the front of `me` and `av`, metres, if `av` is a front object of `me`. With
/// `slack` (metres) the filter is slightly wider than that of the metric.
pub(super) fn gap_to_front(me: &OrientedBox, av: &OrientedBox, slack: f64) -> Option<f64> {
    let (gap, beside) = placement(me, av);
    // Heading differences are expensive, and rarely needed.
    if gap + slack <= 0.0 || beside - slack >= 0.0 {
        return None;
    }
    let turned = (signed_angle_between(me.axis, av.axis).abs() - ANGLE_PER_SLACK * slack).max(0.0);
    is_front(gap + slack, beside - slack, turned).then_some(gap)
}

#[cfg(test)]
mod tests {
    use reactsim_geometry::Vec2;

    use super::*;

    fn car(x: f64, y: f64, degrees: f64) -> OrientedBox {
        OrientedBox::new(Vec2::new(x, y), f64::to_radians(degrees), 4.0, 2.0)
    }

    #[test]
    fn the_filters_of_the_metric() {
        let me = car(0.0, 0.0, 0.0);
        assert_eq!(gap_to_front(&me, &car(10.0, 1.9, 0.0), 0.0), Some(6.0));
        assert_eq!(gap_to_front(&me, &car(10.0, 2.1, 0.0), 0.0), None);
        assert_eq!(gap_to_front(&me, &car(-10.0, 0.0, 0.0), 0.0), None);
        assert_eq!(gap_to_front(&me, &car(10.0, 0.0, 90.0), 0.0), None);
        assert_eq!(gap_to_front(&me, &car(10.0, 0.0, 180.0), 0.0), None);
        assert!(gap_to_front(&me, &car(10.0, 0.0, 70.0), 0.0).is_some());
        assert!(gap_to_front(&me, &car(10.0, 2.3, 20.0), 0.0).is_none());
    }
}
