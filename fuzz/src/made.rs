//! Small good files, made here: what fuzzing begins with, and the other half of formats of two files.

mod argoverse2;
mod gpudrive;
mod json;
mod native;
mod nuplan;
mod scenarionet;

pub use argoverse2::{map as argoverse2_map, tracks as argoverse2_tracks};
pub use gpudrive::{new as gpudrive, old as gpudrive_old};
pub use json::HAND;
pub use native::{repaired, with_whole_pages};
pub use nuplan::{LIST, log as nuplan_log, map as nuplan_map};
pub use scenarionet::made as scenarionet;
use reactsim_test_support::proto;

/// A Waymo message, and another one with less in it.
pub fn womd() -> [Vec<u8>; 2] {
    let few = proto::Proto {
        tracks: vec![(8, 1, 5000.0, 0.0, 5.0, 0..91)],
        lights: vec![],
        sdc: 0,
        ..Default::default()
    };
    [proto::Proto::default().encode(), few.encode()]
}

/// Payloads as TFRecords, with the right checksums.
pub fn framed(payloads: &[Vec<u8>]) -> Vec<u8> {
    proto::framed(payloads)
}
