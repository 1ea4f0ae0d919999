//! `reactsim export scenes`: scenarios as frames of the protocol for external simulators.

use std::io;

use clap::Args;

use crate::cli::inputs::select;
use crate::cli::output::{ExitStatus, say, write_result};
use crate::evaluation::ScenarioSpec;
use crate::external::{FrameWriter, SceneExtras, scene_frame};

const AFTER: &str = "\
Writes one message of type `scene` per scenario and a final `bye` to standard output; the Python \
package reads them (`reactsim.scenarios`). Without --with-future, nothing after the current frame is \
written. The protocol is described in docs/external-protocol.md.";

/// Arguments of `export scenes`.
#[derive(Debug, Args)]
#[command(after_help = AFTER)]
pub(super) struct ExportScenesArgs {
    #[command(flatten)]
    input: ScenarioSpec,
    /// Also write the logged future and the deviated AV
    #[arg(long)]
    with_future: bool,
}

pub(super) fn export(args: &ExportScenesArgs) -> anyhow::Result<ExitStatus> {
    let selected = select(&args.input)?;
    let mut failed = 0;
    write_result(None, |out| {
        let mut number = 0;
        failed = selected.each(|scenario| {
            let track = || scenario.deviation.as_ref().map(|deviation| deviation.track.clone());
            let extras =
                if args.with_future { SceneExtras::Future { av: track() } } else { SceneExtras::None };
            let mut frame = scene_frame(&scenario, number, extras);
            frame.text("seq", number.to_string());
            number += 1;
            out.write_all(&frame.to_frame().map_err(io::Error::other)?)
        })?;
        let mut bye = FrameWriter::new("bye");
        bye.text("seq", number.to_string());
        out.write_all(&bye.to_frame().map_err(io::Error::other)?)
    })?;
    if failed > 0 {
        say(format_args!("warning: {failed} failed; the others are written"));
        return Ok(ExitStatus::SomeFailed);
    }
    Ok(ExitStatus::Done)
}
