//! Curation of deviated AVs: the paper's four steps from logs to a set of deviations (ReactSim-Bench,
//! "Data Collection Pipeline"), the taxonomy, and the certificates.
// Tests may call the mathematical functions of the platform: their comparisons have tolerances.
#![cfg_attr(test, allow(clippy::disallowed_methods))]

pub mod apply;
mod avoidance;
pub mod benchmark;
mod candidate;
mod candidate_file;
mod choice;
pub mod decisions;
pub mod driver;
mod filter;
mod filters;
mod ground;
pub mod outcomes;
mod partitions;
mod pipeline;
mod planner;
mod preselect;
mod quota;
mod record;
mod replay;
mod rules;
mod signals;
pub mod stats;
pub mod store;
mod taxonomy;

pub use avoidance::{AvoidanceSettings, Unavoidable, certify, certify_case};
pub use candidate::{Candidate, CandidateSource, NoProposal, Proposal};
pub use candidate_file::{CandidateFile, MAX_CANDIDATES};
pub use choice::Chooser;
pub use decisions::candidate_digest;
pub use filter::{CandidateFilter, FilterContext, FilterSettings, Trial, Verdict};
pub use filters::FILTERS;
pub use partitions::merge;
pub use pipeline::{CurationOutcome, CurationSettings, SOURCES, curate_scenario, taxonomy_of};
pub use planner::PlannerSource;
pub use preselect::{AV_ABSENT, FEW_VEHICLES, NO_APPROACH, Preselection};
pub use quota::{DIFFICULTIES, PROPORTIONS, Quota, Strictness, in_proportion};
pub use record::{
    Application, CandidateRecord, CurationProvenance, Decision, Figure, Funnel, InputFile, Offsets, Pressure,
    ReviewMark, ScenarioRecord, Taxonomy,
};
pub use rules::{LaneRoutes, Rules};
pub use taxonomy::{Conflict, classify};

pub use reactsim_scene::{Certificate, Response};

#[cfg(test)]
mod length_tests;
