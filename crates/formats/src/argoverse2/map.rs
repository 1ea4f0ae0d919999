//! Map of a scenario.

use std::collections::BTreeMap;
use std::path::Path;

use reactsim_geometry::Polygon;
use reactsim_scene::{Crosswalk, MapHeights, MapParts};
use serde::Deserialize;

use super::lanes::{self, RawLane};
use super::point::{Point, between, heights, points};
use crate::error::{Cause, FormatError};

/// Maximum number of lanes of a map; usual maps have some hundred.
const MAX_LANES: usize = 10_000;

#[derive(Deserialize)]
#[serde(expecting = "an object")]
struct RawMap {
    lane_segments: BTreeMap<String, RawLane>,
    drivable_areas: BTreeMap<String, RawArea>,
    pedestrian_crossings: BTreeMap<String, RawCrossing>,
}

#[derive(Deserialize)]
#[serde(expecting = "an object")]
struct RawArea {
    area_boundary: Vec<Point>,
}

#[derive(Deserialize)]
#[serde(expecting = "an object")]
struct RawCrossing {
    edge1: Vec<Point>,
    edge2: Vec<Point>,
}

pub(super) fn read(path: &Path, text: &[u8]) -> Result<MapParts, FormatError> {
    let refuse = |cause| FormatError::file(path, cause);
    let raw: RawMap =
        serde_json::from_slice(text).map_err(|e| refuse(Cause::Undecodable(format!("as a map: {e}"))))?;
    if raw.lane_segments.len() > MAX_LANES {
        let expected = format!("at most {MAX_LANES}: the map of one scenario");
        return Err(refuse(Cause::value("the number of `lane_segments`", raw.lane_segments.len(), expected)));
    }
    let mut area = Vec::with_capacity(raw.drivable_areas.len());
    for (key, drivable) in &raw.drivable_areas {
        let exterior = points(&drivable.area_boundary);
        if exterior.len() < 3 {
            let field = format!("drivable_areas[\"{}\"].area_boundary", key.escape_debug());
            let found = format!("{} points", exterior.len());
            return Err(refuse(Cause::value(field, found, "at least 3 points; fetch the map again")));
        }
        area.push(Polygon { exterior, holes: Vec::new() });
    }
    let crossing = |c: &RawCrossing| Crosswalk { outline: between(&c.edge1, &c.edge2) };
    let (road_lines, line_heights) = lanes::paint(&raw.lane_segments);
    let ring = |c: &RawCrossing| c.edge1.iter().chain(c.edge2.iter().rev()).copied().collect::<Vec<_>>();
    let map_heights = MapHeights {
        lanes: lanes::heights(&raw.lane_segments),
        road_lines: line_heights,
        crosswalks: raw.pedestrian_crossings.values().map(|c| heights(&ring(c))).collect(),
        drivable_area: raw.drivable_areas.values().map(|a| heights(&a.area_boundary)).collect(),
        ..MapHeights::default()
    };
    Ok(MapParts {
        lanes: lanes::lanes(&raw.lane_segments),
        road_lines,
        crosswalks: raw.pedestrian_crossings.values().map(crossing).collect(),
        drivable_area: (!area.is_empty()).then_some(area),
        heights: map_heights,
        ..MapParts::default()
    })
}
