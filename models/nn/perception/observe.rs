//! Observation of an agent: its motion, its lane and its candidate paths.

use reactsim_geometry::{Vec2, direction};
use reactsim_scene::{Agent, AgentState, DT, Frame};

use super::body::Body;
use super::class::Class;
use super::lane::{self, CandidatePath, VehicleMotion};
use super::places::Places;
use super::widths::{BODY_FEATURES, LANE_FEATURES, OWN_FEATURES};

/// Time over which the curvature of an agent's course is measured, frames: over a shorter time it is
/// mostly noise in recordings.
const CURVATURE_FRAMES: usize = 5;

impl Body {
    /// Describes the agent at frame `now` from this and earlier frames of its track, and the AV also
    /// from its state one frame later (`next`) if the protocol shows it. `places` are searched for its
    /// lane. Also returns its candidate paths, its own course first. `None` if the agent is absent or
    /// has no class.
    pub(crate) fn at(
        agent: &Agent,
        track: &[Frame],
        now: usize,
        is_av: bool,
        next: Option<AgentState>,
        places: &Places,
    ) -> Option<(Self, Vec<CandidatePath>)> {
        let class = Class::of(agent.kind)?;
        let state = track.get(now).copied().flatten()?;
        let ahead = direction(state.heading);
        let back = |k: usize| now.checked_sub(k).and_then(|f| track[f]);
        let step = |from: Frame, to: Frame| Some((to?.position() - from?.position()) / DT);
        let recorded = || state.velocity().unwrap_or_default();
        let last = step(back(1), Some(state));
        let coming = next.and_then(|n| step(Some(state), Some(n)));
        let velocity = coming.or(last).unwrap_or_else(recorded);
        // Over 0.2 s, because differences of single frames are mostly noise in recordings.
        let earlier = if coming.is_some() { step(back(2), back(1)) } else { step(back(3), back(2)) };
        let acceleration =
            earlier.map_or(0.0, |e| ((velocity - e).dot(&ahead) / (2.0 * DT)).clamp(-10.0, 10.0));
        let mut body = Self {
            position: state.position(),
            ahead,
            velocity,
            half: Vec2::new(0.5 * agent.length, 0.5 * agent.width),
            acceleration,
            class,
            is_av,
            height: f64::NAN,
            features: [0.0; BODY_FEATURES],
        };
        body.describe(agent.kind, state, next, back);
        let speed = body.velocity.dot(&ahead).max(0.0);
        let (course, curvature) = body.course(back(CURVATURE_FRAMES));
        let motion = VehicleMotion { position: body.position, ahead, speed, class, course, curvature };
        let mut paths = vec![lane::course_path(&motion)];
        paths.extend(lane::describe(
            &motion,
            places,
            &mut body.features[OWN_FEATURES..OWN_FEATURES + LANE_FEATURES],
        ));
        Some((body, paths))
    }
}
