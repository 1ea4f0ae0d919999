//! Files made to take time or memory: refused by name, and soon.

use std::fmt::Write as _;
use std::fs;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use arrow_array::{ArrayRef, Float64Array, Int64Array, StringArray};

use super::{HAND_WRITTEN, digests, gzip, write_table};
use reactsim_test_support::proto::{self, Proto, bytes, crc, varint};

/// Time limit for such files, in a build for tests on a machine with other work.
const SOON: Duration = Duration::from_secs(20);

/// Returns the first message of a file with this content.
fn told(name: &str, content: &[u8]) -> String {
    let folder = tempfile::tempdir().unwrap();
    let path: PathBuf = folder.path().join(name);
    fs::write(&path, content).unwrap();
    let begin = Instant::now();
    let told = match digests(&path).remove(0) {
        Ok(digest) => digest,
        Err(error) => error.to_string(),
    };
    assert!(begin.elapsed() < SOON, "{name}: {:?}", begin.elapsed());
    assert!(!told.contains(char::is_control), "{told:?}");
    told
}

#[test]
fn compressed_records_that_are_far_longer_than_their_files() {
    // A header that claims 512 MiB, followed by any number of zeros.
    let sound = proto::framed(&[Vec::new()]);
    assert_eq!(sound.len(), 16);
    let length = (1_u64 << 29).to_le_bytes();
    let claimed = [length.as_slice(), &crc(&length), &[0; 4_000_000]].concat();
    let most = "the length of the record is 536870912, expected at most 128 MiB";
    for (name, content) in [
        ("f.tfrecord", claimed.clone()),
        ("f.tfrecord.gz", gzip(&claimed)),
        ("f.tfrecord.zst", zstd::encode_all(&claimed[..], 1).unwrap()),
    ] {
        let said = told(name, &content);
        assert!(said.contains(most), "{said}");
    }
}

#[test]
fn messages_of_many_small_parts() {
    // Two bytes each, and a hundred times as much in memory.
    let empty = |tag: u8| proto::framed(&[[tag << 3 | 2, 0].repeat(2_000_000)]);
    for tag in [2, 7, 8] {
        let said = told("f.tfrecord", &empty(tag));
        assert!(said.contains("the number of fields is more than 1000000"), "{tag}: {said}");
    }
    // Within other messages, and in lists of ids.
    let mut track = Vec::new();
    bytes(&mut track, 2, &[3 << 3 | 2, 0].repeat(2_000_000));
    let (mut lane, mut feature, mut map) = (Vec::new(), Vec::new(), Vec::new());
    bytes(&mut lane, 9, &[1; 2_000_000]);
    bytes(&mut feature, 3, &lane);
    bytes(&mut map, 8, &feature);
    let mut interest = Vec::new();
    bytes(&mut interest, 4, &[1; 2_000_000]);
    for message in [track, map, interest] {
        let said = told("f.tfrecord", &proto::framed(&[message]));
        assert!(said.contains("the number of fields is more than 1000000"), "{said}");
    }
    // Fields that are passed over take no memory, and groups are refused.
    let unknown = [[12 << 3 | 2, 0].repeat(2_000_000), vec![12 << 3 | 3]].concat();
    let said = told("f.tfrecord", &proto::framed(&[unknown]));
    assert!(said.contains("cannot be decoded: field 12 has the wire type 3"), "{said}");
}

#[test]
fn lights_of_many_lanes() {
    let mut message = Proto { lights: Vec::new(), ..Proto::default() }.encode();
    // Frames are identified by their number, so one of the existing frames gets all lights.
    let mut lights = Vec::new();
    for lane in 0..200_000 {
        let mut light = vec![1 << 3];
        varint(&mut light, lane + 1000);
        bytes(&mut lights, 1, &light);
    }
    let at = message.windows(3).position(|w| w == [7 << 3 | 2, 0, 7 << 3 | 2]).unwrap();
    let rest = message.split_off(at + 2);
    message.truncate(at);
    bytes(&mut message, 7, &lights);
    message.extend(rest);
    // Their lanes are not on the map: all are dropped and counted.
    assert_eq!(told("f.tfrecord", &proto::framed(&[message])).len(), 64);
}

#[test]
fn deep_json() {
    for (open, close) in [("[", "]"), ("{\"a\":", "}")] {
        let deep = format!("{}1{}", open.repeat(1_000_000), close.repeat(1_000_000));
        let hand = HAND_WRITTEN.replacen("\"agents\": [", &format!("\"agents\": {deep}, \"x\": ["), 1);
        assert!(told("f.json", hand.as_bytes()).contains("cannot be decoded"));
        let cut = &hand.as_bytes()[..hand.len() / 2];
        assert!(told("f.json", cut).contains("cannot be decoded"));
        // A key that is ignored, and one that is read.
        for key in ["other", "tl_states", "metadata"] {
            let text = format!("{{\"{key}\": {deep}, \"objects\": [], \"roads\": [{{\"geometry\": []}}]}}");
            let text = format!("{{\"roads\": [], \"geometry\": 0, {}", &text[1..]);
            assert!(told("f.json", text.as_bytes()).contains("f.json: "), "{key}");
        }
        let selection = format!("{{\"format\": \"reactsim-nuplan-v1\", \"logs\": {deep}}}");
        assert!(told("f.json", selection.as_bytes()).contains("cannot be decoded"));
    }
}

