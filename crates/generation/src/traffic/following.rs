//! Longitudinal behaviour: Gipps' car-following model, bends ahead, stopping at a point.
//!
//! P. G. Gipps, A behavioural car-following model for computer simulation, Transportation Research Part B
//! 15 (1981). A driver chooses the speed at the end of the reaction time: at most what the free road
//! allows, and at most what allows stopping behind the leader if the leader brakes.

use super::driver::Driver;

/// The leader as perceived by a driver.
#[derive(Clone, Copy, Debug)]
pub(super) struct Leader {
    /// Bumper-to-bumper gap, metres.
    pub(super) gap: f64,
    /// Speed, m/s.
    pub(super) speed: f64,
}

/// Maximum braking, m/s²: within what the benchmark considers feasible.
pub(super) const MAX_BRAKING: f64 = 5.5;

impl Driver {
    /// Returns the acceleration on a free road towards the speed `wanted`, m/s² (Gipps' free-road term).
    pub(super) fn free(&self, speed: f64, wanted: f64) -> f64 {
        let wanted = wanted.max(0.1);
        if speed > wanted {
            // Drivers do not brake hard to obey a limit.
            return ((wanted - speed) / 2.0).max(-self.braking);
        }
        let share = speed / wanted;
        2.5 * self.acceleration * (1.0 - share) * (0.025 + share).sqrt()
    }

    /// Returns the acceleration that allows stopping behind the leader, m/s² (Gipps' following term).
    pub(super) fn behind(&self, speed: f64, leader: Leader) -> f64 {
        self.safe_acceleration(speed, leader.gap - self.gap, leader.speed)
    }

    /// Returns the acceleration that stops the vehicle after `distance` metres, m/s².
    pub(super) fn stop_in(&self, speed: f64, distance: f64) -> f64 {
        self.safe_acceleration(speed, distance, 0.0)
    }

    fn safe_acceleration(&self, speed: f64, room: f64, leader: f64) -> f64 {
        let (b, t) = (self.braking, self.reaction);
        // The driver assumes that others brake slightly harder.
        let others = b + 0.1;
        let under = b * b * t * t + b * (2.0 * room - speed * t) + b * leader * leader / others;
        let safe = if under > 0.0 { (under.sqrt() - b * t).max(0.0) } else { 0.0 };
        // Without room left: the deceleration needed to stop.
        let needed = if room > 0.1 {
            -(speed * speed - leader * leader).max(0.0) / (2.0 * room)
        } else {
            -MAX_BRAKING
        };
        let chosen = (safe - speed) / t;
        if chosen < -b { chosen.max(needed.min(-b)) } else { chosen }
    }

    /// Returns the speed at which the driver takes a bend of this curvature (1/m), m/s.
    pub(super) fn in_bend(&self, curvature: f64) -> f64 {
        if curvature > 1e-4 { (self.lateral / curvature).sqrt() } else { f64::INFINITY }
    }

    /// Returns the acceleration towards a point `distance` metres ahead where the speed must not exceed
    /// `limit`, m/s².
    pub(super) fn for_limit(&self, speed: f64, limit: f64, distance: f64) -> f64 {
        if speed <= limit {
            // Slightly below the limit: at most the acceleration that reaches it at that point.
            return (limit * limit - speed * speed) / (2.0 * distance.max(2.0)) + 0.3;
        }
        (limit * limit - speed * speed) / (2.0 * distance.max(1.0))
    }
}

/// Returns the time in seconds to cover a distance from `speed`, accelerating by `acceleration` up to
/// `top`.
pub(super) fn time_for(distance: f64, speed: f64, acceleration: f64, top: f64) -> f64 {
    if distance <= 0.0 {
        return 0.0;
    }
    let top = top.max(speed).max(0.1);
    let until = (top - speed) / acceleration;
    let covered = speed * until + 0.5 * acceleration * until * until;
    if covered >= distance {
        return ((speed * speed + 2.0 * acceleration * distance).sqrt() - speed) / acceleration;
    }
    until + (distance - covered) / top
}

#[cfg(test)]
mod tests {
    use reactsim_rollout::{Purpose, stream};

    use super::*;

    fn driver() -> Driver {
        Driver::of_car(1.0, &mut stream(0, "driver", 0, Purpose::Traffic))
    }

    #[test]
    fn followers_stop_behind_a_leader_that_brakes_hard() {
        let driver = driver();
        let (mut x, mut v) = (0.0, 15.0);
        let (mut ahead, mut speed) = (30.0, 15.0);
        let mut hardest: f64 = 0.0;
        for _ in 0..300 {
            speed = f64::max(speed - 0.4, 0.0);
            ahead += speed * 0.1;
            let a = driver.behind(v, Leader { gap: ahead - x, speed });
            hardest = hardest.min(a);
            v = f64::max(v + 0.1 * a, 0.0);
            x += v * 0.1;
            assert!(x < ahead, "collision");
        }
        assert!(v < 1e-3 && ahead - x < driver.gap + 3.0, "{v} {}", ahead - x);
        assert!(hardest > -MAX_BRAKING, "{hardest}");
    }

    #[test]
    fn time_over_a_distance() {
        assert!((time_for(100.0, 10.0, 1.0, 10.0) - 10.0).abs() < 1e-9);
        assert!((time_for(8.0, 0.0, 1.0, 50.0) - 4.0).abs() < 1e-9);
    }
}
