//! Conversion of scenarios to columns.

use Leaf::{Flag, Number, Text, Whole};
use reactsim_geometry::Vec2;
use reactsim_scene::{Agent, Frame, Lane, LaneArea, LaneNeighbor, Scenario};

use super::Optional;
use crate::certificates::{self, STATE_VALUES};
use crate::table::{Column, Leaf, TableWriter, Value};

/// Name, cell type, nesting depth of lists and nullability of each column, in file order.
pub(super) const COLUMNS: &[(&str, Leaf, usize, bool)] = &[
    ("id", Text, 0, false),
    ("source", Text, 0, false),
    ("digest", Text, 0, false),
    ("origin_x", Number, 0, false),
    ("origin_y", Number, 0, false),
    ("timestamps", Number, 1, false),
    ("tracks_to_predict", Text, 1, false),
    ("objects_of_interest", Text, 1, false),
    ("repair_what", Text, 1, false),
    ("repair_count", Whole, 1, false),
    ("agent_id", Text, 1, false),
    ("agent_kind", Text, 1, false),
    ("agent_length", Number, 1, false),
    ("agent_width", Number, 1, false),
    ("agent_x", Number, 2, true),
    ("agent_y", Number, 2, true),
    ("agent_heading", Number, 2, true),
    ("agent_vx", Number, 2, true),
    ("agent_vy", Number, 2, true),
    ("lane_id", Text, 1, false),
    ("lane_kind", Text, 1, false),
    ("lane_class", Text, 1, false),
    ("lane_speed_limit", Number, 1, true),
    ("lane_x", Number, 2, false),
    ("lane_y", Number, 2, false),
    ("lane_half_width", Number, 1, true),
    ("lane_polygon_x", Number, 2, false),
    ("lane_polygon_y", Number, 2, false),
    ("lane_successors", Text, 2, false),
    ("lane_predecessors", Text, 2, false),
    ("lane_left", Text, 2, false),
    ("lane_left_self_start", Whole, 2, false),
    ("lane_left_self_end", Whole, 2, false),
    ("lane_left_other_start", Whole, 2, false),
    ("lane_left_other_end", Whole, 2, false),
    ("lane_right", Text, 2, false),
    ("lane_right_self_start", Whole, 2, false),
    ("lane_right_self_end", Whole, 2, false),
    ("lane_right_other_start", Whole, 2, false),
    ("lane_right_other_end", Whole, 2, false),
    ("road_edge_kind", Text, 1, false),
    ("road_edge_x", Number, 2, false),
    ("road_edge_y", Number, 2, false),
    ("road_line_paint", Whole, 1, false),
    ("road_line_x", Number, 2, false),
    ("road_line_y", Number, 2, false),
    ("stop_line_kind", Text, 1, false),
    ("stop_line_lane", Text, 1, false),
    ("stop_line_s", Number, 1, false),
    ("stop_line_x", Number, 2, false),
    ("stop_line_y", Number, 2, false),
    ("crosswalk_x", Number, 2, false),
    ("crosswalk_y", Number, 2, false),
    ("speed_bump_x", Number, 2, false),
    ("speed_bump_y", Number, 2, false),
    ("driveway_x", Number, 2, false),
    ("driveway_y", Number, 2, false),
    ("intersection_x", Number, 2, false),
    ("intersection_y", Number, 2, false),
    ("has_drivable_area", Flag, 0, false),
    ("drivable_area_x", Number, 3, false),
    ("drivable_area_y", Number, 3, false),
    ("light_lane", Text, 1, false),
    ("light_stop_x", Number, 1, false),
    ("light_stop_y", Number, 1, false),
    ("light_state", Text, 2, true),
    ("deviation_category", Text, 0, true),
    ("deviation_x", Number, 1, false),
    ("deviation_y", Number, 1, false),
    ("deviation_heading", Number, 1, false),
    ("deviation_vx", Number, 1, true),
    ("deviation_vy", Number, 1, true),
];

