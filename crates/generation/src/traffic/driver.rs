//! Drivers and their parameters.

use reactsim_rollout::Stream;

use crate::Draw;

/// Speed limit, m/s, above which a road is a motorway.
pub(super) const MOTORWAY_LIMIT: f64 = 22.0;

/// Parameters of one driver, drawn once. For the models see `crates/generation/README.md`. The ranges are
/// chosen, some of them so that traffic resembles recorded traffic (`realism`).
#[derive(Clone, Copy, Debug)]
pub(super) struct Driver {
    /// Desired speed as a multiple of the speed limit.
    pub(super) haste: f64,
    /// Maximum speed, m/s, which binds cyclists and heavy vehicles.
    pub(super) top: f64,
    /// Reaction time of Gipps' model, s.
    pub(super) reaction: f64,
    /// Age of the driver's knowledge of the leader's speed, s.
    pub(super) delay: f64,
    /// Comfortable acceleration, m/s².
    pub(super) acceleration: f64,
    /// Comfortable deceleration, m/s², positive.
    pub(super) braking: f64,
    /// Distance kept from a standing leader, m.
    pub(super) gap: f64,
    /// Distance kept from the stop line, m.
    pub(super) line_gap: f64,
    /// Lateral acceleration accepted in bends, m/s².
    pub(super) lateral: f64,
    /// Weight of the others' disadvantage in lane changes, 0 to 1 (MOBIL).
    pub(super) politeness: f64,
    /// Minimum advantage of a lane change, m/s² (MOBIL).
    pub(super) threshold: f64,
    /// Minimum time between leaving a conflict and the arrival of a vehicle with right of way, s.
    pub(super) margin: f64,
    /// Preferred lateral position in the lane, m, left positive.
    pub(super) bias: f64,
    /// Standard deviation of the lateral wander about that position, m.
    pub(super) wandering: f64,
    /// Standard deviation of the error in perceived speeds, m/s.
    pub(super) speed_noise: f64,
    /// Standard deviation of the error in perceived distances, as a share of the distance.
    pub(super) distance_noise: f64,
    /// Duration of a lane change, s.
    pub(super) change_time: f64,
    /// Look-ahead distance of the steering at standstill, m.
    pub(super) preview_distance: f64,
    /// Additional look-ahead of the steering per m/s of speed, s.
    pub(super) preview_time: f64,
}

/// Factors on the parameters of drivers.
#[derive(Clone, Copy, Debug)]
pub struct Manner {
    /// Factor of the desired speed.
    haste: f64,
    /// Factor of the comfortable acceleration.
    acceleration: f64,
    /// Factor of the reaction time.
    reaction: f64,
    /// Factor of the distance to a standing leader.
    gap: f64,
    /// Factor of the lateral acceleration accepted in bends.
    lateral: f64,
    /// Factor of the preferred lateral position in the lane.
    bias: f64,
}

impl Manner {
    /// Drivers as they are drawn.
    pub const CALM: Self =
        Self { haste: 1.0, acceleration: 1.0, reaction: 1.0, gap: 1.0, lateral: 1.0, bias: 1.0 };
    /// Drivers with the speeds, accelerations and gaps of recordings.
    pub const BRISK: Self =
        Self { haste: 1.2, acceleration: 1.2, reaction: 0.75, gap: 0.85, lateral: 1.1, bias: 1.2 };
}

impl Driver {
    pub(super) fn with(mut self, manner: &Manner) -> Self {
        self.haste *= manner.haste;
        self.acceleration *= manner.acceleration;
        self.reaction *= manner.reaction;
        self.gap *= manner.gap;
        self.lateral *= manner.lateral;
        self.bias *= manner.bias;
        self
    }

    /// Returns the desired speed under this limit, m/s. Drivers are more alike on motorways.
    pub(super) fn wanted(&self, limit: f64) -> f64 {
        let haste = if limit > MOTORWAY_LIMIT { 0.5 * (self.haste + 1.0) } else { self.haste };
        (haste * limit).min(self.top)
    }

    /// Draws the driver of a car, or of a heavier vehicle whose acceleration is `agility` times that of a
    /// car.
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
            speed_noise: rng.uniform(0.05, 0.35),
            distance_noise: rng.uniform(0.01, 0.05),
            change_time: rng.normal_within(4.5, 1.0, 2.8, 7.0),
            preview_distance: rng.uniform(1.8, 2.4),
            preview_time: rng.uniform(0.5, 0.65),
        }
    }

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
            preview_distance: 2.0,
            preview_time: 0.5,
            ..Self::of_car(1.0, rng)
        }
    }
}