/// Returns the hand-written scenario with another list of lanes.
fn with_lanes(lanes: &str) -> String {
    let begin = HAND_WRITTEN.find("\"lanes\": [").unwrap();
    let end = HAND_WRITTEN.find("],\n    \"road_edges\"").unwrap();
    format!("{}\"lanes\": [{lanes}{}", &HAND_WRITTEN[..begin], &HAND_WRITTEN[end..])
}

#[test]
fn few_words_that_mean_much() {
    let mut lanes = String::new();
    for i in 0..11 {
        let comma = if i > 0 { "," } else { "" };
        let pieces = r#"[{"length": 99999}]"#;
        write!(lanes, r#"{comma}{{"id": "{i}", "path": {{"at": [-50000, {i}], "pieces": {pieces}}}}}"#)
            .unwrap();
    }
    let said = told("f.json", with_lanes(&lanes).as_bytes());
    let expected = "map.lanes[10].path.pieces[0].length is 99999, in addition to those before it, expected";
    assert!(said.contains(expected), "{said}");
    let agent = r#"{"id": "b", "length": 4, "width": 2, "motion": {"at": [0, 0]}},"#;
    let many = HAND_WRITTEN.replacen("\"agents\": [", &format!("\"agents\": [{}", agent.repeat(10_001)), 1);
    let said = told("f.json", many.as_bytes());
    assert!(said.contains("the number of `agents` is 10004, expected at most 10000"), "{said}");
}

#[test]
fn many_stop_lines_on_a_long_lane() {
    let points: Vec<String> = (0..20_000).map(|i| format!("[{i}, 0]")).collect();
    let text = with_lanes(&format!(r#"{{"id": "1", "points": [{}]}}"#, points.join(",")));
    let lines = vec![r#"{"kind": "yield", "lane": "1", "at": [0, 0]}"#; 20_000].join(",");
    let text = text.replacen("\"stop_lines\": [", &format!("\"stop_lines\": [{lines},"), 1);
    let said = told("f.json", text.as_bytes());
    assert!(said.contains("map.stop_lines[10000] is one too many on lanes of many points"), "{said}");
}

#[test]
fn a_table_of_many_tracks() {
    let n = 10_001;
    let numbers = |v: f64| Arc::new(Float64Array::from(vec![v; n])) as ArrayRef;
    let texts =
        |of: &dyn Fn(usize) -> String| Arc::new(StringArray::from_iter_values((0..n).map(of))) as ArrayRef;
    let columns = [
        ("track_id", texts(&|i| i.to_string())),
        ("object_type", texts(&|_| "vehicle".into())),
        ("timestep", Arc::new(Int64Array::from(vec![49; n])) as ArrayRef),
        ("position_x", numbers(0.0)),
        ("position_y", numbers(0.0)),
        ("heading", numbers(0.0)),
        ("scenario_id", texts(&|_| "made".into())),
    ];
    let mut file = Vec::new();
    write_table(&mut file, columns);
    let said = told("f.parquet", &file);
    assert!(
        said.contains(
            "`track_id` in row 10000 is `10000`, one too many, expected one of at most 10000 tracks"
        ),
        "{said}"
    );
}

#[test]
fn lanes_without_extent_in_long_chains() {
    let lanes: Vec<String> = (0..12_000)
        .map(|i| format!(r#"{{"id": "{i}", "points": [], "successors": ["{}"]}}"#, i + 1))
        .collect();
    let said = told("f.json", with_lanes(&lanes.join(",")).as_bytes());
    assert!(said.contains("map.lanes is too many lanes without extent"), "{said}");
    // Only two lists, but long ones.
    let to = |name: &str| (0..50_000).map(|i| format!("\"{name}{i}\"")).collect::<Vec<_>>().join(",");
    let two = format!(
        r#"{{"id": "1", "points": [[0, 0], [1, 0]], "successors": ["2", {}]}}, {{"id": "2", "points": [], "successors": [{}]}}"#,
        to("a"),
        to("b")
    );
    let said = told("f.json", with_lanes(&two).as_bytes());
    assert!(said.contains("or links through them"), "{said}");
    // Many lanes that lead to one another are read.
    let lanes: Vec<String> = (0..20_000)
        .map(|i| {
            format!(r#"{{"id": "{i}", "points": [[0, {i}], [1, {i}]], "successors": ["{}", "0"]}}"#, i + 1)
        })
        .collect();
    assert_eq!(told("f.json", with_lanes(&lanes.join(",")).as_bytes()).len(), 64);
}

#[test]
fn names_are_names() {
    for (name, shown) in [
        ("", "`` (0 bytes)"),
        ("a\\u001b[2J", "`a\\u{1b}[2J` (5 bytes)"),
        (&"x".repeat(1001), "(1001 bytes)"),
    ] {
        for (field, text) in [
            ("id", HAND_WRITTEN.replacen("\"hand\"", &format!("\"{name}\""), 1)),
            ("agents[2].id", HAND_WRITTEN.replacen("\"cone\"", &format!("\"{name}\""), 1)),
            ("map.lanes[0].id", with_lanes(&format!(r#"{{"id": "{name}", "points": []}}"#))),
        ] {
            let said = told("f.json", text.as_bytes());
            assert!(said.contains(&format!("{field} is ")) && said.contains(shown), "{said}");
            assert!(said.contains("expected a name of 1 to 1000 bytes without control characters"), "{said}");
        }
    }
}
