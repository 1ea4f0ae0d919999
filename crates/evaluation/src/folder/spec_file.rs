//! Specifications in run folders.

use std::cell::RefCell;
use std::fs;
use std::io::ErrorKind;
use std::path::{self, Component, Path, PathBuf};

use super::replace;
use crate::av::AvChoice;
use crate::error::EvaluationError;
use crate::layout::SPEC;
use crate::spec::RunSpec;
use crate::spec::file::read;

impl RunSpec {
    /// Returns the text of a file for any folder, with all values that are set or have a default, and
    /// absolute paths.
    ///
    /// # Errors
    /// [`EvaluationError`] names a path that is not UTF-8, or a number that TOML does not have.
    pub fn to_toml(&self) -> Result<String, EvaluationError> {
        self.text(&|path| path::absolute(path).unwrap_or_else(|_| path.to_owned()))
    }

    /// Returns the text of a file in a folder as [`Self::to_toml`], with paths relative to it, or absolute
    /// if the folder and the file have only the root in common.
    ///
    /// # Errors
    /// [`EvaluationError`] as for [`Self::to_toml`].
    pub fn to_toml_in(&self, folder: &Path) -> Result<String, EvaluationError> {
        self.text(&|path| relative(path, folder))
    }

    /// Returns the text of a file with changed paths.
    fn text(&self, change: &dyn Fn(&Path) -> PathBuf) -> Result<String, EvaluationError> {
        let mut spec = self.clone();
        let unwritable = RefCell::new(None);
        spec.change_paths(&|path| {
            let changed = change(path);
            if changed.to_str().is_none() {
                unwritable.replace(Some(changed.clone()));
            }
            changed
        });
        if let Some(path) = unwritable.into_inner() {
            return Err(EvaluationError::Refused(format!(
                "{}: the path is not UTF-8, as {SPEC} is: rename it",
                path.display()
            )));
        }
        // The name of the policy does not have its file.
        if let Some(AvChoice::File(path)) = spec.subject.av.take_if(|av| matches!(av, AvChoice::File(_))) {
            (spec.subject.input.deviations, spec.subject.av) = (Some(path), Some(AvChoice::Deviated));
        }
        let invalid = |error: toml::ser::Error| {
            EvaluationError::Refused(format!("the specification cannot be written: {error}"))
        };
        // Numbers that no file can have are refused by tables only.
        toml::Table::try_from(&spec).map_err(invalid)?;
        toml::to_string(&spec).map_err(invalid)
    }

    /// Writes the text of [`Self::to_toml_in`] to the folder.
    ///
    /// # Errors
    /// [`EvaluationError::Write`], and as for [`Self::to_toml`].
    pub fn write(&self, folder: &Path) -> Result<(), EvaluationError> {
        let text = self.to_toml_in(folder)?;
        replace(&folder.join(SPEC), |out| out.write_all(text.as_bytes()))
    }

    /// Reads the specification in a run folder; `None` for a run of an earlier version or of a program
    /// without specification.
    ///
    /// # Errors
    /// [`EvaluationError`] if the file cannot be read or is damaged.
    pub fn of_run(folder: &Path) -> Result<Option<Self>, EvaluationError> {
        let path = folder.join(SPEC);
        match fs::metadata(&path) {
            Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
            _ => read(&path).map(Some).map_err(EvaluationError::Refused),
        }
    }
}

/// Returns a path as seen from a folder; the whole path if they have only the root in common. Links are
/// followed in folders, but not in the last name, by which the format of a file is recognised.
fn relative(path: &Path, folder: &Path) -> PathBuf {
    let whole = match (path.parent(), path.file_name()) {
        (Some(parent), Some(name)) => canonical(parent).join(name),
        _ => canonical(path),
    };
    let folder = canonical(folder);
    let common = whole.components().zip(folder.components()).take_while(|(a, b)| a == b).count();
    if !whole.components().take(common).any(|part| matches!(part, Component::Normal(_))) {
        return whole;
    }
    let up = folder.components().skip(common).map(|_| Component::ParentDir);
    let relative: PathBuf = up.chain(whole.components().skip(common)).collect();
    if relative.as_os_str().is_empty() { PathBuf::from(".") } else { relative }
}