/// Columns of heights, of the same form as [`COLUMNS`]: without values for scenarios of one level, and
/// missing in files without others.
pub(super) const HEIGHT_COLUMNS: &[(&str, Leaf, usize, bool)] = &[
    ("agent_z", Number, 2, true),
    ("lane_z", Number, 2, false),
    ("road_edge_z", Number, 2, false),
    ("road_line_z", Number, 2, false),
    ("crosswalk_z", Number, 2, false),
    ("speed_bump_z", Number, 2, false),
    ("driveway_z", Number, 2, false),
    ("drivable_area_z", Number, 2, false),
];

/// Column of the number of frames up to and including the current one, of the same form as [`COLUMNS`]. In
/// files without it this is the number of the benchmark.
pub(super) const HISTORY_COLUMN: (&str, Leaf, usize, bool) = ("history", Whole, 0, false);

/// Returns the columns, empty.
pub(super) fn columns(optional: Optional) -> Vec<Column> {
    let own = COLUMNS
        .iter()
        .chain(HEIGHT_COLUMNS.iter().filter(|_| optional.heights))
        .chain(Some(&HISTORY_COLUMN).filter(|_| optional.history))
        .map(|&(name, leaf, depth, nullable)| Column::new(name, leaf, depth, nullable));
    own.chain(certificates::columns()).collect()
}

/// Adds a scenario as one row.
pub(super) fn scenario(table: &mut TableWriter, scenario: &Scenario, optional: Optional) {
    let t = table;
    t.column("id").push(Value::Text(&scenario.id));
    t.column("source").push(Value::Text(&scenario.source));
    t.column("digest").push(Value::Text(&scenario.digest()));
    t.column("origin_x").push(Value::Number(scenario.origin.x));
    t.column("origin_y").push(Value::Number(scenario.origin.y));
    t.column("timestamps").list(scenario.timestamps.iter().copied().map(Value::Number));
    texts(t, "tracks_to_predict", scenario.tracks_to_predict.iter().map(String::as_str));
    texts(t, "objects_of_interest", scenario.objects_of_interest.iter().map(String::as_str));
    texts(t, "repair_what", scenario.repairs.keys().map(String::as_str));
    t.column("repair_count").list(scenario.repairs.values().copied().map(Value::Whole));
    agents(t, scenario);
    lanes(t, scenario);
    surroundings(t, scenario);
    if optional.heights {
        heights(t, scenario);
    }
    if optional.history {
        t.column(HISTORY_COLUMN.0).push(Value::Whole(scenario.length().history as u32));
    }
    lights(t, scenario);
    deviation(t, scenario);
    certificates::encode(t, scenario.deviation.as_ref().and_then(|d| d.certificate.as_ref()));
}

fn texts<'a>(t: &mut TableWriter, column: &str, texts: impl Iterator<Item = &'a str>) {
    t.column(column).list(texts.map(Value::Text));
}

fn lines<'a, I: Iterator<Item = &'a [Vec2]> + Clone>(t: &mut TableWriter, x: &str, y: &str, lines: I) {
    t.column(x).lists(lines.clone().map(|l| l.iter().map(|p| Value::Number(p.x))));
    t.column(y).lists(lines.map(|l| l.iter().map(|p| Value::Number(p.y))));
}

fn agents(t: &mut TableWriter, scenario: &Scenario) {
    let start = &scenario.start;
    let slots = 0..start.agents.len();
    let all = || start.agents.iter().chain(scenario.unselected.iter().map(|a| &a.agent));
    let mut each = |column: &str, value: fn(&Agent) -> Value<'_>| t.column(column).list(all().map(value));
    each("agent_id", |a| Value::Text(&a.id));
    each("agent_kind", |a| Value::Text(a.kind.name()));
    each("agent_length", |a| Value::Number(a.length));
    each("agent_width", |a| Value::Number(a.width));
    let none: &[Frame] = &[];
    let tracks = || {
        let chosen =
            slots.clone().map(|i| (start.history[i].as_slice(), scenario.log_future.tracks[i].as_slice()));
        chosen.chain(scenario.unselected.iter().map(move |a| (a.track.as_slice(), none)))
    };
    for (column, value) in AGENT_STATE.into_iter().zip(STATE_VALUES) {
        let known = |f: &Frame| Value::from(f.as_ref().map(value).filter(|v| !v.is_nan()));
        t.column(column).lists(tracks().map(|(a, b)| a.iter().chain(b).map(known)));
    }
}

