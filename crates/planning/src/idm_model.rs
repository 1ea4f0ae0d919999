//! The intelligent driver model, as the planners and the IDM agents of nuPlan use it.

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct IdmModel {
    /// Gap at standstill, metres.
    pub(crate) min_gap: f64,
    /// Time headway, seconds.
    pub(crate) headway: f64,
    /// Largest acceleration, m/s².
    pub(crate) acceleration: f64,
    /// Comfortable and largest deceleration, m/s².
    pub(crate) deceleration: f64,
}

impl IdmModel {
    /// Returns the acceleration at a speed, m/s², with the exponent 4. `target`: speed aimed at, m/s; `gap`:
    /// free distance to the leader, metres; `leader_speed`: its speed along the own heading, m/s.
    pub(crate) fn acceleration(&self, speed: f64, target: f64, gap: f64, leader_speed: f64) -> f64 {
        let square = (speed / target) * (speed / target);
        self.acceleration_by(square * square, speed, gap, leader_speed)
    }

    /// Returns the acceleration as [`Self::acceleration`] does, with any exponent. `free`: the power of the
    /// speed as a share of the one aimed at.
    pub(crate) fn acceleration_by(&self, free: f64, speed: f64, gap: f64, leader_speed: f64) -> f64 {
        let Self { min_gap, headway, acceleration, deceleration } = *self;
        let approach = speed * (speed - leader_speed) / (2.0 * (acceleration * deceleration).sqrt());
        let desired_gap = min_gap + speed * headway + approach;
        let interaction = desired_gap / gap.max(min_gap);
        (acceleration * (1.0 - free - interaction * interaction)).clamp(-deceleration, acceleration)
    }
}
