//! `reactsim leaderboard`: references and runs of others in one table.

use std::path::PathBuf;

use clap::Args;

use super::subject::open_sources;
use super::{ExitStatus, find_inputs, gallery, write_result};
use crate::evaluation::reference::Entry;
use crate::evaluation::{BenchmarkRecord, Source};
use crate::report::leaderboard;

const AFTER: &str = "\
  reactsim leaderboard references/reactsim-bench-v1 entries/*
  reactsim leaderboard references/reactsim-bench-v1 entries/* --html leaderboard.html

An entry is a folder that `reactsim run --out` left, on a whole benchmark and with the settings of the
first entry. It is verified if it was made with --keep-rollouts and they give its numbers again.";

/// Arguments of `leaderboard`.
#[derive(Debug, Args)]
#[command(after_help = AFTER)]
pub(super) struct LeaderboardArgs {
    /// Folders of references and runs
    #[arg(required = true, value_name = "FOLDER")]
    folders: Vec<PathBuf>,
    /// Scenarios of the benchmark, where it does not ship
    #[arg(long, value_name = "PATH")]
    scenarios: Option<PathBuf>,
    /// Form of the table on stdout
    #[arg(long, default_value = "markdown", value_parser = leaderboard::FORMS)]
    format: String,
    /// Write the table as a page to this file too
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
}

pub(super) fn leaderboard(args: &LeaderboardArgs) -> anyhow::Result<ExitStatus> {
    let open = |benchmark: &BenchmarkRecord| at_hand(args, benchmark);
    let mut entries: Vec<Entry> = Vec::new();
    for (name, folder) in gallery::names(&args.folders).into_iter().zip(&args.folders) {
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

/// The scenarios of a benchmark: those that ship, or the given ones.
fn at_hand(args: &LeaderboardArgs, benchmark: &BenchmarkRecord) -> Option<Source> {
    let given = args.scenarios.iter().filter_map(|path| {
        let inputs = find_inputs(std::slice::from_ref(path)).ok()?;
        open_sources(inputs, usize::MAX).ok()
    });
    let mut sources = std::iter::once(Source::shipped(usize::MAX)).chain(given.flatten());
    sources.find(|source| source.file.blake3 == benchmark.blake3)
}
