//! Scenes as inputs of the network.

use reactsim_geometry::{OrientedBox, Vec2, direction, heading_of, into_frame, left, wrap};
use reactsim_nn::SizeError;
use reactsim_nn::perception::{Class, Nearest, SceneView, velocity_at};
use reactsim_scene::dynamics::REAR_AXLE;
use reactsim_scene::{Agent, AgentState, LightState, Start};
use serde::{Deserialize, Serialize};

use super::lanes::{LanePiece, PlannerMap};
use super::network::{AGENT, POINT, PlannerConfig, PlannerInput, STATIC};

/// Metres, and metres per second, of one unit of the normalised input; the origin is this far ahead of the AV.
pub(super) const UNIT: f64 = 20.0;
pub(super) const AHEAD: f64 = 10.0;
/// Largest number of pedestrians and cyclists among the neighbours (published).
const MOST_OTHERS: usize = 10;

/// Limits of the network's input; stored with the weights.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlannerSight {
    /// Radius around the AV's position at the current frame within which the map is known, metres.
    pub radius: f64,
    /// Length of a piece of a lane, metres; longer lanes are cut into equal pieces.
    pub piece: f64,
    /// Whether the first row of agents is the AV. The published network does not know how fast the AV is.
    pub av_row: bool,
    /// Whether future poses are differences from constant velocity, in units that grow with time. The
    /// published network has positions around the AV, in units of 20 m.
    pub relative: bool,
    /// Whether plans give routes and speeds alone, and are driven along the lanes. Plans of the published
    /// network are followed as they are.
    pub lanes: bool,
}

impl Default for PlannerSight {
    /// Returns what the small network sees.
    fn default() -> Self {
        Self { radius: 80.0, piece: 30.0, av_row: true, relative: true, lanes: true }
    }
}

impl PlannerSight {
    /// Returns what the published network sees. Lanes are whole.
    pub const fn published() -> Self {
        Self { radius: 100.0, piece: 1e5, av_row: false, relative: false, lanes: false }
    }

    /// Checks the lengths.
    ///
    /// # Errors
    /// [`SizeError`], which names the field.
    pub(super) fn check(&self) -> Result<(), SizeError> {
        for (field, value) in [("radius", self.radius), ("piece", self.piece)] {
            if !(1.0..=1e5).contains(&value) {
                return Err(SizeError { field, value, expected: "metres, from 1 to 100000" });
            }
        }
        Ok(())
    }

    /// Returns the map of a scenario.
    pub(crate) fn map(&self, start: &Start, config: &PlannerConfig) -> PlannerMap {
        PlannerMap::of(start, self.radius, self.piece, config.points)
    }
}

/// The frame of the AV's rear axle: x ahead, y to the left.
#[derive(Clone, Copy, Debug)]
pub(super) struct AxleFrame {
    origin: Vec2,
    axis: Vec2,
    heading: f64,
}

impl AxleFrame {
    /// Returns the frame of the AV in this state.
    pub(super) fn of(av: &Agent, state: AgentState) -> Self {
        Self {
            origin: rear_axle(av, state.position(), state.heading),
            axis: direction(state.heading),
            heading: state.heading,
        }
    }

    /// Returns the position of a point in the frame, metres.
    pub(super) fn point(&self, p: Vec2) -> Vec2 {
        into_frame(self.axis, p - self.origin)
    }

    /// Returns the place of a point of the frame, metres.
    pub(super) fn place(&self, p: Vec2) -> Vec2 {
        self.origin + self.axis * p.x + left(self.axis) * p.y
    }

    /// Returns the heading of a direction of the frame, radians.
    pub(super) fn heading(&self, ahead: Vec2) -> f64 {
        wrap(self.heading + heading_of(ahead))
    }

    /// Returns a vector in the frame.
    pub(super) fn vector(&self, v: Vec2) -> Vec2 {
        into_frame(self.axis, v)
    }

