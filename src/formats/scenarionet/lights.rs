//! Lights.

use super::parts::Window;
use super::pickle::View;
use crate::formats::error::Cause;
use crate::geometry::Vec2;
use crate::scene::{FRAMES, LightParts, LightState, MapParts};

/// Most lights of a scenario.
const MOST_LIGHTS: usize = 10_000;

/// The lights, by the id of the lane that each controls. One without a stop point stands where its lane begins.
pub(super) fn lights(all: &View, window: Window, map: &MapParts) -> Result<Vec<LightParts>, Cause> {
    let starts: std::collections::BTreeMap<&str, Vec2> =
        map.lanes.iter().filter_map(|l| Some((l.id.as_str(), *l.points.first()?))).collect();
    let mut lights = Vec::new();
    for (key, light) in all.entries(MOST_LIGHTS)? {
        let lane = light.get("lane")?.map_or(Ok(key), |lane| lane.name())?;
        let states = light.need("state")?;
        let shown = shown(&states.need("object_state")?, window)?;
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

/// What a light showed in each frame of the window.
fn shown(states: &View, window: Window) -> Result<Vec<Option<LightState>>, Cause> {
    let one_each = || states.wrong(format!("a state for each of {} frames", window.length));
    let mut shown = Vec::with_capacity(FRAMES);
    if states.is_list() {
        let items = states.items()?;
        if items.len() != window.length {
            return Err(one_each());
        }
        for item in &items[window.recorded()] {
            shown.push(match item.as_text() {
                _ if item.is_none() => None,
                Some(name) => named(name).ok_or_else(|| unknown(item))?,
                None => coded(item.whole()? as f64),
            });
        }
    } else {
        let grid = states.grid()?;
        if grid.rows != window.length {
            return Err(one_each());
        }
        shown.extend(window.recorded().map(|f| coded(grid.at(f, 0))));
    }
    shown.resize(FRAMES, None);
    Ok(shown)
}

fn unknown(item: &View) -> Cause {
    item.wrong("`LANE_STATE_` and a state of Waymo's lights, `TRAFFIC_LIGHT_` and a colour, a code of 0 to 8, or None")
}

/// The state of a name; none within where it says that nothing was seen.
fn named(name: &str) -> Option<Option<LightState>> {
    match name {
        "TRAFFIC_LIGHT_GREEN" => Some(Some(LightState::Go)),
        "TRAFFIC_LIGHT_YELLOW" => Some(Some(LightState::Caution)),
        "TRAFFIC_LIGHT_RED" => Some(Some(LightState::Stop)),
        // Where these files have no observation.
        "TRAFFIC_LIGHT_UNKNOWN" => Some(None),
        _ => {
            let state = name.strip_prefix("LANE_STATE_")?.to_ascii_lowercase();
            LightState::from_name(&state).map(Some)
        }
    }
}

/// The state of a code of Waymo's messages; unknown for codes that are newer.
fn coded(code: f64) -> Option<LightState> {
    let known = LightState::ALL.iter().enumerate().find(|(i, _)| *i as f64 == code);
    Some(known.map_or(LightState::Unknown, |(_, state)| *state))
}

/// The stop point of the first frame that has one: others hold zeros.
fn first_point(points: &View, shown: &[Option<LightState>], window: Window) -> Result<Option<Vec2>, Cause> {
    let grid = points.grid()?;
    if grid.rows != window.length || grid.columns < 2 {
        return Err(points.wrong(format!("x and y for each of {} frames", window.length)));
    }
    let seen = window.recorded().zip(shown).filter(|(_, s)| s.is_some());
    let mut given = seen.map(|(f, _)| Vec2::new(grid.at(f, 0), grid.at(f, 1)));
    Ok(given.find(|p| p.x.is_finite() && p.y.is_finite() && *p != Vec2::zeros()))
}
