//! `reactsim reference`: creates references and writes their tables into documents.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use clap::{Args, Subcommand};

use super::output::{ExitStatus, count, say, write_result};
use crate::evaluation::reference::{MakeOptions, Part, Reference, StudyReference, make, make_study};
use crate::evaluation::{StudyResults, is_study, shipped_benchmark};
use crate::report::blocks::{Selection, blocks, render};
use crate::report::study_tables;

/// Folder of the references in a checkout.
const FOLDER: &str = "references";

const AFTER: &str = "\
Examples:
  reactsim run --out runs/bench
  reactsim reference make runs/bench --name reactsim-bench-v2 \\
      --command 'reactsim run --out runs/bench' --out references/reactsim-bench-v2
  reactsim reference tables README.md --check";

/// Arguments of `reference`.
#[derive(Debug, Args)]
#[command(after_help = AFTER)]
pub(super) struct ReferenceArgs {
    #[command(subcommand)]
    command: ReferenceCommand,
}

#[derive(Debug, Subcommand)]
enum ReferenceCommand {
    /// Create a reference from a finished run or study
    Make(MakeArgs),
    /// Write the tables of references into Markdown files, between their markers
    Tables(TablesArgs),
}

#[derive(Debug, Args)]
struct MakeArgs {
    /// Folder of the finished run or study
    #[arg(value_name = "RUNFOLDER")]
    run: PathBuf,
    /// Name of the reference
    #[arg(long)]
    name: String,
    /// Title, one line [default: the name]
    #[arg(long, value_name = "TEXT", default_value = "")]
    title: String,
    /// Command that produced the run; may be repeated
    #[arg(long = "command", value_name = "COMMAND")]
    commands: Vec<String>,
    /// Leave rows out, for recordings whose terms allow only aggregates
    #[arg(long)]
    aggregates_only: bool,
    /// Folder to write, such as references/NAME
    #[arg(long, value_name = "FOLDER")]
    out: PathBuf,
}

#[derive(Debug, Args)]
#[command(after_help = TABLES_AFTER)]
struct TablesArgs {
    /// Markdown files
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    /// Change no file; exit with code 1 if a table differs from its reference
    #[arg(long)]
    check: bool,
}

const TABLES_AFTER: &str = "\
Markers in the files:
  <!-- table references/NAME columns=aav-collision,ade models=idm,stop difficulty=hard -->
  <!-- end -->

columns, models, category and difficulty are optional; give at most one of the last two. Folders \
of references are relative to the current directory. The reference of a study takes only columns; \
without them, all its tables are written.";

pub(super) fn reference(args: &ReferenceArgs) -> anyhow::Result<ExitStatus> {
    match &args.command {
        ReferenceCommand::Make(args) => make_reference(args),
        ReferenceCommand::Tables(args) => tables(args),
    }
}

fn make_reference(args: &MakeArgs) -> anyhow::Result<ExitStatus> {
    let options = MakeOptions {
        name: args.name.clone(),
        title: args.title.clone(),
        commands: args.commands.clone(),
        aggregates_only: args.aggregates_only,
    };
    if is_study(&args.run) {
        let made = make_study(&args.run, &args.out, &options)?;
        say(format_args!("{}: {}", args.out.display(), count(made.members.len(), "member")));
        return Ok(ExitStatus::Done);
    }
    let made = make(&args.run, &args.out, &options)?;
    let rows = made.rows.as_ref().map_or_else(|| "no rows".to_owned(), |rows| count(rows.len(), "row"));
    let simulators = count(made.provenance.simulators.len(), "simulator");
    say(format_args!("{}: {simulators}, {rows}", args.out.display()));
    Ok(ExitStatus::Done)
}

