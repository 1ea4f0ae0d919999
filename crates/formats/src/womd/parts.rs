//! Conversion of a Waymo message to scenario parts.

use std::collections::BTreeMap;

use reactsim_geometry::Vec2;
use reactsim_scene::{
    Agent, AgentState, Crosswalk, DT, LANE_HALF_WIDTH, LaneArea, LaneClass, LaneKind, LaneParts, Length,
    LightParts, LightState, LoggedAgent, MapParts, NeighborParts, RoadEdge, RoadEdgeKind, RoadLine,
    ScenarioParts, StopKind, StopLineParts, Surface,
};

use super::message::{DynamicMapState, Feature, LaneNeighbor, MapFeature, MapPoint, Points, Scenario, Track};
use crate::error::Cause;
use crate::frames::check_lights;

/// One mile per hour in m/s.
const MPH: f64 = 0.44704;

/// Converts a message with the frames that [`Window::crop`](super::Window::crop) leaves to scenario parts of
/// this length. Also returns the number of frames that are not recorded: the scenarios of the test split end
/// at the current frame.
pub(super) fn parts(mut proto: Scenario, length: Length) -> Result<(ScenarioParts, u32), Cause> {
    let (frames, all) = (proto.timestamps_seconds.len(), length.frames());
    let last = proto.timestamps_seconds[frames - 1];
    proto.timestamps_seconds.extend((frames..all).map(|f| last + (f + 1 - frames) as f64 * DT));
    let av = proto.track_index("sdc_track_index", proto.sdc_track_index)?;
    let mut tracks_to_predict = Vec::with_capacity(proto.tracks_to_predict.len());
    for (i, &track) in proto.tracks_to_predict.iter().enumerate() {
        let track = proto.track_index(&format!("tracks_to_predict[{i}].track_index"), track)?;
        tracks_to_predict.push(proto.tracks[track].id.to_string());
    }
    let agents = proto.tracks.iter().map(|track| agent(track, length)).collect();
    let mut map = map(proto.map_features);
    let lights = lights(&proto.dynamic_map_states, &map, all)?;
    map.stop_lines.extend(lights.iter().map(LightParts::stop_line));
    let parts = ScenarioParts {
        id: proto.scenario_id,
        source: "womd".into(),
        origin: None,
        length,
        timestamps: proto.timestamps_seconds,
        av,
        agents,
        tracks_to_predict,
        objects_of_interest: proto.objects_of_interest.iter().map(i32::to_string).collect(),
        map,
        lights,
        deviation: None,
    };
    Ok((parts, (all - frames) as u32))
}

/// Converts a track. Frames that are not recorded are absent.
fn agent(track: &Track, length: Length) -> LoggedAgent {
    let (current, frames) = (length.current(), length.frames());
    // The benchmark uses the box at the current frame; agents that are absent then have their first recorded
    // box.
    let sized = if track.states[current].valid {
        Some(&track.states[current])
    } else {
        track.states.iter().find(|s| s.valid)
    };
    let (length, width) = sized.map_or((0.0, 0.0), |s| (f64::from(s.length), f64::from(s.width)));
    let frame = |s: &super::message::ObjectState| {
        // Data of invalid states have no meaning.
        s.valid.then(|| AgentState {
            x: s.center_x,
            y: s.center_y,
            heading: f64::from(s.heading),
            vx: f64::from(s.velocity_x),
            vy: f64::from(s.velocity_y),
        })
    };
    let mut states: Vec<Option<AgentState>> = track.states.iter().map(frame).collect();
    states.resize(frames, None);
    let bottom = |s: &super::message::ObjectState| s.valid.then(|| s.center_z - 0.5 * f64::from(s.height));
    let heights = track.states.iter().map(bottom).chain(std::iter::repeat(None)).take(frames).collect();
    let agent = Agent { id: track.id.to_string(), kind: track.kind(), length, width };
    LoggedAgent { agent, track: states, heights }
}

fn point(p: &MapPoint) -> Vec2 {
    Vec2::new(p.x, p.y)
}

/// Returns the value of a code, which is its index in `all`; the first value (unknown) for codes that are not
/// in the list.
fn from_code<T: Copy>(all: &[T], code: i32) -> T {
    usize::try_from(code).ok().and_then(|i| all.get(i).copied()).unwrap_or(all[0])
}

fn names(ids: &[i64]) -> Vec<String> {
    ids.iter().map(i64::to_string).collect()
}

