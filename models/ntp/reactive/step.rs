//! What the network is fed of one scene at one step: agents, and whom and what each attends to.

use reactsim::geometry::{Vec2, into_frame};
use reactsim::scene::{Agent, AgentState, Frame, LightState};

use super::super::tokens::Class;
use super::body::Body;
use super::choice::Chooser;
use super::config::Config;
use super::corridor;
use super::lane::Way;
use super::links::{Links, Nearest, put};
use super::pair::{PAIR, relate};
use super::place::TO_PLACE;
use super::places::Places;

/// Numbers that describe how an earlier step of an agent stands to its present one.
pub(crate) const PAST: usize = 7;

/// A node of an earlier step: whose, where, when.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Earlier {
    /// Slot of the agent.
    pub slot: usize,
    /// Where it was.
    pub position: Vec2,
    /// Where it looked.
    pub ahead: Vec2,
    /// Frame of the step.
    pub frame: usize,
}

/// One scene at one step, ready for the network. Nodes are the agents that are present, in the order of their slots.
#[derive(Clone, Debug, Default)]
pub(crate) struct Step {
    /// The frame.
    pub frame: usize,
    /// Per node the slot of its agent.
    pub slots: Vec<usize>,
    /// Per node its class.
    pub classes: Vec<Class>,
    /// `[n, BODY]`.
    pub bodies: Vec<f32>,
    /// To the agent's own earlier nodes: indices into the list that was given.
    pub past: Links,
    /// To places: indices into the places of the scene.
    pub places: Links,
    /// To other agents: indices of nodes of this step.
    pub agents: Links,
    /// The nodes as later steps see them.
    pub here: Vec<Earlier>,
}

/// A scene up to a frame, as a simulator may see it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct View<'a> {
    /// The agents; slot 0 is the AV.
    pub agents: &'a [Agent],
    /// Their realised frames (frames after `now` are not looked at).
    pub tracks: &'a [Vec<Frame>],
    /// The frame of the step.
    pub now: usize,
    /// The AV one frame later, where the protocol shows it.
    pub av_next: Option<AgentState>,
    /// Per light what it shows at `now`.
    pub lights: &'a [Option<LightState>],
}

impl View<'_> {
    /// An agent as it is described among these places, and the ways on, its own course first; `None` where it is absent or of no class.
    pub(crate) fn body(&self, slot: usize, places: &Places) -> Option<(Body, Vec<Way>)> {
        let next = if slot == 0 { self.av_next } else { None };
        Body::at(&self.agents[slot], &self.tracks[slot], self.now, slot == 0, next, places)
    }
}

impl Step {
    /// What the network is fed. `earlier` are the nodes of earlier steps that may be attended to, oldest first.
    pub(crate) fn of(view: &View<'_>, places: &Places, earlier: &[Earlier], config: &Config) -> Self {
        let mut step = Self { frame: view.now, ..Self::default() };
        let (mut bodies, mut ways) = (Vec::new(), Vec::new());
        for slot in 0..view.agents.len() {
            let Some((body, own_ways)) = view.body(slot, places) else { continue };
            step.slots.push(slot);
            step.classes.push(body.class);
            ways.push(own_ways);
            step.here.push(Earlier { slot, position: body.position, ahead: body.ahead, frame: view.now });
            bodies.push(body);
        }
        for (i, ways) in ways.iter().enumerate() {
            let mut features = bodies[i].features;
            let out = &mut features[Body::corridor()];
            corridor::describe(&bodies, i, ways, &places.all, view.lights, out);
            step.bodies.extend_from_slice(&features);
        }
        step.link_past(earlier, view.now, config);
        step.link_places(&bodies, places, view.lights, config);
        step.link_agents(&bodies, config);
        step
    }

    fn link_past(&mut self, earlier: &[Earlier], now: usize, config: &Config) {
        let mut found = Vec::new();
        for node in &self.here {
            found.clear();
            let own = earlier.iter().enumerate().rev().filter(|(_, e)| e.slot == node.slot);
            found.extend(own.take(config.past).map(|(i, _)| i));
            self.past.push(config.past, PAST, &found, |i, out| {
                let then = &earlier[i];
                let steps = (now - then.frame) as f64 / 5.0;
                let at = into_frame(node.ahead, then.position - node.position) / steps;
                let toward = into_frame(node.ahead, then.ahead);
                put(
                    out,
                    [
                        at.x / 5.0,
                        at.y / 2.0,
                        1.0 - toward.x,
                        toward.y,
                        steps / 4.0,
                        1.0 / (1.0 + at.norm()),
                        1.0,
                    ],
                );
            });
        }
    }

    fn link_places(
        &mut self,
        bodies: &[Body],
        places: &Places,
        lights: &[Option<LightState>],
        config: &Config,
    ) {
        let mut chooser = Chooser::new(config);
        let mut chosen = Vec::new();
        for body in bodies {
            chooser.choose(body, &places.all, &mut chosen);
            self.places.push(config.places(), TO_PLACE, &chosen, |i, out| {
                let place = &places.all[i];
                let light = place.light.and_then(|l| lights.get(l).copied().flatten());
                place.relate(body, light, out);
            });
        }
    }

    fn link_agents(&mut self, bodies: &[Body], config: &Config) {
        let mut nearest = Nearest::new(config.agents);
        let mut found = Vec::new();
        for (i, body) in bodies.iter().enumerate() {
            nearest.clear();
            for (j, other) in bodies.iter().enumerate() {
                // The AV goes first whatever its distance: it is what this network must not miss.
                let d = (other.position - body.position).norm();
                if i != j && other.is_av {
                    nearest.offer(-1.0, j);
                } else if i != j && d < config.agent_radius {
                    nearest.offer(d, j);
                }
            }
            found.clear();
            found.extend(nearest.found());
            self.agents.push(config.agents, PAIR, &found, |j, out| relate(body, &bodies[j], out));
        }
    }
}
