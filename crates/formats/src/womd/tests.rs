use reactsim_scene::{CURRENT, FRAMES, Length};

use super::message::{Feature, LaneCenter, Line, MapFeature, MapPoint, ObjectState, Scenario, Track};
use super::parts::parts;
use super::record::masked_crc;

#[test]
fn checksum_matches_tensorflow() {
    // The header of a record of 24 bytes, as TensorFlow writes it.
    assert_eq!(masked_crc(&24u64.to_le_bytes()).to_le_bytes(), [0xa3, 0x7f, 0x4b, 0x22]);
}

#[test]
fn heights_are_those_of_the_ground() {
    let state = |f: usize| ObjectState {
        center_z: 10.0 + f as f64,
        length: 4.0,
        width: 2.0,
        height: 3.0,
        valid: f != 20,
        ..ObjectState::default()
    };
    let polyline = vec![MapPoint { x: 0.0, y: 0.0, z: 8.25 }, MapPoint { x: 9.0, y: 0.0, z: 8.5 }];
    let lane = LaneCenter { polyline: polyline.clone(), ..LaneCenter::default() };
    let edge = Line { kind: 1, polyline };
    let features = [Feature::Lane(lane), Feature::RoadEdge(edge)].into_iter().zip(1..);
    let message = Scenario {
        timestamps_seconds: (0..FRAMES).map(|f| 0.1 * f as f64).collect(),
        current_time_index: CURRENT as i32,
        tracks: vec![Track { id: 1, object_type: 1, states: (0..FRAMES).map(state).collect() }],
        map_features: features.map(|(feature, id)| MapFeature { id, feature: Some(feature) }).collect(),
        ..Scenario::default()
    };
    let (parts, _) = parts(message, Length::BENCHMARK).unwrap();
    // The bottom of the box, half of its height below the recorded centre.
    assert_eq!(parts.agents[0].heights[CURRENT], Some(18.5));
    assert_eq!(parts.agents[0].heights[20], None, "an absent agent has no height");
    assert_eq!(parts.map.heights.lanes, [[8.25, 8.5]]);
    assert_eq!(parts.map.heights.road_edges, [[8.25, 8.5]]);
}
