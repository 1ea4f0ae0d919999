//! Studies: several runs on the same scenarios whose specifications differ in some keys, the axes.
//!
//! A study is a folder with `study.json`, which lists its members, `study.md` with its table, and one
//! ordinary run folder per member; studies of planners also have `planners.json`, studies of errors
//! `errors.json`. [`StudyPlan`] defines the
//! runs, [`StudyFolder`] stores them, [`StudyResults`] reads them.

mod errors;
mod file;
mod folder;
mod guards;
mod plan;
mod planner_pairs;
mod planners;
mod results;

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::spec::AxisValue;

pub use errors::{ErrorGroup, LOG_ERRORS, LogErrors, SimulatorErrors};
pub use file::{is_study, read_study};
pub use folder::StudyFolder;
pub use plan::{AxisPoint, StudyPlan};
pub use planner_pairs::{Dependence, PlannerPair};
pub use planners::{Agreement, OrderChange, PLANNER_RANKS, PlannerRanks, SimulatorRanks};
pub use results::{Difference, StudyResults};

/// The subject of a study.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum StudyKind {
    /// Replan interval (ReactSim-Bench, "Effect of replanning interval").
    Replan,
    /// Reactive protocol against realism protocol (ReactSim-Bench, table 2).
    Realism,
    /// Ablation of the components of simulators, and of observing the AV one step ahead.
    Guards,
    /// Planners of the AV under several simulators.
    Planners,
    /// Displacements from the log, by what agents do in it.
    Errors,
    /// Any keys of a specification.
    Axes,
}

impl StudyKind {
    /// Returns the name used on the command line and in files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Replan => "replan",
            Self::Realism => "realism",
            Self::Guards => "guards",
            Self::Planners => "planners",
            Self::Errors => "errors",
            Self::Axes => "axes",
        }
    }
}

/// A study: its kind, and its runs in the order of its table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Study {
    /// Format version of `study.json`.
    pub version: u32,
    /// Subject.
    pub kind: StudyKind,
    /// Runs; at least one, with different folders.
    pub members: Vec<Member>,
}

/// A run of a study. The provenance in its folder has all other settings.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Member {
    /// Name of its run folder in the folder of the study.
    pub folder: String,
    /// Label in tables, such as `every 5 steps (2 Hz)`.
    pub label: String,
    /// Number of steps between two plans; in studies of kind `replan`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub replan_steps: Option<usize>,
    /// `reactive` or `realism`; in studies of kind `realism`, and in studies of kind `replan` if not
    /// `reactive`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub protocol: Option<String>,
    /// Change of the simulators, such as `without-projection`; `as-is` for none. In studies of kind `guards`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub variant: Option<String>,
    /// Planner of the AV, as in `--av planner:ID`; absent if the AV is fixed. In studies of kind `planners`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub planner: Option<String>,
    /// Whether agents at t+1 observe the AV at t+1; in studies of kind `guards`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub av_lookahead: Option<bool>,
    /// Id of each simulator of this run, and the id of the unchanged simulator (in the first member). They
    /// differ if a stage was added or removed. In studies of kind `guards`.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub originals: BTreeMap<String, String>,
    /// Values of the run on the axes, which are the same in all members; in studies of kind `axes`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub axes: Vec<AxisValue>,
}

impl Study {
    /// The version that this program writes and reads.
    pub const VERSION: u32 = 1;

    /// Creates a study of these members.
    pub fn new(kind: StudyKind, members: Vec<Member>) -> Self {
        Self { version: Self::VERSION, kind, members }
    }

    /// Returns what is wrong with the study if it lacks fields that its kind needs, or has invalid or
    /// repeated folders.
    fn fault(&self) -> Option<String> {
        if self.version != Self::VERSION {
            let expected = Self::VERSION;
            return Some(format!("its version is {}, this program reads version {expected}", self.version));
        }
        if self.members.is_empty() {
            return Some("it has no members".to_owned());
        }
        for (i, member) in self.members.iter().enumerate() {
            let Member { folder, replan_steps, protocol, variant, av_lookahead, originals, axes, .. } =
                member;
            if !is_plain(folder) {
                return Some(format!("`{folder}` is not a valid folder name"));
            }
            if self.members[..i].iter().any(|m| m.folder == *folder) {
                return Some(format!("it has two members `{folder}`"));
            }
            let missing = match self.kind {
                // A member without a planner has fixed AVs.
                StudyKind::Planners | StudyKind::Errors => None,
                StudyKind::Replan => replan_steps.is_none().then_some("replan_steps"),
                StudyKind::Realism => protocol.is_none().then_some("protocol"),
                StudyKind::Guards if variant.is_none() => Some("variant"),
                StudyKind::Guards if av_lookahead.is_none() => Some("av_lookahead"),
                StudyKind::Guards => originals.is_empty().then_some("originals"),
                StudyKind::Axes => axes.is_empty().then_some("axes"),
            };
            if let Some(field) = missing {
                return Some(format!("the member `{folder}` has no `{field}`"));
            }
        }
        None
    }
}

/// Returns whether a text is a plain name within a folder, not a path that could lead elsewhere.
fn is_plain(name: &str) -> bool {
    let known = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_');
    !name.is_empty() && name.chars().all(known)
}
