//! The filters of step 3, in the order in which they are asked: what is cheap first, avoidability last.

mod comfort;
mod contact;
mod feasibility;
mod pressure;
mod rules_of_road;

use super::CandidateFilter;

/// All filters. Those that cost little are asked of every candidate, so that all their figures are known; the last one only of
/// candidates that passed the others.
pub const FILTERS: &[&dyn CandidateFilter] = &[
    &feasibility::LogDistance,
    &feasibility::DrivableArea,
    &feasibility::Kinematics,
    &comfort::Comfort,
    &rules_of_road::WrongWay,
    &rules_of_road::RedLight,
    &pressure::Pressing,
    &contact::EarlyContact,
    &contact::ActiveCollision,
    &pressure::Avoidable,
];