fn tables(args: &TablesArgs) -> anyhow::Result<ExitStatus> {
    let mut references: BTreeMap<String, Tables> = BTreeMap::new();
    let mut stale = 0;
    for path in &args.files {
        let named = || path.display().to_string();
        let old = fs::read_to_string(path).with_context(|| format!("could not read {}", named()))?;
        let mut new = String::with_capacity(old.len());
        let mut written = 0;
        for block in blocks(&old).with_context(named)? {
            let place = || format!("{}, line {}", named(), block.line);
            if !references.contains_key(&block.reference) {
                let opened = Tables::open(Path::new(&block.reference)).with_context(place)?;
                references.insert(block.reference.clone(), opened);
            }
            let table = references[&block.reference].render(&block.selection).with_context(place)?;
            if old[block.place.clone()] != table {
                stale += 1;
                if args.check {
                    say(format_args!("{}: the table `{}` differs from its reference", place(), block.name));
                }
            }
            new.push_str(&old[written..block.place.start]);
            new.push_str(&table);
            written = block.place.end;
        }
        new.push_str(&old[written..]);
        if new != old && !args.check {
            write_result(Some(path), |out| out.write_all(new.as_bytes()))?;
            say(format_args!("{}: written", named()));
        }
    }
    if args.check && stale > 0 {
        say(format_args!("update the tables with `reactsim reference tables` and the same files"));
        return Ok(ExitStatus::SomeFailed);
    }
    Ok(ExitStatus::Done)
}

/// Source of the tables of a document.
enum Tables {
    Run(Box<Reference>),
    Study(Box<StudyResults>),
}

impl Tables {
    fn open(folder: &Path) -> anyhow::Result<Self> {
        if is_study(folder) {
            StudyReference::open(folder)?;
            return Ok(Self::Study(Box::new(StudyResults::read(folder)?)));
        }
        Ok(Self::Run(Box::new(Reference::open(folder)?)))
    }

    fn render(&self, selection: &Selection) -> anyhow::Result<String> {
        match self {
            Self::Run(reference) => Ok(render(reference, selection)?),
            Self::Study(_) if !selection.models.is_empty() || selection.part != Part::All => {
                bail!(
                    "the tables of a study have all simulators and scenarios: \
                     leave out models, category and difficulty"
                )
            }
            Self::Study(results) => {
                let mut text = Vec::new();
                study_tables::write_document(results, &selection.columns, &mut text)?;
                Ok(String::from_utf8_lossy(&text).into_owned())
            }
        }
    }
}

/// Finds the references of a name or a folder: all members if it is a study.
pub(super) fn find_all(requested: Option<&str>) -> anyhow::Result<Vec<Reference>> {
    let folder = requested.map(folder_of);
    match folder {
        Some(folder) if is_study(&folder) => Ok(StudyReference::open(&folder)?.members),
        _ => Ok(vec![find(requested)?]),
    }
}

/// Returns the folder of a name or path: in a checkout, the folder of a name in `references/`.
fn folder_of(name: &str) -> PathBuf {
    let in_checkout = Path::new(FOLDER).join(name);
    if !is_path(name) && in_checkout.is_dir() { in_checkout } else { PathBuf::from(name) }
}

fn is_path(name: &str) -> bool {
    name.contains(['/', std::path::MAIN_SEPARATOR]) || name.starts_with('.')
}

/// Finds the reference of a name or a folder; by default that of the shipped benchmark. Unless a path
/// is given, references that are part of the program take precedence over folders.
pub(super) fn find(requested: Option<&str>) -> anyhow::Result<Reference> {
    let name = match requested {
        Some(name) => name.to_owned(),
        None => {
            let benchmark = shipped_benchmark().context("no benchmark ships with this program")?.record;
            format!("{}-{}", benchmark.name, benchmark.version)
        }
    };
    if !is_path(&name)
        && let Some(embedded) = Reference::embedded(&name)
    {
        return Ok(embedded?);
    }
    let folder = folder_of(&name);
    if !folder.is_dir() {
        bail!(
            "there is no reference `{name}`: it is not part of the program, \
             and there is no folder {FOLDER}/{name}"
        );
    }
    Ok(Reference::open(&folder)?)
}
