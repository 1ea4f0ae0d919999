//! Conversion of a hand-written file to scenario parts.

use std::collections::{BTreeMap, BTreeSet};

use reactsim_geometry::{Polygon, Vec2};
use reactsim_scene::{
    Agent, AgentKind, AgentState, Crosswalk, Deviation, DeviationParts, Frame, LANE_HALF_WIDTH, LaneArea,
    LaneClass, LaneKind, LaneParts, Length, LightParts, LightState, LoggedAgent, MapParts, NeighborParts,
    RoadEdge, RoadEdgeKind, RoadLine, ScenarioParts, StopKind, StopLineParts, Surface,
};

use super::motion;
use super::raw::{
    FORMAT, RawAgent, RawDeviation, RawLane, RawLight, RawMap, RawNeighbor, RawPath, RawScenario, RawTrack,
};
use crate::error::Cause;
use crate::frames::{check_lights, most_agents};

pub(super) fn parts(raw: RawScenario) -> Result<ScenarioParts, Cause> {
    if raw.format != FORMAT {
        return Err(Cause::schema("`format`", format!("`{}`", raw.format), format!("`{FORMAT}`")));
    }
    if raw.intent.trim().is_empty() {
        return Err(Cause::value("intent", "empty", "one sentence on what the scenario is for"));
    }
    let av = match &raw.av {
        None => 0,
        Some(id) => raw
            .agents
            .iter()
            .position(|a| a.id == *id)
            .ok_or_else(|| Cause::value("av", format!("`{id}`"), "the id of an agent"))?,
    };
    let length = Length { history: raw.history, future: raw.future };
    if !length.is_valid() {
        let found = format!("{} and {} frames", length.history, length.future);
        let (history, future) = (Length::MAX_HISTORY, Length::MAX_FUTURE);
        let expected = format!("2 to {history} and 1 to {future} frames");
        return Err(Cause::value("history and future", found, expected));
    }
    // Each agent has all states, however short its description is.
    let most = most_agents(length.frames());
    if raw.agents.len() > most {
        let expected = format!("at most {most} in one scenario");
        return Err(Cause::value("the number of `agents`", raw.agents.len(), expected));
    }
    let agent = |(i, agent)| logged(&format!("agents[{i}]"), agent, length);
    let agents: Vec<LoggedAgent> = raw.agents.iter().enumerate().map(agent).collect::<Result<_, _>>()?;
    let known: BTreeSet<&str> = raw.agents.iter().map(|a| a.id.as_str()).collect();
    for (field, ids) in
        [("tracks_to_predict", &raw.tracks_to_predict), ("objects_of_interest", &raw.objects_of_interest)]
    {
        if let Some(id) = ids.iter().find(|id| !known.contains(id.as_str())) {
            return Err(Cause::value(field, format!("`{id}`"), "ids of agents"));
        }
    }
    let now = agents.get(av).and_then(|a| a.track[length.current()]);
    let deviation = raw.deviation.map(|deviation| deviated(deviation, now, length)).transpose()?;
    let mut map = map(raw.map)?;
    check_lights(raw.lights.len(), length.frames())?;
    let light = |(i, light)| self::light(&format!("lights[{i}]"), light, length.frames());
    let lights: Vec<LightParts> = raw.lights.iter().enumerate().map(light).collect::<Result<_, _>>()?;
    map.stop_lines.extend(lights.iter().map(LightParts::stop_line));
    Ok(ScenarioParts {
        id: raw.id,
        source: raw.source.unwrap_or_else(|| "json".into()),
        origin: None,
        length,
        timestamps: raw.timestamps,
        av,
        agents,
        tracks_to_predict: raw.tracks_to_predict,
        objects_of_interest: raw.objects_of_interest,
        map,
        lights,
        deviation,
    })
}

/// Converts a name by `from_name`.
fn named<T>(field: String, name: &str, from_name: fn(&str) -> Option<T>, expected: &str) -> Result<T, Cause> {
    from_name(name).ok_or_else(|| Cause::value(field, format!("`{name}`"), expected))
}

/// Returns the error of two exclusive fields of which both or neither is given.
fn either(field: &str, a: &str, b: &str, both: bool) -> Cause {
    let found = if both { "given both" } else { "given neither" };
    Cause::value(format!("{field}.{a} and .{b}"), found, "exactly one of the two")
}

fn logged(field: &str, raw: &RawAgent, length: Length) -> Result<LoggedAgent, Cause> {
    let kinds = "vehicle, pedestrian, cyclist or other";
    let kind = named(format!("{field}.kind"), &raw.kind, AgentKind::from_name, kinds)?;
    let track = match (&raw.track, &raw.motion) {
        (Some(track), None) => frames(&format!("{field}.track"), track, length.frames())?,
        (None, Some(motion)) => motion::track(&format!("{field}.motion"), motion, length)?,
        (track, _) => return Err(either(field, "track", "motion", track.is_some())),
    };
    Ok(LoggedAgent {
        agent: Agent { id: raw.id.clone(), kind, length: raw.length, width: raw.width },
        track,
        heights: Vec::new(),
    })
}

