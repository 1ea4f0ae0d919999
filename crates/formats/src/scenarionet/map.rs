//! Map of a scenario.

use std::collections::BTreeMap;

use reactsim_geometry::Vec2;
use reactsim_scene::{
    Crosswalk, LANE_HALF_WIDTH, LaneArea, LaneClass, LaneKind, LaneParts, MapParts, NeighborParts, RoadEdge,
    RoadEdgeKind, RoadLine, StopKind, StopLineParts, Surface,
};

use super::ground;
use crate::error::Cause;
use crate::gpudrive::links;
use crate::pickle::View;

/// One mile per hour in m/s.
const MPH: f64 = 0.44704;
/// One kilometre per hour in m/s.
const KMH: f64 = 1.0 / 3.6;
/// Maximum number of map features; maps of a kilometre around the AV have some thousand.
const MAX_FEATURES: usize = 50_000;
/// Maximum number of lanes; maps of a kilometre around the AV have some thousand.
const MAX_LANES: usize = 10_000;
/// Type of connectors, in files that distinguish them from lanes.
const CONNECTOR_TYPE: &str = "LANE_SURFACE_UNSTRUCTURE";
/// Data sets whose speed limits ScenarioNet's converters do not read but fill in (100 km/h, 85 mph).
const DATASETS_WITHOUT_LIMITS: &[&str] = &["nuscenes", "nuplan", "av2", "argoverse2"];
/// Data set whose converter writes the direction of a lane as the third coordinate of its points. Assembly
/// recognises the same in files of other data sets.
const DATASET_WITH_DIRECTIONS: &str = "nuscenes";
/// Suffixes of `ROAD_LINE_` types, in the order of their paint codes from 1.
const PAINT_TYPES: [&str; 8] = [
    "BROKEN_SINGLE_WHITE",
    "SOLID_SINGLE_WHITE",
    "SOLID_DOUBLE_WHITE",
    "BROKEN_SINGLE_YELLOW",
    "BROKEN_DOUBLE_YELLOW",
    "SOLID_SINGLE_YELLOW",
    "SOLID_DOUBLE_YELLOW",
    "PASSING_DOUBLE_YELLOW",
];

