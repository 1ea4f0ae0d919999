//! Conversion of JSON text to a checked document.

use std::collections::{BTreeMap, BTreeSet};

use reactsim_geometry::{Polygon, Polyline, Vec2};
use reactsim_scene::{
    Agent, AgentKind, AgentState, DT, Frame, Lane, LaneArea, LaneClass, LaneKind, LoggedAgent, RoadEdge,
    RoadEdgeKind, RoadMap, SceneError,
    limits::{self, MAX_BOX_SIZE, MAX_COORDINATE},
};
use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

use super::values::{Area, Name, Number, Points, Size, quote_not_finite};
use super::{Document, DocumentError, DocumentLog, DocumentScenario, FORMAT};

/// Limit on the number of frames; larger numbers are taken for damage.
const MAX_FRAMES: usize = 100_000;
/// Limit on the number of agents of a scenario: the time of the metrics grows with the number of pairs.
const MAX_DOCUMENT_AGENTS: usize = 2000;

#[derive(Deserialize)]
#[serde(deny_unknown_fields, expecting = "an object")]
struct RawDocument {
    format: String,
    dt: f64,
    options: Option<BTreeMap<String, Value>>,
    scenarios: Vec<Value>,
}

#[derive(Deserialize)]
#[serde(expecting = "an object")]
struct RawScenario {
    id: Name,
    current_index: usize,
    num_future: usize,
    av_index: usize,
    map: Option<RawMap>,
    agents: Vec<Value>,
    log: Option<Vec<Value>>,
    rollouts: Option<Vec<Vec<Value>>>,
}

#[derive(Default, Deserialize)]
#[serde(expecting = "an object")]
struct RawMap {
    drivable_area: Option<Vec<Area>>,
    lanes: Option<Vec<Value>>,
    intersections: Option<Vec<Points>>,
    road_edges: Option<Vec<Points>>,
}

#[derive(Deserialize)]
#[serde(expecting = "an object")]
struct RawLane {
    id: Name,
    kind: String,
    polygon: Points,
    baseline: Points,
    successors: Option<Vec<Name>>,
    predecessors: Option<Vec<Name>>,
}

#[derive(Deserialize)]
#[serde(expecting = "an object")]
struct RawAgent {
    id: Name,
    #[serde(rename = "type")]
    kind: String,
    length: Size,
    width: Size,
    x: Vec<Number>,
    y: Vec<Number>,
    heading: Vec<Number>,
    vx: Option<Vec<Number>>,
    vy: Option<Vec<Number>>,
    valid: Vec<bool>,
}

#[derive(Deserialize)]
#[serde(expecting = "an object")]
struct RawLog {
    x: Vec<Number>,
    y: Vec<Number>,
    heading: Vec<Number>,
    valid: Vec<bool>,
}

#[derive(Deserialize)]
#[serde(expecting = "an object")]
struct RawTrack {
    x: Vec<Number>,
    y: Vec<Number>,
    heading: Vec<Number>,
}

/// Location of a value, for error messages.
#[derive(Clone, Copy)]
struct Location<'a> {
    scenario: &'a str,
    /// Position of the AV, from which coordinates have to lie within 100 km; `None` before it is known.
    center: Option<Vec2>,
}

impl Location<'_> {
    fn error(self, field: impl ToString, value: impl ToString, expected: impl ToString) -> DocumentError {
        DocumentError::from(SceneError {
            scenario: self.scenario.to_owned(),
            field: field.to_string(),
            value: value.to_string(),
            expected: expected.to_string(),
        })
    }

    /// Reads a part of the scenario; an error names the part.
    fn part<T: DeserializeOwned>(self, field: &str, value: Value) -> Result<T, DocumentError> {
        let named = match value.get("id") {
            Some(Value::String(id)) => format!("{field} (`{id}`)"),
            Some(Value::Number(id)) => format!("{field} (`{id}`)"),
            _ => field.to_owned(),
        };
        let refuse = |e| DocumentError(format!("scenario `{}`: {named}: {e}", self.scenario));
        serde_json::from_value(value).map_err(refuse)
    }

    fn length<T>(self, field: &str, values: &[T], expected: usize) -> Result<(), DocumentError> {
        if values.len() == expected {
            return Ok(());
        }
        let found = format!("{} entries long", values.len());
        Err(self.error(field, found, format!("{expected} entries")))
    }

    fn points(self, field: &str, points: Vec<Vec2>) -> Result<Vec<Vec2>, DocumentError> {
        let center = self.center.unwrap_or_default();
        let is_near = |p: &Vec2| (p - center).amax() < MAX_COORDINATE;
        match points.iter().position(|p| !is_near(p)) {
            None => Ok(points),
            Some(i) => {
                let value = format!("[{}, {}]", points[i].x, points[i].y);
                let expected = "finite coordinates within 100 km of the AV";
                Err(self.error(format!("{field}[{i}]"), value, expected))
            }
        }
    }

    /// Refuses states of an agent beyond the limits of scenarios. If it has no extent they are padding and
    /// become absent.
    fn within_limits(self, agent: &Agent, field: &str, track: &mut [Frame]) -> Result<(), DocumentError> {
        let center = self.center.unwrap_or_default();
        if !agent.has_extent() {
            limits::drop_beyond(track, center);
        }
        match limits::first_beyond(track, center) {
            Some((f, name, value, expected)) => {
                Err(self.error(format!("{field}.{name}[{f}]"), value, expected))
            }
            None => Ok(()),
        }
    }
}

