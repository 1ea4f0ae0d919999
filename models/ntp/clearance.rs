//! Whether a token leads into others.

use reactsim::geometry::{OrientedBox, Vec2, rounded_distance};
use reactsim::scene::{Agent, AgentState, DT, Frame};

/// Boxes are rounded as in the metrics (Waymo sim-agents convention).
const ROUNDING: f64 = 0.7;

/// Everybody as they stand at a frame, going on as they do.
#[derive(Debug)]
pub(crate) struct Traffic {
    going: Vec<Option<Going>>,
}

#[derive(Clone, Copy, Debug)]
struct Going {
    footprint: OrientedBox,
    /// m/s.
    velocity: Vec2,
}

impl Traffic {
    /// The agents at `frame` of their tracks. `av_next` is the AV one frame later, where the protocol shows it; slot 0 is the AV.
    pub(crate) fn at(
        agents: &[Agent],
        tracks: &[Vec<Frame>],
        frame: usize,
        av_next: Option<AgentState>,
    ) -> Self {
        let going = agents.iter().zip(tracks).enumerate().map(|(slot, (agent, track))| {
            let state = track.get(frame).copied().flatten()?;
            let before = frame.checked_sub(1).and_then(|f| track[f]);
            let step = |from: AgentState, to: AgentState| (to.position() - from.position()) / DT;
            let shown = av_next.filter(|_| slot == 0).map(|next| step(state, next));
            let velocity = shown.or(before.map(|b| step(b, state))).or(state.velocity());
            Some(Going { footprint: state.footprint(agent), velocity: velocity.unwrap_or_default() })
        });
        Self { going: going.collect() }
    }

    /// The least distance to others of an agent that takes `planned` for its next frames, while they go on as they do; metres, below 0 in
    /// contact. Only those count to whom it comes nearer than it is: who overlaps another may leave. Infinite where nobody is near.
    pub(crate) fn room(&self, slot: usize, agent: &Agent, planned: &[Frame]) -> f64 {
        let Some(me) = self.going[slot] else { return f64::INFINITY };
        let mut least = f64::INFINITY;
        for other in self.others(slot) {
            let reach = me.footprint.radius() + other.footprint.radius();
            let mut now = None;
            for (k, state) in planned.iter().enumerate() {
                let Some(state) = state else { continue };
                let gone = other.velocity * ((k + 1) as f64 * DT);
                let center = other.footprint.center + gone;
                if (state.position() - center).norm_squared() > reach * reach {
                    continue;
                }
                let there = OrientedBox { center, ..other.footprint };
                let distance = rounded_distance(&state.footprint(agent), &there, ROUNDING);
                let now =
                    *now.get_or_insert_with(|| rounded_distance(&me.footprint, &other.footprint, ROUNDING));
                if distance < now {
                    least = least.min(distance);
                }
            }
        }
        least
    }

    fn others(&self, slot: usize) -> impl Iterator<Item = &Going> {
        self.going.iter().enumerate().filter(move |(j, _)| *j != slot).filter_map(|(_, other)| other.as_ref())
    }
}

#[cfg(test)]
mod tests {
    use reactsim::dynamics::Pose;
    use reactsim::scene::AgentKind;

    use super::super::execute::Executor;
    use super::super::tokens::{Class, ORIGIN, TOKEN_FRAMES, TokenPoses};
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

    fn straight(way: f64) -> TokenPoses {
        std::array::from_fn(|k| {
            let x = way * k as f64 / TOKEN_FRAMES as f64;
            Pose { position: Vec2::new(x, 0.0), ..ORIGIN }
        })
    }

    /// Where the second car goes with tokens of these lengths, the other one in its way or not.
    fn driven(tracks: &[Vec<Frame>], av_next: Option<AgentState>, ways: &[f64], clear: bool) -> f64 {
        let agents = [car("a"), car("b")];
        let traffic = clear.then(|| Traffic::at(&agents, tracks, NOW, av_next));
        let tokens: Vec<TokenPoses> = ways.iter().map(|way| straight(*way)).collect();
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
        // A gap of 1 m to a car that stands.
        let tracks = [track(5.0, 0.0), track(0.0, 2.0)];
        assert_eq!(driven(&tracks, None, &[1.5, 1.0, 0.5, 0.2], false), 1.5);
        assert_eq!(driven(&tracks, None, &[1.5, 1.0, 0.5, 0.2], true), 0.5);
        assert_eq!(driven(&tracks, None, &[0.2, 0.5], true), 0.2);
        assert_eq!(driven(&tracks, None, &[1.5, 1.0], true), 0.0, "stands where no token does");
        // It drives away, or will have, as far as is shown.
        assert_eq!(driven(&[track(5.0, 4.0), track(0.0, 2.0)], None, &[1.5], true), 1.5);
        let leaving = AgentState { x: 5.4, y: 0.0, heading: 0.0, vx: 4.0, vy: 0.0 };
        assert_eq!(driven(&tracks, Some(leaving), &[1.5], true), 1.5);
    }

    #[test]
    fn who_overlaps_another_may_leave() {
        let tracks = [track(3.0, 0.0), track(0.0, 0.0)];
        assert_eq!(driven(&tracks, None, &[1.0, -1.0], true), -1.0);
        assert_eq!(driven(&tracks, None, &[-1.0, 1.0], true), -1.0);
        assert_eq!(driven(&tracks, None, &[1.0], true), 0.0);
    }

    #[test]
    fn where_nothing_keeps_clear_the_farthest_is_driven() {
        // Somebody comes from behind, faster than any token.
        let tracks = [track(-4.5, 8.0), track(0.0, 2.0)];
        assert_eq!(driven(&tracks, None, &[0.5, 2.0, 1.0], true), 2.0);
    }
}
