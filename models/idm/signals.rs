//! Lights and stop signs on a path.

use reactsim::rollout::Observation;
use reactsim::scene::{LightState, StopKind};

use super::actor::Actor;
use super::driver::OnPath;

/// The gentlest braking that a yellow light is still worth, m/s².
const YELLOW: f64 = 3.0;
/// Slower than this is a stop, m/s, if it is nearer to the line than this, m.
const STOPPED: f64 = 0.3;
const AT_LINE: f64 = 3.0;

/// The last known state of the light of a lane: lights that are out of sight keep their colour.
fn shown(seen: &Observation<'_>, lane: usize) -> Option<LightState> {
    let start = seen.start();
    let light = start.lights.iter().position(|l| l.lane == lane)?;
    seen.light(light).iter().rev().flatten().find(|s| **s != LightState::Unknown).copied()
}

/// Where the front must stop, and how strictly.
#[derive(Clone, Copy, Debug)]
pub(super) struct MustStop {
    /// Arc length, metres.
    pub(super) s: f64,
    /// A stop sign may be passed to get out of the AV's way; a red light, or the end of the ground, hardly.
    pub(super) strict: bool,
}

/// The next obligation to stop, if there is one; notes obeyed stop signs.
pub(super) fn next_stop(seen: &Observation<'_>, own: &Actor, driver: &mut OnPath) -> Option<MustStop> {
    let front = driver.s + own.half_length;
    let reach = 20.0 + 6.0 * own.speed;
    let mut next = driver.ground_ends.map(|s| MustStop { s: s - own.half_length, strict: true });
    for stop in &mut driver.stops {
        let gap = stop.s - front;
        if gap < -0.5 || gap > reach {
            continue;
        }
        let needed = own.speed * own.speed / (2.0 * gap.max(0.1));
        let obliged = match stop.kind {
            StopKind::Light => match shown(seen, stop.lane) {
                Some(s) if s.is_red() => needed < 5.5,
                Some(s) if s.is_yellow() => needed < YELLOW,
                Some(LightState::FlashingStop) => !stop.done && needed < 5.5,
                _ => false,
            },
            StopKind::Sign => !stop.done && needed < 5.5,
            StopKind::Yield => false,
        };
        if own.speed < STOPPED && gap < AT_LINE {
            stop.done = true;
        }
        if obliged && next.is_none_or(|n| stop.s < n.s) {
            next = Some(MustStop { s: stop.s, strict: stop.kind == StopKind::Light });
        }
    }
    next
}
