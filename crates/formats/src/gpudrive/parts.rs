//! Conversion of a GPUDrive file to scenario parts.

use std::collections::BTreeMap;

use reactsim_geometry::Vec2;
use reactsim_scene::{
    Agent, AgentKind, AgentState, HISTORY, LATER_FRAME, Length, LightParts, LightState, LoggedAgent,
    ScenarioParts, unknown_type,
};

use super::angles;
use super::raw::{Name, Point, RawLight, RawObject, RawScenario};
use super::roads;
use crate::error::Cause;
use crate::frames::{LengthChoice, check_lights, seconds};

/// Coordinate in metres that marks invalid frames.
const INVALID_COORDINATE: f64 = -10_000.0;

/// Name of the repair that counts AVs that the file does not mark.
const UNMARKED_AV: &str =
    "mark of the AV (`metadata.sdc_track_index`) that the file lacks: the last object is taken";

/// Converts a file to scenario parts; also returns the repairs made, with their numbers.
pub(super) fn parts(
    raw: RawScenario,
    choice: LengthChoice,
) -> Result<(ScenarioParts, BTreeMap<String, u32>), Cause> {
    let id = raw
        .id()
        .ok_or_else(|| Cause::schema("`scenario_id`", "missing", "the id of the scenario, or a `name`"))?;
    let ids: Vec<String> = raw.objects.iter().enumerate().map(|(i, o)| name(&o.id, i)).collect();
    let index = |field: &str, value: i64| {
        let expected = || format!("the index of one of {} objects", ids.len());
        let found = usize::try_from(value).ok().filter(|i| *i < ids.len());
        found.ok_or_else(|| Cause::value(field, value, expected()))
    };
    // The AV is the last object of the files of GPUDrive; newer files state its index, which that program
    // needs.
    let is_av_stated = raw.metadata.as_ref().is_some_and(|m| m.sdc_track_index.is_some());
    let av = match raw.metadata.as_ref().and_then(|m| m.sdc_track_index) {
        Some(given) => index("metadata.sdc_track_index", given)?,
        None => {
            let last = ids.len().checked_sub(1);
            last.ok_or_else(|| Cause::value("objects", "empty", "the objects of the scenario, the AV last"))?
        }
    };
    let (mut tracks_to_predict, mut objects_of_interest) = (Vec::new(), Vec::new());
    if let Some(metadata) = &raw.metadata {
        for (i, required) in metadata.tracks_to_predict.iter().enumerate() {
            let track = index(&format!("metadata.tracks_to_predict[{i}].track_index"), required.track_index)?;
            tracks_to_predict.push(ids[track].clone());
        }
        objects_of_interest = metadata.objects_of_interest.iter().map(Name::to_string).collect();
    }
    let window = Window::of(&raw, choice)?;
    let unit = angles::radians_per_unit(&raw);
    let mut agents = Vec::with_capacity(raw.objects.len());
    let mut repairs = BTreeMap::new();
    for (i, object) in raw.objects.iter().enumerate() {
        agents.push(agent(i, object, ids[i].clone(), unit, &window)?);
        if kind(&object.kind).is_none() {
            *repairs.entry(unknown_type(&object.kind)).or_default() += 1;
        }
    }
    let mut lights = Vec::new();
    check_lights(raw.tl_states.len(), window.length.frames())?;
    for (lane, light) in raw.tl_states {
        lights.extend(self::light(lane, &light, &window)?);
    }
    let mut map = roads::map(raw.roads, &mut repairs)?;
    if !is_av_stated {
        repairs.insert(UNMARKED_AV.to_owned(), 1);
    }
    if window.length.history > HISTORY {
        repairs.insert(LATER_FRAME.to_owned(), (window.length.history - HISTORY) as u32);
    }
    map.stop_lines.extend(lights.iter().map(LightParts::stop_line));
    let parts = ScenarioParts {
        id,
        source: "gpudrive".into(),
        origin: None,
        length: window.length,
        timestamps: Vec::new(),
        av,
        agents,
        tracks_to_predict,
        objects_of_interest,
        map,
        lights,
        deviation: None,
    };
    Ok((parts, repairs))
}

/// The frames of a recording that become those of the scenario.
struct Window {
    /// Number of frames of the recording.
    recorded: usize,
    /// Index of the first frame.
    first: usize,
    length: Length,
}

impl Window {
    /// The frames around the current one, which follows a second of history in all files; the first one with
    /// the requested history if that is longer.
    fn of(raw: &RawScenario, choice: LengthChoice) -> Result<Self, Cause> {
        let recorded = raw.objects.first().map_or(0, |object| object.position.len());
        let until = HISTORY.max(choice.history());
        let future = choice.future(recorded.saturating_sub(until));
        let length = Length { history: choice.history(), future };
        if length.future == 0 || recorded < until + length.future {
            let (found, least) = (format!("{recorded} entries"), until + choice.least_future());
            return Err(Cause::value("objects[0].position", found, entries(least)));
        }
        Ok(Self { recorded, first: until - length.history, length })
    }
}

