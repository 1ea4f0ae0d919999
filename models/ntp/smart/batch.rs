//! Batches of whole scenes, all steps at once.

use reactsim_nn::Noise;

use super::edges::Visibility;
use super::relation::Pose;
use super::{Agents, Edges, InputError, MapTokens, Scene, SmartConfig};

/// Concatenated scenes with all pairs that attend to each other. A node is an agent at a step; nodes are
/// numbered by scene, then agent, then step.
#[derive(Clone, Debug)]
pub struct Batch {
    /// Maps of all scenes.
    pub(super) map: MapTokens,
    /// Pairs of map tokens. May be replaced before the batch is used.
    pub map_edges: Edges,
    pub(super) agents: Agents,
    /// Agent of each node.
    pub(super) agent: Vec<usize>,
    /// Class of each node.
    pub(super) class: Vec<u8>,
    /// Token of each node that led to its pose.
    pub(super) token: Vec<u32>,
    /// Distance (m) and bearing (rad) of the last displacement of each node.
    pub(super) motion: Vec<[f32; 2]>,
    /// Pairs of steps of the same agent.
    pub over_time: Edges,
    /// Pairs of map tokens and nodes.
    pub from_map: Edges,
    /// Pairs of nodes at the same step.
    pub among_agents: Edges,
}

impl Batch {
    /// Builds a batch. With active `noise`, steps of agents are randomly hidden from later ones, as in
    /// training.
    ///
    /// # Errors
    /// [`InputError`] if the network cannot read a scene.
    pub fn new<'a>(
        config: &SmartConfig,
        scenes: impl IntoIterator<Item = &'a Scene>,
        noise: &mut Noise,
    ) -> Result<Self, InputError> {
        let mut batch = Self {
            map: MapTokens::default(),
            map_edges: Edges::new(3),
            agents: Agents::default(),
            agent: Vec::new(),
            class: Vec::new(),
            token: Vec::new(),
            motion: Vec::new(),
            over_time: Edges::new(4),
            from_map: Edges::new(3),
            among_agents: Edges::new(3),
        };
        for scene in scenes {
            scene.check(config)?;
            batch.add(config, scene, noise);
        }
        Ok(batch)
    }

    fn add(&mut self, config: &SmartConfig, scene: &Scene, noise: &mut Noise) {
        let (first_piece, first_node, first_agent) = (self.map.len(), self.nodes(), self.agents.len());
        let count = scene.steps.len();
        self.map_edges.append(&Edges::among_map(config, &scene.map), first_piece, first_piece);
        self.map.append(&scene.map);
        for agent in 0..scene.agents.len() {
            for (t, step) in scene.steps.iter().enumerate() {
                self.agent.push(first_agent + agent);
                self.class.push(scene.agents.class[agent]);
                self.token.push(step.token[agent]);
                let own = Pose::new(step.position[agent], step.heading[agent]);
                // The first step has no motion. After an invalid step, motion counts from that step's
                // stated position, as published.
                self.motion.push(if t == 0 {
                    [0.0; 2]
                } else {
                    own.motion(scene.steps[t - 1].position[agent])
                });
            }
        }
        self.agents.append(&scene.agents);
        let mut is_visible = |valid: &bool| *valid && !noise.happens(config.hist_drop_prob);
        let visible: Visibility =
            scene.steps.iter().map(|s| s.valid.iter().map(&mut is_visible).collect()).collect();
        let node = |agent: usize, step: usize| agent * count + step;
        let own = Edges::over_time(config, &scene.steps, &visible, 0..count, node, node);
        let (mut seen, mut others) = (Edges::new(3), Edges::new(3));
        let map = Pose::all(&scene.map.position, &scene.map.orientation);
        for (t, step) in scene.steps.iter().enumerate() {
            seen.add_from_map(config, &map, step, |agent| node(agent, t));
            others.among_agents(config, step, |agent| node(agent, t));
        }
        self.over_time.append(&own, first_node, first_node);
        self.from_map.append(&seen, first_piece, first_node);
        self.among_agents.append(&others, first_node, first_node);
    }

    /// Returns the number of nodes.
    pub fn nodes(&self) -> usize {
        self.agent.len()
    }

    /// Distance (m) and bearing (rad) of the last displacement of each node.
    pub fn motion(&self) -> &[[f32; 2]] {
        &self.motion
    }
}
