//! The planning map of a scenario.

use reactsim_geometry::Vec2;
use reactsim_scene::{Lane, LaneArea, LaneKind, RoadMap, Scenario};

use crate::map::{
    Area, AreaError, Areas, DrivableArea, Intersections, PlanningLane, PlanningMap, PlanningMapParts,
};

use super::SceneHistoryError;
use super::pieces::Pieces;
use super::roadblocks::{Roadblocks, roadblocks};

/// Creates the map that planners and metrics of a scenario use.
///
/// Lanes for bicycles only are left out, as in the maps of nuPlan. A lane is cut where a lane beside it
/// begins or ends, as the lanes of those maps are; roadblocks are groups of lanes side by side. Without
/// outlines, intersections are where connectors are, or unknown if all lanes are connectors. Without drivable
/// polygons, the left side of road edges and the driveways are drivable.
///
/// # Errors
/// [`SceneHistoryError`] if a polygon of the map has no area.
pub fn planning_map(scenario: &Scenario) -> Result<PlanningMap, SceneHistoryError> {
    let id = &scenario.id;
    let map = &scenario.start.map;
    let pieces = Pieces::of(map);
    let Roadblocks { list, of_lane } = roadblocks(&pieces);
    let lanes = &pieces.lanes;
    let parts = PlanningMapParts {
        lanes: lanes
            .iter()
            .zip(of_lane)
            .map(|(lane, roadblock)| Ok((planning_lane(lane, roadblock), lane_area(id, lane)?)))
            .collect::<Result<_, SceneHistoryError>>()?,
        roadblocks: list,
        intersections: intersections(id, map, lanes)?,
        drivable: drivable(id, map)?,
    };
    PlanningMap::new(parts).map_err(|source| SceneHistoryError::Map { scenario: id.clone(), source })
}

/// Returns the lane of the scenario for each lane of its planning map, as indices. A lane that is cut has
/// several lanes in the planning map, one after the other; lanes for bicycles only have none.
pub fn planning_lanes(map: &RoadMap) -> Vec<usize> {
    Pieces::of(map).origins
}

fn planning_lane(lane: &Lane, roadblock: usize) -> PlanningLane {
    PlanningLane {
        id: lane.id.clone(),
        kind: lane.kind,
        baseline: lane.baseline.clone(),
        speed_limit: lane.speed_limit,
        roadblock,
        predecessors: lane.predecessors.clone(),
        successors: lane.successors.clone(),
    }
}

fn lane_area(scenario: &str, lane: &Lane) -> Result<Area, SceneHistoryError> {
    let area = match &lane.area {
        LaneArea::Polygon(ring) => Area::ring(ring.clone()),
        LaneArea::Corridor { half_width } => Area::corridor(lane.baseline.clone(), *half_width),
    };
    let (scenario, lane) = (scenario.to_owned(), lane.id.clone());
    area.map_err(|source| SceneHistoryError::Lane { scenario, lane, source })
}

fn intersections(scenario: &str, map: &RoadMap, lanes: &[Lane]) -> Result<Intersections, SceneHistoryError> {
    Ok(if !map.intersections.is_empty() {
        let outlines = rings(scenario, "intersections", map.intersections.iter())?;
        Intersections::Areas(Areas::new(outlines))
    } else if lanes.iter().any(|lane| lane.kind == LaneKind::Lane) {
        Intersections::Connectors
    } else {
        Intersections::Unknown
    })
}

fn drivable(scenario: &str, map: &RoadMap) -> Result<DrivableArea, SceneHistoryError> {
    if let Some(polygons) = &map.drivable_area {
        let areas = polygons.iter().cloned().map(Area::polygon);
        return Ok(DrivableArea::of_areas(collected(scenario, "drivable_area", areas)?));
    }
    if map.road_edges.is_empty() {
        return Ok(DrivableArea::Unknown);
    }
    let driveways = rings(scenario, "driveways", map.driveways.iter().map(|driveway| &driveway.outline))?;
    Ok(DrivableArea::of_road_edges(map.road_edges.iter().map(|edge| edge.points.as_slice()), driveways))
}

fn rings<'a>(
    scenario: &str,
    list: &'static str,
    rings: impl Iterator<Item = &'a Vec<Vec2>>,
) -> Result<Vec<Area>, SceneHistoryError> {
    collected(scenario, list, rings.cloned().map(Area::ring))
}

/// Collects the areas of a list of the map; the error names the list and the index.
fn collected(
    scenario: &str,
    list: &'static str,
    areas: impl Iterator<Item = Result<Area, AreaError>>,
) -> Result<Vec<Area>, SceneHistoryError> {
    let named = |(index, area): (usize, Result<Area, AreaError>)| {
        area.map_err(|source| SceneHistoryError::Area { scenario: scenario.to_owned(), list, index, source })
    };
    areas.enumerate().map(named).collect()
}
