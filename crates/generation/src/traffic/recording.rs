//! Recording of traffic once it has settled.

use rand_chacha::rand_core::SeedableRng;
use reactsim_rollout::Stream;
use reactsim_scene::{Agent, AgentKind, AgentState, Frame, Length, LightState};

use super::driver::Manner;
use super::parked;
use super::vehicle::Vehicle;
use super::world::World;
use crate::{Draw, Layout};

/// Minimum time for which traffic settles before it is recorded, s.
const WARM_UP_MIN: f64 = 30.0;
/// Maximum time for which traffic settles before it is recorded, s.
const WARM_UP_MAX: f64 = 50.0;

/// Recorded traffic at 10 Hz.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Recording {
    /// Number of frames.
    pub length: Length,
    /// Agents that were present at some frame, with all frames each.
    pub agents: Vec<(Agent, Vec<Frame>)>,
    /// Height of each agent at each frame, metres, `None` where it is absent; empty lists on maps without
    /// heights.
    pub heights: Vec<Vec<Option<f64>>>,
    /// Light states at each frame, per signal plan of the layout.
    pub lights: Vec<Vec<LightState>>,
    /// Indices into `agents` of the drivers who can be the AV: present at every frame, not parked, no
    /// red-light runners.
    pub drivers: Vec<usize>,
    /// Indices into `agents` of drivers who ran a red light while they were recorded.
    pub offenders: Vec<usize>,
}

/// Simulates traffic on a map until it has settled, then records it.
///
/// `density` multiplies the flows of the entries, at which vehicles arrive as long as it is recorded. The
/// result depends only on the arguments; that of a longer future begins with that of a shorter one.
pub fn record(layout: &Layout, density: f64, manner: Manner, length: Length, rng: &mut Stream) -> Recording {
    let frames = length.frames();
    let warm_up = rng.uniform(WARM_UP_MIN, WARM_UP_MAX);
    let parked = parked::park(&[layout.parking.as_slice(), &layout.yards].concat(), rng);
    let mut world = World::new(layout, density, manner, Stream::from_rng(rng));
    while world.time < warm_up {
        world.step();
    }
    let mut recorder = Recorder::default();
    recorder.recording.length = length;
    recorder.recording.lights = vec![Vec::with_capacity(frames); layout.signals.len()];
    for frame in 0..frames {
        recorder.record_frame(&world, frame);
        world.step();
    }
    let standing = parked.into_iter().map(|(agent, state)| (agent, vec![Some(state); frames]));
    let parked_heights = if layout.map.heights.is_empty() { Vec::new() } else { vec![Some(0.0); frames] };
    recorder.finish(standing, &parked_heights)
}

#[derive(Default)]
struct Recorder {
    /// Kind and number of each recorded agent.
    ids: Vec<(AgentKind, u64)>,
    recording: Recording,
}

impl Recorder {
    fn record_frame(&mut self, world: &World<'_>, frame: usize) {
        for (list, &state) in self.recording.lights.iter_mut().zip(&world.lights) {
            list.push(state);
        }
        for v in &world.vehicles {
            let bicycle = world.network.lanes[v.path[0]].bicycles;
            let kind = if bicycle { AgentKind::Cyclist } else { AgentKind::Vehicle };
            let height = world.network.lanes[v.path[0]].height_at(v.s);
            let size = (v.body.length, v.body.width);
            let at = self.store((kind, v.id.into()), size, frame, (state(v), height));
            if v.passed_red && frame > 0 {
                self.recording.offenders.push(at);
            }
        }
        for p in world.encounters.crowd.people() {
            let state = AgentState {
                x: p.position.x,
                y: p.position.y,
                heading: p.heading,
                vx: p.velocity.x,
                vy: p.velocity.y,
            };
            let size = (p.length, p.width);
            self.store((AgentKind::Pedestrian, p.id), size, frame, (state, p.height));
        }
    }

    fn store(
        &mut self,
        id: (AgentKind, u64),
        (length, width): (f64, f64),
        frame: usize,
        (state, height): (AgentState, Option<f64>),
    ) -> usize {
        let frames = self.recording.length.frames();
        let at = self.ids.iter().position(|&known| known == id).unwrap_or_else(|| {
            let agent = Agent { id: format!("{}-{}", id.0, id.1), kind: id.0, length, width };
            self.ids.push(id);
            self.recording.agents.push((agent, vec![None; frames]));
            self.recording.heights.push(Vec::new());
            self.ids.len() - 1
        });
        self.recording.agents[at].1[frame] = Some(state);
        if height.is_some() {
            self.recording.heights[at].resize(frames, None);
            self.recording.heights[at][frame] = height;
        }
        at
    }

    /// Completes the recording with the parked vehicles and the heights of each.
    fn finish(
        mut self,
        standing: impl Iterator<Item = (Agent, Vec<Frame>)>,
        heights: &[Option<f64>],
    ) -> Recording {
        let agents = self.recording.agents.iter().enumerate();
        self.recording.drivers = agents
            .filter(|(_, (agent, track))| {
                agent.kind == AgentKind::Vehicle && track.iter().all(Option::is_some)
            })
            .map(|(i, _)| i)
            .collect();
        self.recording.agents.extend(standing);
        self.recording.heights.resize(self.recording.agents.len(), heights.to_vec());
        self.recording
    }
}

fn state(v: &Vehicle) -> AgentState {
    let (pose, velocity) = (v.pose(), v.velocity());
    AgentState {
        x: pose.position.x,
        y: pose.position.y,
        heading: pose.heading,
        vx: velocity.x,
        vy: velocity.y,
    }
}
