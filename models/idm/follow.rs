//! Car following: the intelligent driver model with the constant-acceleration heuristic.

use reactsim_geometry::math;

use super::parameters::Class;
use super::styles::Variation;

/// Parameters of one driver.
#[derive(Clone, Copy, Debug)]
pub(super) struct Style {
    /// Time headway, s.
    pub(super) headway: f64,
    /// Standstill gap, m.
    pub(super) gap: f64,
    /// Largest acceleration, m/s².
    pub(super) acceleration: f64,
    /// Comfortable deceleration, m/s².
    pub(super) deceleration: f64,
    /// Coolness of the constant-acceleration heuristic.
    pub(super) coolness: f64,
    /// Factor on speed limits.
    pub(super) speed_factor: f64,
    /// Part of this factor that comes from the style of the driver.
    pub(super) haste: f64,
}

impl Style {
    /// Creates a driver of a class; `headway` and `speed` in [-1, 1] place it within the spreads.
    pub(super) fn of(class: &Class, headway: f64, speed: f64, variation: Variation) -> Self {
        Self {
            headway: class.headway * (1.0 + headway * class.headway_spread) * variation.headway,
            gap: class.standstill_gap,
            acceleration: class.acceleration * variation.acceleration,
            deceleration: class.deceleration,
            coolness: class.coolness,
            speed_factor: (1.0 + speed * class.speed_spread) * variation.speed,
            haste: variation.speed,
        }
    }

    /// Returns the acceleration on a free road towards the speed `desired` (improved IDM, Treiber and
    /// Kesting 2013, eq. 11.14).
    pub(super) fn free(&self, speed: f64, desired: f64) -> f64 {
        let desired = desired.max(0.1);
        if speed <= desired {
            let square = (speed / desired) * (speed / desired);
            self.acceleration * (1.0 - square * square)
        } else {
            -self.deceleration
                * (1.0 - math::pow(desired / speed, 4.0 * self.acceleration / self.deceleration))
        }
    }

    /// Returns the acceleration behind a leader at `gap` metres that moves at `leader` m/s along the
    /// path and accelerates by `leader_acceleration` (ACC model: IDM, softened by the
    /// constant-acceleration heuristic where a gap is small but harmless).
    pub(super) fn behind(&self, speed: f64, gap: f64, leader: f64, leader_acceleration: f64) -> f64 {
        let gap = gap.max(0.05);
        let closing = speed - leader;
        let dynamic =
            speed * self.headway + speed * closing / (2.0 * (self.acceleration * self.deceleration).sqrt());
        let desired_gap = self.gap + dynamic.max(0.0);
        let idm = self.acceleration * (1.0 - (desired_gap / gap) * (desired_gap / gap));
        let cah = heuristic(speed, gap, leader.max(0.0), leader_acceleration.min(self.acceleration));
        if idm >= cah {
            return idm;
        }
        let (a, b, c) = (self.acceleration, self.deceleration, self.coolness);
        (1.0 - c) * idm + c * (cah + b * math::tanh((idm - cah) / b)).min(a)
    }

    /// Returns the acceleration to stop after `gap` metres.
    pub(super) fn stop_in(&self, speed: f64, gap: f64) -> f64 {
        // Half a metre is kept to a line instead of the standstill gap of a queue.
        self.behind(speed, gap + self.gap - 0.5, 0.0, 0.0)
    }
}

/// Returns the acceleration that just avoids a collision if the leader keeps its acceleration (Kesting
/// et al. 2010, eq. 2.3).
fn heuristic(speed: f64, gap: f64, leader: f64, leader_acceleration: f64) -> f64 {
    let closing = (speed - leader).max(0.0);
    // The leader stops before the gap is closed. Not used without braking: 0 / 0 for a standing leader.
    if leader_acceleration < 0.0 && leader * closing <= -2.0 * gap * leader_acceleration {
        speed * speed * leader_acceleration / (leader * leader - 2.0 * gap * leader_acceleration)
    } else {
        leader_acceleration - closing * closing / (2.0 * gap)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STYLE: Style = Style {
        headway: 1.3,
        gap: 2.0,
        acceleration: 1.6,
        deceleration: 2.0,
        coolness: 0.99,
        speed_factor: 1.0,
        haste: 1.0,
    };

    #[test]
    fn free_road_speeds_up_and_slows_down_to_the_desired_speed() {
        assert_eq!(STYLE.free(0.0, 15.0), 1.6);
        assert_eq!(STYLE.free(15.0, 15.0), 0.0);
        let down = STYLE.free(20.0, 15.0);
        assert!(-2.0 < down && down < -0.5, "{down}");
    }

    #[test]
    fn never_drives_into_a_standing_leader() {
        for v0 in [5.0, 10.0, 15.0, 20.0] {
            let (mut gap, mut v) = (v0 * v0 / (2.0 * 5.0) + 3.0, v0);
            for _ in 0..300 {
                let a = STYLE.behind(v, gap, 0.0, 0.0);
                assert!(a.is_finite());
                let a = a.max(-5.5);
                let next = (v + 0.1 * a).max(0.0);
                gap -= 0.05 * (v + next);
                v = next;
            }
            assert!(gap > 0.3 && v < 0.1, "from {v0}: gap {gap}, speed {v}");
        }
    }

    #[test]
    fn a_cut_in_at_equal_speed_is_no_emergency() {
        assert!(STYLE.behind(15.0, 6.0, 15.0, 0.0) > -2.5);
    }
}
