//! What the network is shown of an episode: the map once, agents at every step.

use reactsim::dynamics::Pose;
use reactsim::rollout::Observation;
use reactsim::scene::{CURRENT, Frame, Start};

use super::super::tokens::{
    Class, MapVocabulary, ORIGIN, PreparedTrack, TOKEN_FRAMES, TokenTrack, Vocabulary, curve_pieces,
    fill_gaps, token_of_motion,
};
use super::{Agents, MapTokens, Step};

/// The pieces of the map that begin within `radius` metres of where the AV is now, with lights as they are now.
pub(super) fn map_tokens(start: &Start, vocabulary: &MapVocabulary, radius: f64) -> MapTokens {
    let about = start.now(0).position();
    let mut map = MapTokens::default();
    for piece in curve_pieces(start).iter().filter(|p| (p.start() - about).norm() < radius) {
        map.position.push([piece.start().x as f32, piece.start().y as f32]);
        map.orientation.push(piece.heading() as f32);
        map.token.push(vocabulary.nearest(piece) as u32);
        map.kind.push(piece.kind.code() as u8);
        map.polygon.push(piece.kind.line_code() as u8);
        map.light.push(piece.light.code() as u8);
    }
    map
}

/// An agent that the network knows: a row of its steps.
#[derive(Clone, Debug)]
pub(super) struct Participant {
    /// The agent.
    pub(super) slot: usize,
    /// Its class.
    pub(super) class: Class,
    /// Where it was, up to the current frame: without gaps, without jumps of the heading, and long enough for one token.
    past: PreparedTrack,
    /// The same as states, frames 0 to 10, without what was before it was first seen.
    history: Vec<Frame>,
    /// The tokens of its history.
    tokens: TokenTrack,
}

impl Participant {
    /// The agents of a scenario, in its order. The AV counts as a vehicle; others that have no class are not seen.
    pub(super) fn all(start: &Start, vocabulary: &Vocabulary) -> Vec<Self> {
        let class = |slot: usize| match slot {
            0 => Some(Class::Vehicle),
            _ => Class::of(start.agents[slot].kind),
        };
        let slots = (0..start.agents.len()).filter_map(|slot| Some((slot, class(slot)?)));
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

    /// Its track as the network knows it: the history as it was prepared, then what was realised.
    pub(super) fn track(&self, seen: &Observation<'_>) -> Vec<Frame> {
        let realised = seen.track(self.slot).get(self.history.len()..).unwrap_or_default();
        self.history.iter().chain(realised).copied().collect()
    }

    /// Where it is at the frame of a step, the token that led there, and whether it was there half a second before too.
    ///
    /// Tokens of the history are matched one after the other, and their ends are where the agent is, as the published networks see it.
    /// What came after is matched from where the agent truly was, and it is where it truly is: nothing adds up.
    fn node(&self, track: &[Frame], frame: usize, vocabulary: &Vocabulary) -> (Pose, usize, bool) {
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
            let state = track.get(frame).copied().flatten();
            state.map(Pose::from)
        };
        match (pose(frame - TOKEN_FRAMES), pose(frame)) {
            (Some(from), Some(to)) => (to, token_of_motion(vocabulary, self.class, from, to).0, true),
            (None, Some(to)) => (to, 0, false),
            (_, None) => (ORIGIN, 0, false),
        }
    }
}

/// Who takes part, as the network wants it. Boxes have no height here: all get this one, metres.
pub(super) fn identities(start: &Start, participants: &[Participant], height: f64) -> Agents {
    let shape = |p: &Participant| {
        let agent = &start.agents[p.slot];
        [agent.length as f32, agent.width as f32, height as f32]
    };
    Agents {
        class: participants.iter().map(|p| p.class.index() as u8).collect(),
        shape: participants.iter().map(shape).collect(),
    }
}

/// The step that ends at a frame from 5 on. `tracks` has a track per participant.
pub(super) fn step_at(
    participants: &[Participant],
    tracks: &[Vec<Frame>],
    frame: usize,
    vocabulary: &Vocabulary,
) -> Step {
    let mut step = Step::default();
    for (participant, track) in participants.iter().zip(tracks) {
        let (pose, token, valid) = participant.node(track, frame, vocabulary);
        step.position.push([pose.position.x as f32, pose.position.y as f32]);
        step.heading.push(pose.heading as f32);
        step.valid.push(valid);
        step.token.push(token as u32);
    }
    step
}
