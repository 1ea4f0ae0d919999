//! The fields of `waymo.open_dataset.Scenario` that the metrics of the challenge read; all others are
//! skipped.
//!
//! The reader of scenarios has messages of its own: it needs velocities and links of lanes, which are skipped
//! here, and no heights.

use prost::{Message, Oneof};

#[derive(Message)]
pub(super) struct Scenario {
    #[prost(string, tag = "5")]
    pub(super) scenario_id: String,
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
    #[prost(message, repeated, tag = "11")]
    pub(super) tracks_to_predict: Vec<RequiredPrediction>,
}

#[derive(Clone, Copy, Message)]
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
    #[prost(double, tag = "4")]
    pub(super) center_z: f64,
    #[prost(float, tag = "5")]
    pub(super) length: f32,
    #[prost(float, tag = "6")]
    pub(super) width: f32,
    #[prost(float, tag = "7")]
    pub(super) height: f32,
    #[prost(float, tag = "8")]
    pub(super) heading: f32,
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
    #[prost(double, tag = "3")]
    pub(super) z: f64,
}

#[derive(Message)]
pub(super) struct MapFeature {
    #[prost(int64, tag = "1")]
    pub(super) id: i64,
    #[prost(oneof = "Feature", tags = "3, 5")]
    pub(super) feature: Option<Feature>,
}

#[derive(Oneof)]
pub(super) enum Feature {
    #[prost(message, tag = "3")]
    Lane(LaneCenter),
    #[prost(message, tag = "5")]
    RoadEdge(RoadEdge),
}

#[derive(Message)]
pub(super) struct LaneCenter {
    #[prost(int32, tag = "2")]
    pub(super) kind: i32,
    #[prost(message, repeated, tag = "8")]
    pub(super) polyline: Vec<MapPoint>,
}

#[derive(Message)]
pub(super) struct RoadEdge {
    #[prost(message, repeated, tag = "2")]
    pub(super) polyline: Vec<MapPoint>,
}