    /// Returns x, y, cosine and sine of a pose, normalised.
    pub(super) fn pose(&self, p: Vec2, heading: f64) -> [f32; 4] {
        let (at, ahead) = (self.point(p), direction(heading - self.heading));
        [(at.x - AHEAD) / UNIT, at.y / UNIT, ahead.x, ahead.y].map(|v| v as f32)
    }

    /// Returns a vector, normalised.
    fn way(&self, v: Vec2) -> [f32; 2] {
        let v = self.vector(v) / UNIT;
        [v.x, v.y].map(|v| v as f32)
    }
}

/// Returns the rear axle of a vehicle whose box is here.
pub(super) fn rear_axle(av: &Agent, center: Vec2, heading: f64) -> Vec2 {
    center - direction(heading) * (REAR_AXLE * av.length)
}

/// A scene as the network sees it.
#[derive(Clone, Debug)]
pub(crate) struct PlannerScene {
    pub(super) input: PlannerInput,
    pub(super) frame: AxleFrame,
    /// Slots of the AV and of the neighbours whose motion is predicted.
    pub(super) slots: Vec<usize>,
}

impl PlannerScene {
    /// Describes a scene; `None` if the AV is absent. The route is left out, as in ReactSim-Bench.
    pub(crate) fn of(
        view: &SceneView<'_>,
        map: &PlannerMap,
        config: &PlannerConfig,
        sight: &PlannerSight,
    ) -> Option<Self> {
        let av = view.state(0)?;
        let frame = AxleFrame::of(&view.agents[0], av);
        let mut neighbours = neighbours(view, av.position());
        neighbours.truncate(config.agents - usize::from(sight.av_row));
        let mut slots = vec![0];
        slots.extend(neighbours.iter().take(config.predicted));

        let rows = sight.av_row.then_some(0).into_iter().chain(neighbours);
        let mut agents: Vec<f32> = rows.flat_map(|slot| history(view, slot, &frame, config)).collect();
        agents.resize(config.agents * config.history * AGENT, 0.0);

        let mut statics: Vec<f32> =
            nearest(&map.boxes, config.statics, |b| (b.center - av.position()).norm())
                .flat_map(|standing| box_row(standing, &frame))
                .collect();
        statics.resize(config.statics * STATIC, 0.0);

        let near: Vec<&LanePiece> =
            nearest(&map.lanes, config.lanes, |lane| lane.distance(av.position())).collect();
        let mut lanes: Vec<f32> = near.iter().flat_map(|lane| lane_rows(lane, &frame, view.lights)).collect();
        lanes.resize(config.lanes * config.points * POINT, 0.0);
        let mut limits: Vec<Option<f32>> =
            near.iter().map(|lane| lane.limit.map(|limit| (limit / UNIT) as f32)).collect();
        limits.resize(config.lanes, None);

        let state = |slot: &usize| view.state(*slot).map(|s| (*slot, s));
        let pose = |(slot, s): (usize, AgentState)| match slot {
            0 => frame.pose(rear_axle(&view.agents[0], s.position(), s.heading), s.heading),
            _ => frame.pose(s.position(), s.heading),
        };
        let mut current: Vec<f32> = slots.iter().filter_map(state).flat_map(pose).collect();
        current.resize(4 * (1 + config.predicted), 0.0);
        let route = vec![0.0; config.route * config.points * POINT];
        Some(Self { input: PlannerInput { agents, statics, lanes, limits, route, current }, frame, slots })
    }
}

/// Returns the agents that are there besides the AV, the nearest first, with at most ten pedestrians and cyclists.
fn neighbours(view: &SceneView<'_>, av: Vec2) -> Vec<usize> {
    let mut all = Nearest::new(view.agents.len());
    for slot in 1..view.agents.len() {
        if let (Some(state), Some(_)) = (view.state(slot), Class::of(view.agents[slot].kind))
            && !view.is_apart(0, slot)
        {
            all.offer((state.position() - av).norm(), slot);
        }
    }
    let mut others = 0;
    let allowed = |slot: &usize| {
        let is_other = Class::of(view.agents[*slot].kind) != Some(Class::Vehicle);
        others += usize::from(is_other);
        !is_other || others <= MOST_OTHERS
    };
    all.found().filter(allowed).collect()
}

