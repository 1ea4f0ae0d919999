//! Structure of a hand-written scenario file. The fields are described in `docs/files.md`.

use reactsim_scene::Length;
use serde::Deserialize;

/// Required value of `format`.
pub(super) const FORMAT: &str = "reactsim-scenario-v1";

#[derive(Deserialize)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub(super) struct RawScenario {
    pub(super) format: String,
    pub(super) id: String,
    pub(super) intent: String,
    pub(super) source: Option<String>,
    /// Frames up to and including the current one.
    #[serde(default = "history")]
    pub(super) history: usize,
    /// Frames after the current one.
    #[serde(default = "future")]
    pub(super) future: usize,
    #[serde(default)]
    pub(super) timestamps: Vec<f64>,
    pub(super) av: Option<String>,
    pub(super) agents: Vec<RawAgent>,
    #[serde(default)]
    pub(super) tracks_to_predict: Vec<String>,
    #[serde(default)]
    pub(super) objects_of_interest: Vec<String>,
    #[serde(default)]
    pub(super) map: RawMap,
    #[serde(default)]
    pub(super) lights: Vec<RawLight>,
    pub(super) deviation: Option<RawDeviation>,
}

fn history() -> usize {
    Length::BENCHMARK.history
}

fn future() -> usize {
    Length::BENCHMARK.future
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub(super) struct RawAgent {
    pub(super) id: String,
    #[serde(default = "vehicle")]
    pub(super) kind: String,
    pub(super) length: f64,
    pub(super) width: f64,
    pub(super) track: Option<RawTrack>,
    pub(super) motion: Option<RawMotion>,
}

fn vehicle() -> String {
    "vehicle".to_owned()
}

/// Track with one entry per frame; `null` where absent (x, y, heading) or unknown (vx, vy).
#[derive(Deserialize)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub(super) struct RawTrack {
    pub(super) x: Vec<Option<f64>>,
    pub(super) y: Vec<Option<f64>>,
    pub(super) heading: Vec<Option<f64>>,
    pub(super) vx: Option<Vec<Option<f64>>>,
    pub(super) vy: Option<Vec<Option<f64>>>,
}

/// Motion given by the state at the current frame, the time before it and the pieces after it.
#[derive(Deserialize)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub(super) struct RawMotion {
    pub(super) at: [f64; 2],
    #[serde(default)]
    pub(super) heading: f64,
    #[serde(default)]
    pub(super) speed: f64,
    #[serde(default)]
    pub(super) past: RawPast,
    #[serde(default)]
    pub(super) pieces: Vec<RawPiece>,
    pub(super) frames: Option<[usize; 2]>,
}

#[derive(Clone, Copy, Default, Deserialize)]
#[serde(default, deny_unknown_fields, expecting = "an object")]
pub(super) struct RawPast {
    pub(super) acceleration: f64,
    pub(super) curvature: f64,
}

/// Time interval with constant acceleration and curvature, and a lateral shift.
#[derive(Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub(super) struct RawPiece {
    pub(super) seconds: f64,
    #[serde(default)]
    pub(super) acceleration: f64,
    #[serde(default)]
    pub(super) curvature: f64,
    #[serde(default)]
    pub(super) shift: f64,
}

#[derive(Default, Deserialize)]
#[serde(default, deny_unknown_fields, expecting = "an object")]
pub(super) struct RawMap {
    pub(super) lanes: Vec<RawLane>,
    pub(super) road_edges: Vec<RawEdge>,
    pub(super) road_lines: Vec<RawLine>,
    pub(super) stop_lines: Vec<RawStopLine>,
    pub(super) crosswalks: Vec<Vec<[f64; 2]>>,
    pub(super) speed_bumps: Vec<Vec<[f64; 2]>>,
    pub(super) driveways: Vec<Vec<[f64; 2]>>,
    pub(super) intersections: Vec<Vec<[f64; 2]>>,
    pub(super) drivable_area: Option<Vec<RawPolygon>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub(super) struct RawLane {
    pub(super) id: String,
    #[serde(default = "lane")]
    pub(super) kind: String,
    #[serde(default = "surface_street")]
    pub(super) class: String,
    pub(super) speed_limit: Option<f64>,
    pub(super) points: Option<Vec<[f64; 2]>>,
    pub(super) path: Option<RawPath>,
    pub(super) half_width: Option<f64>,
    pub(super) polygon: Option<Vec<[f64; 2]>>,
    #[serde(default)]
    pub(super) successors: Vec<String>,
    pub(super) predecessors: Option<Vec<String>>,
    #[serde(default)]
    pub(super) left: Vec<RawNeighbor>,
    #[serde(default)]
    pub(super) right: Vec<RawNeighbor>,
}

fn lane() -> String {
    "lane".to_owned()
}

fn surface_street() -> String {
    "surface_street".to_owned()
}

/// Line from a point through straight pieces and arcs.
#[derive(Deserialize)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub(super) struct RawPath {
    pub(super) at: [f64; 2],
    #[serde(default)]
    pub(super) heading: f64,
    pub(super) pieces: Vec<RawArc>,
}

#[derive(Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub(super) struct RawArc {
    pub(super) length: f64,
    #[serde(default)]
    pub(super) curvature: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub(super) struct RawNeighbor {
    pub(super) lane: String,
    pub(super) self_start: Option<u32>,
    pub(super) self_end: Option<u32>,
    pub(super) other_start: Option<u32>,
    pub(super) other_end: Option<u32>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub(super) struct RawEdge {
    #[serde(default = "boundary")]
    pub(super) kind: String,
    pub(super) points: Option<Vec<[f64; 2]>>,
    pub(super) path: Option<RawPath>,
}

fn boundary() -> String {
    "boundary".to_owned()
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub(super) struct RawLine {
    #[serde(default)]
    pub(super) paint: u8,
    pub(super) points: Option<Vec<[f64; 2]>>,
    pub(super) path: Option<RawPath>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub(super) struct RawStopLine {
    pub(super) kind: String,
    pub(super) lane: String,
    pub(super) at: [f64; 2],
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub(super) struct RawPolygon {
    pub(super) exterior: Vec<[f64; 2]>,
    #[serde(default)]
    pub(super) holes: Vec<Vec<[f64; 2]>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub(super) struct RawLight {
    pub(super) lane: String,
    pub(super) stop_point: [f64; 2],
    pub(super) states: Option<Vec<Option<String>>>,
    pub(super) phases: Option<Vec<RawPhase>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub(super) struct RawPhase {
    pub(super) state: Option<String>,
    pub(super) seconds: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub(super) struct RawDeviation {
    pub(super) category: Option<String>,
    pub(super) track: Option<RawTrack>,
    pub(super) pieces: Option<Vec<RawPiece>>,
}
