//! A recorded scenario as the metrics of the challenge read it.

use std::collections::BTreeSet;

use crate::{AgentKind, CURRENT, FRAMES, HISTORY, SceneError, limits};

/// Largest magnitude of a world coordinate in metres; beyond it, single precision resolves less than a metre.
const MAX_WORLD_COORDINATE: f32 = 1e7;

/// Maximum length of the id of a scenario in bytes.
const MAX_ID_LENGTH: usize = 1000;

/// A recorded scenario in world coordinates. Everything is in single precision, the precision of the official
/// code: values that files store in double precision are rounded once, when they are read.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct WosacLog {
    /// Id of the scenario.
    pub scenario_id: String,
    /// All recorded objects in file order.
    pub tracks: Vec<WosacTrack>,
    /// Index of the AV in `tracks`.
    pub av: usize,
    /// Indices in `tracks` of the objects that the data set marks for prediction.
    pub tracks_to_predict: Vec<usize>,
    /// Points of the road edges in map order, metres (x, y, z); the drivable side is on the left.
    pub road_edges: Vec<Vec<[f32; 3]>>,
    /// Lanes of surface streets in map order. The challenge ignores lanes of other types.
    pub surface_lanes: Vec<SurfaceLane>,
    /// Observed signals by frame, in file order; empty if the scenario has none.
    pub signals: Vec<Vec<LaneSignal>>,
}

/// A recorded object. Arrays have one entry per frame: 91, or 11 if the future is withheld (test split).
#[derive(Clone, Debug, PartialEq)]
pub struct WosacTrack {
    /// Id, unique in the scenario.
    pub id: i32,
    /// Class.
    pub kind: AgentKind,
    /// Extent along the heading at the current frame, metres.
    pub length: f32,
    /// Extent across the heading at the current frame, metres.
    pub width: f32,
    /// Vertical extent at the current frame, metres.
    pub height: f32,
    /// Box centres, metres; at invalid frames as stored, normally 0.
    pub x: Vec<f32>,
    /// Box centres, metres.
    pub y: Vec<f32>,
    /// Box centres, metres.
    pub z: Vec<f32>,
    /// Headings, radians counter-clockwise from the x axis, not wrapped.
    pub heading: Vec<f32>,
    /// Whether the states were observed.
    pub valid: Vec<bool>,
}

/// The centre line of a lane of a surface street.
#[derive(Clone, Debug, PartialEq)]
pub struct SurfaceLane {
    /// Id, to which signals refer.
    pub id: i64,
    /// Points in driving direction, metres.
    pub points: Vec<[f32; 2]>,
}

/// The observed signal of a lane at one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LaneSignal {
    /// Id of the lane.
    pub lane: i64,
    /// Code of the state, as in [`LightState`](crate::LightState).
    pub state: i32,
    /// Point at which to stop, metres; the origin if not recorded.
    pub stop_point: [f32; 2],
}

impl WosacTrack {
    /// Returns whether the object is simulated in the challenge: it was observed at the current frame.
    pub fn is_simulated(&self) -> bool {
        self.valid.get(CURRENT).copied().unwrap_or(false)
    }
}

impl WosacLog {
    /// Returns whether the log has the future frames that rollouts are compared with.
    pub fn has_future(&self) -> bool {
        self.tracks.iter().all(|track| track.valid.len() == FRAMES)
    }

    /// Returns the simulated objects: all that were observed at the current frame, in file order.
    pub fn simulated(&self) -> impl Iterator<Item = &WosacTrack> {
        self.tracks.iter().filter(|track| track.is_simulated())
    }

    /// Returns the ids of the evaluated objects in ascending order: the AV and the objects marked for
    /// prediction.
    pub fn evaluated(&self) -> BTreeSet<i32> {
        let indices = self.tracks_to_predict.iter().copied().chain([self.av]);
        indices.filter_map(|track| self.tracks.get(track)).map(|track| track.id).collect()
    }

