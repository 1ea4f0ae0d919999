//! The fields of `waymo.open_dataset.Scenario` that are read, by scenarios or by the metrics of the challenge
//! (heights); all others are skipped.

use prost::{Message, Oneof};

#[derive(Message)]
pub(crate) struct Scenario {
    #[prost(string, tag = "5")]
    pub(crate) scenario_id: String,
    #[prost(double, repeated, tag = "1")]
    pub(crate) timestamps_seconds: Vec<f64>,
    #[prost(int32, tag = "10")]
    pub(crate) current_time_index: i32,
    #[prost(message, repeated, tag = "2")]
    pub(crate) tracks: Vec<Track>,
    #[prost(message, repeated, tag = "7")]
    pub(crate) dynamic_map_states: Vec<DynamicMapState>,
    #[prost(message, repeated, tag = "8")]
    pub(crate) map_features: Vec<MapFeature>,
    #[prost(int32, tag = "6")]
    pub(crate) sdc_track_index: i32,
    #[prost(int32, repeated, tag = "4")]
    pub(crate) objects_of_interest: Vec<i32>,
    #[prost(message, repeated, tag = "11")]
    pub(crate) tracks_to_predict: Vec<RequiredPrediction>,
}

#[derive(Message)]
pub(crate) struct RequiredPrediction {
    #[prost(int32, tag = "1")]
    pub(crate) track_index: i32,
}

#[derive(Message)]
pub(crate) struct Track {
    #[prost(int32, tag = "1")]
    pub(crate) id: i32,
    #[prost(int32, tag = "2")]
    pub(crate) object_type: i32,
    #[prost(message, repeated, tag = "3")]
    pub(crate) states: Vec<ObjectState>,
}

#[derive(Clone, Copy, Message)]
pub(crate) struct ObjectState {
    #[prost(double, tag = "2")]
    pub(crate) center_x: f64,
    #[prost(double, tag = "3")]
    pub(crate) center_y: f64,
    #[prost(double, tag = "4")]
    pub(crate) center_z: f64,
    #[prost(float, tag = "5")]
    pub(crate) length: f32,
    #[prost(float, tag = "6")]
    pub(crate) width: f32,
    #[prost(float, tag = "7")]
    pub(crate) height: f32,
    #[prost(float, tag = "8")]
    pub(crate) heading: f32,
    #[prost(float, tag = "9")]
    pub(crate) velocity_x: f32,
    #[prost(float, tag = "10")]
    pub(crate) velocity_y: f32,
    #[prost(bool, tag = "11")]
    pub(crate) valid: bool,
}

#[derive(Message)]
pub(crate) struct DynamicMapState {
    #[prost(message, repeated, tag = "1")]
    pub(crate) lane_states: Vec<TrafficSignalLaneState>,
}

#[derive(Clone, Copy, Message)]
pub(crate) struct TrafficSignalLaneState {
    #[prost(int64, tag = "1")]
    pub(crate) lane: i64,
    #[prost(int32, tag = "2")]
    pub(crate) state: i32,
    #[prost(message, optional, tag = "3")]
    pub(crate) stop_point: Option<MapPoint>,
}

#[derive(Clone, Copy, Message)]
pub(crate) struct MapPoint {
    #[prost(double, tag = "1")]
    pub(crate) x: f64,
    #[prost(double, tag = "2")]
    pub(crate) y: f64,
    #[prost(double, tag = "3")]
    pub(crate) z: f64,
}

#[derive(Message)]
pub(crate) struct MapFeature {
    #[prost(int64, tag = "1")]
    pub(crate) id: i64,
    #[prost(oneof = "Feature", tags = "3, 4, 5, 7, 8, 9, 10")]
    pub(crate) feature: Option<Feature>,
}

#[derive(Oneof)]
pub(crate) enum Feature {
    #[prost(message, tag = "3")]
    Lane(LaneCenter),
    #[prost(message, tag = "4")]
    RoadLine(Line),
    #[prost(message, tag = "5")]
    RoadEdge(Line),
    #[prost(message, tag = "7")]
    StopSign(StopSign),
    #[prost(message, tag = "8")]
    Crosswalk(Outline),
    #[prost(message, tag = "9")]
    SpeedBump(Outline),
    #[prost(message, tag = "10")]
    Driveway(Outline),
}

#[derive(Message)]
pub(crate) struct LaneCenter {
    #[prost(double, tag = "1")]
    pub(crate) speed_limit_mph: f64,
    #[prost(int32, tag = "2")]
    pub(crate) kind: i32,
    #[prost(message, repeated, tag = "8")]
    pub(crate) polyline: Vec<MapPoint>,
    #[prost(int64, repeated, tag = "9")]
    pub(crate) entry_lanes: Vec<i64>,
    #[prost(int64, repeated, tag = "10")]
    pub(crate) exit_lanes: Vec<i64>,
    #[prost(message, repeated, tag = "11")]
    pub(crate) left_neighbors: Vec<LaneNeighbor>,
    #[prost(message, repeated, tag = "12")]
    pub(crate) right_neighbors: Vec<LaneNeighbor>,
}

#[derive(Clone, Copy, Message)]
pub(crate) struct LaneNeighbor {
    #[prost(int64, tag = "1")]
    pub(crate) feature_id: i64,
    #[prost(int32, tag = "2")]
    pub(crate) self_start_index: i32,
    #[prost(int32, tag = "3")]
    pub(crate) self_end_index: i32,
    #[prost(int32, tag = "4")]
    pub(crate) neighbor_start_index: i32,
    #[prost(int32, tag = "5")]
    pub(crate) neighbor_end_index: i32,
}

/// A road line or a road edge.
#[derive(Message)]
pub(crate) struct Line {
    #[prost(int32, tag = "1")]
    pub(crate) kind: i32,
    #[prost(message, repeated, tag = "2")]
    pub(crate) polyline: Vec<MapPoint>,
}

#[derive(Message)]
pub(crate) struct StopSign {
    #[prost(int64, repeated, tag = "1")]
    pub(crate) lane: Vec<i64>,
    #[prost(message, optional, tag = "2")]
    pub(crate) position: Option<MapPoint>,
}

/// A crosswalk, a speed bump or a driveway.
#[derive(Message)]
pub(crate) struct Outline {
    #[prost(message, repeated, tag = "1")]
    pub(crate) polygon: Vec<MapPoint>,
}
