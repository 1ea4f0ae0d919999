//! Layers of a `map.gpkg`.

use std::collections::BTreeMap;
use std::path::Path;

use reactsim_geometry::{Bounds, Polygon, Vec2};

use super::map::{Area, Boundary, Map, MapLane, Stop};
use super::sqlite::{Cells, Database};
use super::utm::Utm;
use super::wkb::{self, Geometry};
use crate::error::{Cause, FormatError};

/// Layers whose polygons form the drivable area (`DRIVABLE_AREA` in the devkit).
const DRIVABLE_LAYERS: [&str; 4] =
    ["road_segments", "intersections", "generic_drivable_areas", "carpark_areas"];
/// Maximum number of fids of a list; usual lists have a few.
const MAX_FIDS: usize = 1000;
/// EPSG code of longitude and latitude on WGS 84.
const DEGREES_EPSG: i64 = 4326;

/// Reads a map.
pub(super) fn read(path: &Path) -> Result<Map, FormatError> {
    let database = Database::open(path)?;
    Reader::open(&database).and_then(|reader| reader.map()).map_err(|cause| FormatError::file(path, cause))
}

struct Reader<'a> {
    database: &'a Database,
    epsg: i64,
    zone: Utm,
    /// Geometry column and EPSG code of each layer.
    layers: BTreeMap<String, (String, i64)>,
}

impl<'a> Reader<'a> {
    fn open(database: &'a Database) -> Result<Self, Cause> {
        let mut layers = BTreeMap::new();
        database.each("gpkg_geometry_columns", &["table_name", "column_name", "srs_id"], |row| {
            layers.insert(row.text(0)?, (row.text(1)?, row.must_whole(2)?));
            Ok(())
        })?;
        let mut system = None;
        database.each("meta", &["key", "value"], |row| {
            if row.text(0)? == "projectedCoordSystem" {
                system = Some(row.text(1)?);
            }
            Ok(())
        })?;
        let name = system.ok_or_else(|| {
            Cause::schema("`meta.projectedCoordSystem`", "missing", "the map's zone, such as `epsg:32611`")
        })?;
        let code = name.to_ascii_lowercase().strip_prefix("epsg:").and_then(|c| c.trim().parse().ok());
        let zone = code.and_then(|epsg| Some((epsg, Utm::of_epsg(epsg)?)));
        let (epsg, zone) = zone.ok_or_else(|| {
            let expected = "a northern UTM zone, `epsg:32601` to `epsg:32660`";
            Cause::value("`meta.projectedCoordSystem`", format!("`{name}`"), expected)
        })?;
        Ok(Self { database, epsg, zone, layers })
    }