/// Reads the map; omitted features are counted in `repairs`.
pub(super) fn map(
    features: &View,
    dataset: Option<&str>,
    repairs: &mut BTreeMap<String, u32>,
) -> Result<MapParts, Cause> {
    let mut map = MapParts::default();
    let mut lanes = LaneCollector {
        has_limits: !dataset.is_some_and(|d| DATASETS_WITHOUT_LIMITS.contains(&d)),
        has_heights: dataset != Some(DATASET_WITH_DIRECTIONS),
        ..LaneCollector::default()
    };
    let mut boundaries: Vec<(u8, Vec<Vec2>, Vec<f64>)> = Vec::new();
    for (id, feature) in features.entries(MAX_FEATURES)? {
        let kind = feature.need("type")?.text()?;
        let line = || feature.need("polyline")?.points();
        let outline = || feature.get("polygon")?.map_or_else(line, |polygon| polygon.points());
        let line_heights = || feature.need("polyline")?.heights();
        let outline_heights =
            || feature.get("polygon")?.map_or_else(line_heights, |polygon| polygon.heights());
        if kind.starts_with("LANE_") {
            if lanes.all.len() >= MAX_LANES {
                return Err(feature.wrong(format!("at most {MAX_LANES} lanes: the map of one scenario")));
            }
            lanes.add(id, kind, &feature)?;
        } else if let Some(paint) = kind.strip_prefix("ROAD_LINE_") {
            let paint = PAINT_TYPES.iter().position(|p| *p == paint).map_or(0, |i| i as u8 + 1);
            let points = line()?;
            if id.starts_with(ground::KEY_PREFIX) {
                boundaries.push((paint, points, line_heights()?));
            } else {
                map.road_lines.push(RoadLine { paint, points });
                map.heights.road_lines.push(line_heights()?);
            }
        } else {
            match kind {
                "ROAD_EDGE_BOUNDARY" => {
                    map.road_edges.push(RoadEdge { kind: RoadEdgeKind::Boundary, points: line()? });
                    map.heights.road_edges.push(line_heights()?);
                }
                "ROAD_EDGE_MEDIAN" => {
                    map.road_edges.push(RoadEdge { kind: RoadEdgeKind::Median, points: line()? });
                    map.heights.road_edges.push(line_heights()?);
                }
                "CROSSWALK" | "CROSS_WALK" => {
                    map.crosswalks.push(Crosswalk { outline: outline()? });
                    map.heights.crosswalks.push(outline_heights()?);
                }
                "SPEED_BUMP" => {
                    map.speed_bumps.push(Surface { outline: outline()? });
                    map.heights.speed_bumps.push(outline_heights()?);
                }
                "DRIVEWAY" => {
                    map.driveways.push(Surface { outline: outline()? });
                    map.heights.driveways.push(outline_heights()?);
                }
                "STOP_SIGN" => {
                    let at = feature.need("position")?.point()?;
                    for lane in feature.need("lane")?.items()? {
                        map.stop_lines.push(StopLineParts { kind: StopKind::Sign, lane: lane.name()?, at });
                    }
                }
                _ => *repairs.entry("map features of other types".to_owned()).or_default() += 1,
            }
        }
    }
    map.heights.lanes = std::mem::take(&mut lanes.heights);
    map.lanes = lanes.finish(dataset)?;
    let rings: Vec<&[Vec2]> = boundaries.iter().map(|(_, points, _)| points.as_slice()).collect();
    map.drivable_area = ground::ground(&rings);
    if map.drivable_area.is_none() {
        for (paint, points, heights) in boundaries {
            map.road_lines.push(RoadLine { paint, points });
            map.heights.road_lines.push(heights);
        }
    }
    Ok(map)
}

/// Collector of lanes while the map is read.
#[derive(Default)]
struct LaneCollector {
    all: Vec<LaneParts>,
    /// Heights of their points.
    heights: Vec<Vec<f64>>,
    /// Neighbours given only by id: index of the lane, whether they are on its left, ids.
    unresolved: Vec<(usize, bool, Vec<String>)>,
    /// Whether the speed limits are those of the data set.
    has_limits: bool,
    /// Whether the third coordinate of a point is its height.
    has_heights: bool,
    /// Whether connectors have a type of their own.
    has_connectors: bool,
}

impl LaneCollector {
    fn add(&mut self, id: String, kind: &str, feature: &View) -> Result<(), Cause> {
        let class = match kind {
            "LANE_SURFACE_STREET" | CONNECTOR_TYPE => LaneClass::SurfaceStreet,
            "LANE_FREEWAY" => LaneClass::Freeway,
            "LANE_BIKE_LANE" => LaneClass::Bike,
            _ => LaneClass::Undefined,
        };
        self.has_connectors |= kind == CONNECTOR_TYPE;
        let polygon = feature.get("polygon")?.map(|p| p.points()).transpose()?.filter(|ring| ring.len() > 2);
        // Preliminary; [`LaneCollector::finish`] knows whether the file distinguishes lanes and connectors.
        let kind = match (&polygon, kind) {
            (Some(_), kind) if kind != CONNECTOR_TYPE => LaneKind::Lane,
            _ => LaneKind::Connector,
        };
        let corridor = LaneArea::Corridor { half_width: LANE_HALF_WIDTH };
        let links = |key: &str| match feature.get(key)? {
            None => Ok(Vec::new()),
            Some(list) => list.items()?.iter().map(View::name).collect::<Result<Vec<_>, _>>(),
        };
        let lane = LaneParts {
            id,
            kind,
            class,
            speed_limit: if self.has_limits { limit(feature)? } else { None },
            points: feature.need("polyline")?.points()?,
            area: polygon.map_or(corridor, LaneArea::Polygon),
            successors: links("exit_lanes")?,
            predecessors: links("entry_lanes")?,
            left: self.neighbors(feature, "left_neighbor", true)?,
            right: self.neighbors(feature, "right_neighbor", false)?,
        };
        self.all.push(lane);
        let heights = if self.has_heights { feature.need("polyline")?.heights()? } else { Vec::new() };
        self.heights.push(heights);
        Ok(())
    }

