//! `reactsim export wosac`: a submission to the Sim Agents challenge.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use clap::Args;
use serde::Deserialize;

use crate::cli::inputs::find_inputs;
use crate::cli::output::{ExitStatus, count, note, say};
use crate::cli::progress::Progress;
use crate::evaluation::read_summary;
use crate::evaluation::realism::{LogSource, RunPairs};
use crate::formats::wosac::{SubmissionMetadata, SubmissionWriter};
use crate::rollout::Protocol;
use crate::scene::wosac::{CHALLENGE_ROLLOUTS, check_rollouts};

/// Largest number of steps between two plans: the challenge requires at least 1 Hz.
const MAX_REPLAN_STEPS: usize = 10;

/// Arguments of `export wosac`.
#[derive(Debug, Args)]
pub(super) struct ExportWosacArgs {
    /// Run folder: realism protocol, 32 rollouts, --all-agents, --keep-rollouts
    run: PathBuf,
    /// Simulator, if the run has several
    #[arg(long, value_name = "ID")]
    simulator: Option<String>,
    /// Recordings of the scenarios: files or folders of the Waymo Open Motion Dataset; may be repeated
    #[arg(long, required = true, value_name = "PATH")]
    scenarios: Vec<PathBuf>,
    /// Description of the method (TOML): account_name, unique_method_name, num_model_parameters,
    /// uses_lidar_data, uses_camera_data, uses_public_model_pretraining, and optionally authors,
    /// affiliation, description, method_link, public_model_names
    #[arg(long, value_name = "FILE")]
    metadata: PathBuf,
    /// Archive to write (.tar.gz)
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Number of files in the archive; customarily one per file of the data set, 150
    #[arg(long, default_value_t = 1, value_name = "N",
          value_parser = clap::value_parser!(u32).range(1..=99_999))]
    shards: u32,
}

/// Fields of the file of metadata.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Description {
    account_name: String,
    unique_method_name: String,
    num_model_parameters: String,
    uses_lidar_data: bool,
    uses_camera_data: bool,
    uses_public_model_pretraining: bool,
    #[serde(default)]
    authors: Vec<String>,
    affiliation: Option<String>,
    description: Option<String>,
    method_link: Option<String>,
    #[serde(default)]
    public_model_names: Vec<String>,
}

impl From<Description> for SubmissionMetadata {
    fn from(of: Description) -> Self {
        Self {
            authors: of.authors,
            affiliation: of.affiliation,
            description: of.description,
            method_link: of.method_link,
            uses_lidar_data: Some(of.uses_lidar_data),
            uses_camera_data: Some(of.uses_camera_data),
            uses_public_model_pretraining: Some(of.uses_public_model_pretraining),
            public_model_names: of.public_model_names,
            ..Self::new(&of.account_name, &of.unique_method_name, &of.num_model_parameters)
        }
    }
}

pub(super) fn export(args: &ExportWosacArgs) -> anyhow::Result<ExitStatus> {
    let metadata = read_metadata(&args.metadata)?;
    check_run(&args.run)?;
    let mut sources = Vec::new();
    for input in find_inputs(&args.scenarios)? {
        if !input.is_recording() {
            bail!("{} is no recording of the Waymo Open Motion Dataset", input.path.display());
        }
        sources.push(LogSource::of(input));
    }
    let mut pairs = RunPairs::open(&args.run, args.simulator.as_deref(), sources)?;
    let total = pairs.scenarios();
    let per_shard = total.div_ceil(args.shards as usize).max(1);
    let name = file_name(&metadata);
    let mut writer = SubmissionWriter::create(&args.out, &name, args.shards, &metadata)?;
    let progress = Progress::new();
    progress.set_total(Some(total));
    let (mut written, mut finished) = (0, 0);
    for pair in pairs.by_ref() {
        // A submission that lacks a scenario would be refused.
        let pair = pair.map_err(|failure| anyhow::anyhow!(failure.error))?;
        check_rollouts(&pair.rollouts, &pair.log).with_context(|| pair.place.clone())?;
        writer.write(&pair.rollouts)?;
        written += 1;
        progress.set_done(written);
        if written % per_shard == 0 && finished + 1 < args.shards {
            writer.finish_shard()?;
            finished += 1;
        }
    }
    progress.end();
    if written == 0 {
        bail!("the run has none of the scenarios of these recordings");
    }
    writer.finish()?;
    let missing = pairs.missing().len();
    note(format_args!(
        "{} holds {} of `{}`",
        args.out.display(),
        count(written, "scenario"),
        pairs.simulator()
    ));
    if missing > 0 {
        let n = count(missing, "scenario");
        say(format_args!(
            "warning: {n} of the recordings are not in the run: the server requires all of a split"
        ));
        return Ok(ExitStatus::SomeFailed);
    }
    Ok(ExitStatus::Done)
}

fn read_metadata(path: &Path) -> anyhow::Result<SubmissionMetadata> {
    let text = fs::read_to_string(path).with_context(|| format!("could not read {}", path.display()))?;
    let description: Description =
        toml::from_str(&text).with_context(|| format!("{} is no description of a method", path.display()))?;
    let metadata = SubmissionMetadata::from(description);
    metadata.check().map_err(|cause| anyhow::anyhow!("{}: {cause}", path.display()))?;
    Ok(metadata)
}

/// Checks that a run complies with the rules of the challenge.
fn check_run(folder: &Path) -> anyhow::Result<()> {
    let settings = read_summary(folder)?.provenance.run.settings;
    let folder = folder.display();
    if settings.protocol != Protocol::Realism.name() {
        bail!("{folder} is a run of the {} protocol: run with --protocol realism", settings.protocol);
    }
    if settings.rollouts as usize != CHALLENGE_ROLLOUTS {
        bail!("{folder} has {} rollouts per scenario: run with --rollouts 32", settings.rollouts);
    }
    if settings.replan_steps > MAX_REPLAN_STEPS {
        let rate = settings.replan_steps;
        bail!(
            "{folder} plans every {rate} steps, the challenge requires at least 1 Hz: run with --replan 2hz"
        );
    }
    Ok(())
}

/// Returns the name of the files in the archive: that of the method in plain characters.
fn file_name(metadata: &SubmissionMetadata) -> String {
    let name = metadata.unique_method_name.as_deref().unwrap_or_default();
    let plain = |c: char| if c.is_ascii_alphanumeric() || c == '-' { c.to_ascii_lowercase() } else { '_' };
    let name: String = name.chars().take(60).map(plain).collect();
    if name.is_empty() { "submission".to_owned() } else { name }
}
