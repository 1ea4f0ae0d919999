//! The fields of `waymo.open_dataset.Scenario` that are read, by scenarios or by the metrics of the challenge
//! (heights); all others are passed over.

use reactsim_geometry::Vec2;
use reactsim_scene::AgentKind;

use crate::error::Cause;
use crate::wire::{Fields, Key, WireError};

/// Maximum number of fields that are kept, and of bytes with ids: few bytes can expand to much memory. The
/// largest scenarios have some hundred thousand.
const MAX_FIELDS: usize = 1_000_000;
/// Size of a field with a `double` and of one with a `float` in bytes, for tags below 16.
const DOUBLE_SIZE: usize = 9;
const FLOAT_SIZE: usize = 5;
/// Size of a field with a point of three coordinates in bytes.
const POINT_SIZE: usize = 2 + 3 * DOUBLE_SIZE;

#[derive(Default)]
pub(crate) struct Scenario {
    pub(crate) scenario_id: String,
    pub(crate) timestamps_seconds: Vec<f64>,
    pub(crate) current_time_index: i32,
    pub(crate) tracks: Vec<Track>,
    pub(crate) dynamic_map_states: Vec<DynamicMapState>,
    pub(crate) map_features: Vec<MapFeature>,
    pub(crate) sdc_track_index: i32,
    pub(crate) objects_of_interest: Vec<i32>,
    /// Indices of tracks.
    pub(crate) tracks_to_predict: Vec<i32>,
}

#[derive(Default)]
pub(crate) struct Track {
    pub(crate) id: i32,
    pub(crate) object_type: i32,
    pub(crate) states: Vec<ObjectState>,
}

#[derive(Clone, Copy, Default)]
pub(crate) struct ObjectState {
    pub(crate) center_x: f64,
    pub(crate) center_y: f64,
    pub(crate) center_z: f64,
    pub(crate) length: f32,
    pub(crate) width: f32,
    pub(crate) height: f32,
    pub(crate) heading: f32,
    pub(crate) velocity_x: f32,
    pub(crate) velocity_y: f32,
    pub(crate) valid: bool,
}

#[derive(Default)]
pub(crate) struct DynamicMapState {
    pub(crate) lane_states: Vec<TrafficSignalLaneState>,
}

#[derive(Clone, Copy, Default)]
pub(crate) struct TrafficSignalLaneState {
    pub(crate) lane: i64,
    pub(crate) state: i32,
    pub(crate) stop_point: Option<MapPoint>,
}

#[derive(Clone, Copy, Default)]
pub(crate) struct MapPoint {
    pub(crate) x: f64,
    pub(crate) y: f64,
    pub(crate) z: f64,
}

/// A list of `MapPoint`.
#[derive(Default)]
pub(crate) struct Points {
    pub(crate) points: Vec<Vec2>,
    /// The height of each point.
    pub(crate) heights: Vec<f64>,
}

#[derive(Default)]
pub(crate) struct MapFeature {
    pub(crate) id: i64,
    pub(crate) feature: Option<Feature>,
}

pub(crate) enum Feature {
    Lane(LaneCenter),
    RoadLine(Line),
    RoadEdge(Line),
    StopSign(StopSign),
    Crosswalk(Points),
    SpeedBump(Points),
    Driveway(Points),
}

#[derive(Default)]
pub(crate) struct LaneCenter {
    pub(crate) speed_limit_mph: f64,
    pub(crate) kind: i32,
    pub(crate) polyline: Points,
    pub(crate) entry_lanes: Vec<i64>,
    pub(crate) exit_lanes: Vec<i64>,
    pub(crate) left_neighbors: Vec<LaneNeighbor>,
    pub(crate) right_neighbors: Vec<LaneNeighbor>,
}

