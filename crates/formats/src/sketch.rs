//! Sketches: the drawn content of a scenario as compact JSON.
//!
//! Lengths are centimetres, angles milliradians, both rounded to integers. A list of points is flat: the
//! first point, then the difference of each point from the previous one (`x0 y0 dx dy …`). Tracks are
//! lists of spans without gaps, each with the frame of its first state and flat states
//! `x y heading speed`, the first one whole and the others as differences. Speeds (cm/s) are those of a
//! replayed log, from the distance since the previous frame: computed from rounded positions they would
//! be too coarse for times to collision. The same scenario gives the same bytes.

mod lines;
mod near;

use std::fmt::Write;

use reactsim_geometry::{Vec2, wrap};
use reactsim_scene::{Agent, DT, Frame, LaneArea, Length, LightState, RoadMap, Scenario};

use self::lines::{points, runs};
use self::near::Near;

/// Version of the format of [`sketch`].
pub const SKETCH_VERSION: u32 = 1;

/// Returns the JSON of a scenario: `agents` (the AV first, then the world agents), `context` (recorded
/// agents that take no part), the map in the surroundings, and the lights with one character per frame
/// (code 0 to 8, `-` if not observed). Scenarios of another length than the benchmark have `length`: the
/// index of the current frame, and the number of frames.
pub fn sketch(scenario: &Scenario) -> String {
    let near = Near::new(scenario);
    let length = scenario.length();
    let mut out = format!("{{\"v\":{SKETCH_VERSION},");
    if length != Length::BENCHMARK {
        write!(out, "\"length\":[{},{}],", length.current(), length.frames()).ok();
    }
    out.push_str("\"agents\":[");
    let count = scenario.start.agents.len();
    let agents = (0..count).map(|i| (&scenario.start.agents[i], scenario.logged(i)));
    list(&mut out, agents, |out, (agent, track)| self::agent(out, agent, &track));
    out.push_str("],\"context\":[");
    let present = |track: &[Frame]| track.iter().flatten().any(|s| near.holds(s.position()));
    let context = scenario.unselected.iter().filter(|logged| present(&logged.track));
    list(&mut out, context, |out, logged| agent(out, &logged.agent, &logged.track));
    out.push(']');
    map(&mut out, &scenario.start.map, &near);
    lights(&mut out, scenario, &near);
    out.push('}');
    out
}

/// Converts to centimetres. Clamped far beyond any real value, so that differences cannot overflow.
fn cm(metres: f64) -> i64 {
    (metres * 100.0).round().clamp(-1e15, 1e15) as i64
}

/// Writes items with commas between them.
fn list<T>(out: &mut String, items: impl Iterator<Item = T>, mut write: impl FnMut(&mut String, T)) {
    for (i, item) in items.enumerate() {
        if i > 0 {
            out.push(',');
        }
        write(out, item);
    }
}

/// Writes numbers with commas between them.
fn numbers(out: &mut String, values: impl Iterator<Item = i64>) {
    list(out, values, |out, value| {
        write!(out, "{value}").ok();
    });
}

fn agent(out: &mut String, agent: &Agent, track: &[Frame]) {
    let id = serde_json::Value::from(agent.id.as_str());
    let (kind, length, width) = (agent.kind as u8, cm(agent.length), cm(agent.width));
    write!(out, "{{\"id\":{id},\"k\":{kind},\"l\":{length},\"w\":{width},\"t\":[").ok();
    let mut f = 0;
    let mut is_first = true;
    while f < track.len() {
        if track[f].is_none() {
            f += 1;
            continue;
        }
        let span = track[f..].iter().map_while(|s| *s);
        out.push_str(if is_first { "[" } else { ",[" });
        is_first = false;
        write!(out, "{f}").ok();
        // Headings are unwrapped, so that differences stay small.
        let (mut before, mut last) = ([0; 4], None::<(Vec2, f64)>);
        for state in span {
            let heading = last.map_or(wrap(state.heading), |(_, h)| h + wrap(state.heading - h));
            let speed = last.map_or(state.speed(), |(p, _)| (state.position() - p).norm() / DT);
            last = Some((state.position(), heading));
            // The casts turn NaN into 0.
            let now = [cm(state.x), cm(state.y), (heading * 1000.0).round() as i64, cm(speed)];
            for (now, before) in now.iter().zip(before) {
                write!(out, ",{}", now - before).ok();
            }
            before = now;
            f += 1;
        }
        out.push(']');
    }
    out.push_str("]}");
}

