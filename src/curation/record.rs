//! What is kept of a curation: one record per candidate, by scenario.

use super::{Candidate, Certificate};
use crate::geometry::Vec2;
use crate::scene::{Deviation, Difficulty};

/// What became of one scenario that passed step 1.
#[derive(Clone, Debug, PartialEq)]
pub struct ScenarioRecord {
    /// Id.
    pub scenario_id: String,
    /// Digest of the scenario.
    pub scenario_digest: String,
    /// The point of the world that coordinates are relative to.
    pub origin: Vec2,
    /// The candidates in the order of their streams.
    pub candidates: Vec<CandidateRecord>,
    /// What the review page draws (JSON); `None` where it was left out.
    pub scene: Option<String>,
}

impl ScenarioRecord {
    /// The chosen candidate, where there is one.
    pub fn chosen(&self) -> Option<&CandidateRecord> {
        self.candidates.iter().find(|c| c.chosen)
    }
}

/// One candidate with all that was found out about it.
#[derive(Clone, Debug, PartialEq)]
pub struct CandidateRecord {
    /// The candidate.
    pub candidate: Candidate,
    /// Seed of the curation.
    pub seed: u64,
    /// The category and what it was read from.
    pub taxonomy: Taxonomy,
    /// What it does to others under log replay.
    pub pressure: Pressure,
    /// How far it leaves the log.
    pub offsets: Offsets,
    /// What every filter said, in the order in which they were asked.
    pub figures: Vec<Figure>,
    /// Id of the first filter that rejected it; `None` for survivors.
    pub rejected_by: Option<String>,
    /// Why, in words; empty for survivors.
    pub reason: String,
    /// How good it is among the survivors of its scenario; NaN for those that did not survive.
    pub score: f64,
    /// Whether it is in the set.
    pub chosen: bool,
    /// Who decided by hand, and when (RFC 3339, UTC), where anybody did.
    pub review: Option<ReviewMark>,
    /// How the agents can avoid the conflict, where they can and it was asked.
    pub certificate: Option<Certificate>,
}

impl CandidateRecord {
    /// How difficult it is to avoid; `None` where it has no certificate, or one whose effort was not measured.
    pub fn difficulty(&self) -> Option<Difficulty> {
        self.certificate.as_ref().and_then(Certificate::difficulty)
    }
}

/// What a candidate does to the vehicles around it while these replay their log (metrics `aav-collision`, `aav-overlap`, `aav-ttc`).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Pressure {
    /// Vehicles that collide with the AV by their own fault.
    pub at_fault: u32,
    /// Vehicles that overlap the AV, whosever fault it is.
    pub overlaps: u32,
    /// Vehicles with a time to collision below 0.5 s.
    pub risky: u32,
}

/// How far a candidate leaves the logged AV over the steps 1 to 80 (ReactSim-Bench, "Data Analysis").
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Offsets {
    /// Offset of the last position along the AV's current heading, metres.
    pub endpoint_longitudinal: f64,
    /// Offset of the last position to the left of the AV's current heading, metres.
    pub endpoint_lateral: f64,
    /// Mean distance, metres.
    pub ade: f64,
    /// Mean speed of the candidate minus that of the log, m/s.
    pub mean_speed_difference: f64,
}

/// What one filter said about one candidate.
#[derive(Clone, Debug, PartialEq)]
pub struct Figure {
    /// Id of the filter.
    pub filter: String,
    /// The figure that decided, in the filter's unit; `None` where there is none.
    pub value: Option<f64>,
    /// Whether the candidate passed; `None` where the filter was not asked, because another had rejected the candidate before.
    pub passed: Option<bool>,
}

/// What a reviewer decided about a scenario.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Decision {
    /// The named candidate belongs into the set.
    Pick,
    /// Without a candidate: none of the scenario belongs into the set. With one: this one does not; where it was chosen, no other
    /// takes its place until one is picked.
    Reject,
    /// To be looked at again.
    Flag,
    /// Nothing: takes back what was decided before. Stands in journals only, never in a [`ReviewMark`] of a file.
    Clear,
}

impl Decision {
    /// The name in files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Pick => "pick",
            Self::Reject => "reject",
            Self::Flag => "flag",
            Self::Clear => "clear",
        }
    }
}

/// Who decided by hand.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ReviewMark {
    /// Name of the reviewer.
    pub reviewer: String,
    /// When, RFC 3339, UTC.
    pub at: String,
    /// What; never [`Decision::Clear`].
    pub decision: Decision,
}

/// The category of a deviation, with the cues that it was read from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Taxonomy {
    /// The category.
    pub category: Deviation,
    /// Last heading against the logged way at the nearest point of it, degrees, 0 to 180.
    pub heading_change: f64,
    /// Whether the way over the lane graph is another one: another successor at a split.
    pub other_branch: bool,
    /// Largest distance from the logged path, metres, left positive.
    pub lateral_offset: f64,
    /// Largest distance along the logged path between where the AV is and where it was in the log, metres, ahead positive.
    pub longitudinal_offset: f64,
    /// Step of the first conflict under log replay, 1 to 80, where there is one: the cue that is there at that step decides among
    /// several.
    pub conflict_step: Option<u32>,
}

/// How many fell where.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Funnel {
    /// Scenarios that were read.
    pub scenarios: u64,
    /// Scenarios that fell in step 1, by rule.
    pub preselection: std::collections::BTreeMap<String, u64>,
    /// Scenarios that passed step 1.
    pub preselected: u64,
    /// Candidates that were proposed.
    pub candidates: u64,
    /// Streams for which a source had nothing to propose, by reason.
    pub unproposed: std::collections::BTreeMap<String, u64>,
    /// Candidates by the filter that rejected them first.
    pub rejected: std::collections::BTreeMap<String, u64>,
    /// Candidates that survived all filters.
    pub survivors: u64,
    /// Scenarios with a chosen candidate.
    pub chosen: u64,
}

/// Where a file of candidates comes from; stands in its metadata.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct CurationProvenance {
    /// Version of the program.
    pub version: String,
    /// Its commit.
    pub commit: String,
    /// All settings, by name.
    pub settings: std::collections::BTreeMap<String, String>,
    /// Files with their digests.
    pub inputs: Vec<InputFile>,
    /// How many fell where.
    pub funnel: Funnel,
    /// Scenarios that could not be read, as texts.
    pub failures: Vec<String>,
    /// Whether the curation was interrupted: the file holds what was finished until then.
    pub interrupted: bool,
    /// What was decided by hand since, in the order in which it was folded in. Program, settings and inputs above are those of the
    /// curation itself.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub applied: Vec<Application>,
}

/// How decisions made by hand came into a file.
#[derive(Clone, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Application {
    /// Version of the program that folded them in.
    pub version: String,
    /// Its commit.
    pub commit: String,
    /// The file of candidates that they were folded into.
    pub file: InputFile,
    /// The journals that they stand in.
    pub reviews: Vec<InputFile>,
    /// Whether candidates could be picked that a filter had rejected.
    pub allow_rejected: bool,
}

/// An input of a curation.
#[derive(Clone, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct InputFile {
    /// Name without folders.
    pub name: String,
    /// BLAKE3 of the content.
    pub digest: String,
}