pub(super) fn document(text: &str) -> Result<Document, DocumentError> {
    let text = quote_not_finite(text);
    let raw: RawDocument =
        serde_json::from_str(&text).map_err(|e| DocumentError(format!("the rollout document: {e}")))?;
    if raw.format != FORMAT {
        let text = format!("the document's format is `{}`, expected `{FORMAT}`", raw.format);
        return Err(DocumentError(text));
    }
    if (raw.dt - DT).abs() >= 1e-9 {
        return Err(DocumentError(format!("the document's dt is {} s, expected 0.1 s (10 Hz)", raw.dt)));
    }
    let text_of = |value: Value| match value {
        Value::String(text) => text,
        other => other.to_string(),
    };
    let options = raw.options.unwrap_or_default().into_iter().map(|(name, v)| (name, text_of(v))).collect();
    if raw.scenarios.is_empty() {
        return Err(Location { scenario: "", center: None }.error(
            "scenarios",
            "empty",
            "at least one scenario",
        ));
    }
    let scenarios = raw.scenarios.into_iter().enumerate();
    let scenarios: Vec<_> = scenarios.map(|(i, value)| scenario(i, value)).collect::<Result<_, _>>()?;
    let mut seen = BTreeSet::new();
    for (i, DocumentScenario { id, .. }) in scenarios.iter().enumerate() {
        if !seen.insert(id.as_str()) {
            let at = Location { scenario: id, center: None };
            return Err(at.error(format!("scenarios[{i}].id"), id, "an id that no other scenario has"));
        }
    }
    Ok(Document { options, scenarios })
}

fn scenario(index: usize, value: Value) -> Result<DocumentScenario, DocumentError> {
    let raw: RawScenario = {
        let id = value.get("id").and_then(Value::as_str).map_or_else(String::new, |id| format!(" (`{id}`)"));
        serde_json::from_value(value).map_err(|e| DocumentError(format!("scenarios[{index}]{id}: {e}")))?
    };
    let at = Location { scenario: &raw.id.0, center: None };
    let (current, future) = (raw.current_index, raw.num_future);
    if future == 0 || current >= MAX_FRAMES || future >= MAX_FRAMES {
        let value = format!("{current} and {future}");
        return Err(at.error(
            "current_index and num_future",
            value,
            "at least one frame after the current one",
        ));
    }
    let frames = current + 1 + future;
    if raw.agents.len() > MAX_DOCUMENT_AGENTS {
        let expected = format!("at most {MAX_DOCUMENT_AGENTS} agents");
        return Err(at.error("agents", raw.agents.len(), expected));
    }
    let mut agents = Vec::with_capacity(raw.agents.len());
    let mut seen = BTreeSet::new();
    for (i, value) in raw.agents.into_iter().enumerate() {
        let field = format!("agents[{i}]");
        let agent = agent(at, &field, at.part(&field, value)?, current, frames)?;
        if !seen.insert(agent.agent.id.clone()) {
            return Err(at.error(format!("{field}.id"), &agent.agent.id, "an id that no other agent has"));
        }
        agents.push(agent);
    }
    if raw.av_index >= agents.len() {
        let value = format!("{} of {} agents", raw.av_index, agents.len());
        return Err(at.error("av_index", value, "the index of an agent"));
    }
    // The AV is usually present at the current frame; then its position is the center.
    let known = |agent: &LoggedAgent| {
        if !agent.agent.has_extent() {
            return None;
        }
        let now = agent.track.get(current).copied().flatten();
        now.or_else(|| agent.track.iter().flatten().next().copied())
    };
    let center = known(&agents[raw.av_index]).or_else(|| agents.iter().find_map(known));
    let at = Location { center: center.map(|state| state.position()), ..at };
    for (i, LoggedAgent { agent, track, .. }) in agents.iter_mut().enumerate() {
        at.within_limits(agent, &format!("agents[{i}] (`{}`)", agent.id), track)?;
    }
    if let Some(log) = &raw.log {
        at.length("log", log, agents.len())?;
    }
    let track_of = |(i, (value, agent)): (usize, (Value, &LoggedAgent))| {
        let field = format!("log[{i}]");
        let part = at.part(&field, value)?;
        let field = format!("{field} (agent `{}`)", agent.agent.id);
        let mut log = logged(at, &field, part, current, frames)?;
        at.within_limits(&agent.agent, &field, &mut log.track)?;
        Ok::<_, DocumentError>(log)
    };
    let log = raw.log.map(|log| log.into_iter().zip(&agents).enumerate().map(track_of).collect());
    let log = log.transpose()?;
    let mut rollouts = Vec::new();
    for (r, rollout) in raw.rollouts.unwrap_or_default().into_iter().enumerate() {
        at.length(&format!("rollouts[{r}]"), &rollout, agents.len())?;
        let mut tracks = Vec::with_capacity(rollout.len());
        for (i, value) in rollout.into_iter().enumerate() {
            let field = format!("rollouts[{r}][{i}]");
            let RawTrack { x, y, heading } = at.part(&field, value)?;
            let field = format!("{field} (agent `{}`)", agents[i].agent.id);
            let mut track = track(at, &field, [x, y, heading], None, [None, None], future)?;
            at.within_limits(&agents[i].agent, &field, &mut track)?;
            tracks.push(track);
        }
        rollouts.push(tracks);
    }
    let map = map(at, raw.map.unwrap_or_default())?;
    Ok(DocumentScenario { current, future, av: raw.av_index, map, agents, log, rollouts, id: raw.id.0 })
}

