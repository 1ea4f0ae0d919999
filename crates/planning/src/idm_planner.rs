//! The IDM planner of nuPlan (devkit 1.2.2, `IDMPlanner`): ego follows the centre line of the route and
//! the nearest object on it by the intelligent driver model.
//!
//! Start with [`IdmPlanner`].

use std::collections::BTreeSet;

use reactsim_geometry::{OrientedBox, direction, math};

use crate::idm_model::IdmModel;
use crate::path::{Path, baseline_states, kept_states};
use crate::planner::{Planner, PlannerInput, no_lanes, no_path, not_started};
use crate::search::{Layer, path_to};
use crate::shapes::Shape;
use crate::trajectory::{Pose, Trajectory};
use crate::{EgoShape, EgoState, PlanningError, PlanningMap, TrackedObject};

/// Speed aimed at where the lane has no limit, m/s (nuPlan devkit 1.2.2, `target_velocity`).
const FALLBACK_SPEED: f64 = 10.0;
/// Parameters of the model (nuPlan devkit 1.2.2, `min_gap_to_lead_agent`, `headway_time`, `accel_max` and
/// `decel_max`).
const MODEL: IdmModel = IdmModel { min_gap: 1.0, headway: 1.5, acceleration: 1.0, deceleration: 3.0 };
/// Number of steps of a trajectory (nuPlan devkit 1.2.2, `planned_trajectory_samples`).
const STEPS: usize = 16;
/// Interval of the states of a trajectory, seconds (nuPlan devkit 1.2.2,
/// `planned_trajectory_sample_interval`).
const INTERVAL: f64 = 0.5;
/// Distance in metres between the centres of ego and of objects below which objects are considered
/// (nuPlan devkit 1.2.2, `occupancy_map_radius`).
const RADIUS: f64 = 40.0;

/// The planner. It observes the present only, and assumes that objects stay where they are.
#[derive(Debug, Default)]
pub struct IdmPlanner {
    plan: Option<RoutePlan>,
}

/// The path and target speed, found at the first iteration and kept.
#[derive(Debug)]
struct RoutePlan {
    /// Lanes of the route.
    on_route: BTreeSet<usize>,
    /// Path of the centre of ego, which ends a state before the last lane.
    path: Path,
    /// All states of the lanes, onto which ego is projected.
    line: Path,
    /// Speed that the model aims at, m/s.
    target_speed: f64,
}

/// An object or red connector that may block the path.
#[derive(Debug)]
struct Obstacle {
    shape: Shape,
    /// Heading, radians.
    heading: f64,
    /// Speed, m/s; 0 for static objects and red connectors.
    speed: f64,
}

/// The leader, or the end of the path, as the model sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Leader {
    /// Free distance, metres.
    gap: f64,
    /// Speed along the heading of ego, m/s.
    speed: f64,
}

impl IdmPlanner {
    /// Creates a planner for one scenario.
    pub fn new() -> Self {
        Self::default()
    }
}

impl Planner for IdmPlanner {
    fn plan(&mut self, input: &PlannerInput<'_>) -> Result<Trajectory, PlanningError> {
        if self.plan.is_none() {
            if input.iteration != 0 {
                return Err(not_started(input));
            }
            self.plan = Some(RoutePlan::find(input)?);
        }
        let Some(plan) = &self.plan else { return Err(not_started(input)) };
        Ok(Trajectory::new(plan.states(input), input.ego())?)
    }
}

impl RoutePlan {
    /// Finds the path and the speed that is aimed at: the limit of the first lane, or the present speed
    /// if that is larger.
    fn find(input: &PlannerInput<'_>) -> Result<Self, PlanningError> {
        let (map, blocks) = (input.map, input.route.roadblocks());
        let on_route: BTreeSet<usize> = input.route.lanes(map).into_iter().collect();
        let start = starting_lane(input).ok_or_else(|| no_lanes(blocks.len()))?;
        let lanes = lane_sequence(map, start, blocks, &on_route);
        let states: Vec<Pose> =
            lanes.iter().flat_map(|&lane| baseline_states(&map.lane(lane).baseline)).collect();
        let no_path = || no_path(map, start);
        let path = Path::new(kept_states(&states)).ok_or_else(no_path)?;
        let line = Path::new(states).ok_or_else(no_path)?;
        let limit = map.lane(start).speed_limit.filter(|&limit| limit > 0.0).unwrap_or(FALLBACK_SPEED);
        Ok(Self { on_route, path, line, target_speed: limit.max(input.ego().speed()) })
    }

