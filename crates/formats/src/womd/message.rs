//! The fields of `waymo.open_dataset.Scenario` that are read; all others are skipped.

use prost::{Message, Oneof};

#[derive(Message)]
pub(super) struct Scenario {
    #[prost(string, tag = "5")]
    pub(super) scenario_id: String,
    #[prost(double, repeated, tag = "1")]
    pub(super) timestamps_seconds: Vec<f64>,
    #[prost(int32, tag = "10")]
    pub(super) current_time_index: i32,
    #[prost(message, repeated, tag = "2")]
    pub(super) tracks: Vec<Track>,
    #[prost(message, repeated, tag = "7")]
    pub(super) dynamic_map_states: Vec<DynamicMapState>,
    #[prost(message, repeated, tag = "8")]
    pub(super) map_features: Vec<MapFeature>,
    #[prost(int32, tag = "6")]
    pub(super) sdc_track_index: i32,
    #[prost(int32, repeated, tag = "4")]
    pub(super) objects_of_interest: Vec<i32>,
    #[prost(message, repeated, tag = "11")]
    pub(super) tracks_to_predict: Vec<RequiredPrediction>,
}

#[derive(Message)]
pub(super) struct RequiredPrediction {
    #[prost(int32, tag = "1")]
    pub(super) track_index: i32,
}

#[derive(Message)]
pub(super) struct Track {
    #[prost(int32, tag = "1")]
    pub(super) id: i32,
    #[prost(int32, tag = "2")]
    pub(super) object_type: i32,
    #[prost(message, repeated, tag = "3")]
    pub(super) states: Vec<ObjectState>,
}

#[derive(Clone, Copy, Message)]
pub(super) struct ObjectState {
    #[prost(double, tag = "2")]
    pub(super) center_x: f64,
    #[prost(double, tag = "3")]
    pub(super) center_y: f64,
    #[prost(float, tag = "5")]
    pub(super) length: f32,
    #[prost(float, tag = "6")]
    pub(super) width: f32,
    #[prost(float, tag = "8")]
    pub(super) heading: f32,
    #[prost(float, tag = "9")]
    pub(super) velocity_x: f32,
    #[prost(float, tag = "10")]
    pub(super) velocity_y: f32,
    #[prost(bool, tag = "11")]
    pub(super) valid: bool,
}

#[derive(Message)]
pub(super) struct DynamicMapState {
    #[prost(message, repeated, tag = "1")]
    pub(super) lane_states: Vec<TrafficSignalLaneState>,
}

#[derive(Clone, Copy, Message)]
pub(super) struct TrafficSignalLaneState {
    #[prost(int64, tag = "1")]
    pub(super) lane: i64,
    #[prost(int32, tag = "2")]
    pub(super) state: i32,
    #[prost(message, optional, tag = "3")]
    pub(super) stop_point: Option<MapPoint>,
}

#[derive(Clone, Copy, Message)]
pub(super) struct MapPoint {
    #[prost(double, tag = "1")]
    pub(super) x: f64,
    #[prost(double, tag = "2")]
    pub(super) y: f64,
}

#[derive(Message)]
pub(super) struct MapFeature {
    #[prost(int64, tag = "1")]
    pub(super) id: i64,
    #[prost(oneof = "Feature", tags = "3, 4, 5, 7, 8, 9, 10")]
    pub(super) feature: Option<Feature>,
}

#[derive(Oneof)]
pub(super) enum Feature {
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
pub(super) struct LaneCenter {
    #[prost(double, tag = "1")]
    pub(super) speed_limit_mph: f64,
    #[prost(int32, tag = "2")]
    pub(super) kind: i32,
    #[prost(message, repeated, tag = "8")]
    pub(super) polyline: Vec<MapPoint>,
    #[prost(int64, repeated, tag = "9")]
    pub(super) entry_lanes: Vec<i64>,
    #[prost(int64, repeated, tag = "10")]
    pub(super) exit_lanes: Vec<i64>,
    #[prost(message, repeated, tag = "11")]
    pub(super) left_neighbors: Vec<LaneNeighbor>,
    #[prost(message, repeated, tag = "12")]
    pub(super) right_neighbors: Vec<LaneNeighbor>,
}

#[derive(Clone, Copy, Message)]
pub(super) struct LaneNeighbor {
    #[prost(int64, tag = "1")]
    pub(super) feature_id: i64,
    #[prost(int32, tag = "2")]
    pub(super) self_start_index: i32,
    #[prost(int32, tag = "3")]
    pub(super) self_end_index: i32,
    #[prost(int32, tag = "4")]
    pub(super) neighbor_start_index: i32,
    #[prost(int32, tag = "5")]
    pub(super) neighbor_end_index: i32,
}

/// A road line or a road edge.
#[derive(Message)]
pub(super) struct Line {
    #[prost(int32, tag = "1")]
    pub(super) kind: i32,
    #[prost(message, repeated, tag = "2")]
    pub(super) polyline: Vec<MapPoint>,
}

#[derive(Message)]
pub(super) struct StopSign {
    #[prost(int64, repeated, tag = "1")]
    pub(super) lane: Vec<i64>,
    #[prost(message, optional, tag = "2")]
    pub(super) position: Option<MapPoint>,
}

/// A crosswalk, a speed bump or a driveway.
#[derive(Message)]
pub(super) struct Outline {
    #[prost(message, repeated, tag = "1")]
    pub(super) polygon: Vec<MapPoint>,
}