/// Returns the `most` nearest of these, the nearest first.
fn nearest<T>(all: &[T], most: usize, distance: impl Fn(&T) -> f64) -> impl Iterator<Item = &T> {
    let mut nearest = Nearest::new(most);
    all.iter().enumerate().for_each(|(i, one)| nearest.offer(distance(one), i));
    nearest.found().map(|i| &all[i]).collect::<Vec<_>>().into_iter()
}

/// Returns the rows of an agent that is there now: `[history, 11]`. Before it was first seen it is where it was seen
/// first.
fn history(view: &SceneView<'_>, slot: usize, frame: &AxleFrame, config: &PlannerConfig) -> Vec<f32> {
    let (agent, track) = (&view.agents[slot], &view.tracks[slot]);
    let kind = Class::ALL.map(|class| f32::from(Class::of(agent.kind) == Some(class)));
    let row = |at: usize| {
        let state = track[at].unwrap_or_else(|| unreachable!("frames of this agent are known from here on"));
        let [x, y, cos, sin] = frame.pose(state.position(), state.heading);
        let [vx, vy] = frame.way(velocity_at(track, at));
        let size = [agent.width, agent.length].map(|v| (v / UNIT) as f32);
        [x, y, cos, sin, vx, vy, size[0], size[1], kind[0], kind[1], kind[2]]
    };
    // The last run of frames without a gap.
    let earliest = (view.now + 1).saturating_sub(config.history);
    let first = (earliest..=view.now).rev().take_while(|at| track[*at].is_some()).last().unwrap_or(view.now);
    let back = |k: usize| (view.now + k + 1).saturating_sub(config.history).max(first);
    (0..config.history).flat_map(|k| row(back(k))).collect()
}

/// Returns the row of a box that stands: `[10]`. Sizes are in metres, as in the public code.
fn box_row(standing: &OrientedBox, frame: &AxleFrame) -> [f32; STATIC] {
    let ahead = frame.vector(standing.axis);
    let at = frame.pose(standing.center, frame.heading);
    let (width, length) = (2.0 * standing.half_width, 2.0 * standing.half_length);
    [at[0], at[1], ahead.x as f32, ahead.y as f32, width as f32, length as f32, 0.0, 0.0, 0.0, 1.0]
}

/// Returns the rows of a lane: `[points, 12]`.
fn lane_rows(lane: &LanePiece, frame: &AxleFrame, lights: &[Option<LightState>]) -> Vec<f32> {
    let light = lane.light.and_then(|light| lights.get(light).copied().flatten());
    let colour = light_flags(light);
    let row = |k: usize| {
        let p = lane.points[k];
        let [x, y, ..] = frame.pose(p, frame.heading);
        let next = lane.points.get(k + 1).map_or([0.0; 2], |next| frame.way(next - p));
        let [left, right] = [0, 1].map(|side| frame.way(lane.sides[side][k] - p));
        let own = [x, y, next[0], next[1], left[0], left[1], right[0], right[1]];
        own.into_iter().chain(colour)
    };
    (0..lane.points.len()).flat_map(row).collect()
}

/// Returns whether a light is green, yellow, red, or its state unknown.
fn light_flags(light: Option<LightState>) -> [f32; 4] {
    use LightState::{ArrowCaution, ArrowGo, ArrowStop, Caution, FlashingCaution, FlashingStop, Go, Stop};
    match light {
        Some(Go | ArrowGo) => [1.0, 0.0, 0.0, 0.0],
        Some(Caution | ArrowCaution | FlashingCaution) => [0.0, 1.0, 0.0, 0.0],
        Some(Stop | ArrowStop | FlashingStop) => [0.0, 0.0, 1.0, 0.0],
        Some(LightState::Unknown) | None => [0.0, 0.0, 0.0, 1.0],
    }
}
