//! Intermediate results that several metrics share.

use reactsim_geometry::{OrientedBox, Vec2};

use super::corner_lanes::{CornerLanes, corner_lanes, in_common_lane};
use super::matched_lanes::{lanes_overlap, matched_lanes};
use super::{History, center_lanes::center_lanes};

/// Boxes and lanes of ego, per sample.
pub(super) struct Context<'a> {
    pub(super) history: &'a History<'a>,
    pub(super) centers: Vec<Vec2>,
    pub(super) footprints: Vec<OrientedBox>,
    pub(super) center_lanes: Vec<Vec<usize>>,
    /// The one lane of the centre that counts, per sample.
    pub(super) matched_lanes: Vec<Option<usize>>,
    pub(super) corner_lanes: Vec<CornerLanes>,
    /// Whether ego is in a common lane; `None` in maps without lanes.
    pub(super) in_common_lane: Option<Vec<bool>>,
    /// Whether lanes overlap where ego is.
    pub(super) lanes_overlap: bool,
}

impl<'a> Context<'a> {
    pub(super) fn new(history: &'a History<'a>) -> Self {
        let map = history.map;
        let centers = history.centers();
        let footprints: Vec<_> = (0..history.ego.len()).map(|k| history.footprint(k)).collect();
        let center_lanes = center_lanes(map, &centers);
        let corner_lanes = corner_lanes(map, &footprints);
        let in_common_lane = (!map.lanes().is_empty())
            .then(|| corner_lanes.iter().map(|corners| in_common_lane(map, corners)).collect());
        let lanes_overlap = lanes_overlap(map, center_lanes.iter().chain(corner_lanes.iter().flatten()));
        let matched_lanes = matched_lanes(map, &center_lanes, history.ego, &centers, lanes_overlap);
        Self {
            history,
            centers,
            footprints,
            center_lanes,
            matched_lanes,
            corner_lanes,
            in_common_lane,
            lanes_overlap,
        }
    }

    pub(super) fn samples(&self) -> usize {
        self.centers.len()
    }

    pub(super) fn has_lanes(&self) -> bool {
        self.in_common_lane.is_some()
    }
}
