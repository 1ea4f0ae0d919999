//! `reactsim view`: shows run folders in a browser, with every scene.

use std::path::PathBuf;

use anyhow::Context;
use clap::Args;

use super::gallery;
use super::output::{ExitStatus, say, write_result};
use crate::web::{Loopback, Stop};

/// Arguments of `view`.
#[derive(Debug, Args)]
pub(super) struct ViewArgs {
    /// Folders of runs or studies, written with --keep-rollouts
    #[arg(required = true, value_name = "RUN")]
    runs: Vec<PathBuf>,
    #[command(flatten)]
    scenarios: gallery::RunScenarioArgs,
    /// Port of the page, on this machine only; 0 for any free one
    #[arg(long, default_value_t = 0, value_name = "PORT")]
    port: u16,
    /// Open the page in the browser of this desktop
    #[arg(long)]
    open: bool,
}

pub(super) fn view(args: &ViewArgs) -> anyhow::Result<ExitStatus> {
    let gallery = gallery::open(&args.runs, &args.scenarios)?;
    let loopback = Loopback::bind(args.port)?;
    let url = loopback.url();
    let stop = Stop::default();
    let handle = stop.clone();
    ctrlc::set_handler(move || handle.stop()).context("could not install the interrupt handler")?;
    write_result(None, |out| writeln!(out, "{url}"))?;
    // A browser that does not open ends nothing: the address is printed.
    let opened = args.open
        && match open::that_detached(&url) {
            Ok(()) => true,
            Err(error) => {
                say(format_args!("warning: no browser could be opened: {error}"));
                false
            }
        };
    say(format_args!("{}press ^C to end", if opened { "" } else { "open this address in a browser; " }));
    gallery.serve(loopback, &stop)?;
    Ok(ExitStatus::Done)
}
