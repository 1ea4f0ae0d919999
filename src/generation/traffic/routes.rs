//! Where drivers want to go, and which way leads there.

use super::network::{Beside, Network};
use crate::generation::Draw;
use crate::rollout::Stream;

/// What a lane change costs in the choice of a way, seconds; on short ways more, since there is little room for it.
const CHANGE: f64 = 4.0;
/// That much more per change on a way of one metre, falling with its length, seconds times metres.
const CHANGE_ON_SHORT: f64 = 300.0;
/// How often drivers go straight on and turn, where they can, as weights: about as often as not, since recordings are made where they turn.
const STRAIGHT: f64 = 0.28;
const TURN: f64 = 0.36;
/// Ways that turn by more than this are turns, radians.
const IS_TURN: f64 = 0.5;

/// The ends of the map that drivers go to, and the cost of the way there from every way.
pub(super) struct Routes {
    /// Per goal, per way: seconds from its beginning to the goal; infinite where no way leads there.
    costs: Vec<Vec<f64>>,
    /// Per way without successors: its goal.
    goal_of: Vec<Option<usize>>,
}

impl Routes {
    /// Finds all goals: ways that end at the border; those beside one another are one goal.
    pub(super) fn new(network: &Network) -> Self {
        let n = network.ways.len();
        let mut goal_of: Vec<Option<usize>> = vec![None; n];
        let mut goals: Vec<Vec<usize>> = Vec::new();
        for w in (0..n).filter(|&w| network.ways[w].next.is_empty()) {
            if goal_of[w].is_some() {
                continue;
            }
            let mut group = vec![w];
            let mut k = 0;
            while k < group.len() {
                let way = &network.ways[group[k]];
                for beside in way.left.iter().chain(&way.right) {
                    if network.ways[beside.way].next.is_empty() && !group.contains(&beside.way) {
                        group.push(beside.way);
                    }
                }
                k += 1;
            }
            group.iter().for_each(|&w| goal_of[w] = Some(goals.len()));
            goals.push(group);
        }
        let costs = goals.iter().map(|group| costs_to(network, group)).collect();
        Self { costs, goal_of }
    }

    /// Seconds from the beginning of a way to a goal.
    pub(super) fn cost(&self, goal: usize, way: usize) -> f64 {
        self.costs[goal][way]
    }

    /// The way to go on with at the end of `way`, if any leads to the goal.
    pub(super) fn next(&self, network: &Network, goal: usize, way: usize) -> Option<usize> {
        let cost = |w: &usize| self.costs[goal][*w];
        let next = network.ways[way].next.iter().copied().min_by(|a, b| cost(a).total_cmp(&cost(b)))?;
        self.costs[goal][next].is_finite().then_some(next)
    }

    /// A goal that can be reached from the end of this very way, without a lane change on it: where the straightest way on leads.
    pub(super) fn draw_goal_from(&self, network: &Network, way: usize, rng: &mut Stream) -> Option<usize> {
        let bend = |w: &usize| network.ways[*w].tightest();
        let next = network.ways[way].next.iter().copied().min_by(|a, b| bend(a).total_cmp(&bend(b)))?;
        self.draw_goal(network, next, rng)
    }

    /// A goal for somebody who comes in at `way`: where a walk over the ways ends, with the usual shares of turns.
    pub(super) fn draw_goal(&self, network: &Network, way: usize, rng: &mut Stream) -> Option<usize> {
        let mut at = way;
        for _ in 0..200 {
            let mut here: Vec<usize> = vec![at];
            // Where one comes in, any lane of the road may be taken.
            let beside = |b: &Beside| b.way;
            here.extend(network.ways[at].left.iter().chain(&network.ways[at].right).map(beside));
            let next: Vec<usize> = here.iter().flat_map(|&w| &network.ways[w].next).copied().collect();
            if next.is_empty() {
                return self.goal_of[at];
            }
            let turns = |w: &usize| network.ways[*w].turn.abs() > IS_TURN;
            let (turning, straight): (Vec<usize>, Vec<usize>) = next.iter().partition(|w| turns(w));
            // Few turn into driveways: slow roads have little traffic.
            let calm = |w: usize| {
                let beyond =
                    network.ways[w].next.first().map_or(network.ways[w].limit, |&n| network.ways[n].limit);
                (beyond / network.ways[at].limit).min(1.0)
            };
            let weights: Vec<f64> = next
                .iter()
                .map(|&w| {
                    if turns(&w) {
                        TURN * calm(w) * calm(w) / turning.len() as f64
                    } else {
                        STRAIGHT / straight.len() as f64
                    }
                })
                .collect();
            at = next[rng.weighted(&weights)];
        }
        None
    }
}

/// Seconds from the beginning of every way to the nearest of these.
fn costs_to(network: &Network, group: &[usize]) -> Vec<f64> {
    let mut cost = vec![f64::INFINITY; network.ways.len()];
    for &w in group {
        cost[w] = network.ways[w].length / network.ways[w].limit;
    }
    // As many rounds as there are ways are enough; a few are needed.
    for _ in 0..network.ways.len() {
        let mut changed = false;
        for (w, way) in network.ways.iter().enumerate() {
            let along = way.length / way.limit;
            let ahead = way.next.iter().map(|&n| cost[n] + along).fold(f64::INFINITY, f64::min);
            let change = CHANGE + CHANGE_ON_SHORT / way.length.max(1.0);
            let aside =
                way.left.iter().chain(&way.right).map(|b| cost[b.way] + change).fold(f64::INFINITY, f64::min);
            let best = ahead.min(aside);
            if best < cost[w] - 1e-9 {
                cost[w] = best;
                changed = true;
            }
        }
        if !changed {
            break;
        }
    }
    cost
}
