//! Free driving without leaders and conflicts: speed limits, and bends ahead.

use super::network::Network;
use super::vehicle::Vehicle;

/// Standard deviation of the actual speed from the desired one, as a share of it.
const SPEED_NOISE: f64 = 0.09;
/// Share of the comfortable braking with which drivers slow down for bends and lower limits.
const CALM_BRAKING_SHARE: f64 = 0.8;
/// Distance, metres, that drivers look ahead beyond their braking distance.
const LOOK_AHEAD: f64 = 8.0;
/// Distance between two points at which bends ahead are sampled, metres.
const LOOK_STEP: f64 = 2.0;
/// Distance, metres, within which drivers keep exactly to the speed of a bend.
const EXACT_SPEED_DISTANCE: f64 = 10.0;

/// Returns the acceleration on an empty road, given speed limits and bends.
pub(super) fn free_acceleration(network: &Network, v: &Vehicle) -> f64 {
    let lane = &network.lanes[v.path[0]];
    // No driver holds a speed exactly.
    let wanted = v.driver.wanted(lane.limit) * (1.0 + SPEED_NOISE * v.mood);
    let here = wanted.min(v.driver.in_bend(lane.curvature_at(v.s)));
    let mut acceleration = v.driver.free(v.speed, here);
    let comfortable = CALM_BRAKING_SHARE * v.driver.braking;
    let horizon = v.speed * v.speed / (2.0 * comfortable) + LOOK_AHEAD;
    let mut start = 0.0;
    for (k, &index) in v.path.iter().enumerate() {
        let lane = &network.lanes[index];
        if start - v.s > horizon {
            break;
        }
        if k > 0 {
            let limit = v.driver.wanted(lane.limit);
            if limit < v.speed {
                acceleration = acceleration.min(v.driver.for_limit(v.speed, limit, start - v.s));
            }
        }
        if !lane.is_straight() {
            let mut s = (v.s - start).max(0.0);
            while s < lane.length && s + start - v.s < horizon {
                let limit = v.driver.in_bend(lane.curvature_at(s));
                let distance = s + start - v.s;
                if limit < v.speed + 1.0 && distance > 0.5 {
                    let needed = v.driver.for_limit(v.speed, limit, distance);
                    if needed < -0.5 * comfortable || distance < EXACT_SPEED_DISTANCE {
                        acceleration = acceleration.min(needed);
                    }
                }
                s += LOOK_STEP;
            }
        }
        start += lane.length;
    }
    acceleration.max(-2.0 * comfortable)
}
