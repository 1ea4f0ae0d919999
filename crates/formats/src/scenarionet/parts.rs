//! Conversion of a pickle to scenario parts.

use std::collections::BTreeMap;

use reactsim_scene::{DT, LATER_FRAME, Length, LightParts, ScenarioParts};

use super::window::Window;
use super::{lights, map, tracks};
use crate::error::Cause;
use crate::format::UNRECORDED_FRAMES;
use crate::frames::LengthChoice;
use crate::pickle::View;

/// Reads the id of the scenario.
pub(super) fn id(root: &View) -> Result<String, Cause> {
    let about = root.get("metadata")?;
    for place in [Some(root), about.as_ref()].into_iter().flatten() {
        for key in ["id", "scenario_id"] {
            if let Some(id) = place.get(key)? {
                return id.name().and_then(|name| {
                    if name.is_empty() { Err(id.wrong("the name of the scenario")) } else { Ok(name) }
                });
            }
        }
    }
    Err(Cause::schema("`id`", "missing", "the name of the scenario"))
}

/// Converts a pickle to scenario parts; `current` overrides the current frame of the file. Also returns the
/// repairs made, with their numbers.
pub(super) fn parts(
    root: &View,
    id: String,
    current: Option<usize>,
    length: LengthChoice,
) -> Result<(ScenarioParts, BTreeMap<String, u32>), Cause> {
    let about = root.need("metadata")?;
    let (window, mut repairs) = window(root, &about, current, length)?;
    let timestamps = timestamps(&about, window)?;
    let dataset = about.get("dataset")?;
    let dataset = dataset.as_ref().and_then(View::as_text);
    let stated = about.need("sdc_id")?;
    let av_id = stated.name()?;
    let mut agents = tracks::tracks(&root.need("tracks")?, &av_id, window, &mut repairs)?;
    let Some(av) = agents.iter().position(|a| a.agent.id == av_id) else {
        return Err(stated.wrong("the id of a track"));
    };
    let sizes = &mut agents[av].agent;
    // Some versions of the nuScenes converter exchanged length and width of the AV.
    if dataset == Some("nuscenes") && sizes.width > sizes.length {
        std::mem::swap(&mut sizes.width, &mut sizes.length);
        repairs.insert("length and width of the AV that were exchanged".to_owned(), 1);
    }
    let mut map = map::map(&root.need("map_features")?, dataset, &mut repairs)?;
    let lights = match root.get("dynamic_map_states")? {
        None => Vec::new(),
        Some(states) => lights::lights(&states, window, &map)?,
    };
    map.stop_lines.extend(lights.iter().map(LightParts::stop_line));
    let parts = ScenarioParts {
        id,
        source: "scenarionet".into(),
        origin: None,
        length: window.scenario,
        timestamps,
        av,
        agents,
        tracks_to_predict: names(&about, "tracks_to_predict")?,
        objects_of_interest: names(&about, "objects_of_interest")?,
        map,
        lights,
        deviation: None,
    };
    Ok((parts, repairs))
}

/// Reads the number of frames of the recording.
pub(super) fn frames(root: &View) -> Result<usize, Cause> {
    let stated = root.need("length")?;
    let length = usize::try_from(stated.whole()?).ok();
    let length = length.filter(|n| (1..=tracks::MAX_FRAMES).contains(n));
    length.ok_or_else(|| stated.wrong("the number of frames"))
}

/// Determines the window of frames, and the repairs for missing and unread frames.
fn window(
    root: &View,
    about: &View,
    current: Option<usize>,
    choice: LengthChoice,
) -> Result<(Window, BTreeMap<String, u32>), Cause> {
    let length = frames(root)?;
    let stored = about.get("current_time_index")?;
    let (before, mut later) = (choice.history() - 1, 0);
    let now = match (current, &stored) {
        (Some(current), _) => i64::try_from(current).unwrap_or(i64::MAX),
        (None, Some(stored)) => {
            let stored = stored.whole()?;
            let now = usize::try_from(stored).map_or(stored, |stored| choice.current(stored, length) as i64);
            later = now - stored;
            now
        }
        (None, None) => before as i64,
    };
    let first = usize::try_from(now).ok().filter(|now| *now < length).and_then(|now| now.checked_sub(before));
    let Some(first) = first else {
        let expected = format!("a frame with {before} before it, {before} to {}", length as i64 - 1);
        return Err(match stored.filter(|_| current.is_none()) {
            Some(stored) => stored.wrong(format!("{expected}; choose it with `current-frame`")),
            None => Cause::value("the current frame", now, expected),
        });
    };
    let after = length - 1 - (first + before);
    let scenario = Length { history: choice.history(), future: choice.future(after) };
    let missing = scenario.future.saturating_sub(after);
    if scenario.future == 0 || missing > 0 && !choice.pads() {
        let expected = format!("{} or more", choice.least_future());
        return Err(Cause::value(format!("the number of frames after frame {now}"), after, expected));
    }
    let window = Window { first, length, scenario };
    let unread = length - window.recorded().len();
    let repairs = [
        (UNRECORDED_FRAMES, missing),
        (LATER_FRAME, later.max(0) as usize),
        ("recorded frames before and after those that are read", unread),
    ];
    Ok((window, repairs.map(|(what, frames)| (what.to_owned(), frames as u32)).into()))
}

/// Returns the times of the frames; missing frames continue at the mean time step.
fn timestamps(about: &View, window: Window) -> Result<Vec<f64>, Cause> {
    let rate = about.get("sample_rate")?;
    if let Some(rate) = rate {
        let step = rate.number()?;
        if !((step - DT).abs() <= 0.1 * DT) {
            return Err(rate.wrong("0.1 (10 Hz); convert the data set with interpolated frames"));
        }
    }
    let Some(given) = about.get("ts")? else { return Ok(Vec::new()) };
    let grid = given.grid()?;
    if grid.rows != window.length || grid.columns != 1 {
        return Err(given.wrong(format!("one time for each of {} frames", window.length)));
    }
    let mut times: Vec<f64> = window.recorded().map(|f| grid.at(f, 0)).collect();
    let (n, first, last) = (times.len(), times[0], times[times.len() - 1]);
    // Missing frames continue at the recorded rate, so that a recording of another rate is not accepted.
    let step = if n > 1 { (last - first) / (n - 1) as f64 } else { DT };
    times.extend((n..window.scenario.frames()).map(|f| last + (f - n + 1) as f64 * step));
    Ok(times)
}

/// Reads ids from the keys of a dictionary, or from a list of ids or of records with `track_id`.
fn names(about: &View, key: &str) -> Result<Vec<String>, Cause> {
    let Some(list) = about.get(key)? else { return Ok(Vec::new()) };
    if list.is_dict() {
        return Ok(list.entries(tracks::MAX_TRACKS)?.into_iter().map(|(name, _)| name).collect());
    }
    let name = |item: &View| if item.is_dict() { item.need("track_id")?.name() } else { item.name() };
    list.items()?.iter().map(name).collect()
}
