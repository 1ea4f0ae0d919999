//! Drivers: who they are, and what they do from one decision to the next.

use crate::generation::Draw;
use crate::rollout::Stream;

/// Limits above this are those of motorways, m/s.
pub(super) const MOTORWAY: f64 = 22.0;

/// Parameters of one driver, drawn once. Models: `src/generation/README.md`; the ranges are chosen, some of them so that
/// traffic is like the recorded one (`realism`).
#[derive(Clone, Copy, Debug)]
pub(super) struct Driver {
    /// Speed wanted where the limit is 1, that is as a multiple of the limit.
    pub(super) haste: f64,
    /// Top speed, m/s: cyclists and heavy vehicles.
    pub(super) top: f64,
    /// Reaction time of Gipps' model, s.
    pub(super) reaction: f64,
    /// How old what is known of the leader's speed is, s.
    pub(super) delay: f64,
    /// Comfortable acceleration, m/s².
    pub(super) acceleration: f64,
    /// Comfortable braking, m/s², positive.
    pub(super) braking: f64,
    /// Distance kept from who stands ahead, m.
    pub(super) gap: f64,
    /// Distance kept from the stop line, m.
    pub(super) line_gap: f64,
    /// Lateral acceleration accepted in bends, m/s².
    pub(super) lateral: f64,
    /// Weight of the others' disadvantage in lane changes, 0 to 1 (MOBIL).
    pub(super) politeness: f64,
    /// What a lane change must bring, m/s² (MOBIL).
    pub(super) threshold: f64,
    /// Time that must be left after one has passed before another who goes first, s.
    pub(super) margin: f64,
    /// Where in the lane the driver likes to be, m, left positive.
    pub(super) bias: f64,
    /// Deviation of the wandering about that place, m.
    pub(super) wandering: f64,
    /// Deviation of the error in what is seen of speeds, m/s, and of distances, as a share.
    pub(super) noise: (f64, f64),
    /// How long a lane change takes, s.
    pub(super) change_time: f64,
    /// Look-ahead of steering, m, and that per m/s, s.
    pub(super) preview: (f64, f64),
}

impl Driver {
    /// The speed wanted where this is the limit, m/s. On motorways all drive more alike.
    pub(super) fn wanted(&self, limit: f64) -> f64 {
        let haste = if limit > MOTORWAY { 0.5 * (self.haste + 1.0) } else { self.haste };
        (haste * limit).min(self.top)
    }

    /// A driver of a car, or of something heavier with that share of a car's acceleration.
    pub(super) fn of_car(agility: f64, rng: &mut Stream) -> Self {
        let heavy = agility < 0.8;
        Self {
            haste: rng.normal_within(if heavy { 0.8 } else { 0.85 }, 0.18, 0.5, 1.25),
            top: if heavy { 28.0 } else { 40.0 },
            reaction: rng.normal_within(0.7, 0.25, 0.35, 1.4),
            delay: rng.uniform(0.1, 0.4),
            acceleration: agility * rng.normal_within(1.7, 0.35, 1.0, 2.6),
            braking: rng.normal_within(2.1, 0.4, 1.3, 3.2),
            gap: rng.normal_within(3.7, 1.5, 1.3, 8.0),
            line_gap: rng.normal_within(1.2, 0.7, 0.3, 3.0),
            lateral: rng.normal_within(2.4, 0.5, 1.4, 3.6) * if heavy { 0.7 } else { 1.0 },
            politeness: rng.uniform(0.0, 0.5),
            threshold: rng.uniform(0.15, 0.6),
            margin: rng.normal_within(1.6, 0.5, 0.8, 3.0),
            bias: rng.normal_within(0.0, 0.32, -0.6, 0.6),
            wandering: rng.uniform(0.12, 0.32),
            noise: (rng.uniform(0.05, 0.35), rng.uniform(0.01, 0.05)),
            change_time: rng.normal_within(4.5, 1.0, 2.8, 7.0),
            preview: (rng.uniform(1.8, 2.4), rng.uniform(0.5, 0.65)),
        }
    }

    /// Somebody on a bicycle.
    pub(super) fn of_bicycle(rng: &mut Stream) -> Self {
        Self {
            haste: 1.0,
            top: rng.normal_within(5.2, 1.2, 3.0, 8.5),
            acceleration: rng.uniform(0.6, 1.0),
            braking: rng.uniform(1.2, 2.0),
            gap: rng.uniform(0.6, 1.5),
            line_gap: rng.uniform(0.3, 1.5),
            lateral: rng.uniform(1.2, 2.0),
            bias: rng.normal_within(0.0, 0.15, -0.35, 0.35),
            wandering: rng.uniform(0.05, 0.15),
            preview: (2.0, 0.5),
            ..Self::of_car(1.0, rng)
        }
    }
}
