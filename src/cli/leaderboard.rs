//! `reactsim leaderboard`: references and submitted runs in one table.

use std::path::PathBuf;

use clap::Args;

use super::inputs::find_inputs;
use super::output::{ExitStatus, write_result};
use crate::evaluation::reference::Entry;
use crate::evaluation::{BenchmarkRecord, Source, limited};
use crate::report::leaderboard;
use crate::report::page::folder_names;

const AFTER: &str = "\
Examples:
  reactsim leaderboard references/reactsim-bench-v2 entries/*
  reactsim leaderboard references/reactsim-bench-v2 entries/* --html leaderboard.html

An entry is a run folder (`reactsim run --out`) on a whole benchmark, with the settings of the \
first entry. It is verified if it has rollouts (--keep-rollouts) that reproduce its numbers. Methods \
are ranked by Pareto fronts of collisions with the AV, ADE and progress.";

/// Arguments of `leaderboard`.
#[derive(Debug, Args)]
#[command(after_help = AFTER)]
pub(super) struct LeaderboardArgs {
    /// Folders of references and runs
    #[arg(required = true, value_name = "FOLDER")]
    folders: Vec<PathBuf>,
    /// Scenarios of the benchmark, unless they ship with the program
    #[arg(long, value_name = "PATH")]
    scenarios: Option<PathBuf>,
    /// Format of the output
    #[arg(long, default_value = "markdown", value_parser = leaderboard::FORMS)]
    format: String,
    /// Also write the table to this file, as an HTML page
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
}

pub(super) fn leaderboard(args: &LeaderboardArgs) -> anyhow::Result<ExitStatus> {
    let open = |benchmark: &BenchmarkRecord| find_scenarios(args, benchmark);
    let mut entries: Vec<Entry> = Vec::new();
    for (name, folder) in folder_names(&args.folders).into_iter().zip(&args.folders) {
        let entry = Entry::read(folder, name, open)?;
        if let Some(first) = entries.first() {
            entry.check_comparable(first)?;
        }
        entries.push(entry);
    }
    write_result(None, |out| leaderboard::write(&entries, &args.format, out))?;
    if let Some(path) = &args.html {
        write_result(Some(path), |out| leaderboard::write_page(&entries, out))?;
    }
    Ok(ExitStatus::Done)
}

/// Finds the scenarios of a benchmark among the shipped and the given ones.
fn find_scenarios(args: &LeaderboardArgs, benchmark: &BenchmarkRecord) -> Option<Source> {
    let given = args.scenarios.iter().filter_map(|path| {
        let inputs = find_inputs(std::slice::from_ref(path)).ok()?;
        Source::of_inputs(limited(inputs, None, None)).ok()
    });
    let mut sources = std::iter::once(Source::shipped(usize::MAX)).chain(given.flatten());
    sources.find(|source| source.file.blake3 == benchmark.blake3)
}
