//! Destinations of drivers, and the routes to them.

use reactsim_rollout::Stream;

use super::network::{AdjacentLane, Network};
use crate::Draw;

/// Cost of a lane change in route choice, seconds; higher on short lanes, which leave little room for it.
const CHANGE_COST: f64 = 4.0;
/// Additional cost per lane change on a lane of one metre, inversely proportional to its length, seconds
/// times metres.
const SHORT_LANE_COST: f64 = 300.0;
/// Weight of going straight on where drivers have a choice. Drivers turn about as often as not, since
/// recordings are made where they turn.
const STRAIGHT_WEIGHT: f64 = 0.28;
/// Weight of turning where drivers have a choice.
const TURN_WEIGHT: f64 = 0.36;
/// Heading change of a lane, radians, above which it is a turn.
const TURN_ANGLE: f64 = 0.5;

/// Goals at the ends of the map, and the cost of the route to them from every lane.
pub(super) struct Routes {
    /// Per goal and lane: seconds from the beginning of the lane to the goal; infinite without a route.
    costs: Vec<Vec<f64>>,
    /// Goal of each lane without successors.
    goal_of: Vec<Option<usize>>,
}

impl Routes {
    /// Finds all goals: lanes that end at the border of the map; adjacent ones form one goal.
    pub(super) fn new(network: &Network) -> Self {
        let n = network.lanes.len();
        let mut goal_of: Vec<Option<usize>> = vec![None; n];
        let mut goals: Vec<Vec<usize>> = Vec::new();
        for index in (0..n).filter(|&index| network.lanes[index].next.is_empty()) {
            if goal_of[index].is_some() {
                continue;
            }
            let mut group = vec![index];
            let mut k = 0;
            while k < group.len() {
                let lane = &network.lanes[group[k]];
                for beside in lane.left.iter().chain(&lane.right) {
                    if network.lanes[beside.lane].next.is_empty() && !group.contains(&beside.lane) {
                        group.push(beside.lane);
                    }
                }
                k += 1;
            }
            group.iter().for_each(|&index| goal_of[index] = Some(goals.len()));
            goals.push(group);
        }
        let costs = goals.iter().map(|group| costs_to(network, group)).collect();
        Self { costs, goal_of }
    }

    /// Returns the travel time from the beginning of a lane to a goal, seconds.
    pub(super) fn cost(&self, goal: usize, lane: usize) -> f64 {
        self.costs[goal][lane]
    }

    /// Returns the next lane at the end of `lane`, if one leads to the goal.
    pub(super) fn next(&self, network: &Network, goal: usize, lane: usize) -> Option<usize> {
        let cost = |index: &usize| self.costs[goal][*index];
        let next = network.lanes[lane].next.iter().copied().min_by(|a, b| cost(a).total_cmp(&cost(b)))?;
        self.costs[goal][next].is_finite().then_some(next)
    }

    /// Draws a goal that can be reached from the end of this lane without a lane change on it, along the
    /// straightest successor.
    pub(super) fn draw_goal_from(&self, network: &Network, lane: usize, rng: &mut Stream) -> Option<usize> {
        let bend = |index: &usize| network.lanes[*index].max_curvature;
        let next = network.lanes[lane].next.iter().copied().min_by(|a, b| bend(a).total_cmp(&bend(b)))?;
        self.draw_goal(network, next, rng)
    }

    /// Draws a goal for a vehicle that enters at `lane`: the end of a random walk over the lanes, with the
    /// usual shares of turns.
    pub(super) fn draw_goal(&self, network: &Network, lane: usize, rng: &mut Stream) -> Option<usize> {
        let mut at = lane;
        for _ in 0..200 {
            let mut here: Vec<usize> = vec![at];
            // On entry, any lane of the road may be taken.
            let beside = |b: &AdjacentLane| b.lane;
            here.extend(network.lanes[at].left.iter().chain(&network.lanes[at].right).map(beside));
            let next: Vec<usize> =
                here.iter().flat_map(|&index| &network.lanes[index].next).copied().collect();
            if next.is_empty() {
                return self.goal_of[at];
            }
            let turns = |index: &usize| network.lanes[*index].turn.abs() > TURN_ANGLE;
            let (turning, straight): (Vec<usize>, Vec<usize>) = next.iter().partition(|index| turns(index));
            // Few drivers turn into driveways: slow roads have little traffic.
            let calm = |index: usize| {
                let beyond = network.lanes[index]
                    .next
                    .first()
                    .map_or(network.lanes[index].limit, |&n| network.lanes[n].limit);
                (beyond / network.lanes[at].limit).min(1.0)
            };
            let weights: Vec<f64> = next
                .iter()
                .map(|&index| {
                    if turns(&index) {
                        TURN_WEIGHT * calm(index) * calm(index) / turning.len() as f64
                    } else {
                        STRAIGHT_WEIGHT / straight.len() as f64
                    }
                })
                .collect();
            at = next[rng.weighted(&weights)];
        }
        None
    }
}

/// Returns the travel time in seconds from the beginning of every lane to the nearest lane of the group.
fn costs_to(network: &Network, group: &[usize]) -> Vec<f64> {
    let mut cost = vec![f64::INFINITY; network.lanes.len()];
    for &index in group {
        cost[index] = network.lanes[index].length / network.lanes[index].limit;
    }
    // As many rounds as there are lanes always suffice; usually a few do.
    for _ in 0..network.lanes.len() {
        let mut changed = false;
        for (index, lane) in network.lanes.iter().enumerate() {
            let along = lane.length / lane.limit;
            let ahead = lane.next.iter().map(|&n| cost[n] + along).fold(f64::INFINITY, f64::min);
            let change = CHANGE_COST + SHORT_LANE_COST / lane.length.max(1.0);
            let aside = lane
                .left
                .iter()
                .chain(&lane.right)
                .map(|b| cost[b.lane] + change)
                .fold(f64::INFINITY, f64::min);
            let best = ahead.min(aside);
            if best < cost[index] - 1e-9 {
                cost[index] = best;
                changed = true;
            }
        }
        if !changed {
            break;
        }
    }
    cost
}
