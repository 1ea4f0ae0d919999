//! The features of an evaluated object at every step.

use reactsim_scene::FUTURE;

use super::edge_cells::EdgeCells;
use super::feature::Feature;
use super::footprint::RoundedBox;
use super::kinematics::kinematics;
use super::objects::Motion;
use super::road_edges::RoadEdges;
use super::traffic_lights::TrafficLights;
use super::{nearest_object, road_edges, time_to_collision};

/// The features of an evaluated object at the steps 1 to 80 (entries 0 to 79), in the log or in a rollout.
#[derive(Clone, Debug)]
pub struct StepFeatures {
    /// Speed, acceleration, yaw rate and yaw acceleration.
    kinematics: [[f32; FUTURE]; 4],
    distance_to_nearest_object: [f32; FUTURE],
    time_to_collision: [f32; FUTURE],
    distance_to_road_edge: [f32; FUTURE],
    traffic_light_violation: [bool; FUTURE],
}

/// A part of the computation, for measurements.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Validation of the rollouts and alignment with the log.
    Alignment,
    /// Speeds and accelerations.
    Kinematics,
    /// Distance to the nearest object.
    NearestObject,
    /// Time to collision.
    TimeToCollision,
    /// Distance to the road edge.
    RoadEdge,
    /// Traffic-light violations.
    TrafficLights,
    /// Histograms, displacements and likelihoods.
    Likelihoods,
}

impl Stage {
    /// All stages.
    pub const ALL: [Self; 7] = [
        Self::Alignment,
        Self::Kinematics,
        Self::NearestObject,
        Self::TimeToCollision,
        Self::RoadEdge,
        Self::TrafficLights,
        Self::Likelihoods,
    ];
}

/// The parts of a scenario that features refer to.
pub(super) struct Surroundings {
    /// Boxes of all simulated objects.
    pub(super) boxes: Vec<RoundedBox>,
    pub(super) edges: RoadEdges,
    pub(super) lights: TrafficLights,
}

impl StepFeatures {
    /// Computes the features of an evaluated object and reports every stage when it ends.
    pub(super) fn of(
        motion: &Motion,
        surroundings: &Surroundings,
        cells: &mut EdgeCells,
        object: usize,
        observer: &mut dyn FnMut(Stage),
    ) -> Self {
        let kinematics = kinematics(motion, object);
        observer(Stage::Kinematics);
        let distance_to_nearest_object = nearest_object::distances(motion, &surroundings.boxes, object);
        observer(Stage::NearestObject);
        let time_to_collision = time_to_collision::times(motion, object);
        observer(Stage::TimeToCollision);
        let distance_to_road_edge = road_edges::distances(motion, &surroundings.edges, cells, object);
        observer(Stage::RoadEdge);
        let traffic_light_violation = surroundings.lights.violations(motion, object);
        observer(Stage::TrafficLights);
        Self {
            kinematics,
            distance_to_nearest_object,
            time_to_collision,
            distance_to_road_edge,
            traffic_light_violation,
        }
    }

    /// Returns the values of a feature, in its unit; NaN where it is unknown. `None` for features that are
    /// events.
    pub fn values(&self, feature: Feature) -> Option<&[f32; FUTURE]> {
        match feature {
            Feature::LinearSpeed => Some(&self.kinematics[0]),
            Feature::LinearAcceleration => Some(&self.kinematics[1]),
            Feature::AngularSpeed => Some(&self.kinematics[2]),
            Feature::AngularAcceleration => Some(&self.kinematics[3]),
            Feature::DistanceToNearestObject => Some(&self.distance_to_nearest_object),
            Feature::TimeToCollision => Some(&self.time_to_collision),
            Feature::DistanceToRoadEdge => Some(&self.distance_to_road_edge),
            Feature::CollisionIndication | Feature::OffroadIndication | Feature::TrafficLightViolation => {
                None
            }
        }
    }

    /// Returns whether an event occurs at a step (counted from 0); `false` for features that are no events.
    pub fn has_event(&self, feature: Feature, step: usize) -> bool {
        match feature {
            Feature::CollisionIndication => self.distance_to_nearest_object[step] < 0.0,
            Feature::OffroadIndication => self.distance_to_road_edge[step] > 0.0,
            Feature::TrafficLightViolation => self.traffic_light_violation[step],
            _ => false,
        }
    }
}
