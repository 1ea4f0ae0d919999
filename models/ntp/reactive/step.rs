//! Network input of one scene at one step: agents and their attention links.

use reactsim_geometry::{Vec2, into_frame};
use reactsim_nn::Links;
use reactsim_nn::perception::{BODY_FEATURES, Body, Class, Nearest, Places, SceneView, corridor, put};
use reactsim_scene::LightState;

use super::choice::{Chooser, Surroundings};
use super::config::Config;
use super::pair::{PAIR_FEATURES, relate};
use super::place_relations::{TO_PLACE_FEATURES, relate_to_agent};

/// Number of features of the relation of an agent's earlier step to its present one.
pub(crate) const PAST_FEATURES: usize = 7;

/// A node of an earlier step.
#[derive(Clone, Copy, Debug)]
pub(crate) struct EarlierNode {
    /// Slot of the agent.
    pub slot: usize,
    /// Position, metres.
    pub position: Vec2,
    /// Unit vector of its heading.
    pub ahead: Vec2,
    /// Frame of the step.
    pub frame: usize,
}

/// Graph of one scene at one step as network input. Nodes are the agents that are present, in slot order.
#[derive(Clone, Debug, Default)]
pub(crate) struct StepGraph {
    /// Frame of the step.
    pub frame: usize,
    /// Slot of each node's agent.
    pub slots: Vec<usize>,
    /// Class of each node.
    pub classes: Vec<Class>,
    /// Features, `[n, BODY_FEATURES]`.
    pub bodies: Vec<f32>,
    /// Links to the agent's own earlier nodes: indices into the list that was given.
    pub past: Links,
    /// Links to places: indices into the places of the scene.
    pub places: Links,
    /// Links to other agents: indices of nodes of this step, then of the agents that stand.
    pub agents: Links,
    /// The nodes as later steps attend to them.
    pub here: Vec<EarlierNode>,
}

impl StepGraph {
    /// Builds the network input. `earlier` holds the nodes of earlier steps that may be attended to,
    /// oldest first.
    pub(crate) fn of(
        view: &SceneView<'_>,
        places: &Places,
        earlier: &[EarlierNode],
        config: &Config,
    ) -> Self {
        let around = &mut Surroundings { places, chooser: &mut Chooser::new(config) };
        Self::around(&[], view, around, earlier, config).0
    }

    /// Builds the network input, as [`Self::of`], with agents that stand: these are no nodes, but others
    /// attend to them. Also returns the bodies of the nodes.
    pub(crate) fn around(
        standing: &[(usize, Body)],
        view: &SceneView<'_>,
        around: &mut Surroundings<'_>,
        earlier: &[EarlierNode],
        config: &Config,
    ) -> (Self, Vec<Body>) {
        let places = around.places;
        let now = view.frame();
        let mut step = Self { frame: now, ..Self::default() };
        let (mut bodies, mut paths) = (Vec::new(), Vec::new());
        let moves = |slot: &usize| standing.iter().all(|(other, _)| other != slot);
        for slot in (0..view.agents.len()).filter(moves) {
            let Some((body, own_paths)) = view.body(slot, places) else { continue };
            step.slots.push(slot);
            step.classes.push(body.class);
            paths.push(own_paths);
            step.here.push(EarlierNode { slot, position: body.position, ahead: body.ahead, frame: now });
            bodies.push(body);
        }
        let nodes = bodies.len();
        step.bodies.reserve_exact(nodes * BODY_FEATURES);
        step.past = Links::with_capacity(nodes * config.past, PAST_FEATURES);
        step.places = Links::with_capacity(nodes * config.places(), TO_PLACE_FEATURES);
        step.agents = Links::with_capacity(nodes * config.agents, PAIR_FEATURES);
        bodies.extend(standing.iter().map(|(_, body)| *body));
        for (i, paths) in paths.iter().enumerate() {
            let mut features = bodies[i].features;
            let out = &mut features[Body::corridor_features()];
            corridor::describe(&bodies, i, paths, &places.all, view, out);
            step.bodies.extend_from_slice(&features);
        }
        step.link_past(earlier, now, config);
        step.link_places(&bodies[..nodes], around, view.lights, config);
        step.link_agents(&bodies, view, config);
        bodies.truncate(nodes);
        (step, bodies)
    }

    fn link_past(&mut self, earlier: &[EarlierNode], now: usize, config: &Config) {
        let mut found = Vec::new();
        for node in &self.here {
            found.clear();
            let own = earlier.iter().enumerate().rev().filter(|(_, e)| e.slot == node.slot);
            found.extend(own.take(config.past).map(|(i, _)| i));
            self.past.push(config.past, PAST_FEATURES, &found, |i, out| {
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
        around: &mut Surroundings<'_>,
        lights: &[Option<LightState>],
        config: &Config,
    ) {
        for (&slot, body) in self.slots.iter().zip(bodies) {
            let chosen = around.chooser.choose(slot, body, around.places);
            self.places.push(config.places(), TO_PLACE_FEATURES, chosen, |i, out| {
                let place = &around.places.all[i];
                let light = place.light.and_then(|l| lights.get(l).copied().flatten());
                relate_to_agent(place, body, light, out);
            });
        }
    }

    fn link_agents(&mut self, bodies: &[Body], view: &SceneView<'_>, config: &Config) {
        let mut nearest = Nearest::new(config.agents);
        let mut found = Vec::new();
        for (i, body) in bodies.iter().enumerate().take(self.slots.len()) {
            nearest.clear();
            for (j, other) in bodies.iter().enumerate().filter(|(_, other)| !view.are_apart(body, other)) {
                // The AV ranks first at any distance: the network must always see it.
                let d = (other.position - body.position).norm();
                if i != j && other.is_av {
                    nearest.offer(-1.0, j);
                } else if i != j && d < config.agent_radius {
                    nearest.offer(d, j);
                }
            }
            found.clear();
            found.extend(nearest.found());
            self.agents.push(config.agents, PAIR_FEATURES, &found, |j, out| relate(body, &bodies[j], out));
        }
    }
}
