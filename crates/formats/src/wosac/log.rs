//! Reading of recorded scenarios for the metrics of the challenge.

use std::io::Read;
use std::path::{Path, PathBuf};

use reactsim_scene::{
    CURRENT, FRAMES,
    wosac::{LaneSignal, SurfaceLane, WosacLog, WosacTrack},
};

use crate::error::{Cause, FormatError};
use crate::frames::LengthChoice;
use crate::womd::message::{Feature, MapPoint, Points, Scenario, Track, TrafficSignalLaneState};
use crate::womd::record::{MAX_RECORD_LENGTH, Records, source};
use crate::womd::window::crop_to_stated;

/// Code of lanes of surface streets.
const SURFACE_STREET: i32 = 2;

/// Iterator over the logs of a file, in file order. An error with [`FormatError::ends_file`] ends the file;
/// other errors concern one record.
pub struct WosacLogs {
    path: PathBuf,
    content: Content,
    /// Index of the next record.
    next: u64,
}

enum Content {
    Records(Records),
    /// A message without framing.
    Message(Vec<u8>),
    Ended,
}

impl WosacLogs {
    /// Opens a file of the Waymo Open Motion Dataset: a TFRecord file, or one `Scenario` message without
    /// framing. Either may be compressed with gzip or zstd.
    ///
    /// # Errors
    /// [`FormatError`] if the file cannot be read at all.
    pub fn open(path: &Path) -> Result<Self, FormatError> {
        let content = if Records::starts(path) {
            Content::Records(Records::open(path)?)
        } else {
            Content::Message(read_message(path)?)
        };
        Ok(Self { path: path.to_owned(), content, next: 0 })
    }

    /// Passes over this many records without decoding them.
    pub fn pass_over(&mut self, records: u64) {
        for _ in 0..records {
            self.next += 1;
            let was_there = match &mut self.content {
                Content::Records(records) => records.next().is_some(),
                Content::Message(_) | Content::Ended => false,
            };
            if !was_there {
                self.content = Content::Ended;
                return;
            }
        }
    }

    /// Reads the scenario id of the next record, and the log if it is `wanted`.
    pub fn next_if(
        &mut self,
        wanted: impl FnOnce(&str) -> bool,
    ) -> Option<Result<(String, Option<WosacLog>), FormatError>> {
        self.next_with(|path, record, payload| {
            let id = Scenario::decode_id(payload);
            let id = id.map_err(|cause| FormatError::record(path, record, None, cause))?;
            let log = wanted(&id).then(|| decode(path, record, payload)).transpose()?;
            Ok((id, log))
        })
    }

    /// Reads the next record with this function of path, index and message.
    fn next_with<T>(
        &mut self,
        read: impl FnOnce(&Path, u64, &[u8]) -> Result<T, FormatError>,
    ) -> Option<Result<T, FormatError>> {
        let record = self.next;
        self.next += 1;
        match &mut self.content {
            Content::Records(records) => {
                let payload = records.next()?;
                Some(payload.and_then(|payload| read(&self.path, record, payload)))
            }
            Content::Message(message) => {
                let item = read(&self.path, record, message);
                self.content = Content::Ended;
                Some(item)
            }
            Content::Ended => None,
        }
    }
}

/// Reads a file, decompressed, as a whole. Longer content than that of a record is refused.
fn read_message(path: &Path) -> Result<Vec<u8>, FormatError> {
    let refuse = |e| FormatError::file(path, Cause::read(e));
    let mut message = Vec::new();
    source(path).map_err(refuse)?.take(MAX_RECORD_LENGTH + 1).read_to_end(&mut message).map_err(refuse)?;
    let expected = "at most 128 MiB of one `Scenario` message, or a TFRecord file";
    let refuse = |found: &str| Err(FormatError::file(path, Cause::value("the content", found, expected)));
    match message.len() as u64 {
        0 => refuse("empty"),
        length if length > MAX_RECORD_LENGTH => refuse("longer"),
        _ => Ok(message),
    }
}

impl Iterator for WosacLogs {
    type Item = Result<WosacLog, FormatError>;

    fn next(&mut self) -> Option<Self::Item> {
        self.next_with(decode)
    }
}

fn decode(path: &Path, record: u64, payload: &[u8]) -> Result<WosacLog, FormatError> {
    let decoded = Scenario::decode(payload);
    let mut proto = decoded.map_err(|cause| FormatError::record(path, record, None, cause))?;
    let id = proto.scenario_id.clone();
    let is_longer = proto.timestamps_seconds.len() > FRAMES;
    let cropped = is_longer.then(|| crop_to_stated(&mut proto, LengthChoice::default())).transpose();
    let log = cropped
        .and_then(|_| log(proto))
        .map_err(|cause| FormatError::record(path, record, Some(id), cause))?;
    log.check().map_err(|e| FormatError::scene(path, record, e))?;
    Ok(log)
}

/// Converts a message. Coordinates are rounded to single precision here, and only here.
fn log(proto: Scenario) -> Result<WosacLog, Cause> {
    if proto.current_time_index != CURRENT as i32 {
        return Err(Cause::value("current_time_index", proto.current_time_index, "10"));
    }
    let av = proto.track_index("sdc_track_index", proto.sdc_track_index)?;
    let tracks_to_predict = proto
        .tracks_to_predict
        .iter()
        .map(|&track| proto.track_index("tracks_to_predict.track_index", track))
        .collect::<Result<_, _>>()?;
    let (mut road_edges, mut surface_lanes) = (Vec::new(), Vec::new());
    for map_feature in proto.map_features {
        match map_feature.feature {
            Some(Feature::RoadEdge(edge)) => road_edges.push(spatial(&edge.polyline)),
            Some(Feature::Lane(lane)) if lane.kind == SURFACE_STREET => {
                surface_lanes.push(SurfaceLane { id: map_feature.id, points: planar(&lane.polyline) })
            }
            _ => (),
        }
    }
    let signals = proto.dynamic_map_states.iter().map(|frame| {
        let signal = |seen: &TrafficSignalLaneState| LaneSignal {
            lane: seen.lane,
            state: seen.state,
            stop_point: seen.stop_point.map_or([0.0; 2], |MapPoint { x, y, .. }| [x as f32, y as f32]),
        };
        frame.lane_states.iter().map(signal).collect()
    });
    Ok(WosacLog {
        scenario_id: proto.scenario_id,
        tracks: proto.tracks.iter().map(track).collect(),
        av,
        tracks_to_predict,
        road_edges,
        surface_lanes,
        signals: signals.collect(),
    })
}

fn planar(line: &Points) -> Vec<[f32; 2]> {
    line.points.iter().map(|p| [p.x as f32, p.y as f32]).collect()
}

fn spatial(line: &Points) -> Vec<[f32; 3]> {
    let points = line.points.iter().zip(&line.heights);
    points.map(|(p, z)| [p.x as f32, p.y as f32, *z as f32]).collect()
}

fn track(track: &Track) -> WosacTrack {
    let size = track.states.get(CURRENT).map_or([0.0; 3], |s| [s.length, s.width, s.height]);
    WosacTrack {
        id: track.id,
        kind: track.kind(),
        length: size[0],
        width: size[1],
        height: size[2],
        x: track.states.iter().map(|s| s.center_x as f32).collect(),
        y: track.states.iter().map(|s| s.center_y as f32).collect(),
        z: track.states.iter().map(|s| s.center_z as f32).collect(),
        heading: track.states.iter().map(|s| s.heading).collect(),
        valid: track.states.iter().map(|s| s.valid).collect(),
    }
}
