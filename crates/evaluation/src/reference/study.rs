//! References of studies: `study.json`, and one subfolder with a reference per member.

use std::fs;
use std::path::Path;

use super::make::create_empty;
use super::{MakeOptions, Reference, ReferenceError, make};
use crate::folder::{cannot_read, write_json};
use crate::layout::STUDY;
use crate::study::{Member, PLANNER_RANKS, PlannerRanks, Study, read_study};

/// The reference of a study, whose members are consistent with `study.json`.
#[derive(Clone, Debug)]
pub struct StudyReference {
    /// Folder, for messages.
    pub place: String,
    /// The study.
    pub study: Study,
    /// Reference of each member, in order.
    pub members: Vec<Reference>,
}

impl StudyReference {
    /// Reads the reference in a folder and checks it: every member is a valid reference with the settings in
    /// `study.json`, and all members have the same scenarios.
    ///
    /// # Errors
    /// [`ReferenceError`] names the file and what is wrong.
    pub fn open(folder: &Path) -> Result<Self, ReferenceError> {
        let place = folder.display().to_string();
        let study = read_study(folder)?;
        for entry in fs::read_dir(folder).map_err(cannot_read(folder))? {
            let name = entry.map_err(cannot_read(folder))?.file_name().to_string_lossy().into_owned();
            if ![STUDY, PLANNER_RANKS].contains(&name.as_str())
                && !study.members.iter().any(|m| m.folder == name)
            {
                let reason = format!("{name} does not belong to the study: {STUDY} does not list it");
                return Err(ReferenceError::unfit(&place, reason));
            }
        }
        let opened = study.members.iter().map(|m| Reference::open(&folder.join(&m.folder)));
        let members = opened.collect::<Result<Vec<_>, _>>()?;
        let reference = Self { place, study, members };
        reference.check()?;
        Ok(reference)
    }

    /// Checks that the members have the settings in `study.json` and the same scenarios.
    fn check(&self) -> Result<(), ReferenceError> {
        let first = &self.members[0];
        for (member, reference) in self.study.members.iter().zip(&self.members) {
            let unfit = |reason: String| Err(ReferenceError::unfit(&reference.place, reason));
            for (setting, stated, found) in settings(member, reference) {
                if stated != found {
                    return unfit(format!("`{setting}` is {found} here and {stated} in {STUDY}"));
                }
            }
            if reference.summary.provenance.scenarios_blake3 != first.summary.provenance.scenarios_blake3 {
                return unfit(format!("it is on other scenarios than {}", first.place));
            }
        }
        Ok(())
    }
}

/// Returns the settings of a member by name, with the values in the study and in its run.
fn settings(member: &Member, reference: &Reference) -> Vec<(&'static str, String, String)> {
    let run = &reference.provenance.settings;
    let mut all = Vec::new();
    if let Some(steps) = member.replan_steps {
        all.push(("replan_steps", steps.to_string(), run.replan_steps.to_string()));
    }
    if let Some(protocol) = &member.protocol {
        all.push(("protocol", protocol.clone(), run.protocol.clone()));
    }
    if let Some(ahead) = member.av_lookahead {
        all.push(("av_lookahead", ahead.to_string(), run.av_lookahead.to_string()));
    }
    if let Some(planner) = &member.planner {
        all.push(("av", format!("planner:{planner}"), run.av.clone()));
    }
    if !member.originals.is_empty() {
        let stated: Vec<&str> = member.originals.keys().map(String::as_str).collect();
        let mut ran: Vec<&str> = reference.provenance.simulators.iter().map(|s| s.id.as_str()).collect();
        ran.sort_unstable();
        all.push(("simulators", stated.join(", "), ran.join(", ")));
    }
    all
}

/// Writes the reference of a finished study to a folder that is absent or empty, and reads it back. Must be
/// called on the machine of the study.
///
/// # Errors
/// [`ReferenceError`] as for [`make`], for every member.
pub fn make_study(study: &Path, out: &Path, options: &MakeOptions) -> Result<StudyReference, ReferenceError> {
    let found = read_study(study)?;
    let lock = create_empty(out)?;
    for member in &found.members {
        let own = MakeOptions {
            name: format!("{}.{}", options.name, member.folder),
            title: format!("{}: {}", options.title(), member.label),
            ..options.clone()
        };
        make(&study.join(&member.folder), &out.join(&member.folder), &own)?;
    }
    if let Some(ranks) = PlannerRanks::read(study)? {
        ranks.write(out)?;
    }
    write_json(&out.join(STUDY), &found)?;
    drop(lock);
    StudyReference::open(out)
}
