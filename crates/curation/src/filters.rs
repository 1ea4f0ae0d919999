//! The filters of step 3, in the order of evaluation: cheap ones first, avoidability last.

pub(super) mod comfort;
mod contact;
mod feasibility;
mod pressure;
mod rules_of_road;

use super::CandidateFilter;

/// Id of the filter that is so expensive that it judges only candidates that pass all others.
pub(super) const EXPENSIVE: &str = pressure::AVOIDABLE.id;

/// All filters. Every candidate goes through all of them, so that all figures are known, except for the
/// expensive one.
pub const FILTERS: &[CandidateFilter] = &[
    feasibility::LOG_DISTANCE,
    feasibility::DRIVABLE_AREA,
    feasibility::KINEMATICS,
    feasibility::LATERAL_ACCELERATION,
    comfort::COMFORT,
    rules_of_road::WRONG_WAY,
    rules_of_road::RED_LIGHT,
    pressure::PRESSING,
    contact::EARLY_CONTACT,
    contact::ACTIVE_COLLISION,
    pressure::AVOIDABLE,
];
