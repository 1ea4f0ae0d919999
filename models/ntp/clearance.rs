//! Clearance to other agents while a token is executed.

use reactsim_geometry::{OrientedBox, Vec2, direction, rounded_distance};
use reactsim_scene::{Agent, AgentState, DT, Frame};

/// Corner rounding of boxes, as a fraction, as in the metrics (Waymo sim-agents convention).
const CORNER_ROUNDING: f64 = 0.7;

/// Boxes of all agents at a frame, extrapolated at constant velocity.
#[derive(Debug)]
pub(crate) struct Traffic {
    boxes: Vec<Option<MovingBox>>,
}

#[derive(Clone, Copy, Debug)]
struct MovingBox {
    footprint: OrientedBox,
    /// Velocity, m/s.
    velocity: Vec2,
    /// Whether it is the AV, and reverses or has reversed.
    has_backed: bool,
}

/// Speed against the heading from which the AV reverses, m/s: positions of a standing AV jitter.
const REVERSING_SPEED: f64 = 0.3;
/// Distance that is kept to an AV that reverses or has reversed, in addition to the usual one, metres: it
/// does not look ahead, and may stand across a lane.
const REVERSING_MARGIN: f64 = 1.0;
/// Deceleration with which an agent halts before an AV that reverses or has reversed, m/s².
const HALTING_DECELERATION: f64 = 4.5;

/// Whether the AV has reversed, followed from one plan to the next.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Reversals {
    /// Number of frames that are known.
    frames: usize,
    found: bool,
}

impl Reversals {
    /// Considers the frames of the AV, whose track begins with that of the episode, that are new.
    pub(crate) fn follow(&mut self, track: &[Frame]) {
        self.found |= reverses(&track[self.frames.saturating_sub(1)..]);
        self.frames = track.len();
    }
}

/// Returns whether an agent reverses somewhere in these frames.
fn reverses(track: &[Frame]) -> bool {
    track.windows(2).any(|pair| match *pair {
        [Some(from), Some(to)] => backs(from, step(from, to)),
        _ => false,
    })
}

/// Returns the velocity between two consecutive states, m/s.
fn step(from: AgentState, to: AgentState) -> Vec2 {
    (to.position() - from.position()) / DT
}

/// Returns whether an agent reverses at this velocity, m/s.
fn backs(state: AgentState, velocity: Vec2) -> bool {
    velocity.dot(&direction(state.heading)) < -REVERSING_SPEED
}

impl Traffic {
    /// Builds the traffic at `frame` of the latest frames of an episode. `av_next` is the AV one frame later,
    /// if the protocol shows it; slot 0 is the AV, which may have reversed earlier.
    pub(crate) fn at(
        agents: &[Agent],
        tracks: &[Vec<Frame>],
        frame: usize,
        av_next: Option<AgentState>,
        earlier: Reversals,
    ) -> Self {
        let boxes = agents.iter().zip(tracks).enumerate().map(|(slot, (agent, track))| {
            let state = track.get(frame).copied().flatten()?;
            let before = frame.checked_sub(1).and_then(|f| track[f]);
            let shown = av_next.filter(|_| slot == 0).map(|next| step(state, next));
            let velocity = shown.or(before.map(|b| step(b, state))).or(state.velocity());
            let (footprint, velocity) = (state.footprint(agent), velocity.unwrap_or_default());
            let has_backed =
                slot == 0 && (earlier.found || backs(state, velocity) || reverses(&track[..=frame]));
            Some(MovingBox { footprint, velocity, has_backed })
        });
        Self { boxes: boxes.collect() }
    }

    /// Returns the smallest distance in metres to the other agents, below 0 in contact, if an agent
    /// takes the states `planned` in its next frames and the others keep their velocities. Before an AV that
    /// reverses or has reversed, it must be able to halt after these frames. Only distances below the present
    /// one to the same agent count, so that overlapping agents can separate. Infinite if no other agent is
    /// near.
    pub(crate) fn clearance(&self, slot: usize, agent: &Agent, planned: &[Frame]) -> f64 {
        let Some(me) = self.boxes[slot] else { return f64::INFINITY };
        let mut least = f64::INFINITY;
        for other in self.others(slot) {
            let margin = if other.has_backed { REVERSING_MARGIN } else { 0.0 };
            let reach = me.footprint.radius() + other.footprint.radius() + margin;
            let mut now = None;
            let halting = other.has_backed.then(|| halting(planned)).into_iter().flatten();
            let course = planned.iter().copied().chain(halting).enumerate();
            for (k, state) in course.filter_map(|(k, state)| Some((k, state?))) {
                let center = other.footprint.center + other.velocity * ((k + 1) as f64 * DT);
                if (state.position() - center).norm_squared() > reach * reach {
                    continue;
                }
                let there = OrientedBox { center, ..other.footprint };
                // Backing away, an agent is hit all the same, and moves.
                let gone = (state.position() - me.footprint.center).dot(&me.footprint.axis);
                let (own, margin) = match other.has_backed && gone < 0.0 {
                    true => (me.footprint, margin - gone),
                    false => (state.footprint(agent), margin),
                };
                let distance = rounded_distance(&own, &there, CORNER_ROUNDING) - margin;
                let now = *now.get_or_insert_with(|| {
                    rounded_distance(&me.footprint, &other.footprint, CORNER_ROUNDING) - margin
                });
                if distance < now {
                    least = least.min(distance);
                }
            }
        }
        least
    }

