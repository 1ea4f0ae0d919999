//! Studies: several runs on the same scenarios that differ in what is studied.
//!
//! A study is a folder with `study.json`, which says what it consists of, `study.md` with its table, and one ordinary run folder per
//! member. [`StudyPlan`] says what is run, [`StudyFolder`] keeps it, [`StudyResults`] reads it.

mod file;
mod folder;
mod guards;
mod plan;
mod results;

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

pub use file::{STUDY, STUDY_TABLE, is_study, read_study};
pub use folder::StudyFolder;
pub use plan::StudyPlan;
pub use results::{Difference, StudyResults};

/// What is studied.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum StudyKind {
    /// How often simulators plan anew (ReactSim-Bench, "Effect of replanning interval").
    Replan,
    /// The reactive protocol beside the realism protocol (ReactSim-Bench, table 2).
    Realism,
    /// What each part of a simulator is worth, and seeing the AV a step ahead.
    Guards,
}

impl StudyKind {
    /// The name on the command line and in files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Replan => "replan",
            Self::Realism => "realism",
            Self::Guards => "guards",
        }
    }
}

/// A study: what it is, and its runs in the order of its table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Study {
    /// Version of the form of `study.json`.
    pub version: u32,
    /// What is studied.
    pub kind: StudyKind,
    /// Its runs; at least one, with different folders.
    pub members: Vec<Member>,
}

/// A run of a study. Everything else about it stands in the provenance in its folder.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Member {
    /// Name of its run folder, below that of the study.
    pub folder: String,
    /// What it is, for people, such as `every 5 steps (2 Hz)`.
    pub label: String,
    /// Steps between two plans; in studies of kind `replan`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub replan_steps: Option<usize>,
    /// `reactive` or `realism`; in studies of kind `realism`, and of kind `replan` where it is not `reactive`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub protocol: Option<String>,
    /// What is changed about the simulators, such as `without-projection`; `as-is` for nothing. In studies of kind `guards`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub variant: Option<String>,
    /// Whether agents at t+1 see the AV at t+1; in studies of kind `guards`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub av_lookahead: Option<bool>,
    /// Id of each simulator of this run, and its id where nothing is changed about it (in the first member): they differ where a stage
    /// is put behind it or taken away. In studies of kind `guards`.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub originals: BTreeMap<String, String>,
}

impl Study {
    /// The version that this program writes and reads.
    pub const VERSION: u32 = 1;

    /// A study of these members.
    pub(super) fn new(kind: StudyKind, members: Vec<Member>) -> Self {
        Self { version: Self::VERSION, kind, members }
    }

    /// The text of `study.json`.
    pub fn to_json(&self) -> String {
        let mut text = serde_json::to_string_pretty(self).expect("a study holds text and numbers only");
        text.push('\n');
        text
    }

    /// What is wrong with it, where it does not hold what its kind needs.
    fn fault(&self) -> Option<String> {
        if self.version != Self::VERSION {
            let wanted = Self::VERSION;
            return Some(format!("its version is {}, this program reads version {wanted}", self.version));
        }
        if self.members.is_empty() {
            return Some("it has no members".to_owned());
        }
        for (i, member) in self.members.iter().enumerate() {
            let Member { folder, replan_steps, protocol, variant, av_lookahead, originals, .. } = member;
            if !is_plain(folder) {
                return Some(format!("`{folder}` is no name of a folder"));
            }
            if self.members[..i].iter().any(|m| m.folder == *folder) {
                return Some(format!("it has two members `{folder}`"));
            }
            let lacks = match self.kind {
                StudyKind::Replan => replan_steps.is_none().then_some("replan_steps"),
                StudyKind::Realism => protocol.is_none().then_some("protocol"),
                StudyKind::Guards if variant.is_none() => Some("variant"),
                StudyKind::Guards if av_lookahead.is_none() => Some("av_lookahead"),
                StudyKind::Guards => originals.is_empty().then_some("originals"),
            };
            if let Some(field) = lacks {
                return Some(format!("the member `{folder}` has no `{field}`"));
            }
        }
        None
    }
}

/// Whether a text is the name of something within a folder: no path, which could lead elsewhere.
fn is_plain(name: &str) -> bool {
    let known = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_');
    !name.is_empty() && name.chars().all(known)
}