#[derive(Clone, Copy, Default)]
pub(crate) struct LaneNeighbor {
    pub(crate) feature_id: i64,
    pub(crate) self_start_index: i32,
    pub(crate) self_end_index: i32,
    pub(crate) neighbor_start_index: i32,
    pub(crate) neighbor_end_index: i32,
}

/// A road line or a road edge.
#[derive(Default)]
pub(crate) struct Line {
    pub(crate) kind: i32,
    pub(crate) polyline: Points,
}

#[derive(Default)]
pub(crate) struct StopSign {
    pub(crate) lane: Vec<i64>,
    pub(crate) position: Option<MapPoint>,
}

impl Scenario {
    /// Decodes a message.
    ///
    /// # Errors
    /// It is malformed, or has more fields than a scenario has.
    pub(crate) fn decode(message: &[u8]) -> Result<Self, Cause> {
        let (mut scenario, mut decoder) = (Self::default(), Decoder { left: MAX_FIELDS });
        let mut fields = Fields::new(message);
        match decoder.scenario(&mut scenario, &mut fields) {
            Ok(()) => Ok(scenario),
            Err(Problem::TooMany) => {
                let found = format!("more than {MAX_FIELDS}");
                Err(Cause::value("the number of fields", found, "a message of one scenario"))
            }
            Err(Problem::Malformed(error)) => Err(malformed(error, message.len() - fields.left())),
        }
    }

    /// Decodes only the id of the scenario in a message.
    ///
    /// # Errors
    /// The message is malformed.
    pub(crate) fn decode_id(message: &[u8]) -> Result<String, Cause> {
        let (mut id, mut fields) = ("", Fields::new(message));
        let mut read = || -> Result<(), WireError> {
            while let Some(key) = fields.key()? {
                match key.tag() {
                    5 => id = fields.text(key)?,
                    _ => drop(fields.skip(key)?),
                }
            }
            Ok(())
        };
        match read() {
            Ok(()) => Ok(id.to_owned()),
            Err(error) => Err(malformed(error, message.len() - fields.left())),
        }
    }

    /// Returns the value of a field that is the index of a track.
    pub(crate) fn track_index(&self, field: &str, value: i32) -> Result<usize, Cause> {
        let count = self.tracks.len();
        let index = usize::try_from(value).ok().filter(|&i| i < count);
        index.ok_or_else(|| Cause::value(field, value, format!("the index of one of {count} tracks")))
    }
}

impl Track {
    pub(crate) fn kind(&self) -> AgentKind {
        match self.object_type {
            1 => AgentKind::Vehicle,
            2 => AgentKind::Pedestrian,
            3 => AgentKind::Cyclist,
            _ => AgentKind::Other,
        }
    }
}

/// Returns the error of a message that is malformed before its byte `at`, within one field.
fn malformed(error: WireError, at: usize) -> Cause {
    Cause::Undecodable(format!("{error} before byte {at} of the message; fetch the file again"))
}

/// Reason why a message is refused.
enum Problem {
    Malformed(WireError),
    TooMany,
}

impl From<WireError> for Problem {
    fn from(error: WireError) -> Self {
        Self::Malformed(error)
    }
}

/// Decoder of the messages within a scenario: each is merged into what earlier fields gave.
struct Decoder {
    /// Number of fields that may still be kept.
    left: usize,
}

impl Decoder {
    fn count(&mut self, fields: usize) -> Result<(), Problem> {
        self.left = self.left.checked_sub(fields).ok_or(Problem::TooMany)?;
        Ok(())
    }

