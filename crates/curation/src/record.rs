//! The records of a curation: one per candidate, grouped by scenario.

use reactsim_geometry::Vec2;
use reactsim_scene::{Deviation, Difficulty, named_enum};

use super::{Candidate, Certificate};

/// Result of one scenario that passed step 1.
#[derive(Clone, Debug, PartialEq)]
pub struct ScenarioRecord {
    /// Id.
    pub scenario_id: String,
    /// Digest of the scenario.
    pub scenario_digest: String,
    /// World coordinates of the scenario frame's origin, metres.
    pub origin: Vec2,
    /// The candidates in the order of their streams.
    pub candidates: Vec<CandidateRecord>,
    /// Scene that the review page draws (JSON); `None` if it was left out.
    pub scene: Option<String>,
}

impl ScenarioRecord {
    /// Returns the chosen candidate, if any.
    pub fn chosen(&self) -> Option<&CandidateRecord> {
        self.candidates.iter().find(|c| c.chosen)
    }
}

/// One candidate with its results.
#[derive(Clone, Debug, PartialEq)]
pub struct CandidateRecord {
    /// The candidate.
    pub candidate: Candidate,
    /// Seed of the curation.
    pub seed: u64,
    /// The category and the cues that determined it.
    pub taxonomy: Taxonomy,
    /// Pressure on others under log replay.
    pub pressure: Pressure,
    /// Distances from the log.
    pub offsets: Offsets,
    /// Results of the filters, in the order of evaluation.
    pub figures: Vec<Figure>,
    /// Id of the first filter that rejected it; `None` for survivors.
    pub rejected_by: Option<String>,
    /// Reason for the rejection in words; empty for survivors.
    pub reason: String,
    /// Quality among the survivors of the scenario; NaN for rejected candidates.
    pub score: f64,
    /// Whether it is in the set.
    pub chosen: bool,
    /// Manual decision, if any.
    pub review: Option<ReviewMark>,
    /// Responses with which the agents can avoid the conflict, if they exist and were computed.
    pub certificate: Option<Certificate>,
}

impl CandidateRecord {
    /// Returns the difficulty of avoiding the candidate; `None` without a certificate, or if its effort
    /// was not measured.
    pub fn difficulty(&self) -> Option<Difficulty> {
        self.certificate.as_ref().and_then(Certificate::difficulty)
    }
}

/// Pressure of a candidate on the vehicles around it under log replay (metrics `aav-collision`,
/// `aav-overlap`, `aav-ttc`).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Pressure {
    /// Number of vehicles that collide with the AV by their own fault.
    pub at_fault: u32,
    /// Number of vehicles that overlap the AV, whoever is at fault.
    pub overlaps: u32,
    /// Number of vehicles with a time to collision below 0.5 s.
    pub risky: u32,
}

/// Distances between a candidate and the logged AV over all steps (ReactSim-Bench, "Data Analysis").
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Offsets {
    /// Offset of the last position along the AV's current heading, metres.
    pub endpoint_longitudinal: f64,
    /// Offset of the last position to the left of the AV's current heading, metres.
    pub endpoint_lateral: f64,
    /// Mean distance to the logged AV, metres.
    pub ade: f64,
    /// Mean speed of the candidate minus that of the log, m/s.
    pub mean_speed_difference: f64,
}

/// Result of one filter for one candidate.
#[derive(Clone, Debug, PartialEq)]
pub struct Figure {
    /// Id of the filter.
    pub filter: String,
    /// The figure that decided, in the filter's unit; `None` if there is none.
    pub value: Option<f64>,
    /// Whether the candidate passed; `None` if the filter was skipped because another one had rejected
    /// the candidate.
    pub passed: Option<bool>,
}

named_enum! {
    name;

    /// Decision of a reviewer about a scenario.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, serde::Serialize, serde::Deserialize)]
    #[serde(rename_all = "lowercase")]
    pub enum Decision {
        /// The candidate belongs in the set.
        Pick = "pick",
        /// Without a candidate: none of the scenario belongs in the set. With one: this one does not; if it
        /// was chosen, no other takes its place until one is picked.
        Reject = "reject",
        /// To be reviewed again.
        Flag = "flag",
        /// Withdraws the previous decision. Occurs in files of decisions only, never in a [`ReviewMark`] of a
        /// file.
        Clear = "clear",
    }
}

/// A manual decision: reviewer, time and kind.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ReviewMark {
    /// Name of the reviewer.
    pub reviewer: String,
    /// Time of the decision, RFC 3339, UTC.
    pub at: String,
    /// The decision; never [`Decision::Clear`].
    pub decision: Decision,
}

/// Category of a deviation, with the cues that determined it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Taxonomy {
    /// The category.
    pub category: Deviation,
    /// Difference between the last heading and that of the nearest point of the logged path, degrees, 0
    /// to 180.
    pub heading_change: f64,
    /// Whether the route over the lane graph differs: another successor at a fork.
    pub other_branch: bool,
    /// Largest distance from the logged path, metres, left positive.
    pub lateral_offset: f64,
    /// Largest distance along the logged path between the AV and its logged position, metres, ahead
    /// positive.
    pub longitudinal_offset: f64,
    /// Step of the first conflict under log replay, from 1, if any: among several cues the one present
    /// at that step decides.
    pub conflict_step: Option<u32>,
}

/// Numbers of scenarios and candidates at each stage.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Funnel {
    /// Scenarios that were read.
    pub scenarios: u64,
    /// Scenarios rejected in step 1, by rule.
    pub preselection: std::collections::BTreeMap<String, u64>,
    /// Scenarios that passed step 1.
    pub preselected: u64,
    /// Candidates that were proposed.
    pub candidates: u64,
    /// Streams without a proposal, by reason.
    pub unproposed: std::collections::BTreeMap<String, u64>,
    /// Candidates by the filter that rejected them first.
    pub rejected: std::collections::BTreeMap<String, u64>,
    /// Candidates that survived all filters.
    pub survivors: u64,
    /// Scenarios with a chosen candidate.
    pub chosen: u64,
}

/// Provenance of a file of candidates, stored in its metadata.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct CurationProvenance {
    /// Version of the program.
    pub version: String,
    /// Its commit.
    pub commit: String,
    /// All settings, by name.
    pub settings: std::collections::BTreeMap<String, String>,
    /// Input files with their digests.
    pub inputs: Vec<InputFile>,
    /// Numbers of scenarios and candidates at each stage.
    pub funnel: Funnel,
    /// Error messages of scenarios that could not be read.
    pub failures: Vec<String>,
    /// Whether the curation was interrupted: the file then holds only what was finished by that time.
    pub interrupted: bool,
    /// Manual decisions applied since, in order of application. Program, settings and inputs above are
    /// those of the curation itself.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub applied: Vec<Application>,
}

/// One application of manual decisions to a file.
#[derive(Clone, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Application {
    /// Version of the program that applied them.
    pub version: String,
    /// Its commit.
    pub commit: String,
    /// The file of candidates that they were applied to.
    pub file: InputFile,
    /// The files of decisions.
    pub reviews: Vec<InputFile>,
    /// Whether picks of candidates rejected by a filter were accepted.
    pub allow_rejected: bool,
}

/// An input of a curation.
#[derive(Clone, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct InputFile {
    /// File name without folders.
    pub name: String,
    /// BLAKE3 of the content.
    pub digest: String,
}
