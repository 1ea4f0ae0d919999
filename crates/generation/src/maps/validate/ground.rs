//! Checks of the drivable ground: lanes on it, edges around it, parked vehicles clear of the lanes.

use reactsim_geometry::{OrientedBox, Vec2, left};

use super::survey::Survey;
use super::{Flaws, Rule};
use crate::heights::on_different_levels;

/// Tolerance between the borders of lanes and of the ground, metres, since both are sampled.
const SAMPLING_TOLERANCE: f64 = 0.03;
/// Distance from an edge at which its sides are tested, metres.
const SIDE_OFFSET: f64 = 0.1;
/// Length, metres, below which segments of edges are not tested.
const MIN_SEGMENT: f64 = 0.3;
/// Minimum distance between parked vehicles and lanes, metres.
const PARKING_CLEARANCE: f64 = 0.2;

pub(super) fn check(survey: &Survey<'_>, flaws: &mut Flaws) {
    for lane in &survey.lanes {
        let points = lane.line.points().iter().chain(&lane.ring);
        if let Some(&p) =
            points.into_iter().find(|p| !survey.drivable(**p, lane.height(**p), SAMPLING_TOLERANCE))
        {
            flaws.add(Rule::Drivable, lane.id(), p, "is outside the drivable ground");
        }
    }
    if survey.layout.map.road_edges.is_empty() {
        flaws.add(Rule::Edge, "map", Vec2::zeros(), "no road edges");
    }
    for (i, edge) in survey.layout.map.road_edges.iter().enumerate() {
        let name = format!("road edge {i} ({})", edge.kind.name());
        let heights = survey.layout.map.heights.road_edges.get(i).map_or(&[][..], Vec::as_slice);
        for (k, pair) in edge.points.windows(2).enumerate() {
            let along = pair[1] - pair[0];
            if along.norm() < MIN_SEGMENT {
                continue;
            }
            let (middle, aside) = (pair[0] + along * 0.5, left(along.normalize()) * SIDE_OFFSET);
            let height = heights.get(k..k + 2).map(|ends| 0.5 * (ends[0] + ends[1]));
            let drivable = |p: Vec2| survey.drivable(p, height, 0.0);
            let sides = (drivable(middle + aside), drivable(middle - aside));
            if sides != (true, false) {
                let found = format!("drivable on the left: {}, on the right: {}", sides.0, sides.1);
                flaws.add(Rule::Edge, &name, middle, found);
                break;
            }
        }
    }
    parking(survey, flaws);
}

fn parking(survey: &Survey<'_>, flaws: &mut Flaws) {
    let height = survey.parking_height();
    for (i, spot) in survey.layout.parking.iter().enumerate() {
        let name = format!("parking spot {i}");
        let corners = OrientedBox::new(spot.position, spot.heading, spot.length, spot.width).corners();
        let outside = corners
            .iter()
            .chain([&spot.position])
            .find(|p| !survey.drivable(**p, height, SAMPLING_TOLERANCE));
        if let Some(&p) = outside {
            flaws.add(Rule::Parking, &name, p, "is outside the drivable ground");
            continue;
        }
        let around: Vec<Vec2> = (0..4)
            .flat_map(|k| (0..4).map(move |step| (k, f64::from(step) / 4.0)))
            .map(|(k, t)| corners[k] + (corners[(k + 1) % 4] - corners[k]) * t)
            .collect();
        let reach = reactsim_geometry::Bounds::of(around.iter().copied()).inflated(PARKING_CLEARANCE);
        for lane in survey.lanes.iter().filter(|l| l.bounds.intersects(&reach)) {
            let hit = around
                .iter()
                .find(|p| lane.contains(**p, PARKING_CLEARANCE))
                .filter(|p| !on_different_levels(lane.height(**p), height, 0.0));
            if let Some(&p) = hit {
                flaws.add(Rule::Parking, &name, p, format!("less than 0.2 m from lane `{}`", lane.id()));
                break;
            }
        }
    }
}
