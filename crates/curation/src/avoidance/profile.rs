//! Speed profiles: their limits, their bounds, and the extreme profiles.

use reactsim_scene::DT;

/// Kinematic limits of an agent along its path.
#[derive(Clone, Copy, Debug)]
pub(super) struct Limits {
    /// Smallest acceleration (negative), m/s².
    pub(super) brake: f64,
    /// Largest acceleration, m/s².
    pub(super) accelerate: f64,
    /// Largest change of acceleration, m/s³.
    pub(super) jerk: f64,
    /// Largest speed, m/s.
    pub(super) speed: f64,
}

/// Motion of an agent when it begins to respond.
#[derive(Clone, Copy, Debug)]
pub(super) struct Motion {
    /// Speed, m/s, not negative.
    pub(super) speed: f64,
    /// Acceleration, m/s².
    pub(super) acceleration: f64,
}

impl Motion {
    /// Returns the motion within limits, with an acceleration that can be reduced to zero, at limited
    /// jerk, before the speed is 0 or too large.
    pub(super) fn within(self, limits: &Limits) -> Self {
        let speed = self.speed.max(0.0);
        let room = |v: f64| (2.0 * limits.jerk * v.max(0.0)).sqrt();
        let lowest = limits.brake.max(-room(speed));
        let highest = limits.accelerate.min(room(limits.speed - speed));
        Self { speed, acceleration: self.acceleration.clamp(lowest, highest.max(lowest)) }
    }
}

/// Arc lengths and speeds at the steps after the reaction step; entry 0 is the reaction step, with arc
/// length 0.
#[derive(Clone, Debug)]
pub(super) struct Profile {
    /// Arc length, metres.
    pub(super) s: Vec<f64>,
    /// Speed over the step that ends here, m/s.
    pub(super) v: Vec<f64>,
}

/// Returns the profile of the hardest braking or acceleration. No profile within the limits is farther
/// back, or farther ahead, at any step.
pub(super) fn extreme_profile(start: Motion, limits: &Limits, steps: usize, brake: bool) -> Profile {
    let goal = if brake { limits.brake } else { limits.accelerate };
    let change = if brake { -limits.jerk * DT } else { limits.jerk * DT };
    let (mut s, mut v, mut a) = (0.0, start.speed, start.acceleration);
    let mut profile = Profile { s: vec![s], v: vec![v] };
    for _ in 0..steps {
        a = if brake { (a + change).max(goal) } else { (a + change).min(goal) };
        v = (v + a * DT).clamp(0.0, limits.speed.max(start.speed));
        s += v * DT;
        profile.s.push(s);
        profile.v.push(v);
    }
    profile
}

/// Bounds of the arc length at every step; entry 0 is the reaction step. Neither bound decreases from
/// step to step.
#[derive(Clone, Debug)]
pub(super) struct Corridor {
    /// Smallest arc length.
    pub(super) lower: Vec<f64>,
    /// Largest arc length.
    pub(super) upper: Vec<f64>,
    /// Largest speed over the step that ends here, m/s.
    pub(super) speeds: Vec<f64>,
    /// Bounds `(step, gap, bound)`: arc length + gap (s) · speed must not exceed the bound at the step.
    pub(super) gaps: Vec<(usize, f64, f64)>,
}