fn agent(
    at: Location<'_>,
    field: &str,
    raw: RawAgent,
    current: usize,
    frames: usize,
) -> Result<LoggedAgent, DocumentError> {
    let field = format!("{field} (`{}`)", raw.id.0);
    let Some(kind) = AgentKind::from_name(&raw.kind) else {
        return Err(at.error(
            format!("{field}.type"),
            format!("`{}`", raw.kind),
            "`vehicle`, `pedestrian`, `cyclist` or `other`",
        ));
    };
    let size = |name: &str, size: Size| {
        let field = format!("{field}.{name}");
        let size = match size {
            Size::One(size) => size,
            Size::PerFrame(sizes) => {
                at.length(&field, &sizes, frames)?;
                // A missing size at the current frame means a box of size zero, that is, an absent agent.
                sizes[current].0.unwrap_or(0.0)
            }
        };
        if (0.0..MAX_BOX_SIZE).contains(&size) {
            Ok(size)
        } else {
            Err(at.error(field, size, "a size of at least 0 and less than 1000 m"))
        }
    };
    let (length, width) = (size("length", raw.length)?, size("width", raw.width)?);
    let track = track(at, &field, [raw.x, raw.y, raw.heading], Some(&raw.valid), [raw.vx, raw.vy], frames)?;
    Ok(LoggedAgent { agent: Agent { id: raw.id.0, kind, length, width }, track, heights: Vec::new() })
}

fn logged(
    at: Location<'_>,
    field: &str,
    raw: RawLog,
    current: usize,
    frames: usize,
) -> Result<DocumentLog, DocumentError> {
    let RawLog { x, y, heading, valid } = raw;
    let number = |values: &[Number], f: usize| values.get(f).and_then(|n| n.0).unwrap_or(f64::NAN);
    let recorded_history =
        (0..=current).map(|f| [number(&x, f), number(&y, f), number(&heading, f)]).collect();
    let track = track(at, field, [x, y, heading], Some(&valid), [None, None], frames)?;
    Ok(DocumentLog { track, recorded_history })
}

