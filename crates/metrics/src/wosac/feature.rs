//! The features whose distributions the challenge compares.

use reactsim_scene::named_enum;

named_enum! {
    name;

    /// A feature of the challenge, in the order of the fields of the official messages. Names are those of
    /// the fields, without the suffix `_likelihood`.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
    pub enum Feature {
        /// Speed in three dimensions, m/s.
        LinearSpeed = "linear_speed",
        /// Change of the speed, m/s².
        LinearAcceleration = "linear_acceleration",
        /// Yaw rate, rad/s.
        AngularSpeed = "angular_speed",
        /// Change of the yaw rate, rad/s².
        AngularAcceleration = "angular_acceleration",
        /// Signed distance to the nearest other box, metres; negative if they overlap.
        DistanceToNearestObject = "distance_to_nearest_object",
        /// Whether the object overlaps another one at any step.
        CollisionIndication = "collision_indication",
        /// Time to collision with the object ahead, seconds.
        TimeToCollision = "time_to_collision",
        /// Signed distance of the outermost box corner to the nearest road edge, metres; positive off the
        /// road.
        DistanceToRoadEdge = "distance_to_road_edge",
        /// Whether the object is off the road at any step.
        OffroadIndication = "offroad_indication",
        /// Whether the object passes a red light at any step.
        TrafficLightViolation = "traffic_light_violation",
    }
}

/// A group of features with an aggregate of its own in the leaderboard.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bucket {
    /// Speeds and accelerations.
    Kinematic,
    /// Distances to objects, collisions, time to collision.
    Interactive,
    /// Distances to road edges, leaving the road, traffic lights.
    MapBased,
}

impl Feature {
    /// Number of features.
    pub const COUNT: usize = Self::ALL.len();

    /// Returns the name of the likelihood in the official messages.
    pub const fn likelihood_name(self) -> &'static str {
        match self {
            Self::LinearSpeed => "linear_speed_likelihood",
            Self::LinearAcceleration => "linear_acceleration_likelihood",
            Self::AngularSpeed => "angular_speed_likelihood",
            Self::AngularAcceleration => "angular_acceleration_likelihood",
            Self::DistanceToNearestObject => "distance_to_nearest_object_likelihood",
            Self::CollisionIndication => "collision_indication_likelihood",
            Self::TimeToCollision => "time_to_collision_likelihood",
            Self::DistanceToRoadEdge => "distance_to_road_edge_likelihood",
            Self::OffroadIndication => "offroad_indication_likelihood",
            Self::TrafficLightViolation => "traffic_light_violation_likelihood",
        }
    }

    /// Returns the bucket of the feature.
    pub const fn bucket(self) -> Bucket {
        match self {
            Self::LinearSpeed | Self::LinearAcceleration | Self::AngularSpeed | Self::AngularAcceleration => {
                Bucket::Kinematic
            }
            Self::DistanceToNearestObject | Self::CollisionIndication | Self::TimeToCollision => {
                Bucket::Interactive
            }
            Self::DistanceToRoadEdge | Self::OffroadIndication | Self::TrafficLightViolation => {
                Bucket::MapBased
            }
        }
    }
}