fn neighbors(all: &[LaneNeighbor]) -> Vec<NeighborParts> {
    let at = |v: i32| u32::try_from(v).unwrap_or(0);
    all.iter()
        .map(|n| NeighborParts {
            lane: n.feature_id.to_string(),
            self_start: at(n.self_start_index),
            self_end: at(n.self_end_index),
            other_start: at(n.neighbor_start_index),
            other_end: at(n.neighbor_end_index),
        })
        .collect()
}

fn map(features: Vec<MapFeature>) -> MapParts {
    let mut map = MapParts::default();
    for MapFeature { id, feature } in features {
        let heights = &mut map.heights;
        match feature {
            None => {}
            Some(Feature::Lane(lane)) => map.lanes.push(LaneParts {
                id: id.to_string(),
                // Waymo's lanes overlap at merges and junctions, as connectors do.
                kind: LaneKind::Connector,
                class: from_code(&LaneClass::ALL, lane.kind),
                speed_limit: Some(lane.speed_limit_mph * MPH).filter(|v| *v != 0.0),
                points: split(lane.polyline, &mut heights.lanes),
                // Waymo records no widths.
                area: LaneArea::Corridor { half_width: LANE_HALF_WIDTH },
                successors: names(&lane.exit_lanes),
                predecessors: names(&lane.entry_lanes),
                left: neighbors(&lane.left_neighbors),
                right: neighbors(&lane.right_neighbors),
            }),
            Some(Feature::RoadLine(line)) => map.road_lines.push(RoadLine {
                paint: u8::try_from(line.kind).ok().filter(|p| *p <= 8).unwrap_or(0),
                points: split(line.polyline, &mut heights.road_lines),
            }),
            Some(Feature::RoadEdge(line)) => map.road_edges.push(RoadEdge {
                kind: from_code(&RoadEdgeKind::ALL, line.kind),
                points: split(line.polyline, &mut heights.road_edges),
            }),
            Some(Feature::StopSign(sign)) => {
                let Some(at) = sign.position.as_ref().map(point) else { continue };
                let line = |lane: &i64| StopLineParts { kind: StopKind::Sign, lane: lane.to_string(), at };
                map.stop_lines.extend(sign.lane.iter().map(line));
            }
            Some(Feature::Crosswalk(outline)) => {
                map.crosswalks.push(Crosswalk { outline: split(outline, &mut heights.crosswalks) });
            }
            Some(Feature::SpeedBump(outline)) => {
                map.speed_bumps.push(Surface { outline: split(outline, &mut heights.speed_bumps) });
            }
            Some(Feature::Driveway(outline)) => {
                map.driveways.push(Surface { outline: split(outline, &mut heights.driveways) });
            }
        }
    }
    map
}

/// Appends the heights of points to a list and returns the points.
fn split(line: Points, heights: &mut Vec<Vec<f64>>) -> Vec<Vec2> {
    heights.push(line.heights);
    line.points
}

/// Returns one light per controlled lane, in order of appearance. A light without a recorded stop point is
/// placed at the start of its lane, where nearly all recorded stop points are. A light without a lane is
/// dropped and counted later.
fn lights(states: &[DynamicMapState], map: &MapParts, frames: usize) -> Result<Vec<LightParts>, Cause> {
    let (mut order, mut indices) = (Vec::new(), BTreeMap::new());
    let mut lights: Vec<(Option<Vec2>, Vec<Option<LightState>>)> = Vec::new();
    for (f, frame) in states.iter().enumerate() {
        for seen in &frame.lane_states {
            let i = *indices.entry(seen.lane).or_insert_with(|| {
                order.push(seen.lane);
                lights.push((None, vec![None; frames]));
                order.len() - 1
            });
            check_lights(lights.len(), frames)?;
            let (stop, states) = &mut lights[i];
            states[f] = Some(from_code(&LightState::ALL, seen.state));
            *stop = stop.or_else(|| seen.stop_point.as_ref().map(point));
        }
    }
    // The first of lanes with the same id; such a scenario is refused later.
    let mut starts = BTreeMap::new();
    for lane in &map.lanes {
        starts.entry(lane.id.as_str()).or_insert_with(|| lane.points.first().copied());
    }
    let place = |(lane, (stop, states)): (i64, (Option<Vec2>, Vec<Option<LightState>>))| {
        let lane = lane.to_string();
        let start = || starts.get(lane.as_str()).copied().flatten();
        LightParts { stop_point: stop.or_else(start).unwrap_or_default(), states, lane }
    };
    Ok(order.into_iter().zip(lights).map(place).collect())
}
