#![allow(clippy::unwrap_used, reason = "tests stop at what they did not expect")]

use std::fs;
use std::path::Path;

use proptest::collection::vec;
use proptest::prelude::*;
use reactsim_scene::{CURRENT, DeviatedTrack, Deviation, FUTURE, Scenario};
use reactsim_test_support::proto::{self, Proto};

use super::Writer;
use crate::open;

/// Reads the only scenario of a file.
fn only(path: &Path) -> Scenario {
    let mut scenarios = open(path).unwrap();
    let scenario = scenarios.next().unwrap().unwrap();
    assert!(scenarios.next().is_none());
    scenario
}

/// Writes a scenario and reads it back.
fn written(folder: &Path, scenario: &Scenario) -> Scenario {
    let path = folder.join("a.parquet");
    let mut writer = Writer::create(&path).unwrap();
    writer.write(scenario).unwrap();
    writer.finish().unwrap();
    only(&path)
}

/// Reads a message as a scenario.
fn read(folder: &Path, message: &Proto) -> Scenario {
    let path = folder.join("a.tfrecord");
    fs::write(&path, proto::records(std::slice::from_ref(message))).unwrap();
    only(&path)
}

/// A way in which commands change a scenario before they write it.
type Change = fn(Scenario) -> Scenario;

/// What `convert` can do to a scenario besides the choice of its agents.
const CHANGES: [(&str, Change); 4] = [
    ("as it is", |scenario| scenario),
    ("without its future", Scenario::without_future),
    ("with another future", |mut scenario| {
        scenario.log_future.tracks.iter_mut().for_each(|track| track[3..].fill(None));
        scenario.log_future.heights.iter_mut().for_each(|heights| heights.fill(None));
        scenario.deviation = None;
        scenario.unselected.clear();
        scenario.start.obstacles.clear();
        scenario.start.obstacle_heights.clear();
        scenario.id.push_str("+other");
        scenario
    }),
    ("with a deviation", |mut scenario| {
        let now = scenario.start.now(0);
        let track = vec![now; FUTURE];
        let category = Some(Deviation::Lateral);
        scenario.deviation = Some(DeviatedTrack { category, track, certificate: None });
        scenario
    }),
];

/// A track of a message: type, position, length (0: without an extent), first and last frame.
fn track() -> impl Strategy<Value = (u64, u8, u8, usize, usize)> {
    (0..5u64, 0..60u8, 0..3u8, 0..91usize, 0..=91usize)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, ..ProptestConfig::default() })]
    #[test]
    fn scenarios_read_back_equal_with_any_agents(
        tracks in prop_oneof![vec(track(), 0..8), vec(track(), 60..90)],
        all_agents: bool,
    ) {
        let folder = tempfile::tempdir().unwrap();
        let message = Proto {
            sdc: 0,
            tracks: std::iter::once((1000, 1, 5000.0, 0.0, 4.5, 0..91))
                .chain(tracks.iter().enumerate().map(|(i, &(kind, at, length, first, end))| {
                    // Positions in whole metres: distances to the AV are often equal.
                    (i as u64, kind, 4970.0 + f64::from(at), 1.0, f32::from(length), first..end)
                }))
                .collect(),
            ..Proto::default()
        };
        let scenario = read(folder.path(), &message);
        let scenario = if all_agents { scenario.with_all_agents() } else { scenario };
        if all_agents {
            let is_here = tracks.iter().filter(|track| (track.3..track.4).contains(&CURRENT));
            prop_assert_eq!(scenario.start.agents.len(), 1 + is_here.count());
        }
        for (what, change) in CHANGES {
            let scenario = change(scenario.clone());
            let back = written(folder.path(), &scenario);
            prop_assert_eq!(back.digest(), scenario.digest(), "{}", what);
            prop_assert_eq!(&back.start.agents, &scenario.start.agents, "{}", what);
            // Writing again changes nothing.
            prop_assert_eq!(written(folder.path(), &back).digest(), scenario.digest(), "{}", what);
        }
    }
}

#[test]
fn other_objects_and_more_than_the_benchmark_selects_stay_simulated() {
    let folder = tempfile::tempdir().unwrap();
    let mut message = Proto::default();
    message.tracks.extend((20..120).map(|id| (id, 1 + id % 4, 5000.0 + id as f64, 0.0, 2.0, 0..91)));
    let few = read(folder.path(), &message);
    let all = few.clone().with_all_agents();
    assert_eq!((few.start.agents.len(), all.start.agents.len()), (64, 103));
    let back = written(folder.path(), &all);
    assert_eq!((back.start.agents.len(), back.digest()), (103, all.digest()));
    assert!(back.start.obstacles.is_empty());
    let back = written(folder.path(), &few);
    assert_eq!((back.start.agents.len(), back.digest()), (64, few.digest()));
    assert_eq!(back.start.obstacles.len(), few.start.obstacles.len());
    assert_eq!(back.with_all_agents().digest(), all.digest());
}
