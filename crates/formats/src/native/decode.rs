//! Conversion of columns to scenarios.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;

use reactsim_geometry::{Polygon, Vec2};
use reactsim_scene::{
    Agent, AgentKind, AgentState, Certificate, Crosswalk, Deviation, DeviationParts, EARLIER_FRAME, Frame,
    HISTORY, LATER_FRAME, LaneArea, LaneClass, LaneKind, LaneParts, Length, LightParts, LightState,
    LoggedAgent, MapHeights, MapParts, NeighborParts, RoadEdge, RoadEdgeKind, RoadLine, Scenario,
    ScenarioParts, StopKind, StopLine, Surface,
};

use super::encode::{AGENT_STATE, COLUMNS, DEVIATION_STATE, HEIGHT_COLUMNS, HISTORY_COLUMN, LEFT, RIGHT};
use super::wrong;
use crate::certificates;
use crate::crop::{count_unrecorded, cut};
use crate::error::{Cause, FormatError};
use crate::frames::LengthChoice;
use crate::table::{Batch, View};

/// Name of the repair that counts deviated AVs of scenarios whose windows are read.
const LEFT_OUT_AV: &str = "deviated AVs, which windows do not have";

/// Columns of the rows in memory.
pub(super) struct Rows {
    views: Vec<View>,
    certificates: Vec<Option<Certificate>>,
    len: usize,
}

impl Rows {
    /// Finds all columns.
    pub(super) fn new(batch: &Batch) -> Result<Self, Cause> {
        let mut views = Vec::with_capacity(COLUMNS.len());
        for &(name, leaf, depth, _) in COLUMNS {
            views.push(View::need(batch, name, leaf, depth)?);
        }
        for &(name, leaf, depth, _) in HEIGHT_COLUMNS.iter().chain([&HISTORY_COLUMN]) {
            views.extend(View::find(batch, name, leaf, depth)?);
        }
        Ok(Self { views, certificates: certificates::decode(batch)?, len: batch.num_rows() })
    }

    pub(super) fn len(&self) -> usize {
        self.len
    }

    /// Returns the digest stored for a row.
    pub(super) fn digest(&self, row: usize) -> Option<&str> {
        self.text("digest", row).ok()
    }

    /// Decodes the scenario of a row; its digest must match the stored one, with the agents that the
    /// benchmark selects or with all agents. Also returns the digest, unless the scenario was completed
    /// since.
    pub(super) fn scenario(
        &self,
        row: usize,
        path: &Path,
        record: u64,
    ) -> Result<(Scenario, Option<String>), FormatError> {
        self.selected(row, path, record).map(|(scenario, digest, _)| (scenario, digest))
    }

    /// Decodes the same, and whether it has all agents.
    fn selected(
        &self,
        row: usize,
        path: &Path,
        record: u64,
    ) -> Result<(Scenario, Option<String>, bool), FormatError> {
        let id = self.text("id", row).unwrap_or_default().to_owned();
        let refuse = |cause| FormatError::record(path, record, Some(id.clone()), cause);
        let parts = self.parts(row).map_err(refuse)?;
        let assembled = Scenario::assemble_as_stored(parts);
        let mut scenario = assembled.map_err(|e| FormatError::scene(path, record, e))?;
        // Stop lines are stored after projection: projecting them again would move them by a rounding error.
        let stop_lines = self.stop_lines(row, &scenario).map_err(refuse)?;
        scenario.start.map.edit().stop_lines = stop_lines;
        scenario.repairs = self.repairs(row);
        let (found, expected) = (scenario.digest(), self.text("digest", row).map_err(refuse)?);
        let has_all = found != expected;
        if has_all {
            // Agents are stored in their order, and not which of them are simulated. The digest tells a
            // scenario with all agents from one with the agents of the benchmark.
            scenario = scenario.with_all_agents();
            if scenario.digest() != expected {
                let what = "the scenario";
                return Err(refuse(Cause::Checksum { what, found, expected: expected.to_owned() }));
            }
        }
        let is_changed = scenario.complete();
        Ok((scenario, (!is_changed).then(|| expected.to_owned()), has_all))
    }

