//! Searches among lanes and roadblocks: breadth-first search by layers, with the results of searches that
//! visit nodes again.
//!
//! The searches of nuPlan and tuplan_garage enter a node once per path that leads to it, and keep the
//! last parent of each node and depth. Layers without repetitions give the same paths if they remember
//! the orders of first and last visits.

use std::collections::{BTreeMap, VecDeque};

/// The nodes at one depth of a search.
#[derive(Debug, Default)]
pub(crate) struct Layer {
    by_first_visit: Vec<usize>,
    by_last_visit: Vec<usize>,
    /// Parent of each node, of its last visit.
    parents: BTreeMap<usize, usize>,
}

impl Layer {
    /// Returns the first layer.
    pub(crate) fn of(start: usize) -> Self {
        Self { by_first_visit: vec![start], by_last_visit: vec![start], parents: BTreeMap::new() }
    }

    /// Returns the nodes, in the order of their first visits.
    pub(crate) fn nodes(&self) -> &[usize] {
        &self.by_first_visit
    }

    /// Returns the node that is visited last.
    pub(crate) fn last(&self) -> Option<usize> {
        self.by_last_visit.last().copied()
    }

    /// Returns the next layer.
    pub(crate) fn next<N: IntoIterator<Item = usize>>(&self, neighbors: impl Fn(usize) -> N) -> Self {
        let mut next = Self::default();
        for &node in &self.by_first_visit {
            for neighbor in neighbors(node) {
                if !next.by_first_visit.contains(&neighbor) {
                    next.by_first_visit.push(neighbor);
                }
            }
        }
        for &node in &self.by_last_visit {
            for neighbor in neighbors(node) {
                next.by_last_visit.retain(|other| *other != neighbor);
                next.by_last_visit.push(neighbor);
                next.parents.insert(neighbor, node);
            }
        }
        next
    }
}

/// Length in metres of the lanes between two lanes up to which the first one leads to the second one.
const MAX_BETWEEN: f64 = 30.0;

/// Returns the lanes to which a lane leads, directly or through [`MAX_BETWEEN`] metres of other lanes, each
/// with the lanes between in driving order: the fewest, the first ones among equals.
pub(crate) fn led_to<'a>(
    lane: usize,
    successors: impl Fn(usize) -> &'a [usize],
    length: impl Fn(usize) -> f64,
) -> BTreeMap<usize, Vec<usize>> {
    let mut found: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    let mut open: VecDeque<(usize, Vec<usize>, f64)> = VecDeque::from([(lane, Vec::new(), 0.0)]);
    while let Some((from, between, way)) = open.pop_front() {
        for &next in successors(from) {
            if found.contains_key(&next) {
                continue;
            }
            found.insert(next, between.clone());
            let way = way + length(next);
            if way <= MAX_BETWEEN {
                let between = between.iter().copied().chain([next]).collect();
                open.push_back((next, between, way));
            }
        }
    }
    found
}

/// Returns the nodes from the first layer to `node` in the last one.
pub(crate) fn path_to(layers: &[Layer], node: usize) -> Vec<usize> {
    let mut path = vec![node];
    let mut current = node;
    for layer in layers.iter().rev() {
        let Some(&parent) = layer.parents.get(&current) else { break };
        path.push(parent);
        current = parent;
    }
    path.reverse();
    path
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_parent_of_a_node_is_kept() {
        // 0 leads to 1 and 2, and both lead to 3.
        let neighbors = |node: usize| [vec![1, 2], vec![3], vec![3], Vec::new()][node].clone();
        let mut layers = vec![Layer::of(0)];
        for depth in 0..2 {
            layers.push(layers[depth].next(neighbors));
        }
        assert_eq!(layers[2].nodes(), [3]);
        assert_eq!(path_to(&layers, 3), [0, 2, 3]);
        assert!(layers[2].next(neighbors).last().is_none());
    }
}