fn track(
    at: Location<'_>,
    field: &str,
    pose: [Vec<Number>; 3],
    valid: Option<&[bool]>,
    velocity: [Option<Vec<Number>>; 2],
    frames: usize,
) -> Result<Vec<Frame>, DocumentError> {
    for (name, values) in ["x", "y", "heading"].into_iter().zip(&pose) {
        at.length(&format!("{field}.{name}"), values, frames)?;
    }
    for (name, values) in ["vx", "vy"].into_iter().zip(&velocity) {
        if let Some(values) = values {
            at.length(&format!("{field}.{name}"), values, frames)?;
        }
    }
    if let Some(valid) = valid {
        at.length(&format!("{field}.valid"), valid, frames)?;
    }
    let speed = |axis: usize, f: usize| velocity[axis].as_ref().and_then(|v| v[f].0).unwrap_or(f64::NAN);
    let mut track = Vec::with_capacity(frames);
    for f in 0..frames {
        let [Some(x), Some(y), Some(heading)] = [pose[0][f].0, pose[1][f].0, pose[2][f].0] else {
            track.push(None);
            continue;
        };
        if valid.is_some_and(|valid| !valid[f]) {
            track.push(None);
            continue;
        }
        for (name, v) in [("x", x), ("y", y), ("heading", heading)] {
            if !v.is_finite() {
                return Err(at.error(
                    format!("{field}.{name}[{f}]"),
                    v,
                    "a finite number, or null where the agent is absent",
                ));
            }
        }
        for (axis, name) in [(0, "vx"), (1, "vy")] {
            if velocity[axis].as_ref().and_then(|v| v[f].0).is_some_and(|v| !v.is_finite()) {
                return Err(at.error(
                    format!("{field}.{name}[{f}]"),
                    speed(axis, f),
                    "a finite number, or null where it is unknown",
                ));
            }
        }
        track.push(Some(AgentState { x, y, heading, vx: speed(0, f), vy: speed(1, f) }));
    }
    Ok(track)
}

fn map(at: Location<'_>, raw: RawMap) -> Result<RoadMap, DocumentError> {
    let rings = |name: &str, rings: Option<Vec<Points>>| {
        let rings = rings.unwrap_or_default().into_iter().enumerate();
        rings.map(|(i, r)| at.points(&format!("map.{name}[{i}]"), r.0)).collect::<Result<Vec<_>, _>>()
    };
    let mut area = Vec::new();
    for (i, Area(polygon)) in raw.drivable_area.unwrap_or_default().into_iter().enumerate() {
        let field = format!("map.drivable_area[{i}]");
        let holes = polygon.holes.into_iter().enumerate();
        let holes = holes.map(|(k, hole)| at.points(&format!("{field}.holes[{k}]"), hole));
        let holes = holes.collect::<Result<_, _>>()?;
        area.push(Polygon { exterior: at.points(&field, polygon.exterior)?, holes });
    }
    let edges = rings("road_edges", raw.road_edges)?;
    Ok(RoadMap {
        lanes: lanes(at, raw.lanes.unwrap_or_default())?,
        road_edges: edges
            .into_iter()
            .map(|points| RoadEdge { kind: RoadEdgeKind::Unknown, points })
            .collect(),
        intersections: rings("intersections", raw.intersections)?,
        drivable_area: (!area.is_empty()).then_some(area),
        ..RoadMap::default()
    })
}

fn lanes(at: Location<'_>, values: Vec<Value>) -> Result<Vec<Lane>, DocumentError> {
    let mut raws: Vec<RawLane> = Vec::with_capacity(values.len());
    let mut index = BTreeMap::new();
    for (i, value) in values.into_iter().enumerate() {
        let raw: RawLane = at.part(&format!("map.lanes[{i}]"), value)?;
        if index.insert(raw.id.0.clone(), i).is_some() {
            let field = format!("map.lanes[{i}].id");
            return Err(at.error(field, &raw.id.0, "an id that no other lane has"));
        }
        raws.push(raw);
    }
    let mut lanes = Vec::with_capacity(raws.len());
    for (i, raw) in raws.into_iter().enumerate() {
        let field = format!("map.lanes[{i}] (`{}`)", raw.id.0);
        let kind = LaneKind::from_name(&raw.kind).ok_or_else(|| {
            at.error(format!("{field}.kind"), format!("`{}`", raw.kind), "`lane` or `connector`")
        })?;
        let points = at.points(&format!("{field}.baseline"), raw.baseline.0)?;
        let baseline = Polyline::new(&points).map_err(|_| {
            at.error(format!("{field}.baseline"), format!("{} points", points.len()), "two distinct points")
        })?;
        let links = |ids: Option<Vec<Name>>| {
            ids.unwrap_or_default().iter().filter_map(|id| index.get(&id.0).copied()).collect()
        };
        lanes.push(Lane {
            kind,
            class: LaneClass::Undefined,
            speed_limit: None,
            baseline,
            area: LaneArea::Polygon(at.points(&format!("{field}.polygon"), raw.polygon.0)?),
            successors: links(raw.successors),
            predecessors: links(raw.predecessors),
            left: Vec::new(),
            right: Vec::new(),
            id: raw.id.0,
        });
    }
    Ok(lanes)
}
