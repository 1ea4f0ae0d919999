//! The features whose distributions the challenge compares.

/// A feature of the challenge, in the order of the fields of the official messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Feature {
    /// Speed in three dimensions, m/s.
    LinearSpeed,
    /// Change of the speed, m/s².
    LinearAcceleration,
    /// Yaw rate, rad/s.
    AngularSpeed,
    /// Change of the yaw rate, rad/s².
    AngularAcceleration,
    /// Signed distance to the nearest other box, metres; negative if they overlap.
    DistanceToNearestObject,
    /// Whether the object overlaps another one at any step.
    CollisionIndication,
    /// Time to collision with the object ahead, seconds.
    TimeToCollision,
    /// Signed distance of the outermost box corner to the nearest road edge, metres; positive off the road.
    DistanceToRoadEdge,
    /// Whether the object is off the road at any step.
    OffroadIndication,
    /// Whether the object passes a red light at any step.
    TrafficLightViolation,
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
    pub const COUNT: usize = 10;

    /// All features.
    pub const ALL: [Self; Self::COUNT] = [
        Self::LinearSpeed,
        Self::LinearAcceleration,
        Self::AngularSpeed,
        Self::AngularAcceleration,
        Self::DistanceToNearestObject,
        Self::CollisionIndication,
        Self::TimeToCollision,
        Self::DistanceToRoadEdge,
        Self::OffroadIndication,
        Self::TrafficLightViolation,
    ];

    /// Returns the name in the official messages, without the suffix `_likelihood`.
    pub const fn name(self) -> &'static str {
        match self {
            Self::LinearSpeed => "linear_speed",
            Self::LinearAcceleration => "linear_acceleration",
            Self::AngularSpeed => "angular_speed",
            Self::AngularAcceleration => "angular_acceleration",
            Self::DistanceToNearestObject => "distance_to_nearest_object",
            Self::CollisionIndication => "collision_indication",
            Self::TimeToCollision => "time_to_collision",
            Self::DistanceToRoadEdge => "distance_to_road_edge",
            Self::OffroadIndication => "offroad_indication",
            Self::TrafficLightViolation => "traffic_light_violation",
        }
    }

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