fn frames(field: &str, raw: &RawTrack, expected: usize) -> Result<Vec<Frame>, Cause> {
    let lists = [
        ("x", Some(&raw.x)),
        ("y", Some(&raw.y)),
        ("heading", Some(&raw.heading)),
        ("vx", raw.vx.as_ref()),
        ("vy", raw.vy.as_ref()),
    ];
    for (name, list) in lists {
        if let Some(list) = list.filter(|l| l.len() != expected) {
            let found = format!("{} entries", list.len());
            return Err(Cause::value(format!("{field}.{name}"), found, format!("{expected} entries")));
        }
    }
    let speed =
        |list: &Option<Vec<Option<f64>>>, f: usize| list.as_ref().and_then(|l| l[f]).unwrap_or(f64::NAN);
    let mut track = Vec::with_capacity(expected);
    for f in 0..expected {
        track.push(match (raw.x[f], raw.y[f], raw.heading[f]) {
            (Some(x), Some(y), Some(heading)) => {
                Some(AgentState { x, y, heading, vx: speed(&raw.vx, f), vy: speed(&raw.vy, f) })
            }
            (None, None, None) => None,
            _ => {
                let expected = "x, y and heading all given or all null";
                return Err(Cause::value(format!("{field}[{f}]"), "partly null", expected));
            }
        });
    }
    Ok(track)
}

fn deviated(raw: RawDeviation, now: Frame, length: Length) -> Result<DeviationParts, Cause> {
    let categories = "longitudinal, lateral or directional";
    let category = |name| named("deviation.category".into(), name, Deviation::from_name, categories);
    let category = raw.category.as_deref().map(category).transpose()?;
    let track = match (&raw.track, &raw.pieces) {
        (Some(track), None) => frames("deviation.track", track, length.future)?,
        (None, Some(pieces)) => {
            let now = now.ok_or_else(|| {
                let field = format!("agents[av].track[{}]", length.current());
                Cause::value(field, "absent", "the AV present at the current frame")
            })?;
            motion::continuation("deviation", &now, pieces, length.future)?.into_iter().map(Some).collect()
        }
        (track, _) => return Err(either("deviation", "track", "pieces", track.is_some())),
    };
    Ok(DeviationParts { category, track, certificate: None })
}

fn point([x, y]: [f64; 2]) -> Vec2 {
    Vec2::new(x, y)
}

fn points(raw: &[[f64; 2]]) -> Vec<Vec2> {
    raw.iter().copied().map(point).collect()
}

fn line(
    field: &str,
    given: &Option<Vec<[f64; 2]>>,
    path: &Option<RawPath>,
    budget: &mut usize,
) -> Result<Vec<Vec2>, Cause> {
    match (given, path) {
        (Some(given), None) => Ok(points(given)),
        (None, Some(path)) => motion::line(&format!("{field}.path"), path, budget),
        (given, _) => Err(either(field, "points", "path", given.is_some())),
    }
}

fn map(raw: RawMap) -> Result<MapParts, Cause> {
    let outlines = |all: &[Vec<[f64; 2]>]| all.iter().map(|o| points(o)).collect::<Vec<_>>();
    let surfaces = |all| outlines(all).into_iter().map(|outline| Surface { outline }).collect();
    let mut map = MapParts {
        crosswalks: outlines(&raw.crosswalks).into_iter().map(|outline| Crosswalk { outline }).collect(),
        speed_bumps: surfaces(&raw.speed_bumps),
        driveways: surfaces(&raw.driveways),
        intersections: outlines(&raw.intersections),
        drivable_area: raw.drivable_area.as_ref().map(|area| {
            let polygon = |p: &super::raw::RawPolygon| Polygon {
                exterior: points(&p.exterior),
                holes: outlines(&p.holes),
            };
            area.iter().map(polygon).collect()
        }),
        ..MapParts::default()
    };
    let mut budget = motion::MAX_POINTS;
    map.lanes = lanes(&raw.lanes, &mut budget)?;
    for (i, edge) in raw.road_edges.iter().enumerate() {
        let field = format!("map.road_edges[{i}]");
        let kinds = "boundary, median or unknown";
        let kind = named(format!("{field}.kind"), &edge.kind, RoadEdgeKind::from_name, kinds)?;
        map.road_edges.push(RoadEdge { kind, points: line(&field, &edge.points, &edge.path, &mut budget)? });
    }
    for (i, painted) in raw.road_lines.iter().enumerate() {
        let field = format!("map.road_lines[{i}]");
        if painted.paint > 8 {
            return Err(Cause::value(format!("{field}.paint"), painted.paint, "0 to 8"));
        }
        let points = line(&field, &painted.points, &painted.path, &mut budget)?;
        map.road_lines.push(RoadLine { paint: painted.paint, points });
    }
    for (i, stop) in raw.stop_lines.into_iter().enumerate() {
        let field = format!("map.stop_lines[{i}].kind");
        let kind = named(field, &stop.kind, StopKind::from_name, "light, sign or yield")?;
        map.stop_lines.push(StopLineParts { kind, lane: stop.lane, at: point(stop.at) });
    }
    Ok(map)
}

