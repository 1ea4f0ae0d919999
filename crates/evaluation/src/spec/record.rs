//! Specifications in run folders.

use std::fs;
use std::io::ErrorKind;
use std::path::{Component, Path, PathBuf};

use reactsim_files::as_url;

use super::file::read;
use super::{NuplanSpec, RunSpec, SubjectSpec};
use crate::av::AvChoice;
use crate::error::EvaluationError;
use crate::folder::replace;
use crate::layout::SPEC;

impl RunSpec {
    /// Returns the text of a file, with all values that are set or have a default.
    pub fn to_toml(&self) -> String {
        let mut spec = self.clone();
        // The name of the policy does not have its file.
        if let Some(AvChoice::File(path)) = spec.subject.av.take_if(|av| matches!(av, AvChoice::File(_))) {
            (spec.subject.input.deviations, spec.subject.av) = (Some(path), Some(AvChoice::Deviated));
        }
        toml::to_string(&spec).expect("a specification has texts, numbers and lists only")
    }

    /// Changes the paths of all files; URLs remain.
    pub(super) fn change_paths(&mut self, change: &dyn Fn(&Path) -> PathBuf) {
        let SubjectSpec { input, model_weights, av, .. } = &mut self.subject;
        let NuplanSpec { nuplan, filter, maps } = &mut input.reading.nuplan;
        let files = [&mut input.deviations, filter, maps];
        let all = input.scenarios.iter_mut().chain(nuplan).chain(files.into_iter().flatten());
        let of_av = av.iter_mut().filter_map(|av| match av {
            AvChoice::File(path) => Some(path),
            _ => None,
        });
        for path in all.chain(of_av).filter(|path| as_url(path).is_none()) {
            *path = change(path);
        }
        for text in model_weights {
            if let Some((id, file)) = text.split_once('=') {
                *text = format!("{id}={}", change(Path::new(file)).display());
            }
        }
    }

    /// Writes the specification to a folder, with paths relative to it, or absolute if the folder and the
    /// file have only the root in common.
    ///
    /// # Errors
    /// [`EvaluationError::Write`].
    pub fn write(&self, folder: &Path) -> Result<(), EvaluationError> {
        let mut spec = self.clone();
        spec.change_paths(&|path| relative(path, folder));
        replace(&folder.join(SPEC), |out| out.write_all(spec.to_toml().as_bytes()))
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
            _ => read(&path).map(Some).map_err(|reason| EvaluationError::DamagedSpec { reason }),
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
        let text = spec.to_toml();
        assert!(text.contains("deviations = \"d.parquet\"") && text.contains("av = \"deviated\""), "{text}");
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
