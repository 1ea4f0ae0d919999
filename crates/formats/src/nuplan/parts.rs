//! Conversion of a window of a log and its map to scenario parts.

use std::collections::{BTreeMap, BTreeSet};

use reactsim_geometry::{Bounds, Vec2, direction, left};
use reactsim_scene::{
    Agent, AgentKind, AgentState, Crosswalk, Frame, LANE_HALF_WIDTH, LaneArea, LaneClass, LaneKind,
    LaneParts, LightParts, LightState, LoggedAgent, MapParts, NeighborParts, RoadLine, ScenarioParts,
    StopKind, StopLineParts,
};

use super::log::{BOX_VALUES, Ego, Log};
use super::map::{Map, MapLane};
use super::token::Token;
use super::window;
use crate::error::Cause;
use crate::frames::{LengthChoice, check_lights, most_agents};

/// Id of the AV.
pub(super) const AV: &str = "ego";
/// Length of the AV in metres (the devkit's `get_pacifica_parameters`).
const AV_LENGTH: f64 = 5.176;
/// Width of the AV in metres (the devkit's `get_pacifica_parameters`).
const AV_WIDTH: f64 = 2.297;
/// Distance in metres from the rear axle of the AV to the centre of its box.
pub(super) const AXLE_TO_CENTER: f64 = 1.461;
/// Margin of the map in metres around all recorded tracks: simulated agents may leave their logged tracks.
const TRACK_MARGIN: f64 = 50.0;
/// Maximum extent of the map in metres around the AV's track.
const AV_MARGIN: f64 = 400.0;

/// States of the light of each lane connector with a light.
type LightStates = BTreeMap<i64, Vec<Option<LightState>>>;

/// Converts the window of a log with the current frame at row `anchor` to scenario parts.
pub(super) fn parts(
    log: &Log,
    map: &Map,
    anchor: usize,
    choice: LengthChoice,
) -> Result<ScenarioParts, Cause> {
    let (rows, length) = window::rows(log, anchor, choice)?;
    let ego =
        rows.iter().map(|&row| av_state(&log.frames[row].ego, map).map(Some)).collect::<Result<_, _>>()?;
    let av = Agent { id: AV.into(), kind: AgentKind::Vehicle, length: AV_LENGTH, width: AV_WIDTH };
    let mut agents = vec![LoggedAgent { agent: av, track: ego, heights: Vec::new() }];
    agents.extend(objects(log, &rows, length.current())?);

    let states = observed(log, &rows)?;
    let clip = map_bounds(&agents);
    let taken: BTreeSet<i64> = map
        .lanes
        .iter()
        .filter(|(fid, lane)| lane.bounds.intersects(&clip) || states.contains_key(fid))
        .map(|(fid, _)| *fid)
        .collect();
    let first = log.frames[rows[0]].timestamp;
    let interesting = log.tags.get(&anchor).into_iter().flatten().filter_map(|(_, agent)| *agent);
    let interesting: BTreeSet<String> = interesting.map(|token| token.to_string()).collect();
    let known: BTreeSet<&str> = agents.iter().map(|a| a.agent.id.as_str()).collect();
    Ok(ScenarioParts {
        id: log.frames[anchor].token.to_string(),
        source: "nuplan".into(),
        origin: None,
        length,
        timestamps: rows.iter().map(|&row| (log.frames[row].timestamp - first) as f64 * 1e-6).collect(),
        av: 0,
        tracks_to_predict: Vec::new(),
        objects_of_interest: interesting.into_iter().filter(|id| known.contains(id.as_str())).collect(),
        map: clipped(map, &clip, &taken, &states),
        lights: states
            .into_iter()
            .map(|(fid, states)| LightParts {
                lane: fid.to_string(),
                stop_point: stop_point(map, fid),
                states,
            })
            .collect(),
        agents,
        deviation: None,
    })
}

