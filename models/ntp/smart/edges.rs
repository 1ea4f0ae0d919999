//! Attention pairs: the four kinds, in the order and with the limits of the published networks.

use reactsim_geometry::math;

use super::relation::Pose;
use super::{MapTokens, SmartConfig, Step};

/// Pairs of a source and a target, with the scalars of their relations.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Edges {
    /// Source of each pair, which is attended to.
    pub sources: Vec<u32>,
    /// Target of each pair, which attends.
    pub targets: Vec<u32>,
    /// `width` scalars per pair: distance in m, bearing of the source, heading of the source minus that
    /// of the target; for an agent's own steps also the step of the source minus that of the target,
    /// which is negative.
    pub relations: Vec<f32>,
    /// Number of scalars per relation: 3, or 4 for an agent's own steps.
    pub width: usize,
}

/// Whether each agent's step is visible to later ones, by step, then agent.
pub(super) type Visibility = Vec<Vec<bool>>;

impl Edges {
    /// Builds an empty list with `width` scalars per pair.
    pub fn new(width: usize) -> Self {
        Self { width, ..Self::default() }
    }

    /// Returns the number of pairs.
    pub fn len(&self) -> usize {
        self.sources.len()
    }

    /// Returns whether the list is empty.
    pub fn is_empty(&self) -> bool {
        self.sources.is_empty()
    }

    fn push(&mut self, source: usize, target: usize, relation: &[f32]) {
        self.sources.push(source as u32);
        self.targets.push(target as u32);
        self.relations.extend_from_slice(relation);
    }

    /// Appends pairs, with offsets added to their source and target indices.
    pub(super) fn append(&mut self, other: &Self, first_source: usize, first_target: usize) {
        self.sources.extend(other.sources.iter().map(|s| s + first_source as u32));
        self.targets.extend(other.targets.iter().map(|t| t + first_target as u32));
        self.relations.extend_from_slice(&other.relations);
    }

    /// Returns the pairs of different map tokens within the radius. Beyond the limit per target, sources
    /// with the lowest indices are kept.
    pub fn among_map(config: &SmartConfig, map: &MapTokens) -> Self {
        let poses = Pose::all(&map.position, &map.orientation);
        let mut edges = Self::new(3);
        for (target, own) in poses.iter().enumerate() {
            let near = poses
                .iter()
                .enumerate()
                .filter(|(s, p)| *s != target && own.is_within(p, config.pl2pl_radius));
            let near = near.take(config.max_neighbours_pl2pl);
            let mut seen: Vec<_> = near.map(|(source, pose)| (source, own.relation_to(pose))).collect();
            keep_nearest(&mut seen, config.nearest_pl2pl, 0.0);
            seen.iter().for_each(|(source, relation)| edges.push(*source, target, relation));
        }
        edges
    }

    /// Returns the pairs of an agent's steps at `targets` with its earlier steps (sources) within the
    /// window. `source` and `target` map agent and step to node indices. `visible` marks the steps that
    /// count at all.
    pub(super) fn over_time(
        config: &SmartConfig,
        steps: &[Step],
        visible: &Visibility,
        targets: std::ops::Range<usize>,
        source: impl Fn(usize, usize) -> usize,
        target: impl Fn(usize, usize) -> usize,
    ) -> Self {
        let mut edges = Self::new(4);
        let agents = steps.first().map_or(0, |s| s.position.len());
        let poses: Vec<Vec<Pose>> = steps.iter().map(|s| Pose::all(&s.position, &s.heading)).collect();
        for agent in 0..agents {
            for now in targets.clone().filter(|t| visible[*t][agent]) {
                let own = &poses[now][agent];
                for then in (now.saturating_sub(config.window())..now).filter(|t| visible[*t][agent]) {
                    let [distance, bearing, heading] = own.relation_to(&poses[then][agent]);
                    let steps = then as f32 - now as f32;
                    edges.push(source(agent, then), target(agent, now), &[distance, bearing, heading, steps]);
                }
            }
        }
        edges
    }

    /// Returns the pairs of map tokens and agents at one step.
    pub(super) fn from_map(config: &SmartConfig, map: &MapTokens, step: &Step) -> Self {
        let mut edges = Self::new(3);
        edges.add_from_map(config, &Pose::all(&map.position, &map.orientation), step, |agent| agent);
        edges
    }

    /// Adds the map tokens (sources) that agents see at one step. The number of agents that see one map
    /// token is limited to the first by index; invalid ones count towards the limit.
    pub(super) fn add_from_map(
        &mut self,
        config: &SmartConfig,
        map: &[Pose],
        step: &Step,
        node: impl Fn(usize) -> usize,
    ) {
        let mut seen_by = vec![0; map.len()];
        for (agent, own) in Pose::all(&step.position, &step.heading).iter().enumerate() {
            let mut seen = Vec::new();
            for (source, pose) in map.iter().enumerate() {
                if own.is_within(pose, config.pl2a_radius) {
                    seen_by[source] += 1;
                    if step.valid[agent] && seen_by[source] <= config.max_agents_per_map_token_pl2a {
                        seen.push((source, own.relation_to(pose)));
                    }
                }
            }
            keep_nearest(&mut seen, config.nearest_pl2a, config.ahead_pl2a);
            seen.iter().for_each(|(source, relation)| self.push(*source, node(agent), relation));
        }
    }

    /// Adds the other agents (sources) that agents see at one step. Their number is limited to the first
    /// by index; invalid ones count towards the limit.
    pub(super) fn among_agents(&mut self, config: &SmartConfig, step: &Step, node: impl Fn(usize) -> usize) {
        let poses = Pose::all(&step.position, &step.heading);
        for (target, own) in poses.iter().enumerate().filter(|(t, _)| step.valid[*t]) {
            let near =
                poses.iter().enumerate().filter(|(s, p)| *s != target && own.is_within(p, config.a2a_radius));
            let valid = near.take(config.max_neighbours_a2a).filter(|(s, _)| step.valid[*s]);
            let mut seen: Vec<_> = valid.map(|(source, pose)| (source, own.relation_to(pose))).collect();
            keep_nearest(&mut seen, config.nearest_a2a, 0.0);
            seen.iter().for_each(|(source, relation)| self.push(node(*source), node(target), relation));
        }
    }
}

/// Removes all but the `most` nearest sources, or none if `most` is 0; the order stays. Distances count from
/// a point `ahead` metres ahead of the agent. Of equally distant ones the first are kept.
fn keep_nearest(seen: &mut Vec<(usize, [f32; 3])>, most: usize, ahead: f32) {
    if most == 0 || seen.len() <= most {
        return;
    }
    // The square of the distance, less that of `ahead`.
    let distance = |[distance, bearing, _]: [f32; 3]| match ahead {
        0.0 => distance,
        _ => distance * (distance - 2.0 * ahead * math::cos(f64::from(bearing)) as f32),
    };
    let mut ranked: Vec<_> = seen.iter().map(|(source, relation)| (distance(*relation), *source)).collect();
    ranked.sort_by(|(near, a), (far, b)| near.total_cmp(far).then(a.cmp(b)));
    let mut kept: Vec<usize> = ranked[..most].iter().map(|(_, source)| *source).collect();
    kept.sort_unstable();
    seen.retain(|(source, _)| kept.binary_search(source).is_ok());
}