/// Describes a number of frames.
fn entries(count: usize) -> String {
    format!("{count} entries ({} s at 10 Hz)", seconds(count))
}

/// Returns the id, or the index if the file has no id.
fn name(id: &Option<Name>, index: usize) -> String {
    id.as_ref().map_or_else(|| index.to_string(), Name::to_string)
}

/// Returns whether a position marks an invalid frame.
fn is_unset(at: Point) -> bool {
    at.x == INVALID_COORDINATE && at.y == INVALID_COORDINATE
}

/// Returns the kind of objects of a type; `None` if the type is not known.
fn kind(name: &str) -> Option<AgentKind> {
    match name {
        "vehicle" => Some(AgentKind::Vehicle),
        "pedestrian" => Some(AgentKind::Pedestrian),
        "cyclist" => Some(AgentKind::Cyclist),
        "other" | "unset" => Some(AgentKind::Other),
        _ => None,
    }
}

fn agent(i: usize, object: &RawObject, id: String, unit: f64, window: &Window) -> Result<LoggedAgent, Cause> {
    let lengths = [
        ("position", object.position.len()),
        ("velocity", object.velocity.len()),
        ("heading", object.heading.len()),
        ("valid", object.valid.len()),
    ];
    if let Some((field, found)) = lengths.into_iter().find(|(_, n)| *n != window.recorded) {
        let found = format!("{found} entries");
        return Err(Cause::value(format!("objects[{i}].{field}"), found, entries(window.recorded)));
    }
    let bottom = |f: usize| Some(object.position[f].z? - 0.5 * object.height.unwrap_or(0.0));
    let frames = window.first..window.first + window.length.frames();
    let heights = frames.clone().map(|f| bottom(f).filter(|_| object.valid[f])).collect();
    let mut track = Vec::with_capacity(frames.len());
    for f in frames {
        // Padding slots have no extent.
        let is_padding = !(object.length > 0.0 && object.width > 0.0) && is_unset(object.position[f]);
        if !object.valid[f] || is_padding {
            track.push(None);
            continue;
        }
        let (at, v) = (object.position[f], object.velocity[f]);
        if is_unset(at) {
            let field = format!("objects[{i}].position[{f}]");
            let expected =
                "a position where `valid` is true; set `valid` to false where the object is absent";
            return Err(Cause::value(
                field,
                format!("({INVALID_COORDINATE}, {INVALID_COORDINATE})"),
                expected,
            ));
        }
        let heading = object.heading[f] * unit;
        track.push(Some(AgentState { x: at.x, y: at.y, heading, vx: v.x, vy: v.y }));
    }
    let kind = kind(&object.kind).unwrap_or(AgentKind::Other);
    Ok(LoggedAgent { agent: Agent { id, kind, length: object.length, width: object.width }, track, heights })
}

/// Converts a light; `None` if it was never observed.
fn light(lane: String, raw: &RawLight, window: &Window) -> Result<Option<LightParts>, Cause> {
    let field = |what: &str| format!("tl_states[\"{lane}\"].{what}");
    let n = raw.time_index.len();
    for (what, found) in [("state", raw.state.len()), ("x", raw.x.len()), ("y", raw.y.len())] {
        if found != n {
            let expected = format!("as many as `time_index` has: {n}");
            return Err(Cause::value(field(what), format!("{found} entries"), expected));
        }
    }
    let mut states = vec![None; window.length.frames()];
    for (k, (&index, state)) in raw.time_index.iter().zip(&raw.state).enumerate() {
        let frame = usize::try_from(index).ok().filter(|f| *f < window.recorded);
        let frame = frame.ok_or_else(|| {
            let expected = format!("the index of a frame, 0 to {}", window.recorded - 1);
            Cause::value(field(&format!("time_index[{k}]")), index, expected)
        })?;
        let observed = LightState::from_name(state).ok_or_else(|| {
            let known = LightState::ALL.map(LightState::name).join(", ");
            Cause::value(field(&format!("state[{k}]")), format!("`{state}`"), known)
        })?;
        if let Some(state) = frame.checked_sub(window.first).and_then(|f| states.get_mut(f)) {
            *state = Some(observed);
        }
    }
    let at = raw.x.first().zip(raw.y.first());
    Ok(at.map(|(&x, &y)| LightParts { lane, stop_point: Vec2::new(x, y), states }))
}