/// Returns the state of the AV's box for a pose of its rear axle. The velocity is that of the axle, as in the
/// devkit.
pub(super) fn av_state(ego: &Ego, map: &Map) -> Result<AgentState, Cause> {
    for (name, value) in [("x", ego.x), ("y", ego.y), ("qw, qx, qy, qz", ego.heading)] {
        if !value.is_finite() {
            let field = format!("`ego_pose.{name}` of row {}", ego.token);
            return Err(Cause::value(field, value, "a finite number"));
        }
    }
    if ego.epsg != Some(map.epsg) {
        let found = ego.epsg.map_or("NULL".into(), |code| code.to_string());
        let expected = format!("{}, as the map's `projectedCoordSystem`", map.epsg);
        return Err(Cause::value(format!("`ego_pose.epsg` of row {}", ego.token), found, expected));
    }
    let ahead = direction(ego.heading);
    let center = Vec2::new(ego.x, ego.y) + ahead * AXLE_TO_CENTER;
    let velocity = ahead * ego.longitudinal + left(ahead) * ego.lateral;
    Ok(AgentState { x: center.x, y: center.y, heading: ego.heading, vx: velocity.x, vy: velocity.y })
}

/// Returns all objects seen in these frames, by token. Boxes have their size at the current frame, or else
/// their first recorded size.
fn objects(log: &Log, rows: &[usize], current: usize) -> Result<Vec<LoggedAgent>, Cause> {
    // Usual scenarios have some hundred, and each takes all frames however often it was seen.
    let (frames, most) = (rows.len(), most_agents(rows.len()));
    let mut seen: BTreeMap<Token, (Vec<Frame>, [f64; 2])> = BTreeMap::new();
    for (k, &row) in rows.iter().enumerate() {
        for object in log.boxes_at(row) {
            let wrong = |i: usize| format!("`lidar_box.{}` of row {}", BOX_VALUES[i], object.token);
            if let Some(i) = object.values[..5].iter().position(|v| !v.is_finite()) {
                return Err(Cause::value(wrong(i), object.values[i], "a finite number"));
            }
            if seen.len() >= most && !seen.contains_key(&object.track) {
                let expected = format!("a box of one of at most {most} objects in {frames} frames");
                return Err(Cause::value(
                    format!("the row {} of `lidar_box`", object.token),
                    "one too many",
                    expected,
                ));
            }
            let [x, y, heading, length, width, vx, vy] = object.values;
            let moves = log.tracks.get(&object.track).is_some_and(|c| c.kind() != AgentKind::Other);
            let (vx, vy) = if moves { (vx, vy) } else { (f64::NAN, f64::NAN) };
            let (track, size) =
                seen.entry(object.track).or_insert_with(|| (vec![None; frames], [length, width]));
            if track[k].is_some() {
                let field = format!("`lidar_box.track_token` of row {}", object.token);
                return Err(Cause::value(field, object.track, "one box of a track in a frame"));
            }
            track[k] = Some(AgentState { x, y, heading, vx, vy });
            if k == current {
                *size = [length, width];
            }
        }
    }
    let agent = |(token, (track, [length, width])): (Token, (Vec<Frame>, [f64; 2]))| {
        let kind = log.tracks.get(&token).map_or(AgentKind::Other, |c| c.kind());
        // The map has no heights, without which those of boxes are of no use.
        let heights = Vec::new();
        LoggedAgent { agent: Agent { id: token.to_string(), kind, length, width }, track, heights }
    };
    Ok(seen.into_iter().map(agent).collect())
}

/// Returns the observed lights.
fn observed(log: &Log, rows: &[usize]) -> Result<LightStates, Cause> {
    let mut states = BTreeMap::new();
    for (k, row) in rows.iter().enumerate() {
        for (&connector, &state) in log.lights.get(row).into_iter().flatten() {
            states.entry(connector).or_insert_with(|| vec![None; rows.len()])[k] = Some(state);
            check_lights(states.len(), rows.len())?;
        }
    }
    Ok(states)
}

/// Returns the point where vehicles wait for a connector: its start. For a connector that is not in the map,
/// returns the origin.
fn stop_point(map: &Map, connector: i64) -> Vec2 {
    map.lanes.get(&connector).and_then(|lane| lane.baseline.first().copied()).unwrap_or_default()
}

/// Returns the bounds of the map of a scenario.
fn map_bounds(agents: &[LoggedAgent]) -> Bounds {
    let of = |agent: &LoggedAgent| Bounds::of(agent.track.iter().flatten().map(AgentState::position));
    let all = agents.iter().fold(Bounds::EMPTY, |all, agent| all.union(&of(agent))).inflated(TRACK_MARGIN);
    let reach = of(&agents[0]).inflated(AV_MARGIN);
    Bounds { min: all.min.sup(&reach.min), max: all.max.inf(&reach.max) }
}

