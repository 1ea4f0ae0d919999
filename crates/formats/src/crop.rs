//! Scenarios that are shorter than stored.

use std::collections::BTreeMap;
use std::ops::Range;

use reactsim_scene::{Frame, Length, LightState, Scenario, ScenarioParts};

use super::error::Cause;
use super::format::UNRECORDED_FRAMES;
use super::frames::LengthChoice;

/// Reduces a scenario to the chosen numbers of frames around its current frame. A deviated AV that becomes
/// shorter loses its certificate, which was measured over all of its states.
///
/// # Errors
/// [`Cause`] names the number of frames that the scenario has, if more are chosen.
pub fn crop(scenario: &mut Scenario, choice: LengthChoice) -> Result<(), Cause> {
    let own = scenario.length();
    let length = Length {
        history: choice.history.unwrap_or(own.history),
        future: choice.future.map_or(own.future, |future| future.of(own.future)),
    };
    let numbers = [("history", own.history, length.history), ("future", own.future, length.future)];
    if let Some((what, own, wanted)) = numbers.into_iter().find(|(_, own, wanted)| wanted > own) {
        let expected = format!("at least the {wanted} that are requested with `{what}`");
        return Err(Cause::value(format!("the number of frames of the {what}"), own, expected));
    }
    if length != own {
        reduce(scenario, own, length);
    }
    Ok(())
}

/// Reduces the parts of a scenario to a window around frame `current`, which becomes the current one, with
/// the AV there as the origin. What belongs to another current frame is left out: the deviated AV, and the
/// marks of agents, which data sets choose by their motion after it.
///
/// # Errors
/// [`Cause`] names the number of frames, if there are too few for a window.
pub(crate) fn cut(parts: &mut ScenarioParts, current: usize, choice: LengthChoice) -> Result<(), Cause> {
    let frames = parts.length.frames();
    let future = choice.future(frames.saturating_sub(current + 1));
    let (length, end) = (Length { history: choice.history(), future }, current + 1 + future);
    if future == 0 || frames < end {
        let expected = format!("{} or more", length.history + choice.least_future());
        return Err(Cause::value("the number of frames", frames, expected));
    }
    if current != parts.length.current() {
        parts.tracks_to_predict.clear();
        parts.objects_of_interest.clear();
    }
    let kept = current - length.current()..end;
    for agent in &mut parts.agents {
        keep(&mut agent.track, kept.clone());
        keep(&mut agent.heights, kept.clone());
    }
    let av = parts.agents.remove(parts.av);
    parts.agents.retain(|agent| agent.track.iter().any(Option::is_some));
    parts.agents.insert(0, av);
    parts.lights.iter_mut().for_each(|light| keep(&mut light.states, kept.clone()));
    keep(&mut parts.timestamps, kept);
    (parts.av, parts.length, parts.origin, parts.deviation) = (0, length, None, None);
    Ok(())
}

/// Reduces the repair that counts frames that are not recorded, the last ones, by those that are not kept.
pub(crate) fn count_unrecorded(repairs: &mut BTreeMap<String, u32>, removed: usize) {
    if let Some(missing) = repairs.remove(UNRECORDED_FRAMES) {
        let left = missing.saturating_sub(removed as u32);
        repairs.extend((left > 0).then(|| (UNRECORDED_FRAMES.to_owned(), left)));
    }
}

/// Reduces a scenario of length `own` to `length`, which is not longer.
fn reduce(scenario: &mut Scenario, own: Length, length: Length) {
    let early = own.history - length.history;
    let kept = early..early + length.frames();
    let (start, future) = (&mut scenario.start, &mut scenario.log_future);
    start.history.iter_mut().for_each(|track| drop(track.drain(..early)));
    start.heights.iter_mut().for_each(|heights| drop(heights.drain(..early)));
    let past: &mut Vec<Vec<Option<LightState>>> = &mut start.light_history;
    past.iter_mut().for_each(|states| drop(states.drain(..early)));
    future.tracks.iter_mut().for_each(|track| track.truncate(length.future));
    future.heights.iter_mut().for_each(|heights| heights.truncate(length.future));
    future.lights.iter_mut().for_each(|states| states.truncate(length.future));
    for other in &mut scenario.unselected {
        keep(&mut other.track, kept.clone());
        keep(&mut other.heights, kept.clone());
    }
    let is_seen = |track: &[Frame]| track.iter().any(Option::is_some);
    scenario.unselected.retain(|other| is_seen(&other.track));
    keep(&mut scenario.timestamps, kept);
    if let Some(deviation) = &mut scenario.deviation
        && length.future < own.future
    {
        deviation.track.truncate(length.future);
        deviation.certificate = None;
    }
    count_unrecorded(&mut scenario.repairs, own.future - length.future);
}

/// Removes the entries outside of a range from a list, which may be shorter.
pub(crate) fn keep<T>(list: &mut Vec<T>, range: Range<usize>) {
    list.truncate(range.end);
    list.drain(..range.start.min(list.len()));
}