    /// Returns the planned states of the rear axle.
    fn states(&self, input: &PlannerInput<'_>) -> Vec<EgoState> {
        let (ego, shape) = (input.ego(), input.shape);
        let obstacles = self.obstacles(input);
        let (mut progress, mut speed) = (self.line.project(ego.center(shape)), ego.vx);
        let (mut footprint, mut heading) = (ego.footprint(shape), ego.heading);
        let mut states = vec![self.state(progress, speed, ego.time, shape)];
        for step in 1..=STEPS {
            let leader = self.leader(progress, (&footprint, heading), shape, &obstacles);
            let acceleration = MODEL.acceleration(speed, self.target_speed, leader.gap, leader.speed);
            progress += INTERVAL * speed;
            speed = (speed + INTERVAL * acceleration).max(0.0);
            let state = self.state(progress, speed, ego.time + INTERVAL * step as f64, shape);
            (footprint, heading) = (state.footprint(shape), state.heading);
            states.push(state);
        }
        states
    }

    /// Returns the objects near ego, and the red connectors of the route.
    fn obstacles(&self, input: &PlannerInput<'_>) -> Vec<Obstacle> {
        let center = input.ego().center(input.shape);
        let is_near =
            |object: &&TrackedObject| (object.center - center).norm() < RADIUS && object.is_finite();
        let objects = input.objects().iter().filter(is_near).map(|object| Obstacle {
            shape: Shape::Box(object.footprint()),
            heading: object.heading,
            speed: object.speed(),
        });
        let red = input.red_connectors().filter(|lane| self.on_route.contains(lane)).map(|lane| Obstacle {
            shape: Shape::Outline(input.map.lane_area(lane).outline().to_vec()),
            heading: 0.0,
            speed: 0.0,
        });
        objects.chain(red).collect()
    }

    /// Returns the obstacle nearest to the box of ego, among those that touch the box or the corridor
    /// ahead, or the end of the path. `progress`: arc length of the centre, metres; the box with its heading.
    fn leader(
        &self,
        progress: f64,
        (footprint, heading): (&OrientedBox, f64),
        shape: &EgoShape,
        obstacles: &[Obstacle],
    ) -> Leader {
        let reach = self.target_speed * STEPS as f64 * INTERVAL;
        let corridor = self.path.exact_corridor(progress, progress + reach, 0.5 * shape.width);
        let mut nearest: Option<(f64, &Obstacle)> = None;
        for obstacle in obstacles {
            let distance = obstacle.shape.distance(footprint);
            if nearest.is_some_and(|(least, _)| distance >= least) {
                continue;
            }
            if distance <= 0.0 || corridor.touches(&obstacle.shape) {
                nearest = Some((distance, obstacle));
            }
        }
        match nearest {
            Some((gap, obstacle)) => {
                Leader { gap, speed: obstacle.speed * math::cos(obstacle.heading - heading) }
            }
            None => Leader { gap: self.path.length() - progress - 0.5 * shape.length, speed: 0.0 },
        }
    }

    /// Returns the state of the rear axle whose box has its centre on the path.
    fn state(&self, progress: f64, speed: f64, time: f64, shape: &EgoShape) -> EgoState {
        let center = self.path.interpolated(progress);
        let rear_axle = center.position - direction(center.heading) * shape.rear_axle_to_center;
        EgoState { time, vx: speed, ..EgoState::standing(rear_axle, center.heading) }
    }
}

/// Returns the first lane of the first two roadblocks that contains the centre of ego, else the nearest
/// one to its box.
fn starting_lane(input: &PlannerInput<'_>) -> Option<usize> {
    let (map, footprint) = (input.map, input.ego().footprint(input.shape));
    let lanes: Vec<usize> = input
        .route
        .roadblocks()
        .iter()
        .take(2)
        .flat_map(|&block| map.lanes_of_roadblock(block))
        .copied()
        .collect();
    map.nearest_lane(&lanes, &footprint)
}

/// Returns a lane sequence from `start` with one lane per roadblock of the route, up to the last one; the
/// longest sequence that a search finds if there is none.
fn lane_sequence(map: &PlanningMap, start: usize, route: &[usize], on_route: &BTreeSet<usize>) -> Vec<usize> {
    let is_second = route.get(1) == Some(&map.lane(start).roadblock);
    let depth = route.len() - usize::from(is_second);
    let successors = |lane: usize| {
        let linked = map.lane(lane).successors.iter().copied();
        linked.filter(|next| on_route.contains(next)).collect::<Vec<_>>()
    };
    let mut layers = vec![Layer::of(start)];
    while layers.len() <= depth {
        let next = layers[layers.len() - 1].next(successors);
        if layers.len() == depth {
            let is_goal = |lane: &&usize| Some(&map.lane(**lane).roadblock) == route.last();
            if let Some(&goal) = layers[depth - 1].nodes().iter().find(is_goal) {
                return path_to(&layers, goal);
            }
        }
        if next.nodes().is_empty() {
            break;
        }
        layers.push(next);
    }
    let last = layers[layers.len() - 1].last().unwrap_or(start);
    path_to(&layers, last)
}