fn map(out: &mut String, map: &RoadMap, near: &Near) {
    // Lanes: class, half width (0 if the outline is given instead), centre line.
    out.push_str(",\"lanes\":[");
    let layers = map.layers();
    let all_lanes = || layers.iter().flat_map(|layer| &layer.lanes);
    let lanes = all_lanes().flat_map(|lane| {
        let half_width = if let LaneArea::Corridor { half_width } = lane.area { cm(half_width) } else { 0 };
        runs(lane.baseline.points(), near).map(move |run| (lane.class as u8, half_width, run))
    });
    list(out, lanes, |out, (class, half_width, run)| {
        write!(out, "[{class},{half_width},[").ok();
        numbers(out, points(&run));
        out.push_str("]]");
    });
    out.push_str("],\"lane_areas\":[");
    let areas = all_lanes().filter_map(|lane| match &lane.area {
        LaneArea::Polygon(ring) => Some(ring.as_slice()),
        LaneArea::Corridor { .. } => None,
    });
    rings(out, areas, near);
    out.push_str("],\"edges\":[");
    let edges = layers.iter().flat_map(|layer| &layer.road_edges);
    let edges = edges.flat_map(|e| runs(&e.points, near).map(|run| (e.kind as u8, run)));
    list(out, edges, kind_and_points);
    out.push_str("],\"paint\":[");
    let paint = layers.iter().flat_map(|layer| &layer.road_lines);
    let paint = paint.flat_map(|l| runs(&l.points, near).map(|run| (l.paint, run)));
    list(out, paint, kind_and_points);
    out.push_str("],\"stops\":[");
    let stops = map.stop_lines.iter().filter(|s| s.ends.iter().any(|&p| near.holds(p)));
    list(out, stops, |out, stop| kind_and_points(out, (stop.kind as u8, stop.ends.to_vec())));
    for (name, outlines) in [
        ("crosswalks", map.crosswalks.iter().map(|c| c.outline.as_slice()).collect::<Vec<_>>()),
        ("bumps", map.speed_bumps.iter().map(|s| s.outline.as_slice()).collect()),
        ("driveways", map.driveways.iter().map(|s| s.outline.as_slice()).collect()),
        ("junctions", map.intersections.iter().map(Vec::as_slice).collect()),
    ] {
        write!(out, "],\"{name}\":[").ok();
        rings(out, outlines.into_iter(), near);
    }
    // Drivable polygons: the outline, then the holes.
    out.push_str("],\"drivable\":[");
    let drivable = map.drivable_area.iter().flatten().filter(|p| near.meets(&p.exterior));
    list(out, drivable, |out, polygon| {
        out.push('[');
        let outlines = std::iter::once(&polygon.exterior).chain(&polygon.holes);
        list(out, outlines, |out, ring| outline(out, ring));
        out.push(']');
    });
    out.push(']');
}

fn kind_and_points(out: &mut String, (kind, run): (u8, Vec<Vec2>)) {
    write!(out, "[{kind},[").ok();
    numbers(out, points(&run));
    out.push_str("]]");
}

/// Writes the outlines that reach into the surroundings.
fn rings<'a>(out: &mut String, outlines: impl Iterator<Item = &'a [Vec2]>, near: &Near) {
    list(out, outlines.filter(|ring| near.meets(ring)), outline);
}

fn outline(out: &mut String, ring: &[Vec2]) {
    out.push('[');
    numbers(out, points(&lines::simplified(ring)));
    out.push(']');
}

fn lights(out: &mut String, scenario: &Scenario, near: &Near) {
    out.push_str(",\"lights\":[");
    let lights = scenario.start.lights.iter().enumerate().filter(|(_, l)| near.holds(l.stop_point));
    list(out, lights, |out, (i, light)| {
        let states = scenario.light_states(i);
        let code = |s: &Option<LightState>| s.map_or('-', |s| char::from(b'0' + s.code()));
        let states: String = states.iter().map(code).collect();
        write!(out, "[{},{},\"{states}\"]", cm(light.stop_point.x), cm(light.stop_point.y)).ok();
    });
    out.push(']');
}
