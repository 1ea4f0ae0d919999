//! `reactsim completions` and `reactsim man`: files for shells and for `man`.

use std::fs::{self, DirEntry};
use std::io;
use std::path::PathBuf;

use anyhow::Context;
use clap::{Args, Command};
use clap_complete::Shell;

use super::output::{ExitStatus, count, lock_folder, say, write_result};

/// Arguments of `completions`.
#[derive(Debug, Args)]
pub(super) struct CompletionsArgs {
    /// The shell
    shell: Shell,
}

/// Arguments of `man`.
#[derive(Debug, Args)]
pub(super) struct ManArgs {
    /// Folder for the pages, one per command
    #[arg(long, value_name = "FOLDER")]
    out: PathBuf,
}

/// Prints the completion script of the program with this definition of its arguments.
pub(super) fn completions(args: &CompletionsArgs, mut program: Command) -> anyhow::Result<ExitStatus> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut program, "reactsim", &mut script);
    write_result(None, |out| out.write_all(&script))?;
    Ok(ExitStatus::Done)
}

/// Writes the manual pages of the program with this definition of its arguments.
pub(super) fn man(args: &ManArgs, program: Command) -> anyhow::Result<ExitStatus> {
    let folder = &args.out;
    let _lock = lock_folder(folder)?;
    clap_mangen::generate_to(program, folder)
        .with_context(|| format!("could not write manual pages to {}", folder.display()))?;
    let is_page = |entry: &io::Result<DirEntry>| {
        entry.as_ref().is_ok_and(|entry| entry.path().extension().is_some_and(|extension| extension == "1"))
    };
    let pages = fs::read_dir(folder).map_or(0, |entries| entries.filter(is_page).count());
    say(format_args!("{}: {}", folder.display(), count(pages, "page")));
    Ok(ExitStatus::Done)
}
