//! Who sees whom: the four kinds of pairs, in the order and with the limits of the published networks.

use super::relation::Pose;
use super::{MapTokens, SmartConfig, Step};

/// Pairs of a source and a target with the scalars of their relation.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Edges {
    /// Who is seen.
    pub sources: Vec<u32>,
    /// Who sees.
    pub targets: Vec<u32>,
    /// `width` scalars for each pair: distance in m, bearing of the source, heading of the source minus that of the target; for an
    /// agent's own steps also how many steps the source is later (a negative number).
    pub relations: Vec<f32>,
    /// How many scalars a relation has: 3, or 4 for an agent's own steps.
    pub width: usize,
}

/// Agents' steps that are kept from later ones, or all that are valid: by step, then agent.
pub(super) type Shown = Vec<Vec<bool>>;

impl Edges {
    /// No pairs yet, with so many scalars each.
    pub fn new(width: usize) -> Self {
        Self { width, ..Self::default() }
    }

    /// How many pairs there are.
    pub fn len(&self) -> usize {
        self.sources.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.sources.is_empty()
    }

    fn push(&mut self, source: usize, target: usize, relation: &[f32]) {
        self.sources.push(source as u32);
        self.targets.push(target as u32);
        self.relations.extend_from_slice(relation);
    }

    /// Adds pairs whose numbers count from these.
    pub(super) fn append(&mut self, other: &Self, first_source: usize, first_target: usize) {
        self.sources.extend(other.sources.iter().map(|s| s + first_source as u32));
        self.targets.extend(other.targets.iter().map(|t| t + first_target as u32));
        self.relations.extend_from_slice(&other.relations);
    }

    /// Pairs of different map tokens. With more sources than the limit the first by number count.
    pub fn among_map(config: &SmartConfig, map: &MapTokens) -> Self {
        let poses = Pose::all(&map.position, &map.orientation);
        let mut edges = Self::new(3);
        for (target, own) in poses.iter().enumerate() {
            let near =
                poses.iter().enumerate().filter(|(s, p)| *s != target && own.near(p, config.pl2pl_radius));
            for (source, pose) in near.take(config.max_neighbours_pl2pl) {
                edges.push(source, target, &own.sees(pose));
            }
        }
        edges
    }

    /// Earlier steps of an agent (sources) and those at `targets`, not further apart than the window. Nodes are numbered by the two
    /// functions of agent and step. `shown` says which steps count at all.
    pub(super) fn over_time(
        config: &SmartConfig,
        steps: &[Step],
        shown: &Shown,
        targets: std::ops::Range<usize>,
        source: impl Fn(usize, usize) -> usize,
        target: impl Fn(usize, usize) -> usize,
    ) -> Self {
        let mut edges = Self::new(4);
        let agents = steps.first().map_or(0, |s| s.position.len());
        let poses: Vec<Vec<Pose>> = steps.iter().map(|s| Pose::all(&s.position, &s.heading)).collect();
        for agent in 0..agents {
            for now in targets.clone().filter(|t| shown[*t][agent]) {
                let own = &poses[now][agent];
                for then in (now.saturating_sub(config.window())..now).filter(|t| shown[*t][agent]) {
                    let [distance, bearing, heading] = own.sees(&poses[then][agent]);
                    let steps = then as f32 - now as f32;
                    edges.push(source(agent, then), target(agent, now), &[distance, bearing, heading, steps]);
                }
            }
        }
        edges
    }

    /// Map tokens (sources) that agents see at one step. The limit is on agents that see one map token: the first by number, those that
    /// are not valid counted too.
    pub(super) fn add_from_map(
        &mut self,
        config: &SmartConfig,
        map: &[Pose],
        step: &Step,
        node: impl Fn(usize) -> usize,
    ) {
        let mut seen_by = vec![0; map.len()];
        for (agent, own) in Pose::all(&step.position, &step.heading).iter().enumerate() {
            for (source, pose) in map.iter().enumerate() {
                if own.near(pose, config.pl2a_radius) {
                    seen_by[source] += 1;
                    if step.valid[agent] && seen_by[source] <= config.max_agents_per_map_token_pl2a {
                        self.push(source, node(agent), &own.sees(pose));
                    }
                }
            }
        }
    }

    /// Other agents (sources) that agents see at one step. With more than the limit the first by number, those that are not valid
    /// counted too.
    pub(super) fn among_agents(&mut self, config: &SmartConfig, step: &Step, node: impl Fn(usize) -> usize) {
        let poses = Pose::all(&step.position, &step.heading);
        for (target, own) in poses.iter().enumerate().filter(|(t, _)| step.valid[*t]) {
            let near =
                poses.iter().enumerate().filter(|(s, p)| *s != target && own.near(p, config.a2a_radius));
            for (source, pose) in near.take(config.max_neighbours_a2a).filter(|(s, _)| step.valid[*s]) {
                self.push(node(source), node(target), &own.sees(pose));
            }
        }
    }
}
