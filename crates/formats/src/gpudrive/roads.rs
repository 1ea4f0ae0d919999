//! Conversion of road elements to a map.

use std::collections::BTreeMap;

use reactsim_geometry::Vec2;
use reactsim_scene::{
    Crosswalk, LaneClass, LaneKind, LaneParts, MapParts, RoadEdge, RoadEdgeKind, RoadLine, Surface,
};

use super::links;
use super::raw::{Point, RawRoad};
use crate::error::Cause;

/// Element id of paint code 1 (broken single white); the ids of codes 2 to 8 follow.
const FIRST_PAINT_ID: i64 = 6;
/// Element id of road edges that are boundaries.
const BOUNDARY_ID: i64 = 15;
/// Element id of road edges that are medians.
const MEDIAN_ID: i64 = 16;

/// Converts road elements to a map; omitted elements are counted in `repairs`.
pub(super) fn map(roads: Vec<RawRoad>, repairs: &mut BTreeMap<String, u32>) -> Result<MapParts, Cause> {
    let mut map = MapParts::default();
    let mut leave_out = |what: &str| *repairs.entry(what.to_owned()).or_default() += 1;
    for (i, road) in roads.into_iter().enumerate() {
        let code = road.map_element_id;
        let heights: Vec<f64> = road.geometry.iter().map(|p| p.z.unwrap_or(f64::NAN)).collect();
        let points = points(&road.geometry);
        match road.kind.as_str() {
            "lane" if points.windows(2).all(|w| w[0] == w[1]) => {
                leave_out("lanes without extent");
            }
            "lane" => {
                map.heights.lanes.push(heights);
                map.lanes.push(LaneParts {
                    id: road.id.map_or_else(|| i.to_string(), |id| id.to_string()),
                    // Waymo's lanes overlap at merges and junctions, as connectors do.
                    kind: LaneKind::Connector,
                    class: class(code),
                    points,
                    ..LaneParts::default()
                });
            }
            "road_line" => {
                let paint = code.and_then(|c| u8::try_from(c.checked_sub(FIRST_PAINT_ID - 1)?).ok());
                let paint = paint.filter(|p| (1..=8).contains(p)).unwrap_or(0);
                map.heights.road_lines.push(heights);
                map.road_lines.push(RoadLine { paint, points });
            }
            "road_edge" => {
                let kind = match code {
                    Some(BOUNDARY_ID) => RoadEdgeKind::Boundary,
                    Some(MEDIAN_ID) => RoadEdgeKind::Median,
                    _ => RoadEdgeKind::Unknown,
                };
                map.heights.road_edges.push(heights);
                map.road_edges.push(RoadEdge { kind, points });
            }
            "crosswalk" => {
                map.heights.crosswalks.push(heights);
                map.crosswalks.push(Crosswalk { outline: points });
            }
            "speed_bump" => {
                map.heights.speed_bumps.push(heights);
                map.speed_bumps.push(Surface { outline: points });
            }
            "driveway" => {
                map.heights.driveways.push(heights);
                map.driveways.push(Surface { outline: points });
            }
            // The lane of a stop sign is not recorded, and the nearest lane is often the wrong one.
            "stop_sign" => leave_out("stop signs of unknown lanes"),
            _ => leave_out("road elements of unknown type"),
        }
    }
    links::link(&mut map.lanes)?;
    Ok(map)
}

fn class(code: Option<i64>) -> LaneClass {
    let known = code.and_then(|c| usize::try_from(c).ok()).and_then(|c| LaneClass::ALL.get(c).copied());
    known.unwrap_or(LaneClass::Undefined)
}

fn points(line: &[Point]) -> Vec<Vec2> {
    line.iter().copied().map(Vec2::from).collect()
}
