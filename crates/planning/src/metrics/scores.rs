//! All metrics of one driven scenario.

use std::collections::BTreeSet;

use crate::map::{DrivableArea, Intersections};
use crate::{EgoState, PlanningError};

use super::collisions::collisions;
use super::comfort::{ComfortFilters, comfort};
use super::context::{Context, Lanes};
use super::drivable_area::drivable_area;
use super::driving_direction::driving_direction;
use super::progress::{expert_progress, making_progress};
use super::speed_limit::speed_limit;
use super::time_to_collision::time_to_collision;
use super::{
    ClosedLoopScore, Collisions, Comfort, CornerLanes, DrivableAreaCompliance, DrivingDirection,
    ExpertProgress, History, Label, MetricValue, PlannerMetric, SpeedLimitCompliance, TimeToCollision,
};

/// The metrics of one driven scenario.
#[derive(Clone, Debug, PartialEq)]
pub struct PlannerScores {
    /// Collisions that are the fault of ego.
    pub collisions: Collisions,
    /// Corners on drivable ground.
    pub drivable_area: DrivableAreaCompliance,
    /// Motion against the driving direction.
    pub driving_direction: DrivingDirection,
    /// Whether the progress is large enough: 1 or 0.
    pub making_progress: MetricValue,
    /// Progress along the route of the expert.
    pub progress: ExpertProgress,
    /// Time to collision.
    pub time_to_collision: TimeToCollision,
    /// Excess over the speed limit.
    pub speed_limit: SpeedLimitCompliance,
    /// Comfort.
    pub comfort: Comfort,
    /// Mean speed of the rear axle, m/s; not part of the score (nuPlan devkit 1.2.2, `ego_mean_speed`).
    pub mean_speed: f64,
    /// The score.
    pub score: ClosedLoopScore,
    /// Lanes of the centre per sample: indices into the lanes of the map.
    pub center_lanes: Vec<Vec<usize>>,
    /// Lanes of the corners per sample.
    pub corner_lanes: Vec<CornerLanes>,
    /// Whether ego is in a common lane, per sample; `None` in maps without lanes.
    pub in_common_lane: Option<Vec<bool>>,
    /// Substitutes for inputs that the scenario lacks.
    pub labels: BTreeSet<Label>,
}

impl PlannerScores {
    /// Returns the values of the eight metrics, in the order of [`PlannerMetric::ALL`].
    pub fn values(&self) -> [(PlannerMetric, MetricValue); 8] {
        PlannerMetric::ALL.map(|metric| (metric, self.value(metric)))
    }

    /// Returns the value of a metric.
    pub fn value(&self, metric: PlannerMetric) -> MetricValue {
        match metric {
            PlannerMetric::Collisions => self.collisions.value,
            PlannerMetric::DrivableArea => self.drivable_area.value,
            PlannerMetric::DrivingDirection => self.driving_direction.value,
            PlannerMetric::MakingProgress => self.making_progress,
            PlannerMetric::Progress => self.progress.value,
            PlannerMetric::TimeToCollision => self.time_to_collision.value,
            PlannerMetric::SpeedLimit => self.speed_limit.value,
            PlannerMetric::Comfort => self.comfort.value,
        }
    }
}

/// Computes all metrics of a history.
///
/// # Errors
/// [`PlanningError`] if the history has fewer than four samples, or numbers that are not finite.
pub fn judge(history: &History<'_>) -> Result<PlannerScores, PlanningError> {
    history.check()?;
    let context = Context::new(history);
    let collisions = collisions(&context);
    let progress = expert_progress(&context);
    let mut scores = PlannerScores {
        drivable_area: drivable_area(&context),
        driving_direction: driving_direction(&context),
        making_progress: making_progress(progress.value),
        time_to_collision: time_to_collision(&context, &collisions),
        speed_limit: speed_limit(&context),
        comfort: comfort(history.ego, &history.shape, &ComfortFilters::new(history.ego.len())),
        mean_speed: history.ego.iter().map(EgoState::speed).sum::<f64>() / history.ego.len() as f64,
        score: ClosedLoopScore::Complete(0.0),
        labels: BTreeSet::new(),
        collisions,
        progress,
        center_lanes: Vec::new(),
        corner_lanes: Vec::new(),
        in_common_lane: None,
    };
    scores.score = ClosedLoopScore::of(&scores.values());
    scores.labels = labels(&context, &scores);
    Lanes {
        center: scores.center_lanes,
        corners: scores.corner_lanes,
        in_common: scores.in_common_lane,
        ..
    } = context.into_lanes();
    Ok(scores)
}

/// Returns the labels of substitutes that the metrics used.
fn labels(context: &Context<'_>, scores: &PlannerScores) -> BTreeSet<Label> {
    let map = context.history.map;
    let has_lanes = context.has_lanes();
    let applies = |label: &Label| match label {
        Label::LanesCorridors => (0..map.lanes().len()).any(|lane| map.lane_area(lane).is_corridor()),
        Label::LanesOverlapping | Label::DirectionOverlapping => context.lanes().overlap,
        Label::DrivableRoadEdges => matches!(map.drivable(), DrivableArea::RoadEdges { .. }),
        Label::IntersectionConnectors => {
            has_lanes && matches!(map.intersections(), Intersections::Connectors)
        }
        Label::IntersectionUnknown => has_lanes && matches!(map.intersections(), Intersections::Unknown),
        Label::RouteNeighbourGroups => map.roadblocks().iter().any(|roadblock| roadblock.area.is_none()),
        Label::TtcAheadOnly => !has_lanes,
        Label::SpeedLimitsUnknown => !scores.speed_limit.unknown_steps.is_empty(),
        Label::SpeedsDisplacement | Label::VehicleScaled | Label::EgoDifferences | Label::LevelsIgnored => {
            false
        }
    };
    Label::ALL.into_iter().filter(applies).collect()
}