    /// Calls `take` with the fid, the geometry and the cells of each row of a layer. The given columns begin
    /// at cell 2.
    fn each(
        &self,
        layer: &str,
        columns: &[&str],
        mut take: impl FnMut(i64, Geometry, &Cells<'_>) -> Result<(), Cause>,
    ) -> Result<(), Cause> {
        let (geometry, epsg) = self.layers.get(layer).ok_or_else(|| {
            let expected = "a layer of a nuPlan map; fetch the map again";
            Cause::schema(format!("layer `{layer}`"), "missing in `gpkg_geometry_columns`", expected)
        })?;
        let degrees = |x, y| self.zone.project(x, y);
        let metres = |x: f64, y: f64| (x.is_finite() && y.is_finite()).then(|| Vec2::new(x, y));
        let place: &dyn Fn(f64, f64) -> Option<Vec2> = match *epsg {
            DEGREES_EPSG => &degrees,
            epsg if epsg == self.epsg => &metres,
            other => {
                let expected = format!("{DEGREES_EPSG} (longitude and latitude) or {}", self.epsg);
                return Err(Cause::value(
                    format!("`gpkg_geometry_columns.srs_id` of `{layer}`"),
                    other,
                    expected,
                ));
            }
        };
        let mut all = vec!["fid", geometry.as_str()];
        all.extend(columns);
        self.database.each(layer, &all, |row| {
            let blob = row.blob(1, "a GeoPackage geometry")?;
            let geometry = wkb::parse(blob, place).map_err(|wrong| {
                Cause::value(
                    row.field(1),
                    format!("a blob that {wrong}"),
                    "a GeoPackage geometry of nuPlan; fetch the map again",
                )
            })?;
            take(row.must_whole(0)?, geometry, row)
        })
    }

    fn map(&self) -> Result<Map, Cause> {
        let mut map = Map { epsg: self.epsg, ..Map::default() };
        self.lanes(&mut map)?;
        self.connectors(&mut map)?;
        self.baselines(&mut map)?;
        link(&mut map.lanes);
        self.boundaries(&mut map)?;
        self.stops(&mut map)?;
        map.crosswalks = self.areas("crosswalks")?;
        for layer in DRIVABLE_LAYERS {
            let areas = self.areas(layer)?;
            if layer == "intersections" {
                map.intersections.clone_from(&areas);
            }
            map.drivable.extend(areas);
        }
        for lane in map.lanes.values_mut() {
            lane.bounds = Bounds::of(lane.baseline.iter().chain(&lane.outline.exterior).copied());
        }
        Ok(map)
    }

    fn areas(&self, layer: &str) -> Result<Vec<Area>, Cause> {
        let mut areas = Vec::new();
        self.each(layer, &[], |fid, geometry, row| {
            let polygons = polygons(geometry, row)?;
            let bounds = bounds(&polygons);
            areas.push(Area { fid, polygons, bounds });
            Ok(())
        })?;
        areas.sort_by_key(|a| a.fid);
        Ok(areas)
    }

    fn lanes(&self, map: &mut Map) -> Result<(), Cause> {
        let columns = [
            "lane_fid",
            "lane_group_fid",
            "lane_index",
            "speed_limit_mps",
            "?lane_type_fid",
            "?left_boundary_fid",
            "?right_boundary_fid",
        ];
        self.each("lanes_polygons", &columns, |fid, geometry, row| {
            let lane = MapLane {
                is_connector: false,
                roadblock: row.whole(3)?,
                index: row.whole(4)?,
                lane_type: row.whole(6)?,
                speed_limit: row.number(5)?,
                outline: largest(polygons(geometry, row)?),
                sides: [row.whole(7)?, row.whole(8)?],
                ..MapLane::default()
            };
            insert(map, row.whole(2)?.unwrap_or(fid), lane, row)
        })
    }

    fn connectors(&self, map: &mut Map) -> Result<(), Cause> {
        let columns = [
            "exit_lane_fid",
            "entry_lane_fid",
            "lane_group_connector_fid",
            "traffic_light_stop_line_fids",
            "speed_limit_mps",
        ];
        self.each("lane_connectors", &columns, |fid, _, row| {
            let lane = MapLane {
                is_connector: true,
                roadblock: row.whole(4)?,
                speed_limit: row.number(6)?,
                // The exit is that of the preceding lane, the entry that of the following lane.
                incoming: row.whole(2)?.into_iter().collect(),
                outgoing: row.whole(3)?.into_iter().collect(),
                stop_fids: fids(row, 5)?,
                ..MapLane::default()
            };
            insert(map, fid, lane, row)
        })?;
        let columns = ["lane_connector_fid", "?left_boundary_fid", "?right_boundary_fid"];
        self.each("gen_lane_connectors_scaled_width_polygons", &columns, |_, geometry, row| {
            // Outlines without a connector are ignored.
            if let Some(lane) = row.whole(2)?.and_then(|fid| map.lanes.get_mut(&fid)) {
                lane.outline = largest(polygons(geometry, row)?);
                lane.sides = [row.whole(3)?, row.whole(4)?];
            }
            Ok(())
        })
    }

    fn baselines(&self, map: &mut Map) -> Result<(), Cause> {
        self.each("baseline_paths", &["lane_fid", "lane_connector_fid"], |_, geometry, row| {
            let fid = row.whole(2)?.or(row.whole(3)?);
            if let Some(lane) = fid.and_then(|fid| map.lanes.get_mut(&fid)) {
                lane.baseline = line(geometry, row)?;
            }
            Ok(())
        })
    }

    fn boundaries(&self, map: &mut Map) -> Result<(), Cause> {
        self.each("boundaries", &["?boundary_type_fid"], |fid, geometry, row| {
            let points = line(geometry, row)?;
            let bounds = Bounds::of(points.iter().copied());
            map.boundaries.insert(fid, Boundary { kind: row.whole(2)?, points, bounds });
            Ok(())
        })
    }

    fn stops(&self, map: &mut Map) -> Result<(), Cause> {
        let columns = ["stop_polygon_type_fid", "?lane_fids", "?lane_connector_fids"];
        self.each("stop_polygons", &columns, |fid, geometry, row| {
            let (lanes, connectors) = (fids(row, 3)?, fids(row, 4)?);
            let lanes = if connectors.is_empty() { lanes } else { connectors };
            map.stops.insert(fid, Stop { kind: row.whole(2)?, polygons: polygons(geometry, row)?, lanes });
            Ok(())
        })
    }
}

fn insert(map: &mut Map, fid: i64, lane: MapLane, row: &Cells<'_>) -> Result<(), Cause> {
    match map.lanes.insert(fid, lane) {
        None => Ok(()),
        Some(_) => Err(row.wrong(0, "a fid that no other lane or connector has")),
    }
}

/// Sets the connectors and neighbours of lanes.
fn link(lanes: &mut BTreeMap<i64, MapLane>) {
    let mut links = Vec::new();
    let mut places = BTreeMap::new();
    for (&fid, lane) in lanes.iter() {
        if lane.is_connector {
            links.extend(lane.incoming.iter().map(|&from| (from, fid, true)));
            links.extend(lane.outgoing.iter().map(|&to| (to, fid, false)));
        } else if let (Some(group), Some(index)) = (lane.roadblock, lane.index) {
            places.insert((group, index), fid);
        }
    }
    for (lane, connector, leaves) in links {
        if let Some(lane) = lanes.get_mut(&lane).filter(|l| !l.is_connector) {
            if leaves { &mut lane.outgoing } else { &mut lane.incoming }.push(connector);
        }
    }
    for lane in lanes.values_mut().filter(|l| !l.is_connector) {
        if let (Some(group), Some(index)) = (lane.roadblock, lane.index) {
            let at = |index: Option<i64>| places.get(&(group, index?)).copied();
            lane.neighbors = [at(index.checked_sub(1)), at(index.checked_add(1))];
        }
    }
}

/// Parses a list of fids, such as `12, 34`.
fn fids(row: &Cells<'_>, column: usize) -> Result<Vec<i64>, Cause> {
    let text = row.text(column)?;
    if text.len() > 21 * MAX_FIDS {
        return Err(row.wrong(column, format!("at most {MAX_FIDS} fids")));
    }
    let parts = text.split(',').map(str::trim).filter(|part| !part.is_empty());
    parts.map(|part| part.parse().map_err(|_| row.wrong(column, "fids separated by commas"))).collect()
}

fn polygons(geometry: Geometry, row: &Cells<'_>) -> Result<Vec<Polygon>, Cause> {
    match geometry {
        Geometry::Polygons(polygons) => Ok(polygons),
        _ => Err(Cause::value(row.field(1), "a point or a line", "a polygon")),
    }
}

fn line(geometry: Geometry, row: &Cells<'_>) -> Result<Vec<Vec2>, Cause> {
    match geometry {
        // The parts of a multi-line follow one another.
        Geometry::Lines(lines) => Ok(lines.concat()),
        _ => Err(Cause::value(row.field(1), "a point or a polygon", "a line")),
    }
}

fn bounds(polygons: &[Polygon]) -> Bounds {
    polygons.iter().fold(Bounds::EMPTY, |all, polygon| all.union(&polygon.bounds()))
}

/// Returns the largest polygon: a lane has one.
fn largest(polygons: Vec<Polygon>) -> Polygon {
    let area = |p: &Polygon| {
        let origin = p.exterior[0];
        p.exterior.windows(2).map(|w| (w[0] - origin).perp(&(w[1] - origin))).sum::<f64>().abs()
    };
    polygons.into_iter().max_by(|a, b| area(a).total_cmp(&area(b))).unwrap_or_default()
}