    /// Decodes the window of the scenario of a row around this frame, which its id gets: `ID@FRAME`.
    pub(super) fn window(
        &self,
        row: usize,
        path: &Path,
        record: u64,
        (current, length): (usize, LengthChoice),
    ) -> Result<Scenario, FormatError> {
        let (whole, _, has_all) = self.selected(row, path, record)?;
        let refuse = |cause| FormatError::record(path, record, Some(whole.id.clone()), cause);
        let mut parts = self.parts(row).map_err(refuse)?;
        cut(&mut parts, current, length).map_err(refuse)?;
        let assembled = Scenario::assemble_as_stored(parts);
        let mut scenario = assembled.map_err(|e| FormatError::scene(path, record, e))?;
        // Coordinates were relative to the origin of the whole.
        let shift = scenario.origin;
        let stop_lines = whole
            .start
            .map
            .stop_lines
            .iter()
            .map(|line| StopLine { ends: line.ends.map(|end| end - shift), ..line.clone() });
        scenario.start.map.edit().stop_lines = stop_lines.collect();
        scenario.origin += whole.origin;
        scenario.id = format!("{}@{current}", whole.id);
        let after = whole.length().frames() - current - 1;
        let mut repairs = whole.repairs;
        repairs.retain(|what, _| what != EARLIER_FRAME && what != LATER_FRAME);
        count_unrecorded(&mut repairs, after - scenario.length().future);
        repairs.extend(whole.deviation.map(|_| (LEFT_OUT_AV.to_owned(), 1)));
        scenario.repairs.extend(repairs);
        if has_all {
            scenario = scenario.with_all_agents();
        }
        scenario.complete();
        Ok(scenario)
    }

    /// Returns the number of frames of the scenario of a row.
    pub(super) fn frames(&self, row: usize) -> usize {
        let x = self.view("agent_x");
        x.range(0, row).next().map_or(0, |av| x.range(1, av).len())
    }

    fn view(&self, name: &str) -> &View {
        self.views.iter().find(|v| v.name() == name).expect("columns are named as in the schema")
    }

    fn text(&self, column: &'static str, row: usize) -> Result<&str, Cause> {
        self.view(column).text(row).ok_or_else(|| wrong(column, "null", "a text"))
    }

    fn texts(&self, column: &'static str, row: usize) -> Vec<String> {
        let view = self.view(column);
        view.range(0, row).filter_map(|i| view.text(i)).map(str::to_owned).collect()
    }

    /// Returns the cells of a list, which must have `expected` elements.
    fn cells(&self, column: &'static str, row: usize, expected: usize) -> Result<Range<usize>, Cause> {
        let range = self.view(column).range(0, row);
        if range.len() == expected {
            return Ok(range);
        }
        Err(wrong(column, format!("{} entries", range.len()), &format!("{expected} entries")))
    }