/// Returns the absolute path without links, as far as it exists.
fn canonical(path: &Path) -> PathBuf {
    let path = if path.as_os_str().is_empty() { Path::new(".") } else { path };
    match (path.canonicalize(), path.parent(), path.file_name()) {
        (Ok(found), ..) => found,
        (Err(_), Some(parent), Some(name)) => canonical(parent).join(name),
        _ => path.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spec::SubjectSpec;

    /// Returns a specification with a path under every key that has one.
    fn with_paths(path: &dyn Fn(&str) -> PathBuf) -> RunSpec {
        let mut subject = SubjectSpec {
            model_weights: vec![format!("idm={}", path("w.safetensors").display())],
            ..SubjectSpec::default()
        };
        subject.input.scenarios = vec![path("logs"), "s3://bucket/logs".into()];
        subject.input.deviations = Some(path("d.parquet"));
        let nuplan = &mut subject.input.reading.nuplan;
        (nuplan.nuplan, nuplan.filter, nuplan.maps) =
            (vec![path("log.db")], Some(path("filter.yaml")), Some(path("maps")));
        RunSpec { subject, ..RunSpec::default() }
    }

    #[test]
    fn a_folder_has_the_paths_of_its_run() {
        let home = tempfile::tempdir().unwrap();
        let home = home.path().canonicalize().unwrap();
        let folder = home.join("runs/a");
        fs::create_dir_all(&folder).unwrap();
        assert_eq!(RunSpec::of_run(&folder).unwrap(), None);
        with_paths(&|name| home.join(name)).write(&folder).unwrap();
        let text = fs::read_to_string(folder.join(SPEC)).unwrap();
        assert!(text.contains(r#"scenarios = ["../../logs", "s3://bucket/logs"]"#), "{text}");
        assert!(!text.contains(home.to_str().unwrap()), "{text}");
        // The folder can be moved with the files.
        let read = RunSpec::of_run(&folder).unwrap().unwrap();
        assert_eq!(read, with_paths(&|name| folder.join("../..").join(name)));
        fs::write(folder.join(SPEC), "seed = ").unwrap();
        assert!(RunSpec::of_run(&folder).unwrap_err().to_string().contains("spec.toml"));
    }

    #[test]
    fn the_file_of_an_av_is_one_of_deviations() {
        let mut spec = RunSpec::default();
        spec.subject.av = Some(AvChoice::File("d.parquet".into()));
        let text = spec.text(&Path::to_owned).unwrap();
        assert!(text.contains("deviations = \"d.parquet\"") && text.contains("av = \"deviated\""), "{text}");
    }

    #[test]
    fn seeds_have_64_bits() {
        let home = tempfile::tempdir().unwrap();
        for seed in [0, u64::MAX >> 1, (u64::MAX >> 1) + 1, u64::MAX] {
            let mut spec = RunSpec::default();
            spec.subject.seed = seed;
            spec.write(home.path()).unwrap();
            assert_eq!(RunSpec::of_run(home.path()).unwrap(), Some(spec));
        }
        for seed in ["-1", "\"-1\"", "\"x\"", "0.5"] {
            fs::write(home.path().join(SPEC), format!("seed = {seed}")).unwrap();
            let error = RunSpec::of_run(home.path()).unwrap_err().to_string();
            assert!(error.contains("spec.toml: seed"), "{error}");
        }
        let mut spec = RunSpec::default();
        spec.subject.input.limit = std::num::NonZeroUsize::new(usize::MAX);
        assert!(spec.to_toml().unwrap_err().to_string().contains("cannot be written"));
    }

    #[cfg(unix)]
    #[test]
    fn paths_that_are_no_text_are_refused() {
        use std::os::unix::ffi::OsStrExt;

        let mut spec = RunSpec::default();
        spec.subject.input.scenarios = vec![Path::new(std::ffi::OsStr::from_bytes(b"lo\xffgs")).to_owned()];
        let error = spec.to_toml().unwrap_err().to_string();
        assert!(error.contains("gs: the path is not UTF-8"), "{error}");
    }

    #[test]
    fn paths_with_only_the_root_in_common_are_absolute() {
        let home = tempfile::tempdir().unwrap();
        assert_eq!(relative(Path::new("/proc/self"), home.path()), PathBuf::from("/proc/self"));
        assert_eq!(relative(home.path(), home.path()), PathBuf::from("."));
        // Files of another machine have no links.
        let absent = home.path().join("runs/a/../../absent/file");
        fs::create_dir_all(home.path().join("runs/a")).unwrap();
        assert_eq!(relative(&absent, home.path()), PathBuf::from("absent/file"));
    }
}
