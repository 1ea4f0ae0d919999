//! What of an agent enters the network at one step: where it is, how it moves, how it moved.

use reactsim::geometry::{Vec2, direction, into_frame, math};
use reactsim::scene::{Agent, AgentKind, AgentState, DT, Frame};

use super::super::tokens::Class;
use super::corridor::CORRIDOR;
use super::lane::{self, Driver, LANE, Way};
use super::places::Places;

/// Frames before now whose poses are shown to the network.
const LOOKS_BACK: [usize; 4] = [1, 2, 5, 10];
/// Numbers per earlier pose: forward and left in the frame of now, cosine and sine of the turn, whether it is known.
const PER_LOOK: usize = 5;
/// Numbers that describe an agent at a step.
pub(crate) const BODY: usize = OWN + LANE + CORRIDOR;
/// Of these, numbers of its own; then its lane, then what is in its way.
const OWN: usize = 14 + LOOKS_BACK.len() * PER_LOOK;
/// The course of an agent bends as it did over so many frames: over less it is mostly noise in recordings.
const COURSE_FRAMES: usize = 5;
/// Who has gone less in that time is taken to have gone so far, metres.
const MOVES: f64 = 1.0;
/// No course bends more, 1/m.
const BEND: f64 = 0.2;
/// Pedestrians who are faster walk, m/s.
const WALKS: f64 = 0.3;

/// An agent at one step, as relations are computed from it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Body {
    /// Box centre, metres, scenario frame.
    pub position: Vec2,
    /// Unit vector of the heading.
    pub ahead: Vec2,
    /// Velocity, m/s, scenario frame.
    pub velocity: Vec2,
    /// Half of length and width, metres.
    pub half: Vec2,
    /// Change of the forward speed, m/s².
    pub acceleration: f64,
    /// Class.
    pub class: Class,
    /// Whether it is the AV.
    pub is_av: bool,
    /// What describes the agent alone.
    pub features: [f32; BODY],
}

impl Body {
    /// The agent at frame `now` of its track, from this and earlier frames; the AV also from its state one step later where the
    /// protocol shows it (`next`), with its lane among `places`; and the ways on, its own course first. `None` where it is absent or of no class.
    pub(crate) fn at(
        agent: &Agent,
        track: &[Frame],
        now: usize,
        is_av: bool,
        next: Option<AgentState>,
        places: &Places,
    ) -> Option<(Self, Vec<Way>)> {
        let class = Class::of(agent.kind)?;
        let state = track.get(now).copied().flatten()?;
        let ahead = direction(state.heading);
        let back = |k: usize| now.checked_sub(k).and_then(|f| track[f]);
        let step = |from: Frame, to: Frame| Some((to?.position() - from?.position()) / DT);
        let recorded = || state.velocity().unwrap_or_default();
        let last = step(back(1), Some(state));
        let coming = next.and_then(|n| step(Some(state), Some(n)));
        let velocity = coming.or(last).unwrap_or_else(recorded);
        // Over 0.2 s: differences of single frames are mostly noise in recordings.
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
            features: [0.0; BODY],
        };
        body.describe(agent.kind, state, next, back);
        let speed = body.velocity.dot(&ahead).max(0.0);
        let (course, curvature) = body.course(back(COURSE_FRAMES));
        let driver = Driver { position: body.position, ahead, speed, class, course, curvature };
        let mut ways = vec![lane::course(&driver)];
        ways.extend(lane::describe(&driver, places, &mut body.features[OWN..OWN + LANE]));
        Some((body, ways))
    }

    /// Which way it moves and how that way bends, 1/m, by how it was turned a moment `ago`. Pedestrians walk where they do not look.
    fn course(&self, ago: Frame) -> (Vec2, f64) {
        let speed = self.velocity.norm();
        if self.class == Class::Pedestrian {
            return (if speed > WALKS { self.velocity / speed } else { self.ahead }, 0.0);
        }
        let Some(ago) = ago else { return (self.ahead, 0.0) };
        let turned = into_frame(direction(ago.heading), self.ahead);
        let gone = (self.position - ago.position()).norm().max(MOVES);
        (self.ahead, (math::atan2(turned.y, turned.x) / gone).clamp(-BEND, BEND))
    }

    /// Where what is in the way of an agent is described.
    pub(crate) const fn corridor() -> std::ops::Range<usize> {
        OWN + LANE..BODY
    }

    /// Fills `features`.
    fn describe(
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
        let f = &mut self.features;
        let class = [AgentKind::Vehicle, AgentKind::Pedestrian, AgentKind::Cyclist];
        for (slot, k) in class.into_iter().enumerate() {
            f[slot] = f32::from(u8::from(kind == k));
        }
        f[3] = f32::from(u8::from(self.is_av));
        f[4] = (self.half.x / 2.5) as f32;
        f[5] = self.half.y as f32;
        f[6] = (moving.x / 10.0) as f32;
        f[7] = (moving.y / 2.0) as f32;
        // Low speeds decide whether somebody sets off.
        f[8] = (moving.x / (1.0 + moving.x.abs())) as f32;
        f[9] = (self.acceleration / 4.0) as f32;
        f[10] = yaw_rate as f32;
        f[11] = (yaw_rate / moving.x.abs().max(1.0) * 5.0) as f32;
        f[12] = f32::from(u8::from(moving.norm() < 0.05));
        f[13] = f32::from(u8::from(next.is_some()));
        for (slot, k) in LOOKS_BACK.into_iter().enumerate() {
            let Some(earlier) = back(k) else { continue };
            let at = into_frame(self.ahead, earlier.position() - state.position());
            let toward = into_frame(self.ahead, direction(earlier.heading));
            // Displacements per half second look alike at all distances in time.
            let scale = 5.0 / (k as f64) / 5.0;
            let out = &mut f[14 + slot * PER_LOOK..][..PER_LOOK];
            out[0] = (at.x * scale) as f32;
            out[1] = (at.y * scale * 2.0) as f32;
            out[2] = ((1.0 - toward.x) * scale) as f32;
            out[3] = (toward.y * scale * 5.0) as f32;
            out[4] = 1.0;
        }
    }
}