    fn scenario(&mut self, scenario: &mut Scenario, fields: &mut Fields<'_>) -> Result<(), Problem> {
        while let Some(key) = fields.key()? {
            match key.tag() {
                1 => fields.doubles(key, &mut scenario.timestamps_seconds)?,
                2 => {
                    let track = self.track(fields.bytes(key)?)?;
                    scenario.tracks.push(track);
                }
                4 => self.ids(fields, key, |id| scenario.objects_of_interest.push(id as i32))?,
                5 => scenario.scenario_id = fields.text(key)?.to_owned(),
                6 => scenario.sdc_track_index = fields.int32(key)?,
                7 => {
                    let states = self.dynamic_map_state(fields.bytes(key)?)?;
                    scenario.dynamic_map_states.push(states);
                }
                8 => {
                    let feature = self.map_feature(fields.bytes(key)?)?;
                    scenario.map_features.push(feature);
                }
                10 => scenario.current_time_index = fields.int32(key)?,
                11 => {
                    let index = self.required_prediction(fields.bytes(key)?)?;
                    scenario.tracks_to_predict.push(index);
                }
                _ => drop(fields.skip(key)?),
            }
        }
        Ok(())
    }

    fn required_prediction(&mut self, content: &[u8]) -> Result<i32, Problem> {
        self.count(1)?;
        let (mut track_index, mut fields) = (0, Fields::new(content));
        while let Some(key) = fields.key()? {
            match key.tag() {
                1 => track_index = fields.int32(key)?,
                _ => drop(fields.skip(key)?),
            }
        }
        Ok(track_index)
    }

    fn track(&mut self, content: &[u8]) -> Result<Track, Problem> {
        self.count(1)?;
        let (mut track, mut fields) = (Track::default(), Fields::new(content));
        // A state takes more space in a message than in memory, unless fields are missing.
        track.states.reserve(content.len() / size_of::<ObjectState>());
        while let Some(key) = fields.key()? {
            match key.tag() {
                1 => track.id = fields.int32(key)?,
                2 => track.object_type = fields.int32(key)?,
                3 => {
                    self.count(1)?;
                    track.states.push(object_state(fields.bytes(key)?)?);
                }
                _ => drop(fields.skip(key)?),
            }
        }
        Ok(track)
    }

    fn dynamic_map_state(&mut self, content: &[u8]) -> Result<DynamicMapState, Problem> {
        self.count(1)?;
        let (mut states, mut fields) = (DynamicMapState::default(), Fields::new(content));
        while let Some(key) = fields.key()? {
            match key.tag() {
                1 => {
                    self.count(1)?;
                    states.lane_states.push(lane_state(fields.bytes(key)?)?);
                }
                _ => drop(fields.skip(key)?),
            }
        }
        Ok(states)
    }

    fn map_feature(&mut self, content: &[u8]) -> Result<MapFeature, Problem> {
        // The content of a variant, into which further fields are merged, or an empty one after another
        // variant.
        macro_rules! last {
            ($variant:ident, $feature:expr) => {
                match $feature.take() {
                    Some(Feature::$variant(last)) => last,
                    _ => Default::default(),
                }
            };
        }
        self.count(1)?;
        let (mut id, mut feature, mut fields) = (0, None, Fields::new(content));
        while let Some(key) = fields.key()? {
            feature = Some(match key.tag() {
                3 => Feature::Lane(self.lane(last!(Lane, feature), fields.bytes(key)?)?),
                4 => Feature::RoadLine(self.line(last!(RoadLine, feature), fields.bytes(key)?)?),
                5 => Feature::RoadEdge(self.line(last!(RoadEdge, feature), fields.bytes(key)?)?),
                7 => Feature::StopSign(self.stop_sign(last!(StopSign, feature), fields.bytes(key)?)?),
                8 => Feature::Crosswalk(self.outline(last!(Crosswalk, feature), fields.bytes(key)?)?),
                9 => Feature::SpeedBump(self.outline(last!(SpeedBump, feature), fields.bytes(key)?)?),
                10 => Feature::Driveway(self.outline(last!(Driveway, feature), fields.bytes(key)?)?),
                tag => {
                    match tag {
                        1 => id = fields.int64(key)?,
                        _ => drop(fields.skip(key)?),
                    }
                    continue;
                }
            });
        }
        Ok(MapFeature { id, feature })
    }