    /// Checks the log after reading: indices, lengths, unique ids, finite values of plausible magnitude.
    ///
    /// # Errors
    /// The first field with an invalid value. States of objects that are not simulated are not read and not
    /// checked.
    pub fn check(&self) -> Result<(), SceneError> {
        let error = |field: String, value: String, expected: &str| {
            Err(SceneError { scenario: self.scenario_id.clone(), field, value, expected: expected.into() })
        };
        let id = &self.scenario_id;
        if id.is_empty() || id.len() > MAX_ID_LENGTH || id.contains(char::is_control) {
            let expected = "an id of 1 to 1000 bytes without control characters";
            return error("scenario_id".into(), format!("`{}`", id.escape_debug()), expected);
        }
        for (field, index) in [("sdc_track_index", self.av)]
            .into_iter()
            .chain(self.tracks_to_predict.iter().map(|&track| ("tracks_to_predict", track)))
        {
            if index >= self.tracks.len() {
                return error(field.into(), index.to_string(), "the index of a track");
            }
        }
        let frames = self.tracks[self.av].valid.len();
        if frames != FRAMES && frames != HISTORY {
            let expected = "91 (9.1 s at 10 Hz), or 11 without the future";
            return error("the number of states of the AV".into(), frames.to_string(), expected);
        }
        let mut ids = BTreeSet::new();
        for (i, track) in self.tracks.iter().enumerate() {
            let lengths = [&track.x, &track.y, &track.z, &track.heading].map(Vec::len);
            if track.valid.len() != frames || lengths != [frames; 4] {
                let expected = format!("{frames}, as of the AV");
                return error(
                    format!("the number of tracks[{i}].states"),
                    track.valid.len().to_string(),
                    &expected,
                );
            }
            if !ids.insert(track.id) {
                return error(format!("tracks[{i}].id"), track.id.to_string(), "an id of one track");
            }
            if track.is_simulated()
                && let Some((field, value, expected)) = track.implausible()
            {
                return error(format!("tracks[{i}].{field}"), value.to_string(), expected);
            }
        }
        if !self.signals.is_empty() && self.signals.len() != frames {
            let found = format!("{} entries", self.signals.len());
            return error("dynamic_map_states".into(), found, &format!("{frames} entries or none"));
        }
        let edges = self.road_edges.iter().flatten().flatten();
        let lanes = self.surface_lanes.iter().flat_map(|lane| &lane.points).flatten();
        let stops = self.signals.iter().flatten().flat_map(|signal| &signal.stop_point);
        match edges.chain(lanes).chain(stops).find(|value| !is_coordinate(**value)) {
            Some(value) => error("a point of the map".into(), value.to_string(), COORDINATE),
            None => Ok(()),
        }
    }
}

/// Description of a valid coordinate.
const COORDINATE: &str = "a finite coordinate below 10,000 km";

fn is_coordinate(value: f32) -> bool {
    value.abs() < MAX_WORLD_COORDINATE
}

impl WosacTrack {
    /// Returns the first implausible value of the track, with its field and what is expected instead.
    fn implausible(&self) -> Option<(String, f32, &'static str)> {
        let sizes = [("length", self.length), ("width", self.width), ("height", self.height)];
        let is_size = |value: f32| (0.0..limits::MAX_BOX_SIZE as f32).contains(&value);
        if let Some((field, value)) = sizes.into_iter().find(|(_, value)| !is_size(*value)) {
            return Some((format!("states[10].{field}"), value, "a size from 0 to 1000 m"));
        }
        for (field, values) in [("center_x", &self.x), ("center_y", &self.y), ("center_z", &self.z)] {
            if let Some(frame) = values.iter().position(|value| !is_coordinate(*value)) {
                return Some((format!("states[{frame}].{field}"), values[frame], COORDINATE));
            }
        }
        let is_heading = |value: f32| f64::from(value).abs() < limits::MAX_HEADING;
        let frame = self.heading.iter().position(|value| !is_heading(*value))?;
        Some((format!("states[{frame}].heading"), self.heading[frame], "a heading below a thousand turns"))
    }
}
