//! Placeholder.
#[derive(Clone, Copy, Debug)]
pub(super) struct Body {
    pub(super) length: f64,
    pub(super) width: f64,
    /// How far the rear axle lies behind the box centre, metres.
    pub(super) rear: f64,
    /// Largest curvature of the rear axle's path, 1/m.
    pub(super) curvature: f64,
    /// Share of a car's acceleration.
    pub(super) agility: f64,
}

use crate::generation::Draw;
use crate::rollout::Stream;

pub(super) fn car(rng: &mut Stream) -> Body {
    let length = rng.normal_within(4.7, 0.35, 3.9, 5.8);
    Body {
        length,
        width: rng.normal_within(1.95, 0.12, 1.7, 2.2),
        rear: 0.28 * length,
        curvature: 0.19,
        agility: 1.0,
    }
}
pub(super) fn vehicle(rng: &mut Stream) -> Body {
    car(rng)
}
pub(super) fn bicycle(rng: &mut Stream) -> Body {
    Body {
        length: rng.uniform(1.6, 1.9),
        width: rng.uniform(0.6, 0.8),
        rear: 0.4,
        curvature: 0.25,
        agility: 0.6,
    }
}
