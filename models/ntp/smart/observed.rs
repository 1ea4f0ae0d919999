//! Network input from observed episodes: the map once, agents at every step.

use reactsim_geometry::Vec2;
use reactsim_nn::perception::Class;
use reactsim_rollout::Observation;
use reactsim_scene::dynamics::Pose;
use reactsim_scene::{Agent, CURRENT, Frame, Start};

use super::super::tokens::{
    CurvePiece, MapVocabulary, ORIGIN, PreparedTrack, TOKEN_FRAMES, TokenTrack, Vocabulary, curve_pieces,
    fill_gaps, token_of_motion,
};
use super::{Agents, MapTokens, Step};

/// Returns the pieces of the map that begin within `radius` metres of the AV's current position, with
/// the current light states.
pub(super) fn map_tokens(start: &Start, vocabulary: &MapVocabulary, radius: f64) -> MapTokens {
    map_tokens_of(&curve_pieces(start), vocabulary, start.now(0).position(), radius)
}

/// Returns the pieces that begin within `radius` metres of a point.
pub(super) fn map_tokens_of(
    pieces: &[CurvePiece],
    vocabulary: &MapVocabulary,
    center: Vec2,
    radius: f64,
) -> MapTokens {
    let mut map = MapTokens::default();
    for piece in pieces.iter().filter(|p| (p.start() - center).norm() < radius) {
        map.position.push([piece.start().x as f32, piece.start().y as f32]);
        map.orientation.push(piece.heading() as f32);
        map.token.push(vocabulary.nearest(piece) as u32);
        map.kind.push(piece.kind.code() as u8);
        map.polygon.push(piece.kind.line_code() as u8);
        map.light.push(piece.light.code() as u8);
    }
    map
}

/// Returns the class of an agent; the AV counts as a vehicle. `None` for agents that the network does not
/// know.
pub(super) fn class_of(agents: &[Agent], slot: usize) -> Option<Class> {
    if slot == 0 { Some(Class::Vehicle) } else { Class::of(agents[slot].kind) }
}

/// An agent that the network knows.
#[derive(Clone, Debug)]
pub(super) struct Participant {
    /// Slot of the agent.
    pub(super) slot: usize,
    /// Class of the agent.
    pub(super) class: Class,
    /// Poses up to the current frame, without gaps or jumps of the heading, and extended backwards to at
    /// least one token.
    past: PreparedTrack,
    /// The same as states of frames 0 to 10, absent before the agent was first seen.
    history: Vec<Frame>,
    /// Tokens of the history.
    tokens: TokenTrack,
}

impl Participant {
    /// Returns the participants of a scenario, in slot order. The AV counts as a vehicle; other agents
    /// without a class are left out.
    pub(super) fn all(start: &Start, vocabulary: &Vocabulary) -> Vec<Self> {
        let slots = (0..start.agents.len()).filter_map(|slot| Some((slot, class_of(&start.agents, slot)?)));
        slots.map(|(slot, class)| Self::new(slot, class, &start.history[slot], vocabulary)).collect()
    }

    fn new(slot: usize, class: Class, history: &[Frame], vocabulary: &Vocabulary) -> Self {
        let mut history = history.to_vec();
        fill_gaps(&mut history);
        let past = PreparedTrack::new(&history);
        for (frame, state) in history.iter_mut().enumerate() {
            if let (Some(state), Some(pose)) = (state, past.pose(frame)) {
                state.heading = pose.heading;
            }
        }
        let tokens = past.nearest_tokens(vocabulary, class);
        Self { slot, class, past, history, tokens }
    }

    /// Returns the track as the network knows it, from frame `first` on: the prepared history, then the
    /// realized states.
    pub(super) fn track(&self, seen: &Observation<'_>, first: usize) -> Vec<Frame> {
        let history = self.history.get(first..).unwrap_or_default();
        let realized = seen.track(self.slot).get(self.history.len().max(first)..).unwrap_or_default();
        history.iter().chain(realized).copied().collect()
    }

    /// Returns the pose at the frame of a step, the token that led there, and whether the step is valid:
    /// the agent was also present half a second before.
    ///
    /// Tokens of the history are matched in sequence and their ends are the agent's poses, as in the
    /// published networks. Later steps are matched between true poses and keep the true pose, so errors
    /// do not accumulate. The track begins with frame `first`, half a second before or earlier.
    fn node(
        &self,
        track: &[Frame],
        first: usize,
        frame: usize,
        vocabulary: &Vocabulary,
    ) -> (Pose, usize, bool) {
        if frame <= CURRENT && frame.is_multiple_of(TOKEN_FRAMES) {
            let step = frame / TOKEN_FRAMES - 1;
            if self.tokens.valid[step] {
                return (self.tokens.poses[step], self.tokens.tokens[step], true);
            }
        }
        let pose = |frame: usize| {
            if frame <= CURRENT {
                return self.past.pose(frame);
            }
            let state = track.get(frame - first).copied().flatten();
            state.map(Pose::from)
        };
        match (pose(frame - TOKEN_FRAMES), pose(frame)) {
            (Some(from), Some(to)) => (to, token_of_motion(vocabulary, self.class, from, to).0, true),
            (None, Some(to)) => (to, 0, false),
            (_, None) => (ORIGIN, 0, false),
        }
    }
}

/// Returns the classes and shapes of participants as network input. Boxes have no height here: all get
/// `height`, in metres.
pub(super) fn identities(start: &Start, participants: &[Participant], height: f64) -> Agents {
    let mut agents = Agents::default();
    for participant in participants {
        agents.push(participant.class, &start.agents[participant.slot], height);
    }
    agents
}

/// Returns the step that ends at a frame, which must be at least 5. `tracks` has one track per
/// participant, from frame `first` on, half a second before or earlier.
pub(super) fn step_at(
    participants: &[Participant],
    tracks: &[Vec<Frame>],
    first: usize,
    frame: usize,
    vocabulary: &Vocabulary,
) -> Step {
    let mut step = Step::default();
    for (participant, track) in participants.iter().zip(tracks) {
        let (pose, token, valid) = participant.node(track, first, frame, vocabulary);
        step.push(pose, token, valid);
    }
    step
}