fn lanes(raw: &[RawLane], budget: &mut usize) -> Result<Vec<LaneParts>, Cause> {
    let baseline =
        |(i, lane): (usize, &RawLane)| line(&format!("map.lanes[{i}]"), &lane.points, &lane.path, budget);
    let baselines: Vec<Vec<Vec2>> = raw.iter().enumerate().map(baseline).collect::<Result<_, _>>()?;
    let last = |i: usize| u32::try_from(baselines[i].len().saturating_sub(1)).unwrap_or(u32::MAX);
    // The first of lanes with the same id; such a scenario is refused later.
    let (mut index, mut before) = (BTreeMap::new(), BTreeMap::<&str, Vec<String>>::new());
    for (i, lane) in raw.iter().enumerate() {
        index.entry(lane.id.as_str()).or_insert(i);
        for successor in lane.successors.iter().collect::<BTreeSet<_>>() {
            before.entry(successor).or_default().push(lane.id.clone());
        }
    }
    let neighbors = |own: usize, all: &[RawNeighbor]| -> Vec<NeighborParts> {
        let end = |n: &RawNeighbor| index.get(n.lane.as_str()).copied().map_or(0, last);
        all.iter()
            .map(|n| NeighborParts {
                lane: n.lane.clone(),
                self_start: n.self_start.unwrap_or(0),
                self_end: n.self_end.unwrap_or_else(|| last(own)),
                other_start: n.other_start.unwrap_or(0),
                other_end: n.other_end.unwrap_or_else(|| end(n)),
            })
            .collect()
    };
    let mut lanes = Vec::with_capacity(raw.len());
    for (i, lane) in raw.iter().enumerate() {
        let field = format!("map.lanes[{i}]");
        let classes = "surface_street, freeway, bike or undefined";
        let derived = || before.get(lane.id.as_str()).cloned().unwrap_or_default();
        lanes.push(LaneParts {
            id: lane.id.clone(),
            kind: named(format!("{field}.kind"), &lane.kind, LaneKind::from_name, "lane or connector")?,
            class: named(format!("{field}.class"), &lane.class, LaneClass::from_name, classes)?,
            speed_limit: lane.speed_limit,
            points: baselines[i].clone(),
            area: match (&lane.polygon, lane.half_width) {
                (Some(ring), None) => LaneArea::Polygon(points(ring)),
                (None, width) => LaneArea::Corridor { half_width: width.unwrap_or(LANE_HALF_WIDTH) },
                (Some(_), Some(_)) => return Err(either(&field, "polygon", "half_width", true)),
            },
            successors: lane.successors.clone(),
            predecessors: lane.predecessors.clone().unwrap_or_else(derived),
            left: neighbors(i, &lane.left),
            right: neighbors(i, &lane.right),
        });
    }
    Ok(lanes)
}

fn light(field: &str, raw: &RawLight, frames: usize) -> Result<LightParts, Cause> {
    let state = |at: String, name: &Option<String>| {
        let known = |name| named(at, name, LightState::from_name, "a light state such as `stop`");
        name.as_deref().map(known).transpose()
    };
    let mut states = Vec::with_capacity(frames);
    match (&raw.states, &raw.phases) {
        (Some(given), None) => {
            for (f, name) in given.iter().enumerate() {
                states.push(state(format!("{field}.states[{f}]"), name)?);
            }
        }
        (None, Some(phases)) => {
            for (i, phase) in phases.iter().enumerate() {
                let shown = state(format!("{field}.phases[{i}].state"), &phase.state)?;
                let steps = motion::steps(&format!("{field}.phases[{i}].seconds"), phase.seconds)?;
                states.resize((states.len() + steps).min(frames), shown);
            }
            let last = states.last().copied().flatten();
            states.resize(frames, last);
        }
        (given, _) => return Err(either(field, "states", "phases", given.is_some())),
    }
    Ok(LightParts { lane: raw.lane.clone(), stop_point: point(raw.stop_point), states })
}