/// Columns of the states of agents.
pub(super) const AGENT_STATE: [&str; 5] = ["agent_x", "agent_y", "agent_heading", "agent_vx", "agent_vy"];
/// Columns of the states of a deviated AV.
pub(super) const DEVIATION_STATE: [&str; 5] =
    ["deviation_x", "deviation_y", "deviation_heading", "deviation_vx", "deviation_vy"];

fn lanes(t: &mut TableWriter, scenario: &Scenario) {
    let lanes = &scenario.start.map.lanes;
    texts(t, "lane_id", lanes.iter().map(|l| l.id.as_str()));
    texts(t, "lane_kind", lanes.iter().map(|l| l.kind.name()));
    texts(t, "lane_class", lanes.iter().map(|l| l.class.name()));
    t.column("lane_speed_limit").list(lanes.iter().map(|l| Value::from(l.speed_limit)));
    lines(t, "lane_x", "lane_y", lanes.iter().map(|l| l.baseline.points()));
    t.column("lane_half_width").list(lanes.iter().map(|l| match l.area {
        LaneArea::Corridor { half_width } => Value::Number(half_width),
        LaneArea::Polygon(_) => Value::Null,
    }));
    lines(
        t,
        "lane_polygon_x",
        "lane_polygon_y",
        lanes.iter().map(|l| match &l.area {
            LaneArea::Corridor { .. } => &[],
            LaneArea::Polygon(ring) => ring.as_slice(),
        }),
    );
    let id = |i: &usize| Value::Text(&lanes[*i].id);
    t.column("lane_successors").lists(lanes.iter().map(|l| l.successors.iter().map(id)));
    t.column("lane_predecessors").lists(lanes.iter().map(|l| l.predecessors.iter().map(id)));
    let sides: [Side; 2] = [(LEFT, |l| &l.left), (RIGHT, |l| &l.right)];
    for ([other, self_start, self_end, other_start, other_end], side) in sides {
        t.column(other).lists(lanes.iter().map(|l| side(l).iter().map(|n| id(&n.lane))));
        let mut each = |column: &str, value: fn(&LaneNeighbor) -> u32| {
            t.column(column).lists(lanes.iter().map(|l| side(l).iter().map(value).map(Value::Whole)));
        };
        each(self_start, |n| n.self_start);
        each(self_end, |n| n.self_end);
        each(other_start, |n| n.other_start);
        each(other_end, |n| n.other_end);
    }
}

