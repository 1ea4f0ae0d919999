use reactsim_geometry::Vec2;
use reactsim_scene::{CURRENT, FRAMES, Length};
use reactsim_test_support::proto::{Proto, bytes, varint};

use super::message::{Feature, LaneCenter, Line, MapFeature, ObjectState, Points, Scenario, Track};
use super::parts::parts;
use super::record::masked_crc;
use crate::wire::Fields;

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
    let polyline =
        || Points { points: vec![Vec2::new(0.0, 0.0), Vec2::new(9.0, 0.0)], heights: vec![8.25, 8.5] };
    let lane = LaneCenter { polyline: polyline(), ..LaneCenter::default() };
    let edge = Line { kind: 1, polyline: polyline() };
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

/// Returns a field with a number of variable length.
fn whole(tag: u64, number: u64) -> Vec<u8> {
    let mut field = Vec::new();
    varint(&mut field, tag << 3);
    varint(&mut field, number);
    field
}

/// Returns a field with a `double`.
fn double(tag: u8, number: f64) -> Vec<u8> {
    [&[tag << 3 | 1][..], &number.to_le_bytes()].concat()
}

/// Returns a field with a message of these fields.
fn message<const N: usize>(tag: u64, fields: [Vec<u8>; N]) -> Vec<u8> {
    let mut field = Vec::new();
    bytes(&mut field, tag, &fields.concat());
    field
}

#[test]
fn fields_that_occur_again_are_merged() {
    let lane = [
        message(3, [double(1, 20.0), double(1, 25.0), message(9, [vec![1, 0xac, 2]])]),
        message(3, [whole(2, 2), whole(9, 7), message(8, [double(2, 4.0), double(1, 3.0)])]),
    ];
    let replaced =
        [message(3, lane.clone()), whole(1, 8), message(5, [whole(1, 1)]), message(5, [message(2, [])])];
    let light = message(1, [message(3, [double(1, 1.0)]), whole(1, u64::MAX), message(3, [double(2, 2.0)])]);
    let scenario = [
        double(1, 0.5),
        message(1, [0.6_f64.to_le_bytes().to_vec(), 0.7_f64.to_le_bytes().to_vec()]),
        message(8, lane),
        message(8, replaced),
        message(7, [light]),
        whole(4, 3),
        message(4, [vec![4, 5]]),
        message(5, [b"a".to_vec()]),
        message(5, [b"b".to_vec()]),
    ];
    let read = Scenario::decode(&scenario.concat()).unwrap();
    assert_eq!(read.timestamps_seconds, [0.5, 0.6, 0.7]);
    assert_eq!((read.scenario_id.as_str(), read.objects_of_interest.as_slice()), ("b", &[3, 4, 5][..]));
    let Some(Feature::Lane(lane)) = &read.map_features[0].feature else { panic!("no lane") };
    assert_eq!((lane.speed_limit_mph, lane.kind, lane.entry_lanes.as_slice()), (25.0, 2, &[1, 300, 7][..]));
    assert_eq!(
        (lane.polyline.points.as_slice(), &lane.polyline.heights[..]),
        (&[Vec2::new(3.0, 4.0)][..], &[0.0][..])
    );
    let Some(Feature::RoadEdge(edge)) = &read.map_features[1].feature else { panic!("no edge") };
    assert_eq!((read.map_features[1].id, edge.kind, edge.polyline.points.len()), (8, 1, 1));
    let light = read.dynamic_map_states[0].lane_states[0];
    assert_eq!((light.lane, light.stop_point.map(|p| [p.x, p.y, p.z])), (-1, Some([1.0, 2.0, 0.0])));
}

#[test]
fn malformed_messages_are_refused() {
    let refusal = |message: &[u8]| Scenario::decode(message).err().unwrap().to_string();
    for tag in [1, 2, 4, 5, 6, 7, 8, 10, 11] {
        let said = refusal(&[tag << 3 | 5, 0, 0, 0, 0]);
        assert!(
            said.starts_with(&format!("cannot be decoded: field {tag} has the wire type 5 before")),
            "{said}"
        );
    }
    for (content, expected) in [
        (vec![12 << 3 | 4], "field 12 has the wire type 4"),
        (vec![12 << 3 | 6], "field 12 has the wire type 6"),
        (vec![0], "a field has an invalid tag"),
        ([vec![0xf8; 5], vec![1]].concat(), "a field has an invalid tag"),
        (whole(6, u64::MAX)[..10].to_vec(), "a field is cut off"),
        ([vec![6 << 3], vec![0xff; 9], vec![2]].concat(), "a number has more than 64 bits"),
        ([vec![6 << 3], vec![0x80; 10], vec![0]].concat(), "a number has more than 64 bits"),
        (message(5, [vec![0xff]]), "a text is not UTF-8"),
        (message(1, [vec![0; 9]]), "a field is cut off"),
        (message(4, [vec![0x80]]), "a field is cut off"),
        (message(2, [vec![3 << 3 | 2, 200]]), "a field is cut off"),
        (message(2, [message(3, [vec![2 << 3 | 1, 0]])]), "a field is cut off"),
    ] {
        let said = refusal(&[&whole(99, 1)[..], &content].concat());
        assert!(said.contains(&format!("cannot be decoded: {expected} before byte ")), "{said}");
    }
    let whole = Proto::default().encode();
    let read = (0..=whole.len()).filter(|end| Scenario::decode(&whole[..*end]).is_ok()).count();
    // Where a field ends, the message may end.
    let mut fields = Fields::new(&whole);
    let ends = std::iter::from_fn(|| fields.next_content().unwrap()).count();
    assert_eq!(read, 1 + ends);
}