    fn lane(&mut self, mut lane: LaneCenter, content: &[u8]) -> Result<LaneCenter, Problem> {
        lane.polyline.reserve(content);
        let mut fields = Fields::new(content);
        while let Some(key) = fields.key()? {
            match key.tag() {
                1 => lane.speed_limit_mph = fields.double(key)?,
                2 => lane.kind = fields.int32(key)?,
                8 => self.point(&mut lane.polyline, fields.bytes(key)?)?,
                9 => self.ids(&mut fields, key, |id| lane.entry_lanes.push(id))?,
                10 => self.ids(&mut fields, key, |id| lane.exit_lanes.push(id))?,
                11 => self.neighbor(&mut lane.left_neighbors, fields.bytes(key)?)?,
                12 => self.neighbor(&mut lane.right_neighbors, fields.bytes(key)?)?,
                _ => drop(fields.skip(key)?),
            }
        }
        Ok(lane)
    }

    fn neighbor(&mut self, neighbors: &mut Vec<LaneNeighbor>, content: &[u8]) -> Result<(), Problem> {
        self.count(1)?;
        let (mut neighbor, mut fields) = (LaneNeighbor::default(), Fields::new(content));
        while let Some(key) = fields.key()? {
            match key.tag() {
                1 => neighbor.feature_id = fields.int64(key)?,
                2 => neighbor.self_start_index = fields.int32(key)?,
                3 => neighbor.self_end_index = fields.int32(key)?,
                4 => neighbor.neighbor_start_index = fields.int32(key)?,
                5 => neighbor.neighbor_end_index = fields.int32(key)?,
                _ => drop(fields.skip(key)?),
            }
        }
        neighbors.push(neighbor);
        Ok(())
    }

    fn line(&mut self, mut line: Line, content: &[u8]) -> Result<Line, Problem> {
        line.polyline.reserve(content);
        let mut fields = Fields::new(content);
        while let Some(key) = fields.key()? {
            match key.tag() {
                1 => line.kind = fields.int32(key)?,
                2 => self.point(&mut line.polyline, fields.bytes(key)?)?,
                _ => drop(fields.skip(key)?),
            }
        }
        Ok(line)
    }

    fn stop_sign(&mut self, mut sign: StopSign, content: &[u8]) -> Result<StopSign, Problem> {
        let mut fields = Fields::new(content);
        while let Some(key) = fields.key()? {
            match key.tag() {
                1 => self.ids(&mut fields, key, |id| sign.lane.push(id))?,
                2 => sign.position = Some(map_point(sign.position.unwrap_or_default(), fields.bytes(key)?)?),
                _ => drop(fields.skip(key)?),
            }
        }
        Ok(sign)
    }

    /// Decodes a crosswalk, a speed bump or a driveway.
    fn outline(&mut self, mut outline: Points, content: &[u8]) -> Result<Points, Problem> {
        outline.reserve(content);
        let mut fields = Fields::new(content);
        while let Some(key) = fields.key()? {
            match key.tag() {
                1 => self.point(&mut outline, fields.bytes(key)?)?,
                _ => drop(fields.skip(key)?),
            }
        }
        Ok(outline)
    }

    fn point(&mut self, line: &mut Points, content: &[u8]) -> Result<(), Problem> {
        self.count(1)?;
        let MapPoint { x, y, z } = map_point(MapPoint::default(), content)?;
        line.points.push(Vec2::new(x, y));
        line.heights.push(z);
        Ok(())
    }

    /// Passes the ids of a list on. Each takes at least one byte.
    fn ids(&mut self, fields: &mut Fields<'_>, key: Key, mut add: impl FnMut(i64)) -> Result<(), Problem> {
        let ids = fields.int64s(key)?;
        self.count(ids.most())?;
        for id in ids {
            add(id?);
        }
        Ok(())
    }
}

