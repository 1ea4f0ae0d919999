//! Traffic lights of a scenario.

use reactsim_geometry::Vec2;
use reactsim_scene::{LightParts, LightState, MapParts};

use super::window::Window;
use crate::error::Cause;
use crate::pickle::View;

/// Maximum number of lights of a scenario.
const MAX_LIGHTS: usize = 10_000;

/// Reads the lights, which are keyed by the id of the controlled lane. A light without a stop point is placed
/// at the start of its lane.
pub(super) fn lights(all: &View, window: Window, map: &MapParts) -> Result<Vec<LightParts>, Cause> {
    let starts: std::collections::BTreeMap<&str, Vec2> =
        map.lanes.iter().filter_map(|l| Some((l.id.as_str(), *l.points.first()?))).collect();
    let mut lights = Vec::new();
    for (key, light) in all.entries(MAX_LIGHTS)? {
        let lane = light.get("lane")?.map_or(Ok(key), |lane| lane.name())?;
        let states = light.need("state")?;
        let shown = light_states(&states.need("object_state")?, window)?;
        let at = match light.get("stop_point")? {
            Some(point) => Some(point.point()?),
            None => match states.get("stop_point")? {
                Some(points) => first_point(&points, &shown, window)?,
                None => None,
            },
        };
        let at = at.or_else(|| starts.get(lane.as_str()).copied()).unwrap_or_default();
        lights.push(LightParts { lane, stop_point: at, states: shown });
    }
    Ok(lights)
}

/// Reads the state of a light in each frame of the window.
fn light_states(states: &View, window: Window) -> Result<Vec<Option<LightState>>, Cause> {
    let one_each = || states.wrong(format!("a state for each of {} frames", window.length));
    let mut shown = Vec::with_capacity(window.scenario.frames());
    if states.is_list() {
        let items = states.items()?;
        if items.len() != window.length {
            return Err(one_each());
        }
        for item in &items[window.recorded()] {
            shown.push(match item.as_text() {
                _ if item.is_none() => None,
                Some(name) => from_name(name).ok_or_else(|| unknown(item))?,
                None => from_code(item.whole()? as f64),
            });
        }
    } else {
        let grid = states.grid()?;
        if grid.rows != window.length {
            return Err(one_each());
        }
        shown.extend(window.recorded().map(|f| from_code(grid.at(f, 0))));
    }
    shown.resize(window.scenario.frames(), None);
    Ok(shown)
}

/// Returns the error of an unknown state.
fn unknown(item: &View) -> Cause {
    item.wrong(
        "`LANE_STATE_` and a Waymo light state, `TRAFFIC_LIGHT_` and a colour, a code from 0 to 8, or None",
    )
}

/// Converts a state name; the inner `None` means no observation, the outer one an unknown name.
fn from_name(name: &str) -> Option<Option<LightState>> {
    match name {
        "TRAFFIC_LIGHT_GREEN" => Some(Some(LightState::Go)),
        "TRAFFIC_LIGHT_YELLOW" => Some(Some(LightState::Caution)),
        "TRAFFIC_LIGHT_RED" => Some(Some(LightState::Stop)),
        // These files use it for missing observations.
        "TRAFFIC_LIGHT_UNKNOWN" => Some(None),
        _ => {
            let state = name.strip_prefix("LANE_STATE_")?.to_ascii_lowercase();
            LightState::from_name(&state).map(Some)
        }
    }
}

/// Converts a code of Waymo's messages; unknown for codes that are not in the list.
fn from_code(code: f64) -> Option<LightState> {
    let known = LightState::ALL.iter().enumerate().find(|(i, _)| *i as f64 == code);
    Some(known.map_or(LightState::Unknown, |(_, state)| *state))
}

/// Returns the first stop point of the observed frames; frames without one contain zeros.
fn first_point(points: &View, shown: &[Option<LightState>], window: Window) -> Result<Option<Vec2>, Cause> {
    let grid = points.grid()?;
    if grid.rows != window.length || grid.columns < 2 {
        return Err(points.wrong(format!("x and y for each of {} frames", window.length)));
    }
    let seen = window.recorded().zip(shown).filter(|(_, s)| s.is_some());
    let mut given = seen.map(|(f, _)| Vec2::new(grid.at(f, 0), grid.at(f, 1)));
    Ok(given.find(|p| p.x.is_finite() && p.y.is_finite() && *p != Vec2::zeros()))
}
