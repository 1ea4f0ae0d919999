//! Values of metrics, reasons why a metric is undefined, and labels of substituted inputs.

use reactsim_scene::named_enum;

named_enum! {
    id;

    /// The eight metrics of nuPlan's closed-loop score: the four multipliers, then the four weighted metrics.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
    pub enum PlannerMetric {
        /// Collisions that are the fault of ego: 1, 0.5 or 0.
        Collisions = "av-at-fault-collisions",
        /// Corners of ego on drivable ground: 1 or 0.
        DrivableArea = "av-drivable-area",
        /// Motion against the driving direction: 1, 0.5 or 0.
        DrivingDirection = "av-driving-direction",
        /// Whether `Progress` is at least 0.2: 1 or 0.
        MakingProgress = "av-making-progress",
        /// Distance along the route of the expert, relative to the expert: 0 to 1.
        Progress = "av-expert-progress",
        /// Time to collision above its bound: 1 or 0.
        TimeToCollision = "av-time-to-collision",
        /// Excess over the speed limit: 0 to 1.
        SpeedLimit = "av-speed-limit",
        /// Accelerations, jerks and yaw rates within their bounds: 1 or 0.
        Comfort = "av-comfort",
    }
}

impl PlannerMetric {
    /// Returns the name in nuPlan's devkit.
    pub const fn nuplan_name(self) -> &'static str {
        match self {
            Self::Collisions => "no_ego_at_fault_collisions",
            Self::DrivableArea => "drivable_area_compliance",
            Self::DrivingDirection => "driving_direction_compliance",
            Self::MakingProgress => "ego_is_making_progress",
            Self::Progress => "ego_progress_along_expert_route",
            Self::TimeToCollision => "time_to_collision_within_bound",
            Self::SpeedLimit => "speed_limit_compliance",
            Self::Comfort => "ego_is_comfortable",
        }
    }
}

/// The value of a metric in one scenario.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MetricValue {
    /// The value, 0 to 1; more is better.
    Defined(f64),
    /// The scenario lacks an input of the metric.
    Undefined(UndefinedReason),
}

impl MetricValue {
    /// Returns the value, if it is defined.
    pub const fn value(self) -> Option<f64> {
        match self {
            Self::Defined(value) => Some(value),
            Self::Undefined(_) => None,
        }
    }

    /// Returns 1 if `passes`, else 0.
    pub(super) const fn pass(passes: bool) -> Self {
        Self::Defined(if passes { 1.0 } else { 0.0 })
    }
}

named_enum! {
    id;

    /// The reason why a metric is undefined.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
    pub enum UndefinedReason {
        /// The map has no lanes.
        NoLanes = "no-lanes",
        /// The map has neither drivable polygons nor road edges.
        NoDrivableArea = "no-drivable-area",
        /// A sample with a lane has no speed limit.
        UnknownSpeedLimits = "unknown-speed-limits",
        /// Ego had a lateral contact, and the map has no lanes that decide whose fault it is.
        LateralContactWithoutLanes = "lateral-contact-without-lanes",
        /// The log of the expert has gaps.
        IncompleteExpert = "incomplete-expert",
        /// The expert drove in no lane.
        ExpertWithoutLanes = "expert-without-lanes",
    }
}

named_enum! {
    name;

    /// A substitute for an input that the scenario lacks. Values with different labels are not comparable.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
    pub enum Label {
        /// Areas of lanes are corridors around their centre lines.
        LanesCorridors = "lanes: corridors",
        /// Lanes overlap: ego may be in several lanes at once.
        LanesOverlapping = "lanes: overlapping",
        /// Drivable ground is the left side of road edges.
        DrivableRoadEdges = "drivable: road-edges",
        /// Intersections have no outlines: ego is in one while its lane is a connector.
        IntersectionConnectors = "intersection: connectors",
        /// Intersections are unknown: objects at the side count for the time to collision only if ego is not
        /// in a common lane.
        IntersectionUnknown = "intersection: unknown",
        /// Driving direction and route follow the best match among overlapping lanes.
        DirectionOverlapping = "direction: overlapping",
        /// Roadblocks are groups of lanes side by side, cut where one of them is.
        RouteNeighbourGroups = "route: neighbour-groups",
        /// Only objects ahead count for the time to collision.
        TtcAheadOnly = "ttc: ahead-only",
        /// Some speed limits are unknown.
        SpeedLimitsUnknown = "speed-limits: unknown",
        /// Some speeds of objects are displacements divided by the time step.
        SpeedsDisplacement = "speeds: displacement",
        /// The axles of ego divide its length in the same shares as in nuPlan's vehicle.
        VehicleScaled = "vehicle: scaled",
        /// Velocities, accelerations and yaw rates of ego are differences of its track.
        EgoDifferences = "ego: differences",
        /// The scenario has several levels; lanes and drivable ground of all levels count.
        LevelsIgnored = "levels: ignored",
    }
}