    /// Reads the lists of points in two columns; there must be `expected` of them, or any number for `None`.
    fn lines(
        &self,
        [x, y]: [&'static str; 2],
        row: usize,
        expected: Option<usize>,
    ) -> Result<Vec<Vec<Vec2>>, Cause> {
        let (xs, ys) = (self.view(x), self.view(y));
        let outer = xs.range(0, row);
        let expected = expected.unwrap_or(outer.len());
        let (outer_x, outer_y) = (self.cells(x, row, expected)?, self.cells(y, row, expected)?);
        let mut lines = Vec::with_capacity(expected);
        for (i, j) in outer_x.zip(outer_y) {
            lines.push(points(xs, xs.range(1, i), ys, ys.range(1, j))?);
        }
        Ok(lines)
    }

    fn parts(&self, row: usize) -> Result<ScenarioParts, Cause> {
        let number = |column| self.view(column).number(row).ok_or_else(|| wrong(column, "null", "a number"));
        let times = self.view("timestamps");
        let agents = self.agents(row)?;
        Ok(ScenarioParts {
            id: self.text("id", row)?.to_owned(),
            source: self.text("source", row)?.to_owned(),
            origin: Some(Vec2::new(number("origin_x")?, number("origin_y")?)),
            length: self.length(row, &agents),
            timestamps: times.range(0, row).filter_map(|i| times.number(i)).collect(),
            av: 0,
            agents,
            tracks_to_predict: self.texts("tracks_to_predict", row),
            objects_of_interest: self.texts("objects_of_interest", row),
            map: self.map(row)?,
            lights: self.lights(row)?,
            deviation: self.deviation(row)?,
        })
    }

    /// Returns the length of a scenario, which the track of the AV has. Assembly checks the others.
    fn length(&self, row: usize, agents: &[LoggedAgent]) -> Length {
        let stated = self.views.iter().find(|v| v.name() == HISTORY_COLUMN.0);
        let history = stated.map_or(HISTORY, |view| view.whole(row).unwrap_or(0) as usize);
        let frames = agents.first().map_or(0, |av| av.track.len());
        Length { history, future: frames.saturating_sub(history) }
    }

    fn agents(&self, row: usize) -> Result<Vec<LoggedAgent>, Cause> {
        let ids = self.texts("agent_id", row);
        let kinds = self.names("agent_kind", row, ids.len(), AgentKind::from_name)?;
        let sizes = ["agent_length", "agent_width"];
        let [lengths, widths] = sizes.map(|c| (self.view(c), self.cells(c, row, ids.len())));
        let (length_cells, width_cells) = (lengths.1?, widths.1?);
        for field in AGENT_STATE {
            self.cells(field, row, ids.len())?;
        }
        let views = AGENT_STATE.map(|c| self.view(c));
        let mut heights = self.heights("agent_z", row, View::number).into_iter();
        let mut agents = Vec::with_capacity(ids.len());
        for (i, (id, kind)) in ids.into_iter().zip(kinds).enumerate() {
            let ranges = views.map(|v| v.range(1, v.range(0, row).start + i));
            agents.push(LoggedAgent {
                agent: Agent {
                    id,
                    kind,
                    length: lengths.0.number(length_cells.start + i).unwrap_or(f64::NAN),
                    width: widths.0.number(width_cells.start + i).unwrap_or(f64::NAN),
                },
                track: track(views, ranges)?,
                heights: heights.next().unwrap_or_default(),
            });
        }
        Ok(agents)
    }

    /// Reads a list of names and converts each by `from_name`.
    fn names<T>(
        &self,
        column: &'static str,
        row: usize,
        expected: usize,
        from_name: fn(&str) -> Option<T>,
    ) -> Result<Vec<T>, Cause> {
        let view = self.view(column);
        let known = |i| {
            let name = view.text(i).unwrap_or_default();
            from_name(name).ok_or_else(|| wrong(column, format!("`{name}`"), "a known name"))
        };
        self.cells(column, row, expected)?.map(known).collect()
    }

    fn map(&self, row: usize) -> Result<MapParts, Cause> {
        let surfaces = |columns| -> Result<Vec<Surface>, Cause> {
            Ok(self.lines(columns, row, None)?.into_iter().map(|outline| Surface { outline }).collect())
        };
        let edges = self.lines(["road_edge_x", "road_edge_y"], row, None)?;
        let edge_kinds = self.names("road_edge_kind", row, edges.len(), RoadEdgeKind::from_name)?;
        let painted = self.lines(["road_line_x", "road_line_y"], row, None)?;
        let paints = self.view("road_line_paint");
        let paint_cells = self.cells("road_line_paint", row, painted.len())?;
        let paint = |i| paints.whole(i).and_then(|p| u8::try_from(p).ok()).unwrap_or(0);
        let crosswalks = self.lines(["crosswalk_x", "crosswalk_y"], row, None)?;
        Ok(MapParts {
            lanes: self.lanes(row)?,
            road_edges: edge_kinds
                .into_iter()
                .zip(edges)
                .map(|(kind, points)| RoadEdge { kind, points })
                .collect(),
            road_lines: paint_cells
                .zip(painted)
                .map(|(i, points)| RoadLine { paint: paint(i), points })
                .collect(),
            stop_lines: Vec::new(),
            crosswalks: crosswalks.into_iter().map(|outline| Crosswalk { outline }).collect(),
            speed_bumps: surfaces(["speed_bump_x", "speed_bump_y"])?,
            driveways: surfaces(["driveway_x", "driveway_y"])?,
            intersections: self.lines(["intersection_x", "intersection_y"], row, None)?,
            drivable_area: self.drivable_area(row)?,
            heights: self.map_heights(row),
        })
    }

    /// Reads the lists of heights in a column; none if the file has no such column. Assembly checks their
    /// shapes.
    fn heights<T>(&self, column: &str, row: usize, value: fn(&View, usize) -> T) -> Vec<Vec<T>> {
        let Some(view) = self.views.iter().find(|v| v.name() == column) else { return Vec::new() };
        view.range(0, row).map(|i| view.range(1, i).map(|cell| value(view, cell)).collect()).collect()
    }

    fn map_heights(&self, row: usize) -> MapHeights {
        let list = |column| self.heights(column, row, |view, cell| view.number(cell).unwrap_or(f64::NAN));
        MapHeights {
            lanes: list("lane_z"),
            road_edges: list("road_edge_z"),
            road_lines: list("road_line_z"),
            crosswalks: list("crosswalk_z"),
            speed_bumps: list("speed_bump_z"),
            driveways: list("driveway_z"),
            drivable_area: list("drivable_area_z"),
        }
    }

    fn drivable_area(&self, row: usize) -> Result<Option<Vec<Polygon>>, Cause> {
        if self.view("has_drivable_area").flag(row) != Some(true) {
            return Ok(None);
        }
        let (xs, ys) = (self.view("drivable_area_x"), self.view("drivable_area_y"));
        let outer = xs.range(0, row);
        let mut area = Vec::with_capacity(outer.len());
        for (i, j) in outer.clone().zip(self.cells("drivable_area_y", row, outer.len())?) {
            let mut rings = Vec::new();
            for (a, b) in xs.range(1, i).zip(ys.range(1, j)) {
                rings.push(points(xs, xs.range(2, a), ys, ys.range(2, b))?);
            }
            let mut rings = rings.into_iter();
            area.push(Polygon { exterior: rings.next().unwrap_or_default(), holes: rings.collect() });
        }
        Ok(Some(area))
    }

    fn lanes(&self, row: usize) -> Result<Vec<LaneParts>, Cause> {
        let ids = self.texts("lane_id", row);
        let count = ids.len();
        let kinds = self.names("lane_kind", row, count, LaneKind::from_name)?;
        let classes = self.names("lane_class", row, count, LaneClass::from_name)?;
        let (limits, limit) =
            (self.view("lane_speed_limit"), self.cells("lane_speed_limit", row, count)?.start);
        let (widths, width) =
            (self.view("lane_half_width"), self.cells("lane_half_width", row, count)?.start);
        let mut baselines = self.lines(["lane_x", "lane_y"], row, Some(count))?;
        let mut polygons = self.lines(["lane_polygon_x", "lane_polygon_y"], row, Some(count))?;
        let links = |column| -> Result<Vec<Vec<String>>, Cause> {
            let view = self.view(column);
            let list = |i| view.range(1, i).filter_map(|c| view.text(c)).map(str::to_owned).collect();
            Ok(self.cells(column, row, count)?.map(list).collect())
        };
        let (mut successors, mut predecessors) = (links("lane_successors")?, links("lane_predecessors")?);
        let (mut left, mut right) = (self.neighbors(LEFT, row, count)?, self.neighbors(RIGHT, row, count)?);
        let mut lanes = Vec::with_capacity(count);
        for (i, id) in ids.into_iter().enumerate() {
            lanes.push(LaneParts {
                id,
                kind: kinds[i],
                class: classes[i],
                speed_limit: limits.number(limit + i),
                points: std::mem::take(&mut baselines[i]),
                area: match widths.number(width + i) {
                    Some(half_width) => LaneArea::Corridor { half_width },
                    None => LaneArea::Polygon(std::mem::take(&mut polygons[i])),
                },
                successors: std::mem::take(&mut successors[i]),
                predecessors: std::mem::take(&mut predecessors[i]),
                left: std::mem::take(&mut left[i]),
                right: std::mem::take(&mut right[i]),
            });
        }
        Ok(lanes)
    }

    fn neighbors(
        &self,
        columns: [&'static str; 5],
        row: usize,
        count: usize,
    ) -> Result<Vec<Vec<NeighborParts>>, Cause> {
        for column in columns {
            self.cells(column, row, count)?;
        }
        let views = columns.map(|c| self.view(c));
        let mut all = Vec::with_capacity(count);
        for i in 0..count {
            let ranges = views.map(|v| v.range(1, v.range(0, row).start + i));
            let [ids, a, b, c, d] = &ranges;
            if let Some(column) = (0..5).find(|k| ranges[*k].len() != ids.len()) {
                let found = format!("{} entries", ranges[column].len());
                return Err(wrong(columns[column], found, &format!("{} entries", ids.len())));
            }
            let neighbor = |k: usize| NeighborParts {
                lane: views[0].text(ids.start + k).unwrap_or_default().to_owned(),
                self_start: views[1].whole(a.start + k).unwrap_or(0),
                self_end: views[2].whole(b.start + k).unwrap_or(0),
                other_start: views[3].whole(c.start + k).unwrap_or(0),
                other_end: views[4].whole(d.start + k).unwrap_or(0),
            };
            all.push((0..ids.len()).map(neighbor).collect());
        }
        Ok(all)
    }

    fn stop_lines(&self, row: usize, scenario: &Scenario) -> Result<Vec<StopLine>, Cause> {
        let ids = self.view("stop_line_lane");
        let range = ids.range(0, row);
        if range.is_empty() {
            return Ok(Vec::new());
        }
        let lanes = &scenario.start.map.lanes;
        let index: BTreeMap<&str, usize> =
            lanes.iter().enumerate().map(|(i, l)| (l.id.as_str(), i)).collect();
        let kinds = self.names("stop_line_kind", row, range.len(), StopKind::from_name)?;
        let along = self.view("stop_line_s");
        let first = self.cells("stop_line_s", row, range.len())?.start;
        let ends = self.lines(["stop_line_x", "stop_line_y"], row, Some(range.len()))?;
        let mut lines = Vec::with_capacity(range.len());
        for (i, ((cell, kind), ends)) in range.zip(kinds).zip(ends).enumerate() {
            let id = ids.text(cell).unwrap_or_default();
            let lane = index.get(id).copied();
            let lane = lane.ok_or_else(|| wrong("stop_line_lane", format!("`{id}`"), "the id of a lane"))?;
            let s = along.number(first + i).filter(|s| s.is_finite());
            let s = s.ok_or_else(|| wrong("stop_line_s", "not finite", "an arc length"))?;
            let [a, b] = ends[..] else {
                return Err(wrong("stop_line_x", format!("{} points", ends.len()), "2 points"));
            };
            lines.push(StopLine { kind, lane, s, ends: [a, b] });
        }
        Ok(lines)
    }

    fn repairs(&self, row: usize) -> BTreeMap<String, u32> {
        let (what, count) = (self.view("repair_what"), self.view("repair_count"));
        let pairs = what.range(0, row).zip(count.range(0, row));
        pairs.filter_map(|(i, j)| Some((what.text(i)?.to_owned(), count.whole(j)?))).collect()
    }

    fn lights(&self, row: usize) -> Result<Vec<LightParts>, Cause> {
        let lanes = self.texts("light_lane", row);
        let (xs, ys) = (self.view("light_stop_x"), self.view("light_stop_y"));
        let x = self.cells("light_stop_x", row, lanes.len())?.start;
        let y = self.cells("light_stop_y", row, lanes.len())?.start;
        let states = self.view("light_state");
        let first = self.cells("light_state", row, lanes.len())?.start;
        let mut lights = Vec::with_capacity(lanes.len());
        for (i, lane) in lanes.into_iter().enumerate() {
            let state = |cell| match states.text(cell) {
                None => Ok(None),
                Some(name) => LightState::from_name(name)
                    .map(Some)
                    .ok_or_else(|| wrong("light_state", format!("`{name}`"), "a known name")),
            };
            let unknown = f64::NAN;
            lights.push(LightParts {
                lane,
                stop_point: Vec2::new(
                    xs.number(x + i).unwrap_or(unknown),
                    ys.number(y + i).unwrap_or(unknown),
                ),
                states: states.range(1, first + i).map(state).collect::<Result<_, _>>()?,
            });
        }
        Ok(lights)
    }

    fn deviation(&self, row: usize) -> Result<Option<DeviationParts>, Cause> {
        let views = DEVIATION_STATE.map(|c| self.view(c));
        if views[0].range(0, row).is_empty() {
            return Ok(None);
        }
        let category = |name| {
            let expected = "longitudinal, lateral or directional";
            Deviation::from_name(name)
                .ok_or_else(|| wrong("deviation_category", format!("`{name}`"), expected))
        };
        let category = self.view("deviation_category").text(row).map(category).transpose()?;
        let track = track(views, views.map(|v| v.range(0, row)))?;
        Ok(Some(DeviationParts { category, track, certificate: self.certificates[row].clone() }))
    }
}

/// Reads points whose coordinates are in two ranges of cells.
fn points(xs: &View, x: Range<usize>, ys: &View, y: Range<usize>) -> Result<Vec<Vec2>, Cause> {
    if x.len() != y.len() {
        return Err(wrong(ys.name(), format!("{} coordinates", y.len()), &format!("{}", x.len())));
    }
    let ((x, present_x), (y, present_y)) = (xs.numbers(x), ys.numbers(y));
    if [present_x, present_y].into_iter().flatten().flatten().any(|is_present| !is_present) {
        return Err(wrong(xs.name(), "null", "a coordinate"));
    }
    Ok(x.iter().zip(y).map(|(x, y)| Vec2::new(*x, *y)).collect())
}

/// Reads frames whose x, y, heading, vx and vy are in five ranges of cells. Null positions mean absent, null
/// velocities unknown.
fn track(views: [&View; 5], ranges: [Range<usize>; 5]) -> Result<Vec<Frame>, Cause> {
    let frames = ranges[0].len();
    if let Some(k) = (0..5).find(|k| ranges[*k].len() != frames) {
        return Err(wrong(
            views[k].name(),
            format!("{} frames", ranges[k].len()),
            &format!("{frames} frames"),
        ));
    }
    let columns: [_; 5] = std::array::from_fn(|k| views[k].numbers(ranges[k].clone()));
    let mut track = Vec::with_capacity(frames);
    for f in 0..frames {
        let value = |k: usize| {
            let (numbers, present) = columns[k];
            present.is_none_or(|present| present[f]).then(|| numbers[f])
        };
        track.push(match (value(0), value(1), value(2)) {
            (Some(x), Some(y), Some(heading)) => Some(AgentState {
                x,
                y,
                heading,
                vx: value(3).unwrap_or(f64::NAN),
                vy: value(4).unwrap_or(f64::NAN),
            }),
            (None, None, None) => None,
            _ => {
                let field = format!("{}, {} and {}", views[0].name(), views[1].name(), views[2].name());
                return Err(wrong(&field, format!("partly null at frame {f}"), "all known or all null"));
            }
        });
    }
    Ok(track)
}
