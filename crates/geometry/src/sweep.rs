//! Time to impact of two boxes that move at constant velocities.

use parry2d_f64::math::{Isometry, Vector};
use parry2d_f64::na::{Complex, Translation2, Unit};
use parry2d_f64::query::{ShapeCastOptions, cast_shapes};
use parry2d_f64::shape::Cuboid;

use super::{OrientedBox, Vec2};

/// Returns the time in seconds until the sharp boxes `a` and `b` touch if they move at these velocities (m/s)
/// without turning: 0 if they overlap now, `None` if they do not touch within `horizon` seconds.
pub fn time_to_impact(a: (&OrientedBox, Vec2), b: (&OrientedBox, Vec2), horizon: f64) -> Option<f64> {
    if a.0.separation(b.0) <= 0.0 {
        return Some(0.0);
    }
    // Relative to the first box, because digits would be lost far from the origin of the map.
    let place = |of: &OrientedBox| {
        let at = of.center - a.0.center;
        let turned = Unit::new_unchecked(Complex::new(of.axis.x, of.axis.y));
        Isometry::from_parts(Translation2::new(at.x, at.y), turned)
    };
    let shape = |of: &OrientedBox| Cuboid::new(Vector::new(of.half_length, of.half_width));
    let velocity = |v: Vec2| Vector::new(v.x, v.y);
    let options = ShapeCastOptions { max_time_of_impact: horizon, ..ShapeCastOptions::default() };
    let hit = cast_shapes(
        &place(a.0),
        &velocity(a.1),
        &shape(a.0),
        &place(b.0),
        &velocity(b.1),
        &shape(b.0),
        options,
    );
    // Two boxes are always supported.
    hit.ok().flatten().map(|hit| hit.time_of_impact)
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use proptest::prelude::*;

    use super::*;

    fn car(x: f64, y: f64, heading: f64) -> OrientedBox {
        OrientedBox::new(Vec2::new(x, y), heading, 4.0, 2.0)
    }

    fn meet(a: (OrientedBox, Vec2), b: (OrientedBox, Vec2)) -> Option<f64> {
        time_to_impact((&a.0, a.1), (&b.0, b.1), 10.0)
    }

    #[test]
    fn bumpers_meet_and_corners_pass() {
        let fast = (car(0.0, 0.0, 0.0), Vec2::new(10.0, 0.0));
        let ahead = |y| (car(24.0, y, 0.0), Vec2::zeros());
        assert!((meet(fast, ahead(0.0)).unwrap() - 2.0).abs() < 1e-6);
        assert!((meet(fast, ahead(1.9)).unwrap() - 2.0).abs() < 1e-6);
        // Circles of the mean size would touch here.
        assert_eq!(meet(fast, ahead(2.1)), None);
        // Crossing: the front of one box touches the side of the other.
        let across = (car(20.0, -20.0, FRAC_PI_2), Vec2::new(0.0, 10.0));
        assert!((meet(fast, across).unwrap() - 1.7).abs() < 1e-6);
        assert_eq!(meet((car(0.0, 0.0, 0.0), Vec2::zeros()), (car(1.0, 0.0, 0.3), Vec2::zeros())), Some(0.0));
        assert_eq!(meet((fast.0, Vec2::new(1.9, 0.0)), ahead(0.0)), None, "beyond the horizon");
    }

    proptest! {
        #[test]
        fn small_steps_of_the_separating_axes_agree(
            x in -20.0..20.0_f64, y in -20.0..20.0_f64, h in -3.0..3.0_f64,
            vx in -9.0..9.0_f64, vy in -9.0..9.0_f64,
        ) {
            let (a, b) = (car(0.0, 0.0, 0.5), car(x, y, h));
            let v = Vec2::new(vx, vy);
            let at = |t: f64| OrientedBox { center: b.center + v * t, ..b };
            let apart = |t: f64| a.signed_distance(&at(t));
            match meet((a, Vec2::zeros()), (b, v)) {
                Some(t) => {
                    let gap = apart(t);
                    prop_assert!(gap < 1e-3 && (t == 0.0 || gap > -1e-3), "{t}: {gap}");
                }
                None => prop_assert!((0..1000).all(|k| apart(f64::from(k) * 0.01) > -1e-3)),
            }
        }
    }
}
