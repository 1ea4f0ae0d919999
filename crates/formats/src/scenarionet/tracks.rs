//! Tracks of a scenario.

use std::collections::BTreeMap;

use reactsim_scene::{Agent, AgentKind, AgentState, LoggedAgent, unknown_type};

use super::window::Window;
use crate::error::Cause;
use crate::frames::most_agents;
use crate::pickle::{Grid, View};

/// Maximum number of frames of a recording; twenty seconds have 200.
pub(super) const MAX_FRAMES: usize = 100_000;
/// Maximum number of tracks of a scenario; usual scenarios have some hundred.
pub(super) const MAX_TRACKS: usize = 10_000;

/// Types of objects that take no part in traffic, as MetaDrive names them.
const OBJECT_TYPES: [&str; 8] = [
    "OTHER",
    "UNSET",
    "TRAFFIC_OBJECT",
    "TRAFFIC_CONE",
    "TRAFFIC_BARRIER",
    "GUARDRAIL",
    "BUILDING",
    "CROSSWALK",
];

/// Reads the tracks that are present in at least one frame of the window, and that of the AV, in file order.
/// Adds the repairs of types that are not known.
pub(super) fn tracks(
    all: &View,
    av: &str,
    window: Window,
    repairs: &mut BTreeMap<String, u32>,
) -> Result<Vec<LoggedAgent>, Cause> {
    let mut agents = Vec::new();
    for (id, track) in all.entries(MAX_TRACKS.min(most_agents(window.scenario.frames())))? {
        let is_av = id == av;
        let (kind, unknown) = kind(&track)?;
        let agent = agent(id, kind, &track, window)?;
        if is_av || agent.track.iter().any(Option::is_some) {
            agents.push(agent);
            if let Some(repair) = unknown {
                *repairs.entry(repair).or_default() += 1;
            }
        }
    }
    Ok(agents)
}

/// Returns the kind of a track, and the name of the repair if its type is not known.
fn kind(track: &View) -> Result<(AgentKind, Option<String>), Cause> {
    let stated = track.get("type")?;
    let name = stated.as_ref().and_then(View::as_text).unwrap_or_default();
    Ok(match name {
        "VEHICLE" => (AgentKind::Vehicle, None),
        "PEDESTRIAN" => (AgentKind::Pedestrian, None),
        "CYCLIST" => (AgentKind::Cyclist, None),
        _ => (AgentKind::Other, (!OBJECT_TYPES.contains(&name)).then(|| unknown_type(name))),
    })
}

fn agent(id: String, kind: AgentKind, track: &View, window: Window) -> Result<LoggedAgent, Cause> {
    let state = track.need("state")?;
    let [position, heading, valid] = ["position", "heading", "valid"].map(|key| state.need(key));
    let (position, heading) = (position?, heading?);
    let at = rows(&position, 2, "x and y", window)?;
    let headings = rows(&heading, 1, "an angle", window)?;
    let valid = rows(&valid?, 1, "true or false", window)?;
    let velocity = state.get("velocity")?;
    let velocity = velocity.as_ref().map(|v| rows(v, 2, "x and y", window)).transpose()?;
    let mut frames = Vec::with_capacity(window.scenario.frames());
    for f in window.recorded() {
        if valid.at(f, 0) != 1.0 {
            frames.push(None);
            continue;
        }
        let number = |view: &View, v: f64| {
            let field = || format!("{}[{f}]", view.path());
            let expected =
                "a finite number where `valid` is true; set `valid` to false where the agent is absent";
            if v.is_finite() { Ok(v) } else { Err(Cause::value(field(), v, expected)) }
        };
        let moving = |c: usize| velocity.as_ref().map_or(f64::NAN, |v| v.at(f, c));
        frames.push(Some(AgentState {
            x: number(&position, at.at(f, 0))?,
            y: number(&position, at.at(f, 1))?,
            heading: number(&heading, headings.at(f, 0))?,
            vx: moving(0),
            vy: moving(1),
        }));
    }
    frames.resize(window.scenario.frames(), None);
    let tall = state.get("height")?.map(|height| height.grid()).transpose()?;
    // Files of older versions have the size as three columns.
    let size = state.get("size")?.map(|size| size.grid()).transpose()?.filter(|size| size.columns > 2);
    let bottom = |f: usize| {
        let height = match (&tall, &size) {
            (Some(tall), _) if f < tall.rows => tall.at(f, 0),
            (_, Some(size)) if f < size.rows => size.at(f, 2),
            _ => 0.0,
        };
        (at.columns > 2).then(|| at.at(f, 2) - 0.5 * height)
    };
    let known = |(k, frame): (usize, &Option<AgentState>)| frame.and_then(|_| bottom(window.first + k));
    let heights = frames.iter().enumerate().map(known).collect();
    // As for Waymo records: the box at the current frame, else the first recorded one.
    let current = Some(window.scenario.current()).filter(|now| frames[*now].is_some());
    let seen = current.or_else(|| frames.iter().position(Option::is_some));
    let (mut length, mut width) = (0.0, 0.0);
    if let Some(f) = seen.map(|f| window.first + f) {
        (length, width) = match state.get("size")? {
            Some(size) => {
                let size = rows(&size, 2, "length, width and height", window)?;
                (size.at(f, 0), size.at(f, 1))
            }
            None => {
                let (length, width) = (state.need("length")?, state.need("width")?);
                (rows(&length, 1, "a size", window)?.at(f, 0), rows(&width, 1, "a size", window)?.at(f, 0))
            }
        };
    }
    Ok(LoggedAgent { agent: Agent { id, kind, length, width }, track: frames, heights })
}

/// Reads numbers with one row per frame and at least `columns` columns.
fn rows<'a>(view: &View<'a>, columns: usize, what: &str, window: Window) -> Result<Grid<'a>, Cause> {
    let grid = view.grid()?;
    if grid.rows != window.length || grid.columns < columns {
        return Err(view.wrong(format!("{what} for each of {} frames", window.length)));
    }
    Ok(grid)
}
