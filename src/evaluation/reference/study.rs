//! References of studies: `study.json`, and a reference per member in a folder below it.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use super::{MakeOptions, Reference, ReferenceError, make};
use crate::evaluation::folder::{cannot_read, cannot_write, replace};
use crate::evaluation::{Member, STUDY, Study, read_study};

/// The reference of a study, whose members agree with what `study.json` says of them.
#[derive(Clone, Debug)]
pub struct StudyReference {
    /// Its folder, for messages.
    pub place: String,
    /// What the study consists of.
    pub study: Study,
    /// The reference of each member, in their order.
    pub members: Vec<Reference>,
}

impl StudyReference {
    /// Reads the reference in a folder and checks that it is whole: every member is one, ran with the settings that `study.json` states, and
    /// on the scenarios of the others.
    ///
    /// # Errors
    /// [`ReferenceError`] names the file and what is wrong.
    pub fn open(folder: &Path) -> Result<Self, ReferenceError> {
        let place = folder.display().to_string();
        let study = read_study(folder)?;
        for entry in fs::read_dir(folder).map_err(cannot_read(folder))? {
            let name = entry.map_err(cannot_read(folder))?.file_name().to_string_lossy().into_owned();
            if name != STUDY && !study.members.iter().any(|m| m.folder == name) {
                let reason = format!("{name} does not belong to the study: {STUDY} does not list it");
                return Err(ReferenceError::Unfit { place, reason });
            }
        }
        let opened = study.members.iter().map(|m| Reference::open(&folder.join(&m.folder)));
        let members = opened.collect::<Result<Vec<_>, _>>()?;
        let reference = Self { place, study, members };
        reference.check()?;
        Ok(reference)
    }

    /// Checks that the members are what `study.json` says, on the same scenarios.
    fn check(&self) -> Result<(), ReferenceError> {
        let first = &self.members[0];
        for (member, reference) in self.study.members.iter().zip(&self.members) {
            let unfit =
                |reason: String| Err(ReferenceError::Unfit { place: reference.place.clone(), reason });
            for (what, stated, found) in settings(member, reference) {
                if stated != found {
                    return unfit(format!("`{what}` is {found} here and {stated} in {STUDY}"));
                }
            }
            if reference.summary.provenance.scenarios_blake3 != first.summary.provenance.scenarios_blake3 {
                return unfit(format!("it is on other scenarios than {}", first.place));
            }
        }
        Ok(())
    }
}

/// What a study states of a member and what its run states, by name.
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
    if !member.originals.is_empty() {
        let names = |ids: &mut dyn Iterator<Item = &String>| ids.cloned().collect::<Vec<_>>().join(", ");
        let ran: BTreeMap<&String, ()> =
            reference.provenance.simulators.iter().map(|s| (&s.id, ())).collect();
        all.push(("simulators", names(&mut member.originals.keys()), names(&mut ran.into_keys())));
    }
    all
}

/// Writes the reference of a finished study to a folder that is absent or empty, and reads it back. To be called on the machine of the study.
///
/// # Errors
/// [`ReferenceError`] as of [`make`], for every member.
pub fn make_study(study: &Path, out: &Path, options: &MakeOptions) -> Result<StudyReference, ReferenceError> {
    let found = read_study(study)?;
    if fs::read_dir(out).is_ok_and(|mut entries| entries.next().is_some()) {
        return Err(ReferenceError::Exists { path: out.to_owned() });
    }
    fs::create_dir_all(out).map_err(cannot_write(out))?;
    let title = if options.title.is_empty() { &options.name } else { &options.title };
    for member in &found.members {
        let own = MakeOptions {
            name: format!("{}.{}", options.name, member.folder),
            title: format!("{title}: {}", member.label),
            ..options.clone()
        };
        make(&study.join(&member.folder), &out.join(&member.folder), &own)?;
    }
    replace(&out.join(STUDY), |file| file.write_all(found.to_json().as_bytes()))?;
    StudyReference::open(out)
}
