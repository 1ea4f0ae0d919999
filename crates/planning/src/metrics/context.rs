//! Intermediate results that several metrics share.

use std::cell::OnceCell;

use reactsim_geometry::{OrientedBox, Vec2};

use super::corner_lanes::{CornerLanes, corner_lanes, in_common_lane};
use super::matched_lanes::lanes_overlap;
use super::{History, center_lanes::center_lanes};

/// Boxes and lanes of ego, per sample. Lanes are found when they are first asked for: most single samples
/// need none.
pub(super) struct Context<'a> {
    pub(super) history: &'a History<'a>,
    pub(super) centers: Vec<Vec2>,
    pub(super) footprints: Vec<OrientedBox>,
    lanes: OnceCell<Lanes>,
}

/// Lanes of ego, per sample.
#[derive(Default)]
pub(super) struct Lanes {
    pub(super) center: Vec<Vec<usize>>,
    pub(super) corners: Vec<CornerLanes>,
    /// Whether ego is in a common lane; `None` in maps without lanes.
    pub(super) in_common: Option<Vec<bool>>,
    /// Whether lanes overlap where ego is.
    pub(super) overlap: bool,
}

impl<'a> Context<'a> {
    pub(super) fn new(history: &'a History<'a>) -> Self {
        let states = history.ego.iter();
        let centers = states.clone().map(|state| state.center(&history.shape)).collect();
        let footprints = states.map(|state| state.footprint(&history.shape)).collect();
        Self { history, centers, footprints, lanes: OnceCell::new() }
    }

    pub(super) fn lanes(&self) -> &Lanes {
        self.lanes.get_or_init(|| {
            let map = self.history.map;
            let center = center_lanes(map, &self.centers);
            let corners = corner_lanes(map, &self.footprints);
            let in_common = self
                .has_lanes()
                .then(|| corners.iter().map(|corners| in_common_lane(map, corners)).collect());
            let overlap = lanes_overlap(map, center.iter().chain(corners.iter().flatten()));
            Lanes { center, corners, in_common, overlap }
        })
    }

    pub(super) fn into_lanes(self) -> Lanes {
        self.lanes();
        self.lanes.into_inner().unwrap_or_default()
    }

    pub(super) fn samples(&self) -> usize {
        self.centers.len()
    }

    pub(super) fn has_lanes(&self) -> bool {
        !self.history.map.lanes().is_empty()
    }

    /// Returns whether ego is in a common lane at a sample; `None` in maps without lanes.
    pub(super) fn in_common_lane(&self, step: usize) -> Option<bool> {
        self.lanes().in_common.as_ref().map(|common| common[step])
    }
}
