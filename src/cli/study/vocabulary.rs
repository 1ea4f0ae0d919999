//! `reactsim study vocabulary`: what motion tokens do to the motion that they replay.

use std::path::PathBuf;
use std::str::FromStr;

use anyhow::{Context, bail};
use clap::Args;

use super::{PlannedStudy, SharedArgs};
use crate::cli::external::Outside;
use crate::evaluation::{NamedVocabulary, Source, StudyPlan, weights_file};
use crate::models::weights;
use crate::rollout::Settings;

const AFTER: &str = "\
Every agent follows its log by the nearest tokens of a vocabulary (`token-replay`), whatever the AV \
does. The metrics describe the resulting motion, next to the motion of the log itself, and do not \
depend on the AV. A vocabulary is a file of `train vocabulary`, or the weights of a token \
network, which contain one.

Examples:
  reactsim study vocabulary --out studies/vocabulary
  reactsim study vocabulary logs/ --av log --vocabulary fine=fine.safetensors --out studies/mine";

/// Networks that ship, by the name of the vocabulary that they contain.
const SHIPPED: [(&str, &str); 3] =
    [("k-disks", "smart-small"), ("trajtok", "trajtok-small"), ("kinematic", "ntp-reactive")];

/// Arguments of `study vocabulary`.
#[derive(Debug, Args)]
#[command(after_help = AFTER)]
pub(super) struct VocabularyArgs {
    /// A vocabulary and its name in the table; may be repeated [default: vocabularies of the shipped
    /// networks]
    #[arg(long = "vocabulary", value_name = "NAME=FILE")]
    vocabularies: Vec<VocabularyFile>,
    #[command(flatten)]
    pub shared: SharedArgs,
}

/// A vocabulary as the command line names it.
#[derive(Clone, Debug)]
struct VocabularyFile {
    name: String,
    path: PathBuf,
}

impl FromStr for VocabularyFile {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let Some((name, path)) = text.split_once('=').filter(|(_, path)| !path.is_empty()) else {
            return Err("write NAME=FILE, such as fine=fine.safetensors".to_owned());
        };
        let is_plain = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
        if name.is_empty() || !name.chars().all(is_plain) {
            return Err(format!("`{name}` is not a name: use lower-case letters, digits and -"));
        }
        Ok(Self { name: name.to_owned(), path: path.into() })
    }
}

pub(super) fn plan(args: &VocabularyArgs, sources: Vec<Source>) -> anyhow::Result<PlannedStudy> {
    let subject = &args.shared.subject;
    subject.refuse_simulators("this study replays the log: give vocabularies with --vocabulary")?;
    let vocabularies = match args.vocabularies.is_empty() {
        true => shipped()?,
        false => args.vocabularies.iter().map(read).collect::<anyhow::Result<Vec<_>>>()?,
    };
    for (i, NamedVocabulary { name, .. }) in vocabularies.iter().enumerate() {
        if name == "log" || vocabularies[..i].iter().any(|earlier| earlier.name == *name) {
            bail!("--vocabulary: the name `{name}` is taken: give every vocabulary its own");
        }
    }
    let settings = Settings { seed: subject.seed, ..Settings::default() };
    let outside = Outside::default();
    let plan = subject.plan(sources, Vec::new(), &outside, settings, 1, args.shared.keep_rollouts)?;
    Ok((StudyPlan::vocabulary(plan, vocabularies)?, outside))
}

fn read(file: &VocabularyFile) -> anyhow::Result<NamedVocabulary> {
    let context = || format!("could not read the vocabulary {}", file.path.display());
    let weights = weights_file(&file.path).with_context(context)?;
    Ok(NamedVocabulary { name: file.name.clone(), file: weights })
}

/// Returns the vocabularies of the networks that ship.
fn shipped() -> anyhow::Result<Vec<NamedVocabulary>> {
    let mut vocabularies = Vec::new();
    for (name, network) in SHIPPED {
        if let Some(file) = weights::shipped(network)? {
            vocabularies.push(NamedVocabulary { name: name.to_owned(), file });
        }
    }
    Ok(vocabularies)
}
