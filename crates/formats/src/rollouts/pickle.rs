//! Rollouts of one scenario as a Python pickle of numpy arrays, in the file layout of ReactSim-Bench.

use reactsim_geometry::Vec2;
use reactsim_scene::{FUTURE, Frame, HISTORY};

use super::RolloutRecord;
use crate::error::Cause;

/// Value of `format`.
const FORMAT: &str = "reactsim-bench-rollouts-v1";
/// Columns of the trajectories.
const COLUMNS: [&str; 5] = ["x", "y", "heading", "vx", "vy"];

/// Returns the pickle (protocol 4) of the rollouts of a scenario by one simulator, in world coordinates: see
/// `docs/files.md`. The rollouts have the same agents.
///
/// # Errors
/// [`Cause`] for rollouts of other lengths than those of ReactSim-Bench.
pub fn to_pickle(rollouts: &[RolloutRecord]) -> Result<Vec<u8>, Cause> {
    let mut out = Pickle(b"\x80\x04}".to_vec());
    let Some(first) = rollouts.first() else { return Ok(out.end()) };
    if let Some(track) = rollouts.iter().flat_map(|r| &r.tracks).find(|track| track.len() != FUTURE) {
        let field = format!("the number of steps of `{}`", first.scenario_id);
        return Err(Cause::value(field, track.len(), format!("{FUTURE}, as in ReactSim-Bench")));
    }
    let tracks: Vec<Vec<Vec<Frame>>> = rollouts.iter().map(|r| r.tracks_in(Vec2::zeros())).collect();
    let frames = || tracks.iter().flatten().flatten();
    let states = frames()
        .flat_map(|frame| frame.map_or([f64::NAN; COLUMNS.len()], |s| [s.x, s.y, s.heading, s.vx, s.vy]));
    let shape = [rollouts.len(), first.agent_ids.len(), FUTURE, COLUMNS.len()];
    out.entry("format", |out| out.text(FORMAT));
    out.entry("scenario", |out| out.text(&first.scenario_id));
    out.entry("simulator", |out| out.text(&first.simulator));
    out.entry("first_frame", |out| out.whole(HISTORY));
    out.entry("agent_ids", |out| out.texts(&first.agent_ids));
    out.entry("columns", |out| out.texts(&COLUMNS));
    out.entry("trajectories", |out| out.array("f8", &shape, states.flat_map(f64::to_le_bytes).collect()));
    let valid = frames().map(|frame| u8::from(frame.is_some())).collect();
    out.entry("valid", |out| out.array("b1", &shape[..3], valid));
    Ok(out.end())
}

/// A pickle of a dictionary that is being written.
struct Pickle(Vec<u8>);

impl Pickle {
    fn entry(&mut self, key: &str, value: impl FnOnce(&mut Self)) {
        self.text(key);
        value(self);
        self.put(b"s");
    }

    fn end(mut self) -> Vec<u8> {
        self.put(b".");
        self.0
    }

    fn put(&mut self, bytes: &[u8]) {
        self.0.extend_from_slice(bytes);
    }

    fn text(&mut self, text: &str) {
        self.put(b"\x8d");
        self.put(&(text.len() as u64).to_le_bytes());
        self.put(text.as_bytes());
    }

    fn texts(&mut self, texts: &[impl AsRef<str>]) {
        self.put(b"](");
        texts.iter().for_each(|text| self.text(text.as_ref()));
        self.put(b"e");
    }

    fn whole(&mut self, number: usize) {
        self.put(b"J");
        self.put(&(number as u32).to_le_bytes());
    }

    /// Writes an array of a type of numpy, as numpy does.
    fn array(&mut self, kind: &str, shape: &[usize], content: Vec<u8>) {
        self.put(b"cnumpy.core.multiarray\n_reconstruct\ncnumpy\nndarray\nK\0\x85C\x01b\x87R(K\x01(");
        shape.iter().for_each(|size| self.whole(*size));
        self.put(b"tcnumpy\ndtype\n");
        self.text(kind);
        self.put(b"\x89\x88\x87R(K\x03");
        self.text(if kind == "b1" { "|" } else { "<" });
        self.put(b"NNNJ\xff\xff\xff\xffJ\xff\xff\xff\xffK\0tb\x89\x8e");
        self.put(&(content.len() as u64).to_le_bytes());
        self.put(&content);
        self.put(b"tb");
    }
}
