//! Checks of heights.

use reactsim_geometry::Vec2;

use super::survey::{Survey, TracedLane};
use super::{Flaws, Rule};

/// Maximum slope of lanes, metres per metre.
const MAX_SLOPE: f64 = 0.05;
/// Maximum difference of the heights of linked lanes at their joint, metres.
const JOIN_TOLERANCE: f64 = 0.001;

/// The points of several lines.
type Lines<'a> = Vec<&'a [Vec2]>;

pub(super) fn check(survey: &Survey<'_>, flaws: &mut Flaws) {
    let map = &survey.layout.map;
    if map.heights.is_empty() && survey.layout.footways.iter().all(|f| f.heights.is_empty()) {
        return;
    }
    let footways: Vec<Vec<f64>> = survey.layout.footways.iter().map(|f| f.heights.clone()).collect();
    let heights = &map.heights;
    let areas = map.drivable_area.as_deref().unwrap_or_default();
    let lists: [(&str, &[Vec<f64>], Lines<'_>); 8] = [
        ("lane", &heights.lanes, map.lanes.iter().map(|l| &l.points[..]).collect()),
        ("road edge", &heights.road_edges, map.road_edges.iter().map(|e| &e.points[..]).collect()),
        ("line", &heights.road_lines, map.road_lines.iter().map(|l| &l.points[..]).collect()),
        ("crosswalk", &heights.crosswalks, map.crosswalks.iter().map(|c| &c.outline[..]).collect()),
        ("speed bump", &heights.speed_bumps, map.speed_bumps.iter().map(|s| &s.outline[..]).collect()),
        ("driveway", &heights.driveways, map.driveways.iter().map(|s| &s.outline[..]).collect()),
        ("drivable polygon", &heights.drivable_area, areas.iter().map(|p| &p.exterior[..]).collect()),
        ("footway", &footways, survey.layout.footways.iter().map(|f| f.line.points()).collect()),
    ];
    for (what, heights, lines) in lists {
        for (i, points) in lines.into_iter().enumerate() {
            let own = heights.get(i).map_or(&[][..], Vec::as_slice);
            let finite = own.iter().all(|z| z.is_finite());
            if own.len() != points.len() || !finite {
                let found =
                    format!("{} heights for {} points, all finite: {finite}", own.len(), points.len());
                let place = points.first().copied().unwrap_or_default();
                flaws.add(Rule::Height, format!("{what} {i}"), place, found);
            }
        }
    }
    for lane in &survey.lanes {
        slope(lane, flaws);
        for next in lane.part.successors.iter().filter_map(|id| survey.find(id)) {
            let next = &survey.lanes[next];
            let (Some(end), Some(start)) = (lane.heights.last(), next.heights.first()) else { continue };
            if !((end - start).abs() <= JOIN_TOLERANCE) {
                let found = format!("ends at {end:.3} m, `{}` begins at {start:.3} m", next.id());
                flaws.add(Rule::Height, lane.id(), lane.end(), found);
            }
        }
    }
}

fn slope(lane: &TracedLane<'_>, flaws: &mut Flaws) {
    let steps = lane.heights.windows(2).zip(lane.line.arc().windows(2));
    let slopes = steps.map(|(z, s)| (z[1] - z[0]) / (s[1] - s[0]));
    if let Some((i, slope)) = slopes.enumerate().find(|(_, slope)| !(slope.abs() <= MAX_SLOPE)) {
        let found = format!("rises by {:.1} %, expected at most 5 %", 100.0 * slope);
        flaws.add(Rule::Height, lane.id(), lane.line.points()[i], found);
    }
}
