//! What is kept of traffic: 91 frames once it has settled.

use super::vehicle::Vehicle;
use super::world::World;
use crate::generation::{Draw, Layout};
use crate::rollout::Stream;
use crate::scene::{Agent, AgentKind, AgentState, FRAMES, Frame, LightState};

/// How long traffic settles before it is recorded, s.
const WARM_UP: (f64, f64) = (30.0, 50.0);

/// What is recorded of traffic: 91 frames at 10 Hz.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Recording {
    /// Everybody who was there at some frame, with 91 frames each.
    pub agents: Vec<(Agent, Vec<Frame>)>,
    /// Per signal plan of the layout, what it showed at each frame.
    pub lights: Vec<Vec<LightState>>,
    /// Indices into `agents` of the drivers who may be taken for the AV: there at every frame, not parked.
    pub drivers: Vec<usize>,
}

/// Lets traffic run on a map until it has settled, then records it.
///
/// `density` is the multiple of the entries' flows. The result depends on the arguments only.
pub fn record(layout: &Layout, density: f64, rng: &mut Stream) -> Recording {
    let warm_up = rng.uniform(WARM_UP.0, WARM_UP.1);
    let mut world = World::new(layout, density, rng.clone());
    while world.time < warm_up {
        world.step();
    }
    let mut recorder = Recorder::default();
    recorder.recording.lights = vec![Vec::with_capacity(FRAMES); layout.signals.len()];
    for frame in 0..FRAMES {
        recorder.note(&world, frame);
        world.step();
    }
    recorder.finish()
}

#[derive(Default)]
struct Recorder {
    ids: Vec<u32>,
    recording: Recording,
}

impl Recorder {
    fn note(&mut self, world: &World<'_>, frame: usize) {
        for (list, &state) in self.recording.lights.iter_mut().zip(world.lights()) {
            list.push(state);
        }
        for v in &world.vehicles {
            let at = self.ids.iter().position(|&id| id == v.id).unwrap_or_else(|| {
                self.ids.push(v.id);
                let kind = if world.network.ways[v.path[0]].bicycles {
                    AgentKind::Cyclist
                } else {
                    AgentKind::Vehicle
                };
                let agent =
                    Agent { id: format!("v{}", v.id), kind, length: v.body.length, width: v.body.width };
                self.recording.agents.push((agent, vec![None; FRAMES]));
                self.ids.len() - 1
            });
            self.recording.agents[at].1[frame] = Some(state(v));
        }
    }

    fn finish(mut self) -> Recording {
        let agents = self.recording.agents.iter().enumerate();
        self.recording.drivers = agents
            .filter(|(_, (agent, track))| {
                agent.kind == AgentKind::Vehicle && track.iter().all(Option::is_some)
            })
            .map(|(i, _)| i)
            .collect();
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