impl Points {
    /// Makes room for the points of a message; there can be more if they have fewer than three coordinates.
    fn reserve(&mut self, content: &[u8]) {
        let points = content.len() / POINT_SIZE;
        self.points.reserve(points);
        self.heights.reserve(points);
    }
}

fn object_state(content: &[u8]) -> Result<ObjectState, WireError> {
    if let Some(state) = whole_state(content) {
        return Ok(state);
    }
    let (mut state, mut fields) = (ObjectState::default(), Fields::new(content));
    while let Some(key) = fields.key()? {
        match key.tag() {
            2 => state.center_x = fields.double(key)?,
            3 => state.center_y = fields.double(key)?,
            4 => state.center_z = fields.double(key)?,
            5 => state.length = fields.float(key)?,
            6 => state.width = fields.float(key)?,
            7 => state.height = fields.float(key)?,
            8 => state.heading = fields.float(key)?,
            9 => state.velocity_x = fields.float(key)?,
            10 => state.velocity_y = fields.float(key)?,
            11 => state.valid = fields.flag(key)?,
            _ => drop(fields.skip(key)?),
        }
    }
    Ok(state)
}

/// Decodes a state with all of its fields, each once and by ascending tags, as the data set has it: the keys
/// of the fields are then at known places. `None` for any other state.
fn whole_state(content: &[u8]) -> Option<ObjectState> {
    let (center, rest) = content.split_at_checked(3 * DOUBLE_SIZE)?;
    let [[0x11, x @ ..], [0x19, y @ ..], [0x21, z @ ..]] = center.as_chunks::<DOUBLE_SIZE>().0 else {
        return None;
    };
    let (numbers, [0x58, valid @ 0..=1]) = rest.as_chunks::<FLOAT_SIZE>() else { return None };
    let [
        [0x2d, length @ ..],
        [0x35, width @ ..],
        [0x3d, height @ ..],
        [0x45, heading @ ..],
        [0x4d, velocity_x @ ..],
        [0x55, velocity_y @ ..],
    ] = numbers
    else {
        return None;
    };
    let number = |bytes: &[u8; 4]| f32::from_le_bytes(*bytes);
    Some(ObjectState {
        center_x: f64::from_le_bytes(*x),
        center_y: f64::from_le_bytes(*y),
        center_z: f64::from_le_bytes(*z),
        length: number(length),
        width: number(width),
        height: number(height),
        heading: number(heading),
        velocity_x: number(velocity_x),
        velocity_y: number(velocity_y),
        valid: *valid == 1,
    })
}

fn lane_state(content: &[u8]) -> Result<TrafficSignalLaneState, WireError> {
    let (mut state, mut fields) = (TrafficSignalLaneState::default(), Fields::new(content));
    while let Some(key) = fields.key()? {
        match key.tag() {
            1 => state.lane = fields.int64(key)?,
            2 => state.state = fields.int32(key)?,
            3 => {
                state.stop_point = Some(map_point(state.stop_point.unwrap_or_default(), fields.bytes(key)?)?)
            }
            _ => drop(fields.skip(key)?),
        }
    }
    Ok(state)
}

fn map_point(mut point: MapPoint, content: &[u8]) -> Result<MapPoint, WireError> {
    // As the data set has it: three coordinates by ascending tags.
    if let ([[0x09, x @ ..], [0x11, y @ ..], [0x19, z @ ..]], []) = content.as_chunks::<DOUBLE_SIZE>() {
        let [x, y, z] = [x, y, z].map(|bytes| f64::from_le_bytes(*bytes));
        return Ok(MapPoint { x, y, z });
    }
    let mut fields = Fields::new(content);
    while let Some(key) = fields.key()? {
        match key.tag() {
            1 => point.x = fields.double(key)?,
            2 => point.y = fields.double(key)?,
            3 => point.z = fields.double(key)?,
            _ => drop(fields.skip(key)?),
        }
    }
    Ok(point)
}
