//! `reactsim completions` and `reactsim man`: files for shells and for `man`.

use std::fs;
use std::path::PathBuf;

use anyhow::Context;
use clap::Args;
use clap_complete::Shell;

use super::{ExitStatus, command_line, count, say, write_result};

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

pub(super) fn completions(args: &CompletionsArgs) -> anyhow::Result<ExitStatus> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut command_line(), "reactsim", &mut script);
    write_result(None, |out| out.write_all(&script))?;
    Ok(ExitStatus::Done)
}

pub(super) fn man(args: &ManArgs) -> anyhow::Result<ExitStatus> {
    let folder = &args.out;
    fs::create_dir_all(folder).with_context(|| format!("could not create {}", folder.display()))?;
    clap_mangen::generate_to(command_line(), folder)
        .with_context(|| format!("could not write manual pages to {}", folder.display()))?;
    let pages = fs::read_dir(folder).map_or(0, Iterator::count);
    say(format_args!("{}: {}", folder.display(), count(pages, "page")));
    Ok(ExitStatus::Done)
}