    /// Reads neighbours with their index ranges; neighbours given only by id are resolved in
    /// [`LaneCollector::finish`].
    fn neighbors(&mut self, feature: &View, key: &str, left: bool) -> Result<Vec<NeighborParts>, Cause> {
        let Some(list) = feature.get(key)? else { return Ok(Vec::new()) };
        let (mut found, mut ids) = (Vec::new(), Vec::new());
        for item in list.items()? {
            if !item.is_dict() {
                ids.push(item.name()?);
                continue;
            }
            let at = |key: &str| Ok::<u32, Cause>(u32::try_from(item.need(key)?.whole()?).unwrap_or(0));
            found.push(NeighborParts {
                lane: item.need("feature_id")?.name()?,
                self_start: at("self_start_index")?,
                self_end: at("self_end_index")?,
                other_start: at("neighbor_start_index")?,
                other_end: at("neighbor_end_index")?,
            });
        }
        if !ids.is_empty() {
            self.unresolved.push((self.all.len(), left, ids));
        }
        Ok(found)
    }

    /// Resolves kinds, neighbours and links of all lanes.
    fn finish(mut self, dataset: Option<&str>) -> Result<Vec<LaneParts>, Cause> {
        if !(self.has_connectors || dataset == Some("nuscenes")) {
            // Outlines of lanes and connectors overlap.
            self.all.iter_mut().for_each(|lane| lane.kind = LaneKind::Connector);
        }
        let index: BTreeMap<&str, usize> =
            self.all.iter().enumerate().map(|(i, lane)| (lane.id.as_str(), i)).collect();
        let mut nearest = Vec::new();
        for (i, left, names) in &self.unresolved {
            let lane = &self.all[*i];
            // A file may list all lanes of the road on that side, including oncoming ones.
            let others = names.iter().filter_map(|name| self.all.get(*index.get(name.as_str())?));
            let next = others
                .filter_map(|other| Some((start_distance(lane, other)?, other)))
                .min_by(|a, b| a.0.total_cmp(&b.0));
            if let Some((_, other)) = next {
                let neighbor = NeighborParts::whole(&other.id, lane.points.len(), other.points.len());
                nearest.push((*i, *left, neighbor));
            }
        }
        for (i, left, neighbor) in nearest {
            let lane = &mut self.all[i];
            if left { &mut lane.left } else { &mut lane.right }.push(neighbor);
        }
        if self.all.iter().all(|l| l.successors.is_empty() && l.predecessors.is_empty()) {
            links::link(&mut self.all)?;
        }
        Ok(self.all)
    }
}

/// Returns the distance in metres between the first points of two lanes; `None` for lanes of opposite
/// directions.
fn start_distance(lane: &LaneParts, other: &LaneParts) -> Option<f64> {
    let direction = |l: &LaneParts| Some(l.points.last()? - l.points.first()?);
    let along = direction(lane)?.dot(&direction(other)?);
    (along > 0.0).then_some((lane.points.first()? - other.points.first()?).norm())
}

/// Reads the speed limit in m/s; zero means none.
fn limit(feature: &View) -> Result<Option<f64>, Cause> {
    for (key, unit) in [("speed_limit_mph", MPH), ("speed_limit_kmh", KMH)] {
        if let Some(given) = feature.get(key)? {
            return Ok(Some(given.number()? * unit).filter(|v| *v != 0.0));
        }
    }
    Ok(None)
}