/// Returns the part of a map that touches `clip`; areas are taken as a whole.
fn clipped(map: &Map, clip: &Bounds, taken: &BTreeSet<i64>, lights: &LightStates) -> MapParts {
    let near = |areas: &'_ [super::map::Area]| -> Vec<reactsim_geometry::Polygon> {
        areas.iter().filter(|a| a.bounds.intersects(clip)).flat_map(|a| a.polygons.iter().cloned()).collect()
    };
    let outlines = |areas| near(areas).into_iter().map(|polygon| polygon.exterior);
    let of = |fid: &i64| Some((*fid, map.lanes.get(fid)?));
    let lanes: Vec<(i64, &MapLane)> = taken.iter().filter_map(of).collect();
    MapParts {
        lanes: lanes.iter().map(|(fid, lane)| lane_parts(map, *fid, lane, taken)).collect(),
        road_lines: map
            .boundaries
            .values()
            .filter(|line| line.bounds.intersects(clip))
            .filter_map(|line| {
                // Broken and solid single white in Waymo's codes; other boundaries are not painted.
                let paint = match line.kind {
                    Some(0) => 1,
                    Some(2) => 2,
                    _ => return None,
                };
                Some(RoadLine { paint, points: line.points.clone() })
            })
            .collect(),
        stop_lines: stop_lines(map, &lanes, lights),
        crosswalks: outlines(&map.crosswalks).map(|outline| Crosswalk { outline }).collect(),
        intersections: outlines(&map.intersections).collect(),
        drivable_area: Some(near(&map.drivable)),
        ..MapParts::default()
    }
}

fn lane_parts(map: &Map, fid: i64, lane: &MapLane, taken: &BTreeSet<i64>) -> LaneParts {
    // Links to lanes outside the clipped map are removed; those to lanes missing in the map are dropped and
    // counted later.
    let names = |fids: &[i64]| -> Vec<String> {
        let kept = fids.iter().filter(|fid| taken.contains(fid) || !map.lanes.contains_key(fid));
        kept.map(i64::to_string).collect()
    };
    let neighbor = |fid: i64| {
        let other = map.lanes.get(&fid).filter(|_| taken.contains(&fid))?;
        Some(NeighborParts::whole(fid.to_string(), lane.baseline.len(), other.baseline.len()))
    };
    let [left, right] = lane.neighbors.map(|other| other.and_then(neighbor).into_iter().collect());
    LaneParts {
        id: fid.to_string(),
        kind: if lane.is_connector { LaneKind::Connector } else { LaneKind::Lane },
        class: if lane.lane_type == Some(1) { LaneClass::Bike } else { LaneClass::Undefined },
        speed_limit: Some(lane.speed_limit).filter(|v| v.is_finite() && *v > 0.0),
        points: lane.baseline.clone(),
        area: if lane.outline.exterior.is_empty() {
            LaneArea::Corridor { half_width: LANE_HALF_WIDTH }
        } else {
            LaneArea::Polygon(lane.outline.exterior.clone())
        },
        successors: names(&lane.outgoing),
        predecessors: names(&lane.incoming),
        left,
        right,
    }
}

/// Returns the stop lines: for lights at the start of each connector with lights in the map or the log, and
/// for stop signs and yield signs of the map.
fn stop_lines(map: &Map, lanes: &[(i64, &MapLane)], lights: &LightStates) -> Vec<StopLineParts> {
    let mut lines = Vec::new();
    for (fid, lane) in lanes {
        let lit = lane.is_connector && !map.stop_lines(lane).is_empty() || lights.contains_key(fid);
        if let Some(&at) = lane.baseline.first().filter(|_| lit) {
            lines.push(StopLineParts { kind: StopKind::Light, lane: fid.to_string(), at });
        }
    }
    for stop in map.stops.values() {
        let kind = match stop.kind {
            Some(1) => StopKind::Sign,
            Some(4) => StopKind::Yield,
            _ => continue,
        };
        let Some(at) = stop.middle() else { continue };
        let here = stop.lanes.iter().filter(|fid| lanes.binary_search_by_key(*fid, |(fid, _)| *fid).is_ok());
        lines.extend(here.map(|fid| StopLineParts { kind, lane: fid.to_string(), at }));
    }
    lines
}
