//! The ground under simulated boxes (tuplan_garage b51d5d0, `get_drivable_area_map` and
//! `PDMScorer._calculate_ego_area`).

use std::collections::BTreeSet;

use reactsim_geometry::{Bounds, OrientedBox, Vec2};

use crate::PlanningMap;
use crate::shapes::box_touches_ring;

/// Half of the side in metres of the square around the centre of ego in which the map is used
/// (tuplan_garage b51d5d0, `map_radius`).
const MAP_RADIUS: f64 = 50.0;
/// The four corners of a box as bits.
const ALL_CORNERS: u8 = 0b1111;

/// Lanes that count as drivable in one iteration: the lanes of roadblocks near ego. Car parks count in
/// tuplan_garage as well; maps here do not distinguish them from other drivable ground.
#[derive(Debug)]
pub(super) struct DrivableLanes<'a> {
    map: &'a PlanningMap,
    lanes: Vec<DrivableLane>,
}

#[derive(Clone, Copy, Debug)]
struct DrivableLane {
    lane: usize,
    is_on_route: bool,
    bounds: Bounds,
}

/// The ground under a box.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct GroundFlags {
    /// Corners are in more than one lane, and no lane contains them all.
    pub(super) in_multiple_lanes: bool,
    /// A corner is in no lane.
    pub(super) is_off_road: bool,
    /// The centre is in no lane of the route.
    pub(super) is_off_route: bool,
}

impl GroundFlags {
    /// Flags of a box within one lane of the route.
    const IN_LANE_OF_ROUTE: Self = Self { in_multiple_lanes: false, is_off_road: false, is_off_route: false };
}

impl<'a> DrivableLanes<'a> {
    /// Returns the lanes of the roadblocks near the centre of ego.
    pub(super) fn near(map: &'a PlanningMap, center: Vec2, on_route: &BTreeSet<usize>) -> Self {
        let lanes = roadblocks_near(map, center, MAP_RADIUS)
            .into_iter()
            .flat_map(|roadblock| map.lanes_of_roadblock(roadblock))
            .map(|&lane| DrivableLane {
                lane,
                is_on_route: on_route.contains(&lane),
                bounds: map.lane_area(lane).bounds(),
            });
        Self { map, lanes: lanes.collect() }
    }

    /// Returns what is under the boxes of a drive.
    pub(super) fn under(&self, footprints: &[OrientedBox]) -> Vec<GroundFlags> {
        // Successive boxes are mostly in the same lane of the route, and then no other lane matters.
        let mut last: Option<&DrivableLane> = None;
        let mut flags = Vec::with_capacity(footprints.len());
        for footprint in footprints {
            if last.is_some_and(|lane| self.is_within(footprint, lane)) {
                flags.push(GroundFlags::IN_LANE_OF_ROUTE);
            } else {
                let (here, lane) = self.scan(footprint);
                flags.push(here);
                last = lane;
            }
        }
        flags
    }

    /// Returns whether a lane contains all corners and the centre of a box.
    fn is_within(&self, footprint: &OrientedBox, lane: &DrivableLane) -> bool {
        let area = self.map.lane_area(lane.lane);
        area.contains(footprint.center) && footprint.corners().into_iter().all(|corner| area.contains(corner))
    }

    /// Returns what is under a box, by all lanes, and a lane of the route that contains all corners and the
    /// centre.
    fn scan(&self, footprint: &OrientedBox) -> (GroundFlags, Option<&DrivableLane>) {
        let corners = footprint.corners();
        let bounds = Bounds::of(corners);
        let (mut touched, mut covered) = (0, 0);
        let (mut holds_all, mut is_on_route, mut lane_of_route) = (false, false, None);
        for lane in self.lanes.iter().filter(|lane| lane.bounds.intersects(&bounds)) {
            let area = self.map.lane_area(lane.lane);
            let inside = (0..4).filter(|&i| area.contains(corners[i])).fold(0, |bits, i| bits | 1 << i);
            touched += u32::from(inside != 0);
            covered |= inside;
            holds_all |= inside == ALL_CORNERS;
            if lane.is_on_route && area.contains(footprint.center) {
                is_on_route = true;
                lane_of_route = lane_of_route.or((inside == ALL_CORNERS).then_some(lane));
            }
        }
        let flags = GroundFlags {
            in_multiple_lanes: touched > 1 && !holds_all,
            is_off_road: covered != ALL_CORNERS,
            is_off_route: !is_on_route,
        };
        (flags, lane_of_route)
    }
}

/// Returns the roadblocks that intersect the square with half side `radius` around `center`: roadblocks
/// of lanes, then of connectors, each by index.
pub(super) fn roadblocks_near(map: &PlanningMap, center: Vec2, radius: f64) -> Vec<usize> {
    let square = OrientedBox::new(center, 0.0, 2.0 * radius, 2.0 * radius);
    let mut candidates: Vec<usize> = map
        .lanes_within(&Bounds::around(center, radius))
        .into_iter()
        .map(|lane| map.lane(lane).roadblock)
        .collect();
    candidates.sort_by_key(|&roadblock| (is_connector_block(map, roadblock), roadblock));
    candidates.dedup();
    candidates.retain(|&roadblock| {
        roadblock_outlines(map, roadblock).iter().any(|ring| box_touches_ring(&square, ring))
    });
    candidates
}

/// Returns whether a roadblock is a group of connectors.
pub(super) fn is_connector_block(map: &PlanningMap, roadblock: usize) -> bool {
    map.lanes_of_roadblock(roadblock).first().is_some_and(|&lane| map.lane(lane).is_connector())
}

/// Returns the outlines whose union is a roadblock.
pub(super) fn roadblock_outlines(map: &PlanningMap, roadblock: usize) -> Vec<&[Vec2]> {
    match &map.roadblocks()[roadblock].area {
        Some(area) => vec![area.outline()],
        None => map.lanes_of_roadblock(roadblock).iter().map(|&lane| map.lane_area(lane).outline()).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures::{LanePart, map};

    #[test]
    fn boxes_are_in_one_lane_or_several_or_none() {
        let left = LanePart { bottom: 3.5, roadblock: "other", ..LanePart::new("left") };
        let road = map(&[LanePart::new("right"), left]);
        let lanes = DrivableLanes::near(&road, Vec2::new(100.0, 1.75), &BTreeSet::from([0]));
        let at = |y: f64| OrientedBox::new(Vec2::new(100.0, y), 0.0, 5.0, 2.0);
        let flags = |in_multiple_lanes, is_off_road, is_off_route| GroundFlags {
            in_multiple_lanes,
            is_off_road,
            is_off_route,
        };
        let expected = [
            (1.75, flags(false, false, false)),
            (3.0, flags(true, false, false)),
            (4.0, flags(true, false, true)),
            (5.25, flags(false, false, true)),
            (0.5, flags(false, true, false)),
            (20.0, flags(false, true, true)),
        ];
        let found = lanes.under(&expected.map(|(y, _)| at(y)));
        assert_eq!(found, expected.map(|(_, flags)| flags));
    }

    #[test]
    fn roadblocks_are_found_within_a_square() {
        let road = map(&[LanePart { x: [0.0, 40.0], ..LanePart::new("lane") }]);
        assert_eq!(roadblocks_near(&road, Vec2::new(89.0, 1.75), 50.0), [0]);
        assert!(roadblocks_near(&road, Vec2::new(91.0, 1.75), 50.0).is_empty());
    }
}
