//! Deviated AVs: the four steps of the paper that make a set of them from any logs (ReactSim-Bench, "Data Collection Pipeline"), the
//! taxonomy, and the certificates.

mod candidate;
mod certificate;
mod record;

pub mod review;
pub mod stats;
pub mod store;

pub use candidate::{CANDIDATE_STATES, Candidate, CandidateSource, NoProposal, Proposal};
pub use certificate::{Certificate, Response};
pub use record::{
    CandidateRecord, CurationProvenance, Figure, Funnel, InputFile, Offsets, Pressure, ReviewMark,
    ScenarioRecord, Taxonomy,
};
