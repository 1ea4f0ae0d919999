//! The closed-loop metrics of nuPlan (devkit 1.2.2), its score, and labels for replaced inputs.
//!
//! Start with [`History`] and [`judge`]. Each metric has a file; its result has the value and the events or
//! series that explain it.

mod center_lanes;
mod collisions;
pub(crate) mod comfort;
mod context;
mod corner_lanes;
mod drivable_area;
mod driven_lanes;
mod driving_direction;
mod history;
mod matched_lanes;
mod progress;
mod sample;
mod savitzky_golay;
mod score;
mod scores;
mod smoothed_comfort;
mod speed_limit;
mod time_to_collision;
mod value;

pub use center_lanes::center_lanes;
pub use collisions::{AtFaultCounts, Collisions, ContactClass, FirstContact};
pub use comfort::{Comfort, ComfortQuantity};
pub use corner_lanes::{Corner, CornerLanes, corner_lanes, in_common_lane};
pub use drivable_area::{DrivableAreaCompliance, OffRoadCorner};
pub use driving_direction::DrivingDirection;
pub use history::{History, MIN_SAMPLES, MissingInputs};
pub use progress::ExpertProgress;
pub(crate) use progress::passed_lanes;
pub use sample::{Reach, SampleJudge, SampleScores};
pub use savitzky_golay::{PreparedFilter, SavitzkyGolay};
pub use score::{ClosedLoopScore, MetricRole};
pub use scores::{PlannerScores, judge};
pub(crate) use smoothed_comfort::SmoothedComfort;
pub use speed_limit::SpeedLimitCompliance;
pub use time_to_collision::{ShortTtc, TimeToCollision};
pub use value::{Label, MetricValue, PlannerMetric, UndefinedReason};
