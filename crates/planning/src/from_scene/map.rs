//! The planning map of a scenario.

use reactsim_geometry::Vec2;
use reactsim_scene::{Lane, LaneArea, LaneKind, RoadMap, Scenario};

use crate::PlanningError;
use crate::map::{Area, Areas, DrivableArea, Intersections, PlanningLane, PlanningMap, PlanningMapParts};

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
/// [`PlanningError`] if a polygon of the map has no area.
pub fn planning_map(scenario: &Scenario) -> Result<PlanningMap, PlanningError> {
    let map = &scenario.start.map;
    let pieces = Pieces::of(map);
    let made = drivable(map).and_then(|drivable| made_of(map, &pieces.lanes, roadblocks(&pieces), drivable));
    made.map_err(|error| PlanningError(format!("scenario `{}`: {error}", scenario.id)))
}

/// Creates a map of lanes, whose links are indices into `lanes`.
pub(super) fn made_of(
    map: &RoadMap,
    lanes: &[Lane],
    roadblocks: Roadblocks,
    drivable: DrivableArea,
) -> Result<PlanningMap, PlanningError> {
    let parts = PlanningMapParts {
        lanes: lanes
            .iter()
            .zip(roadblocks.of_lane)
            .map(|(lane, roadblock)| Ok((planning_lane(lane, roadblock), lane_area(lane)?)))
            .collect::<Result<_, PlanningError>>()?,
        roadblocks: roadblocks.list,
        intersections: intersections(map, lanes)?,
        drivable,
    };
    PlanningMap::new(parts)
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

fn lane_area(lane: &Lane) -> Result<Area, PlanningError> {
    let area = match &lane.area {
        LaneArea::Polygon(ring) => Area::ring(ring.clone()),
        LaneArea::Corridor { half_width } => Area::corridor(lane.baseline.clone(), *half_width),
    };
    area.map_err(|error| PlanningError(format!("lane `{}`: {error}", lane.id)))
}

fn intersections(map: &RoadMap, lanes: &[Lane]) -> Result<Intersections, PlanningError> {
    Ok(if !map.intersections.is_empty() {
        let outlines = rings("intersections", map.intersections.iter())?;
        Intersections::Areas(Areas::new(outlines))
    } else if lanes.iter().any(|lane| lane.kind == LaneKind::Lane) {
        Intersections::Connectors
    } else {
        Intersections::Unknown
    })
}

fn drivable(map: &RoadMap) -> Result<DrivableArea, PlanningError> {
    if let Some(polygons) = &map.drivable_area {
        let areas = polygons.iter().cloned().map(Area::polygon);
        return Ok(DrivableArea::of_areas(collected("drivable_area", areas)?));
    }
    if map.road_edges.is_empty() {
        return Ok(DrivableArea::Unknown);
    }
    let driveways = rings("driveways", map.driveways.iter().map(|driveway| &driveway.outline))?;
    Ok(DrivableArea::of_road_edges(map.road_edges.iter().map(|edge| edge.points.as_slice()), driveways))
}

fn rings<'a>(
    list: &'static str,
    rings: impl Iterator<Item = &'a Vec<Vec2>>,
) -> Result<Vec<Area>, PlanningError> {
    collected(list, rings.cloned().map(Area::ring))
}

/// Collects the areas of a list of the map; the error names the list and the index.
fn collected(
    list: &'static str,
    areas: impl Iterator<Item = Result<Area, PlanningError>>,
) -> Result<Vec<Area>, PlanningError> {
    let named = |(index, area): (usize, Result<Area, PlanningError>)| {
        area.map_err(|error| PlanningError(format!("{list}[{index}]: {error}")))
    };
    areas.enumerate().map(named).collect()
}
