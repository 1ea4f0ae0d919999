//! Features of an agent at one step: position, present and past motion.

use reactsim_geometry::{Vec2, direction, into_frame, math};
use reactsim_scene::{AgentKind, AgentState, DT, Frame};

use super::class::Class;
use super::features::put;
use super::widths::{
    BODY_FEATURES, LANE_FEATURES, MOTION_FEATURES, OWN_FEATURES, PAST_POSE_FEATURES, PAST_POSE_FRAMES,
};

/// Minimum distance in metres for the curvature: a shorter distance travelled in that time counts as
/// this much.
const MIN_CURVATURE_DISTANCE: f64 = 1.0;
/// Largest curvature of a course, 1/m.
const MAX_CURVATURE: f64 = 0.2;
/// Speed above which a pedestrian counts as walking, m/s.
const WALKING_SPEED: f64 = 0.3;

/// An agent at one step: motion from which relations are computed, and its features.
#[derive(Clone, Copy, Debug)]
pub struct Body {
    /// Box centre, metres, scenario frame.
    pub position: Vec2,
    /// Unit vector of the heading.
    pub ahead: Vec2,
    /// Velocity, m/s, scenario frame.
    pub velocity: Vec2,
    /// Half length and half width, metres.
    pub half: Vec2,
    /// Rate of change of the forward speed, m/s².
    pub acceleration: f64,
    /// Class of the agent.
    pub class: Class,
    /// Whether it is the AV.
    pub is_av: bool,
    /// Height of the road under it, metres; NaN if unknown, and in scenarios of one level.
    pub height: f64,
    /// Features of the agent alone.
    pub features: [f32; BODY_FEATURES],
}

impl Body {
    /// Returns the direction of motion and its curvature in 1/m, from the turn since the state `ago`.
    /// The direction of walking pedestrians is that of their velocity, not their heading.
    pub(super) fn course(&self, ago: Frame) -> (Vec2, f64) {
        let speed = self.velocity.norm();
        if self.class == Class::Pedestrian {
            return (if speed > WALKING_SPEED { self.velocity / speed } else { self.ahead }, 0.0);
        }
        let Some(ago) = ago else { return (self.ahead, 0.0) };
        let turned = into_frame(direction(ago.heading), self.ahead);
        let gone = (self.position - ago.position()).norm().max(MIN_CURVATURE_DISTANCE);
        (self.ahead, (math::atan2(turned.y, turned.x) / gone).clamp(-MAX_CURVATURE, MAX_CURVATURE))
    }

    /// Returns the range of the features that describe agents and stops on the candidate paths.
    pub const fn corridor_features() -> std::ops::Range<usize> {
        OWN_FEATURES + LANE_FEATURES..BODY_FEATURES
    }

    /// Fills the features of the agent's own motion.
    pub fn describe(
        &mut self,
        kind: AgentKind,
        state: AgentState,
        next: Option<AgentState>,
        back: impl Fn(usize) -> Frame,
    ) {
        let moving = into_frame(self.ahead, self.velocity);
        let turn = |other: AgentState| {
            let u = direction(other.heading);
            let local = into_frame(self.ahead, u);
            math::atan2(local.y, local.x)
        };
        let yaw_rate = match (next, back(2)) {
            (Some(n), _) => turn(n) / DT,
            (None, Some(b)) => -turn(b) / (2.0 * DT),
            (None, None) => 0.0,
        };
        let yaw_rate = yaw_rate.clamp(-2.0, 2.0);
        let flag = |is: bool| f64::from(u8::from(is));
        let motion: [f64; MOTION_FEATURES] = [
            flag(kind == AgentKind::Vehicle),
            flag(kind == AgentKind::Pedestrian),
            flag(kind == AgentKind::Cyclist),
            flag(self.is_av),
            self.half.x / 2.5,
            self.half.y,
            moving.x / 10.0,
            moving.y / 2.0,
            // Resolves low speeds, which show whether an agent starts to move.
            moving.x / (1.0 + moving.x.abs()),
            self.acceleration / 4.0,
            yaw_rate,
            yaw_rate / moving.x.abs().max(1.0) * 5.0,
            flag(moving.norm() < 0.05),
            flag(next.is_some()),
        ];
        put(&mut self.features, motion);
        for (slot, k) in PAST_POSE_FRAMES.into_iter().enumerate() {
            let Some(earlier) = back(k) else { continue };
            let at = into_frame(self.ahead, earlier.position() - state.position());
            let toward = into_frame(self.ahead, direction(earlier.heading));
            // Displacements per half second are of similar size whatever the time difference.
            let scale = 5.0 / (k as f64) / 5.0;
            let past: [f64; PAST_POSE_FEATURES] =
                [at.x * scale, at.y * scale * 2.0, (1.0 - toward.x) * scale, toward.y * scale * 5.0, 1.0];
            put(&mut self.features[MOTION_FEATURES + slot * PAST_POSE_FEATURES..], past);
        }
    }
}
