//! The filters of step 3, in the order of evaluation: cheap ones first, avoidability last.

pub(super) mod comfort;
mod contact;
mod feasibility;
mod pressure;
mod rules_of_road;

use super::CandidateFilter;

/// All filters. Every candidate goes through all of them, so that all figures are known, except for the
/// expensive ones.
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