    fn others(&self, slot: usize) -> impl Iterator<Item = &MovingBox> {
        self.boxes.iter().enumerate().filter(move |(j, _)| *j != slot).filter_map(|(_, other)| other.as_ref())
    }
}

/// Returns the states after planned ones in which an agent that moves ahead halts, straight on.
fn halting(planned: &[Frame]) -> impl Iterator<Item = Frame> + use<> {
    let mut motion = match planned {
        [.., Some(before), Some(last)] => {
            let ahead = direction(last.heading);
            Some((*last, ahead, (last.position() - before.position()).dot(&ahead) / DT))
        }
        _ => None,
    };
    std::iter::from_fn(move || {
        let (state, ahead, speed) = motion.as_mut().filter(|(_, _, speed)| *speed > 0.0)?;
        let next = (*speed - HALTING_DECELERATION * DT).max(0.0);
        let at = state.position() + *ahead * (0.5 * (*speed + next) * DT);
        (state.x, state.y, *speed) = (at.x, at.y, next);
        Some(Some(*state))
    })
}

#[cfg(test)]
mod tests {
    use reactsim_nn::perception::Class;
    use reactsim_scene::AgentKind;
    use reactsim_scene::dynamics::Pose;

    use super::super::execute::Executor;
    use super::super::tokens::{ORIGIN, TOKEN_FRAMES, TokenPoses};
    use super::*;

    const NOW: usize = 1;

    fn car(id: &str) -> Agent {
        Agent { id: id.into(), kind: AgentKind::Vehicle, length: 4.0, width: 2.0 }
    }

    /// A car at `x` that moves at `speed` along x.
    fn track(x: f64, speed: f64) -> Vec<Frame> {
        let at = |x| Some(AgentState { x, y: 0.0, heading: 0.0, vx: speed, vy: 0.0 });
        vec![at(x - speed * DT), at(x)]
    }

    fn straight(length: f64) -> TokenPoses {
        std::array::from_fn(|k| {
            let x = length * k as f64 / TOKEN_FRAMES as f64;
            Pose { position: Vec2::new(x, 0.0), ..ORIGIN }
        })
    }

    /// Returns how far the second car goes with tokens of these lengths, in metres, with or without
    /// regard to the first car.
    fn driven(tracks: &[Vec<Frame>], av_next: Option<AgentState>, lengths: &[f64], clear: bool) -> f64 {
        let agents = [car("a"), car("b")];
        let traffic = clear.then(|| Traffic::at(&agents, tracks, NOW, av_next, Reversals::default()));
        let tokens: Vec<TokenPoses> = lengths.iter().map(|length| straight(*length)).collect();
        let mut own = tracks[1].clone();
        let from = own[NOW].unwrap().x;
        Executor::new(false).execute_clear(
            &agents[1],
            1,
            Class::Vehicle,
            tokens.iter(),
            traffic.as_ref(),
            &mut own,
        );
        assert_eq!(own.len(), NOW + 1 + TOKEN_FRAMES);
        own.last().unwrap().unwrap().x - from
    }

    #[test]
    fn the_likeliest_token_that_keeps_clear_is_driven() {
        // A gap of 1 m to a stationary car.
        let tracks = [track(5.0, 0.0), track(0.0, 2.0)];
        assert_eq!(driven(&tracks, None, &[1.5, 1.0, 0.5, 0.2], false), 1.5);
        assert_eq!(driven(&tracks, None, &[1.5, 1.0, 0.5, 0.2], true), 0.5);
        assert_eq!(driven(&tracks, None, &[0.2, 0.5], true), 0.2);
        assert_eq!(driven(&tracks, None, &[1.5, 1.0], true), 0.0, "stands still if no token keeps clear");
        // The other car drives away, or does so in its next frame that is shown.
        assert_eq!(driven(&[track(5.0, 4.0), track(0.0, 2.0)], None, &[1.5], true), 1.5);
        let leaving = AgentState { x: 5.4, y: 0.0, heading: 0.0, vx: 4.0, vy: 0.0 };
        assert_eq!(driven(&tracks, Some(leaving), &[1.5], true), 1.5);
    }

    #[test]
    fn before_an_av_that_reverses_an_agent_can_halt() {
        // Halting from 2 m/s takes 0.44 m after a token of 1 m, and the AV comes 1.4 m closer by then.
        let reversing = |x| [track(x, -1.5), track(0.0, 2.0)];
        let lengths = [1.0, 0.2];
        assert_eq!(driven(&reversing(9.5), None, &lengths, true), 1.0);
        assert_eq!(driven(&reversing(6.5), None, &lengths, true), 0.2);
    }

    #[test]
    fn an_overlapping_agent_can_leave() {
        let tracks = [track(3.0, 0.0), track(0.0, 0.0)];
        assert_eq!(driven(&tracks, None, &[1.0, -1.0], true), -1.0);
        assert_eq!(driven(&tracks, None, &[-1.0, 1.0], true), -1.0);
        assert_eq!(driven(&tracks, None, &[1.0], true), 0.0);
    }

    #[test]
    fn the_largest_clearance_wins_if_nothing_keeps_clear() {
        // A car approaches from behind, faster than any token.
        let tracks = [track(-4.5, 8.0), track(0.0, 2.0)];
        assert_eq!(driven(&tracks, None, &[0.5, 2.0, 1.0], true), 2.0);
    }
}
