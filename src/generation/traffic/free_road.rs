//! Driving where nobody is in the way: speed limits, and bends ahead.

use super::network::Network;
use super::vehicle::Vehicle;

/// Deviation of the speed that is driven from the wanted one, as a share.
const SPEED_NOISE: f64 = 0.09;
/// Drivers slow down for bends and lower limits with this share of their comfortable braking.
const CALM: f64 = 0.8;
/// How far they look for them beyond the way that this takes, metres, and the distance of the places they look at.
const AHEAD: f64 = 8.0;
const STEP: f64 = 2.0;
/// Nearer than this they keep to the speed of a bend exactly, metres.
const NEAR: f64 = 10.0;

/// Acceleration on an empty road: speed limits and bends.
pub(super) fn unhindered(network: &Network, v: &Vehicle) -> f64 {
    let way = &network.ways[v.path[0]];
    // Nobody holds a speed exactly.
    let wanted = v.driver.wanted(way.limit) * (1.0 + SPEED_NOISE * v.mood);
    let here = wanted.min(v.driver.in_bend(way.bend_at(v.s)));
    let mut acceleration = v.driver.free(v.speed, here);
    let comfortable = CALM * v.driver.braking;
    let horizon = v.speed * v.speed / (2.0 * comfortable) + AHEAD;
    let mut start = 0.0;
    for (k, &w) in v.path.iter().enumerate() {
        let way = &network.ways[w];
        if start - v.s > horizon {
            break;
        }
        if k > 0 {
            let limit = v.driver.wanted(way.limit);
            if limit < v.speed {
                acceleration = acceleration.min(v.driver.for_limit(v.speed, limit, start - v.s));
            }
        }
        if !way.is_straight() {
            let mut s = (v.s - start).max(0.0);
            while s < way.length && s + start - v.s < horizon {
                let limit = v.driver.in_bend(way.bend_at(s));
                let distance = s + start - v.s;
                if limit < v.speed + 1.0 && distance > 0.5 {
                    let needed = v.driver.for_limit(v.speed, limit, distance);
                    if needed < -0.5 * comfortable || distance < NEAR {
                        acceleration = acceleration.min(needed);
                    }
                }
                s += STEP;
            }
        }
        start += way.length;
    }
    acceleration.max(-2.0 * comfortable)
}
