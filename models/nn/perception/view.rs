//! A scene up to a frame, as visible to a simulator.

use reactsim_geometry::Vec2;
use reactsim_rollout::Observation;
use reactsim_scene::levels::RoadHeights;
use reactsim_scene::{Agent, AgentState, Frame, LightState, Start};

use super::body::Body;
use super::class::Class;
use super::lane::CandidatePath;
use super::nearest::Nearest;
use super::places::Places;
use super::velocity::velocity_at;

/// A scene up to a frame, as visible to a simulator.
#[derive(Clone, Copy, Debug)]
pub struct SceneView<'a> {
    /// Agents; slot 0 is the AV.
    pub agents: &'a [Agent],
    /// Their realized frames; frames after `now` are ignored.
    pub tracks: &'a [Vec<Frame>],
    /// The frame of the step, as an index of `tracks`.
    pub now: usize,
    /// Frame of the episode with which `tracks` begin; 0 unless earlier ones are left out.
    pub first: usize,
    /// State of the AV one frame later, if the protocol shows it.
    pub av_next: Option<AgentState>,
    /// State of each light at `now`.
    pub lights: &'a [Option<LightState>],
    /// The scenario, from which heights come; `None` where all is one level.
    pub start: Option<&'a Start>,
    /// Heights that were followed from plan to plan; without them they are followed from the current frame
    /// on.
    pub heights: Option<&'a RoadHeights>,
}

impl<'a> SceneView<'a> {
    /// Returns the view of an observation with the current states of its lights.
    pub fn of(seen: &Observation<'a>, lights: &'a [Option<LightState>]) -> Self {
        Self {
            agents: &seen.start().agents,
            tracks: seen.tracks(),
            now: seen.frame(),
            first: 0,
            av_next: seen.av_next(),
            lights,
            start: Some(seen.start()),
            heights: None,
        }
    }

    /// Returns the frame of the step, counted from the beginning of the episode.
    pub fn frame(&self) -> usize {
        self.first + self.now
    }

    /// Returns the state of an agent; `None` if it is absent.
    pub fn state(&self, slot: usize) -> Frame {
        self.tracks[slot].get(self.now).copied().flatten()
    }

    /// Returns the velocity of an agent, as [`velocity_at`].
    pub fn velocity(&self, slot: usize) -> Vec2 {
        velocity_at(&self.tracks[slot], self.now)
    }

    /// Returns the slots of present agents with a class: that of the AV, then those nearest to it, `count` in
    /// all; none if the AV is absent.
    pub fn nearest_agents(&self, count: usize) -> Vec<usize> {
        let Some(av) = self.state(0) else { return Vec::new() };
        let mut nearest = Nearest::new(count);
        for (slot, agent) in self.agents.iter().enumerate() {
            if let (Some(state), Some(_)) = (self.state(slot), Class::of(agent.kind)) {
                let away = if slot == 0 { -1.0 } else { (state.position() - av.position()).norm() };
                nearest.offer(away, slot);
            }
        }
        nearest.found().collect()
    }

    /// Describes an agent among these places, with its candidate paths, its own course first. `None` if
    /// it is absent or has no class.
    pub fn body(&self, slot: usize, places: &Places) -> Option<(Body, Vec<CandidatePath>)> {
        let next = if slot == 0 { self.av_next } else { None };
        let (body, paths) =
            Body::at(&self.agents[slot], &self.tracks[slot], self.now, slot == 0, next, places)?;
        Some((Body { height: self.height(slot), ..body }, paths))
    }

    /// Returns the height of the road under an agent, metres; NaN if unknown, and in scenarios of one level.
    fn height(&self, slot: usize) -> f64 {
        let unknown = f64::NAN;
        let Some(start) = self.start.filter(|start| start.has_levels()) else { return unknown };
        let (frame, current) = (self.frame(), start.current());
        if frame < current {
            return start.recorded_height(slot, frame);
        }
        if let Some(heights) = self.heights {
            return heights.at(start, slot, frame, &self.tracks[slot], self.first);
        }
        let way = self.tracks[slot].get(current..=self.now).unwrap_or_default();
        start.heights_along(slot, way).last().copied().unwrap_or(unknown)
    }

    /// Returns whether two agents are on different levels, so that neither perceives the other.
    pub fn is_apart(&self, a: usize, b: usize) -> bool {
        self.start.is_some_and(Start::has_levels) && {
            let between = self.state(a).zip(self.state(b));
            between.is_some_and(|(at, other)| {
                let place = |state: AgentState, slot: usize| (state.position(), self.height(slot));
                self.start.is_some_and(|start| start.road().is_apart(place(at, a), place(other, b)))
            })
        }
    }

    /// Returns whether two agents are on different levels: neither perceives the other.
    pub fn are_apart(&self, a: &Body, b: &Body) -> bool {
        let is_apart = |start: &Start| start.road().is_apart((a.position, a.height), (b.position, b.height));
        self.start.is_some_and(is_apart)
    }
}
