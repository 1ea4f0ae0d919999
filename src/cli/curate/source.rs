//! The option `--source`.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use anyhow::{Context, bail};

use crate::cli::output::{count, say};
use crate::curation::{
    CandidateFile, CandidateSource, CurationSettings, MAX_CANDIDATES, PlannerSource, SOURCES,
};
use crate::evaluation::weights_file;
use crate::models::diffusion_planner::PlannerPolicy;
use crate::models::nn::device;
use crate::models::weights::{PLANNER, WeightsFile, shipped};

/// Standard deviation of the initial noise of samples: 1.5 times that of the process, for variety. The public
/// code plans with 0.5.
pub(super) const TEMPERATURE: f64 = 1.5;

/// A source of candidates as the command line names it.
#[derive(Clone, Debug)]
pub(super) enum SourceChoice {
    /// One of [`SOURCES`].
    Known(&'static str),
    /// A file.
    File(PathBuf),
    /// A network, with a file of weights or those that ship.
    Planner(Option<PathBuf>),
}

impl FromStr for SourceChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.strip_prefix("file:") {
            Some("") => return Err("`file:` names no file: write file:PATH".to_owned()),
            Some(path) => return Ok(Self::File(path.into())),
            None => {}
        }
        if text == "diffusion" {
            return Ok(Self::Planner(None));
        }
        match text.strip_prefix("diffusion:") {
            Some("") => return Err("`diffusion:` names no weights: write diffusion:FILE".to_owned()),
            Some(path) => return Ok(Self::Planner(Some(path.into()))),
            None => {}
        }
        match SOURCES.iter().find(|source| source.id() == text) {
            Some(source) => Ok(Self::Known(source.id())),
            None => {
                let known: Vec<_> = SOURCES.iter().map(|source| source.id()).collect();
                Err(format!(
                    "`{text}` is not a source: choose {}, diffusion, diffusion:FILE or file:PATH",
                    known.join(", ")
                ))
            }
        }
    }
}

impl SourceChoice {
    /// Returns the number of candidates per scenario if none is requested: all that a file has.
    pub(super) fn candidates(&self) -> u32 {
        match self {
            Self::Known(_) | Self::Planner(_) => CurationSettings::default().candidates,
            Self::File(_) => MAX_CANDIDATES,
        }
    }

    /// Reads the file, if it is one. `temperature` is that of a network.
    pub(super) fn open(&self, temperature: Option<f64>) -> anyhow::Result<OpenSource> {
        if temperature.is_some() && !matches!(self, Self::Planner(_)) {
            bail!("--temperature is that of a network: give it with --source diffusion");
        }
        Ok(match self {
            Self::Planner(path) => {
                let device = device();
                let file = planner_weights(path.as_deref())?;
                let policy = PlannerPolicy::read(&file.bytes, &device)
                    .with_context(|| format!("{} cannot be used with --source diffusion", file.name))?;
                let source = PlannerSource::new(policy, temperature.unwrap_or(TEMPERATURE), device);
                OpenSource::Planner(Box::new(source))
            }
            Self::File(path) => OpenSource::File(CandidateFile::read(path)?),
            Self::Known(id) => match SOURCES.iter().find(|source| source.id() == *id) {
                Some(source) => OpenSource::Known(*source),
                None => bail!("there is no source `{id}`"),
            },
        })
    }
}

/// Returns this file of weights of the planner, or those that ship.
pub(super) fn planner_weights(path: Option<&Path>) -> anyhow::Result<WeightsFile> {
    if let Some(path) = path {
        return Ok(weights_file(path)?);
    }
    shipped(PLANNER)?.context("no weights of the planner ship with this program: write diffusion:FILE")
}

/// A source that is ready.
pub(super) enum OpenSource {
    /// One of [`SOURCES`].
    Known(&'static dyn CandidateSource),
    /// A file in memory.
    File(CandidateFile),
    /// A network in memory.
    Planner(Box<PlannerSource>),
}

impl OpenSource {
    /// Returns the source itself.
    pub(super) fn source(&self) -> &dyn CandidateSource {
        match self {
            Self::Known(source) => *source,
            Self::File(file) => file,
            Self::Planner(planner) => planner.as_ref(),
        }
    }

    /// Warns about candidates for scenarios that were not read; an error if there are no others.
    pub(super) fn compare(&self, read: &BTreeSet<String>) -> anyhow::Result<()> {
        let Self::File(file) = self else { return Ok(()) };
        let unread: Vec<&str> = file.scenarios().filter(|id| !read.contains(*id)).collect();
        let Some(first) = unread.first() else { return Ok(()) };
        if unread.len() == file.scenarios().count() {
            let other = read.first().map_or("", String::as_str);
            bail!(
                "--source: no scenario of the file is among the inputs: it has `{first}`, they have `{other}`"
            );
        }
        let number = count(unread.len(), "scenario");
        say(format_args!(
            "warning: --source has candidates for {number} not among the inputs, such as `{first}`"
        ));
        Ok(())
    }
}
