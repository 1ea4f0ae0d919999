//! Conversion of tracks and a map to scenario parts.

use std::collections::BTreeMap;

use reactsim_scene::{Agent, AgentKind, Length, LoggedAgent, MapParts, ScenarioParts, unknown_type};

use super::tracks::{Track, Tracks};
use crate::error::Cause;
use crate::frames::{LengthChoice, most_agents};

/// Id of the AV's track.
const AV: &str = "AV";
/// Lowest category of tracks that forecasts are scored for.
const MIN_SCORED_CATEGORY: u32 = 2;
/// Relative tolerance of the time step around 0.1 s.
const STEP_TOLERANCE: f64 = 0.1;

/// Converts tracks and a map to scenario parts with the time step `current` as the current frame. Also
/// returns the number of missing frames at the end.
pub(super) fn parts(
    tracks: Tracks,
    map: MapParts,
    current: usize,
    choice: LengthChoice,
) -> Result<(ScenarioParts, u32), Cause> {
    if let Some(step) = tracks.step.filter(|s| !((s - 0.1).abs() <= STEP_TOLERANCE * 0.1)) {
        let what = "the step of `start_timestamp` to `end_timestamp` in `num_timestamps`";
        return Err(Cause::value(what, format!("{step} s"), "0.1 s (10 Hz)"));
    }
    let Some(av) = tracks.tracks.iter().position(|t| t.id == AV) else {
        return Err(Cause::value("`track_id`", "`AV` in no row", "the track of the AV"));
    };
    let now = u32::try_from(current).unwrap_or(u32::MAX);
    if !tracks.tracks[av].states.contains_key(&now) {
        let expected = "the AV present at the current frame; choose another frame";
        return Err(Cause::value(
            format!("the track `{AV}`"),
            format!("absent at time step {current}"),
            expected,
        ));
    }
    let last = tracks.tracks.iter().filter_map(|t| t.states.keys().next_back()).max().copied().unwrap_or(now);
    let after = (last as usize).saturating_sub(current);
    let length = Length { history: choice.history(), future: choice.future(after) };
    let first = current - length.current();
    let missing = length.future.saturating_sub(after);
    if length.future == 0 || missing > 0 && !choice.pads() {
        let expected = format!("{} or more; choose an earlier current frame", choice.least_future());
        return Err(Cause::value(format!("the number of frames after time step {current}"), after, expected));
    }
    if tracks.tracks.len() > most_agents(length.frames()) {
        let expected = format!("at most {} in {} frames", most_agents(length.frames()), length.frames());
        return Err(Cause::value("the number of tracks", tracks.tracks.len(), expected));
    }
    let ids = |chosen: &dyn Fn(&Track) -> bool| {
        tracks.tracks.iter().filter(|t| chosen(t)).map(|t| t.id.clone()).collect::<Vec<_>>()
    };
    let tracks_to_predict = ids(&|t| t.category >= MIN_SCORED_CATEGORY);
    let objects_of_interest = ids(&|t| tracks.focal.as_ref() == Some(&t.id));
    let step = tracks.step;
    let agents = tracks.tracks.into_iter().map(|track| agent(track, first, length.frames())).collect();
    let parts = ScenarioParts {
        id: tracks.scenario_id,
        source: "argoverse2".into(),
        origin: None,
        length,
        timestamps: step.map_or(Vec::new(), |s| (0..length.frames()).map(|f| f as f64 * s).collect()),
        av,
        agents,
        tracks_to_predict,
        objects_of_interest,
        map,
        lights: Vec::new(),
        deviation: None,
    };
    Ok((parts, missing as u32))
}

fn agent(track: Track, first: usize, frames: usize) -> LoggedAgent {
    let (kind, length, width) = class(&track.object_type);
    let frame = |f: usize| track.states.get(&u32::try_from(first + f).ok()?).copied();
    let states = (0..frames).map(frame).collect();
    LoggedAgent { agent: Agent { id: track.id, kind, length, width }, track: states, heights: Vec::new() }
}

/// Classes of objects of any size that take no part in traffic.
const OBJECT_CLASSES: [&str; 3] = ["static", "background", "unknown"];

/// Returns the repairs of classes that are not known, with the number of their tracks.
pub(super) fn unknown_types(tracks: &Tracks) -> BTreeMap<String, u32> {
    let mut found = BTreeMap::new();
    for name in tracks.tracks.iter().map(|track| track.object_type.as_str()) {
        if class(name) == OF_ANY_SIZE && !OBJECT_CLASSES.contains(&name) {
            *found.entry(unknown_type(name)).or_default() += 1;
        }
    }
    found
}

/// Returns the latest frame up to `default` at which the AV is present, enough frames come before it, and the
/// AV is recorded at the frames after it, so that it can follow its log. Without the last condition if no
/// frame meets it; `default` itself if the AV is at none.
pub(super) fn latest_frame(tracks: &Tracks, default: usize, length: LengthChoice) -> usize {
    let av = tracks.tracks.iter().find(|track| track.id == AV);
    let is_present = |frame: usize| {
        av.is_some_and(|av| u32::try_from(frame).is_ok_and(|frame| av.states.contains_key(&frame)))
    };
    let has_future = |frame: &usize| (*frame..=frame + length.least_future()).all(is_present);
    let frames = || (length.history() - 1..=default).rev();
    let latest = frames().find(has_future).or_else(|| frames().find(|frame| is_present(*frame)));
    latest.unwrap_or(default)
}

/// Kind and size of objects of any size.
const OF_ANY_SIZE: (AgentKind, f64, f64) = (AgentKind::Other, 0.0, 0.0);

/// Returns kind, length and width (in metres) of an object class. The data set records no sizes; these are
/// usual ones. A size of zero means an unknown size: such objects do not become obstacles.
fn class(object_type: &str) -> (AgentKind, f64, f64) {
    match object_type {
        "vehicle" => (AgentKind::Vehicle, 4.5, 1.9),
        "bus" => (AgentKind::Vehicle, 12.0, 2.6),
        "motorcyclist" => (AgentKind::Cyclist, 2.2, 0.9),
        "cyclist" => (AgentKind::Cyclist, 1.8, 0.7),
        "pedestrian" => (AgentKind::Pedestrian, 0.7, 0.7),
        "riderless_bicycle" => (AgentKind::Other, 1.8, 0.7),
        "construction" => (AgentKind::Other, 0.6, 0.6),
        // Those of [`OBJECT_CLASSES`] and of newer versions.
        _ => OF_ANY_SIZE,
    }
}
