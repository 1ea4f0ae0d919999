//! The filters of step 3, in the order in which they are asked: what is cheap first, avoidability last.

pub(super) mod comfort;
mod contact;
mod feasibility;
mod pressure;
mod rules_of_road;

use super::CandidateFilter;

/// All filters. All are asked of every candidate, so that all figures are known, but for those that are dear.
pub const FILTERS: &[&dyn CandidateFilter] = &[
    &feasibility::LogDistance,
    &feasibility::DrivableArea,
    &feasibility::Kinematics,
    &feasibility::LateralAcceleration,
    &comfort::Comfort,
    &rules_of_road::WrongWay,
    &rules_of_road::RedLight,
    &pressure::Pressing,
    &contact::EarlyContact,
    &contact::ActiveCollision,
    &pressure::Avoidable,
];
