//! `reactsim export scenes`: scenarios as frames of the protocol for external simulators.

use std::io::{self, Write};

use clap::Args;

use crate::cli::inputs::select;
use crate::cli::output::{ExitStatus, say, write_result};
use crate::evaluation::Deviations;
use crate::evaluation::ScenarioSpec;
use crate::external::{FrameWriter, SceneExtras, scene_frame};
use crate::scene::Scenario;

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
            let av = chosen_av(&scenario, selected.deviations.as_ref());
            write_scene(&scenario, av, args.with_future, number, out)?;
            number += 1;
            io::Result::Ok(())
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

/// States of a deviated AV at every step, if there is one.
type AvTrack = Option<Vec<crate::scene::AgentState>>;

/// Returns the deviated AV of a scenario: with a file of deviations, the one there.
fn chosen_av(scenario: &Scenario, deviations: Option<&Deviations>) -> AvTrack {
    match deviations {
        Some(deviations) => Some(deviations.tracks.get(&scenario.id)?.track_in(scenario.origin)),
        None => scenario.deviation.as_ref().map(|deviation| deviation.track.clone()),
    }
}

fn write_scene(
    scenario: &Scenario,
    av: AvTrack,
    future: bool,
    number: u64,
    out: &mut dyn Write,
) -> io::Result<()> {
    let extras = if future { SceneExtras::Future { av } } else { SceneExtras::None };
    let mut frame = scene_frame(scenario, number, extras);
    frame.text("seq", number.to_string());
    out.write_all(&frame.to_frame().map_err(io::Error::other)?)
}