/// Columns of the neighbours on one side of a lane, and the accessor of these neighbours.
type Side = ([&'static str; 5], fn(&Lane) -> &[LaneNeighbor]);

/// Columns of the neighbours on the left: lane id, then the four point indices.
pub(super) const LEFT: [&str; 5] = [
    "lane_left",
    "lane_left_self_start",
    "lane_left_self_end",
    "lane_left_other_start",
    "lane_left_other_end",
];
/// Columns of the neighbours on the right, as in [`LEFT`].
pub(super) const RIGHT: [&str; 5] = [
    "lane_right",
    "lane_right_self_start",
    "lane_right_self_end",
    "lane_right_other_start",
    "lane_right_other_end",
];

fn surroundings(t: &mut TableWriter, scenario: &Scenario) {
    let map = &scenario.start.map;
    texts(t, "road_edge_kind", map.road_edges.iter().map(|e| e.kind.name()));
    lines(t, "road_edge_x", "road_edge_y", map.road_edges.iter().map(|e| e.points.as_slice()));
    t.column("road_line_paint").list(map.road_lines.iter().map(|l| Value::Whole(u32::from(l.paint))));
    lines(t, "road_line_x", "road_line_y", map.road_lines.iter().map(|l| l.points.as_slice()));
    texts(t, "stop_line_kind", map.stop_lines.iter().map(|l| l.kind.name()));
    texts(t, "stop_line_lane", map.stop_lines.iter().map(|l| map.lanes[l.lane].id.as_str()));
    t.column("stop_line_s").list(map.stop_lines.iter().map(|l| Value::Number(l.s)));
    lines(t, "stop_line_x", "stop_line_y", map.stop_lines.iter().map(|l| l.ends.as_slice()));
    lines(t, "crosswalk_x", "crosswalk_y", map.crosswalks.iter().map(|c| c.outline.as_slice()));
    lines(t, "speed_bump_x", "speed_bump_y", map.speed_bumps.iter().map(|c| c.outline.as_slice()));
    lines(t, "driveway_x", "driveway_y", map.driveways.iter().map(|c| c.outline.as_slice()));
    lines(t, "intersection_x", "intersection_y", map.intersections.iter().map(Vec::as_slice));
    t.column("has_drivable_area").push(Value::Flag(map.drivable_area.is_some()));
    let rings = || {
        map.drivable_area
            .iter()
            .flatten()
            .map(|p| std::iter::once(p.exterior.as_slice()).chain(p.holes.iter().map(Vec::as_slice)))
    };
    t.column("drivable_area_x").nested(rings().map(|p| p.map(|r| r.iter().map(|v| Value::Number(v.x)))));
    t.column("drivable_area_y").nested(rings().map(|p| p.map(|r| r.iter().map(|v| Value::Number(v.y)))));
}

fn heights(t: &mut TableWriter, scenario: &Scenario) {
    let (start, none) = (&scenario.start, &[] as &[Option<f64>]);
    let known = start.has_levels();
    let slots = (0..start.agents.len()).filter(|_| known);
    let chosen = slots.map(|i| (start.heights[i].as_slice(), scenario.log_future.heights[i].as_slice()));
    let unselected = scenario.unselected.iter().filter(|_| known);
    let all = chosen.chain(unselected.map(|a| (a.heights.as_slice(), none)));
    t.column("agent_z").lists(all.map(|(a, b)| a.iter().chain(b).copied().map(Value::from)));
    for ((column, ..), list) in HEIGHT_COLUMNS[1..].iter().zip(start.map.heights.lists()) {
        t.column(column).lists(list.iter().map(|heights| heights.iter().copied().map(Value::Number)));
    }
}

fn lights(t: &mut TableWriter, scenario: &Scenario) {
    let start = &scenario.start;
    texts(t, "light_lane", start.lights.iter().map(|l| start.map.lanes[l.lane].id.as_str()));
    t.column("light_stop_x").list(start.lights.iter().map(|l| Value::Number(l.stop_point.x)));
    t.column("light_stop_y").list(start.lights.iter().map(|l| Value::Number(l.stop_point.y)));
    t.column("light_state").lists((0..start.lights.len()).map(|i| {
        let states = start.light_history[i].iter().chain(&scenario.log_future.lights[i]);
        states.map(|s| Value::from(s.map(|s| s.name())))
    }));
}

fn deviation(t: &mut TableWriter, scenario: &Scenario) {
    let deviation = scenario.deviation.as_ref();
    let category = deviation.and_then(|d| d.category).map(|c| c.name());
    t.column("deviation_category").push(Value::from(category));
    for (column, value) in DEVIATION_STATE.into_iter().zip(STATE_VALUES) {
        let states = deviation.iter().flat_map(|d| &d.track).map(value);
        t.column(column).list(states.map(|v| Value::from(Some(v).filter(|v| !v.is_nan()))));
    }
}