#[cfg(test)]
mod tests {
    use reactsim_geometry::Vec2;

    use super::*;
    use crate::fixtures::{LanePart, car, map, straight_road};
    use crate::map::LaneKind;
    use crate::planner::{History, Light, LightState, Route, Sample};

    fn plan(map: &PlanningMap, route: &[&str], sample: Sample, lights: &[Light]) -> Trajectory {
        let route = Route::new(map, route.iter().copied()).unwrap();
        let samples = [sample];
        let input = PlannerInput {
            iteration: 0,
            history: History::new(&samples).unwrap(),
            lights,
            route: &route,
            map,
            shape: &EgoShape::PACIFICA,
            seen: None,
        };
        IdmPlanner::new().plan(&input).unwrap()
    }

    fn sample(x: f64, speed: f64, objects: Vec<TrackedObject>) -> Sample {
        let ego = EgoState { vx: speed, ..EgoState::standing(Vec2::new(x, 1.75), 0.0) };
        Sample { ego, objects }
    }

    #[test]
    fn free_roads_are_driven_at_the_limit() {
        let trajectory = plan(&straight_road(Some(8.0)), &["block"], sample(5.0, 8.0, Vec::new()), &[]);
        assert_eq!(trajectory.states().len(), 17);
        assert!((trajectory.end() - 8.0).abs() < 1e-12);
        assert!((trajectory.states()[0].x - 5.0).abs() < 1e-9);
        let (first, last) = (trajectory.states()[1], trajectory.states()[16]);
        assert!((first.x - 9.0).abs() < 1e-9 && last.vx < 8.0 && 7.0 < last.vx, "{last:?}");
    }

    #[test]
    fn standing_cars_on_the_path_stop_ego() {
        let blocked = |y| {
            let objects = vec![car("a", 40.0, y, 0.0)];
            plan(&straight_road(Some(8.0)), &["block"], sample(5.0, 8.0, objects), &[])
        };
        assert!(blocked(1.75).states()[16].vx < 0.5);
        assert!(blocked(4.5).states()[16].vx > 7.0);
    }

    #[test]
    fn red_connectors_stop_ego() {
        let road = map(&[
            LanePart { x: [0.0, 50.0], successors: &["through"], ..LanePart::new("lane") },
            LanePart {
                kind: LaneKind::Connector,
                x: [50.0, 70.0],
                roadblock: "junction",
                ..LanePart::new("through")
            },
        ]);
        let light = Light { lane: 1, state: LightState::Red };
        let route = ["block", "junction"];
        let stopped = plan(&road, &route, sample(10.0, 8.0, Vec::new()), &[light]);
        assert!(stopped.states()[16].x + 4.049 < 50.0, "{:?}", stopped.states()[16]);
        let green = Light { state: LightState::Green, ..light };
        let free = plan(&road, &route, sample(10.0, 8.0, Vec::new()), &[green]);
        assert!(free.states()[16].x + 4.049 > 55.0);
    }

    #[test]
    fn the_lane_that_leads_to_the_goal_is_followed() {
        let lane = |id, bottom, x, roadblock, successors| LanePart {
            bottom,
            x,
            roadblock,
            successors,
            ..LanePart::new(id)
        };
        let road = map(&[
            lane("start", 0.0, [0.0, 20.0], "first", &["up", "ahead"]),
            lane("up", 3.5, [20.0, 40.0], "second", &[]),
            lane("ahead", 0.0, [20.0, 40.0], "second", &["goal"]),
            lane("goal", 0.0, [40.0, 90.0], "third", &[]),
        ]);
        let on_route: BTreeSet<usize> = (0..4).collect();
        assert_eq!(lane_sequence(&road, 0, &[0, 1, 2], &on_route), [0, 2, 3]);
        assert_eq!(lane_sequence(&road, 2, &[0, 1, 2], &on_route), [2, 3]);
        // Not reached: the longest sequence.
        assert_eq!(lane_sequence(&road, 1, &[0, 1, 2], &on_route), [1]);
    }
}
