//! Longitudinal behaviour: Gipps' car-following model, bends ahead, standing at a point.
//!
//! P. G. Gipps, A behavioural car-following model for computer simulation, Transportation Research Part B 15 (1981). A driver chooses the
//! speed to have after the reaction time: no more than the free road allows, and no more than lets them stop behind the leader if that
//! one brakes.

use super::driver::Driver;

/// What a driver knows of who is ahead.
#[derive(Clone, Copy, Debug)]
pub(super) struct Leader {
    /// From bumper to bumper, metres.
    pub(super) gap: f64,
    /// Its speed, m/s.
    pub(super) speed: f64,
}

/// The hardest braking that anybody does, m/s²: within what the benchmark calls feasible.
pub(super) const HARDEST: f64 = 5.5;

impl Driver {
    /// Acceleration on a free road towards the speed `wanted`, m/s² (Gipps: free road).
    pub(super) fn free(&self, speed: f64, wanted: f64) -> f64 {
        let wanted = wanted.max(0.1);
        if speed > wanted {
            // Nobody brakes hard to keep a limit.
            return ((wanted - speed) / 2.0).max(-self.braking);
        }
        let share = speed / wanted;
        2.5 * self.acceleration * (1.0 - share) * (0.025 + share).sqrt()
    }

    /// Acceleration that lets one stop behind the leader, m/s² (Gipps: behind a leader).
    pub(super) fn behind(&self, speed: f64, leader: Leader) -> f64 {
        self.keep(speed, leader.gap - self.gap, leader.speed)
    }

    /// Acceleration to stand after so many metres, m/s².
    pub(super) fn stop_in(&self, speed: f64, distance: f64) -> f64 {
        self.keep(speed, distance, 0.0)
    }

    fn keep(&self, speed: f64, room: f64, leader: f64) -> f64 {
        let (b, t) = (self.braking, self.reaction);
        // Others are taken to brake a little harder than oneself.
        let others = b + 0.1;
        let under = b * b * t * t + b * (2.0 * room - speed * t) + b * leader * leader / others;
        let safe = if under > 0.0 { (under.sqrt() - b * t).max(0.0) } else { 0.0 };
        // Where there is no room left, what it takes to come to a halt.
        let needed =
            if room > 0.1 { -(speed * speed - leader * leader).max(0.0) / (2.0 * room) } else { -HARDEST };
        let chosen = (safe - speed) / t;
        if chosen < -b { chosen.max(needed.min(-b)) } else { chosen }
    }

    /// The speed at which a bend is driven, m/s.
    pub(super) fn in_bend(&self, curvature: f64) -> f64 {
        if curvature > 1e-4 { (self.lateral / curvature).sqrt() } else { f64::INFINITY }
    }

    /// Acceleration for a place `distance` metres ahead where the speed must not be above `limit`, m/s².
    pub(super) fn for_limit(&self, speed: f64, limit: f64, distance: f64) -> f64 {
        if speed <= limit {
            // Just under it: no faster than reaches it there.
            return (limit * limit - speed * speed) / (2.0 * distance.max(2.0)) + 0.3;
        }
        (limit * limit - speed * speed) / (2.0 * distance.max(1.0))
    }
}

/// Seconds to cover a distance from `speed`, accelerating by `acceleration` up to `top`.
pub(super) fn time_for(distance: f64, speed: f64, acceleration: f64, top: f64) -> f64 {
    if distance <= 0.0 {
        return 0.0;
    }
    let top = top.max(speed).max(0.1);
    let until = (top - speed) / acceleration;
    let way = speed * until + 0.5 * acceleration * until * until;
    if way >= distance {
        return ((speed * speed + 2.0 * acceleration * distance).sqrt() - speed) / acceleration;
    }
    until + (distance - way) / top
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rollout::{Purpose, stream};

    fn driver() -> Driver {
        Driver::of_car(1.0, &mut stream(0, "driver", 0, Purpose::Traffic))
    }

    #[test]
    fn who_follows_stops_behind_a_leader_that_brakes_hard() {
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
        assert!(hardest > -HARDEST, "{hardest}");
    }

    #[test]
    fn time_over_a_distance() {
        assert!((time_for(100.0, 10.0, 1.0, 10.0) - 10.0).abs() < 1e-9);
        assert!((time_for(8.0, 0.0, 1.0, 50.0) - 4.0).abs() < 1e-9);
    }
}
