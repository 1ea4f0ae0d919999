//! `reactsim curate review`: serves the page on which people verify candidates.

use std::env;
use std::path::PathBuf;

use anyhow::Context;
use clap::Args;

use crate::cli::{ExitStatus, say, write_result};
use crate::curation::review::{ReviewOptions, ReviewServer, is_reviewer};
use crate::curation::store::Store;
use crate::web::Stop;

/// Arguments of `curate review`.
#[derive(Debug, Args)]
pub(super) struct ReviewArgs {
    /// A file that `curate` wrote
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Port of the page, on this machine only; 0 for any free one
    #[arg(long, default_value_t = 0, value_name = "PORT")]
    port: u16,
    /// Your name, recorded with your decisions [default: the page asks]
    #[arg(long, value_name = "NAME", value_parser = reviewer)]
    reviewer: Option<String>,
    /// Journal of another reviewer, to show next to your own decisions; may be repeated
    #[arg(long, value_name = "JOURNAL")]
    reviews: Vec<PathBuf>,
}

fn reviewer(name: &str) -> Result<String, String> {
    let expected = || "expected 1 to 100 characters on one line".to_owned();
    is_reviewer(name).then(|| name.to_owned()).ok_or_else(expected)
}

pub(super) fn review(args: &ReviewArgs) -> anyhow::Result<ExitStatus> {
    let store = Store::open(&args.file)?;
    let options = ReviewOptions {
        port: args.port,
        reviews: args.reviews.clone(),
        reviewer: args.reviewer.clone(),
        suggestion: env::var("USER").or_else(|_| env::var("USERNAME")).unwrap_or_default(),
        ..ReviewOptions::default()
    };
    let server = ReviewServer::new(store, options)?;
    for warning in server.warnings() {
        say(format_args!("warning: {warning}"));
    }
    let journal = server.journal().display().to_string();
    let url = server.url();
    let stop = Stop::default();
    let handle = stop.clone();
    ctrlc::set_handler(move || handle.stop()).context("could not install the interrupt handler")?;
    write_result(None, |out| writeln!(out, "{url}"))?;
    say(format_args!("open this address in a browser; press ^C to end the review"));
    server.run(&stop)?;
    say(format_args!("decisions are in {journal}"));
    Ok(ExitStatus::Done)
}
