//! Traffic lights and stop signs on a path.

use reactsim_rollout::Observation;
use reactsim_scene::{LightState, Start, StopKind};

use super::actor::Actor;
use super::driver::PathFollower;

/// Largest deceleration at which a driver stops for a yellow light, m/s².
const YELLOW_DECELERATION: f64 = 3.0;
/// Speed in m/s below which a vehicle has stopped at a line.
const STOPPED_SPEED: f64 = 0.3;
/// Distance in metres to a line within which a stop counts.
const STOP_DISTANCE: f64 = 3.0;

/// Last known states of the lights: lights out of sight keep their state.
#[derive(Clone, Debug, Default)]
pub(super) struct KnownLights {
    /// Number of frames that are considered.
    frames: usize,
    states: Vec<Option<LightState>>,
}

impl KnownLights {
    /// Considers the frames that are new.
    pub(super) fn follow(&mut self, seen: &Observation<'_>) {
        self.states.resize(seen.start().lights.len(), None);
        for (light, state) in self.states.iter_mut().enumerate() {
            let new = seen.light(light).get(self.frames..).unwrap_or_default();
            *state = new.iter().rev().flatten().find(|s| **s != LightState::Unknown).copied().or(*state);
        }
        self.frames = seen.frame() + 1;
    }

    /// Returns the same states at the beginning of other tracks, whose frames are all to be considered.
    pub(super) fn of_new_tracks(self) -> Self {
        Self { frames: 0, ..self }
    }

    fn of_lane(&self, start: &Start, lane: usize) -> Option<LightState> {
        self.states[start.lights.iter().position(|l| l.lane == lane)?]
    }
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
    start: &Start,
    lights: &KnownLights,
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
            StopKind::Light => match lights.of_lane(start, stop.lane) {
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
