//! Links between lanes, for files without links.

use std::collections::BTreeMap;

use reactsim_geometry::Vec2;
use reactsim_scene::LaneParts;

use crate::error::Cause;

/// Maximum distance in metres between the end of a lane and the start of its successors.
const LINK_DISTANCE: f64 = 0.05;
/// Maximum number of lanes that begin or end at one point.
const MAX_LANES_AT_POINT: usize = 100;

/// Links lanes whose ends touch.
pub(crate) fn link(lanes: &mut [LaneParts]) -> Result<(), Cause> {
    let cell = |p: Vec2| ((p.x / LINK_DISTANCE).floor() as i64, (p.y / LINK_DISTANCE).floor() as i64);
    let mut starts: BTreeMap<(i64, i64), Vec<usize>> = BTreeMap::new();
    let mut ends: BTreeMap<(i64, i64), usize> = BTreeMap::new();
    for (i, lane) in lanes.iter().enumerate() {
        let (Some(first), Some(last)) = (lane.points.first(), lane.points.last()) else { continue };
        let here = starts.entry(cell(*first)).or_default();
        here.push(i);
        let ending = ends.entry(cell(*last)).or_default();
        *ending += 1;
        if here.len().max(*ending) > MAX_LANES_AT_POINT {
            let found = format!("next to {MAX_LANES_AT_POINT} other lanes that begin or end at one point");
            return Err(Cause::value(format!("the lane `{}`", lane.id), found, "fewer lanes at one point"));
        }
    }
    let mut links = Vec::new();
    for (i, lane) in lanes.iter().enumerate() {
        let Some(&end) = lane.points.last() else { continue };
        let (x, y) = cell(end);
        let around = (-1..=1).flat_map(|dx| (-1..=1).map(move |dy| (dx, dy)));
        let near = around.filter_map(|(dx, dy)| starts.get(&(x.saturating_add(dx), y.saturating_add(dy))));
        let touches = |j: &usize| *j != i && (lanes[*j].points[0] - end).norm() <= LINK_DISTANCE;
        let mut found: Vec<usize> = near.flatten().copied().filter(touches).collect();
        found.sort_unstable();
        found.dedup();
        links.extend(found.into_iter().map(|j| (i, j)));
    }
    for (from, to) in links {
        let (before, after) = (lanes[from].id.clone(), lanes[to].id.clone());
        lanes[from].successors.push(after);
        lanes[to].predecessors.push(before);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests stop at what they did not expect")]

    use reactsim_scene::{LaneClass, LaneKind};

    use super::*;

    fn lane(id: usize, points: &[(f64, f64)]) -> LaneParts {
        LaneParts {
            id: id.to_string(),
            kind: LaneKind::Connector,
            class: LaneClass::Undefined,
            points: points.iter().map(|p| Vec2::new(p.0, p.1)).collect(),
            ..LaneParts::default()
        }
    }

    #[test]
    fn lanes_with_touching_ends_are_linked() {
        let mut lanes = [
            lane(0, &[(0.0, 0.0), (10.0, 0.0)]),
            lane(1, &[(10.04, 0.0), (20.0, 0.0)]),
            lane(2, &[(9.97, -0.03), (10.0, 9.0)]),
            lane(3, &[(10.0, 0.06), (20.0, 3.0)]),
            lane(4, &[(30.0, 5.0), (35.0, 9.0), (30.0, 5.0)]),
        ];
        link(&mut lanes).unwrap();
        assert_eq!(lanes[0].successors, ["1", "2"]);
        assert_eq!(
            (lanes[1].predecessors.as_slice(), lanes[2].predecessors.len()),
            (["0".to_owned()].as_slice(), 1)
        );
        assert!(lanes[3].predecessors.is_empty(), "6 cm is too far");
        assert!(lanes[4].successors.is_empty(), "no lane is its own successor");
    }

    #[test]
    fn many_lanes_at_one_point_are_refused() {
        let mut lanes: Vec<LaneParts> = (0..200).map(|i| lane(i, &[(0.0, 0.0), (1.0, i as f64)])).collect();
        let error = link(&mut lanes).unwrap_err().to_string();
        assert!(error.starts_with("the lane `100` is next to 100 other lanes"), "{error}");
        let mut far = [lane(0, &[(1e308, -1e308), (0.0, 1e308)])];
        link(&mut far).unwrap();
    }
}
