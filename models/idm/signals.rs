//! Traffic lights and stop signs on a path.

use reactsim_rollout::Observation;
use reactsim_scene::{LightState, StopKind};

use super::actor::Actor;
use super::driver::PathFollower;

/// Largest deceleration at which a driver stops for a yellow light, m/s².
const YELLOW_DECELERATION: f64 = 3.0;
/// Speed in m/s below which a vehicle has stopped at a line.
const STOPPED_SPEED: f64 = 0.3;
/// Distance in metres to a line within which a stop counts.
const STOP_DISTANCE: f64 = 3.0;

/// Returns the last known state of the light of a lane: lights out of sight keep their state.
fn last_state(seen: &Observation<'_>, lane: usize) -> Option<LightState> {
    let start = seen.start();
    let light = start.lights.iter().position(|l| l.lane == lane)?;
    seen.light(light).iter().rev().flatten().find(|s| **s != LightState::Unknown).copied()
}

/// Position at which the front must stop.
#[derive(Clone, Copy, Debug)]
pub(super) struct RequiredStop {
    /// Arc length, metres.
    pub(super) s: f64,
    /// Whether the line may hardly be crossed to evade the AV: true for a red light and the end of the
    /// drivable area, false for a stop sign.
    pub(super) strict: bool,
}

/// Returns the next required stop, if any, and marks stop signs at which the vehicle has stopped.
pub(super) fn next_stop(
    seen: &Observation<'_>,
    own: &Actor,
    driver: &mut PathFollower,
) -> Option<RequiredStop> {
    let front = driver.s + own.half_length;
    let reach = 20.0 + 6.0 * own.speed;
    let mut next = driver.ground_ends.map(|s| RequiredStop { s: s - own.half_length, strict: true });
    for stop in &mut driver.stops {
        let gap = stop.s - front;
        if gap < -0.5 || gap > reach {
            continue;
        }
        let needed = own.speed * own.speed / (2.0 * gap.max(0.1));
        let obliged = match stop.kind {
            StopKind::Light => match last_state(seen, stop.lane) {
                Some(s) if s.is_red() => needed < 5.5,
                Some(s) if s.is_yellow() => needed < YELLOW_DECELERATION,
                Some(LightState::FlashingStop) => !stop.done && needed < 5.5,
                _ => false,
            },
            StopKind::Sign => !stop.done && needed < 5.5,
            StopKind::Yield => false,
        };
        if own.speed < STOPPED_SPEED && gap < STOP_DISTANCE {
            stop.done = true;
        }
        if obliged && next.is_none_or(|n| stop.s < n.s) {
            next = Some(RequiredStop { s: stop.s, strict: stop.kind == StopKind::Light });
        }
    }
    next
}
