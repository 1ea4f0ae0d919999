//! When the AV is in front of a vehicle: the front-object filter of the risky approaches (ReactSim-Bench, "Metric Computation
//! Details"), as the metric `aav-ttc` has it.

use crate::geometry::OrientedBox;

/// Cosine of the largest heading difference of a front object (75 degrees).
const FRONT_COS: f64 = 0.258_819_045_102_520_74;
/// Cosine of the heading difference up to which any lateral overlap is enough (10 degrees).
const ALIGNED_COS: f64 = 0.984_807_753_012_208;
/// Lateral overlap that is enough at larger heading differences, metres.
const LATERAL_OVERLAP: f64 = 0.5;

/// The gap between the front of `me` and `av`, metres, where `av` is a front object of `me`. With `slack` (metres) the filter takes
/// in a little more than the metric does.
pub(super) fn gap_to_front(me: &OrientedBox, av: &OrientedBox, slack: f64) -> Option<f64> {
    let d = av.center - me.center;
    let (dx, dy) = (d.dot(&me.axis), me.axis.perp(&d));
    let (turn, sin) = (me.axis.dot(&av.axis), me.axis.perp(&av.axis).abs());
    let cos = turn.abs();
    let gap = dx - me.half_length - (av.half_length * cos + av.half_width * sin);
    let beside = dy.abs() - me.half_width - (av.half_length * sin + av.half_width * cos) - slack;
    let turn = turn + 0.1 * slack;
    let front = gap > -slack
        && beside < 0.0
        && turn >= FRONT_COS
        && (beside < -LATERAL_OVERLAP || turn >= ALIGNED_COS);
    front.then_some(gap)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Vec2;

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
