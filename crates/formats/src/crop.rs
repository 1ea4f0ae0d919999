//! Scenarios that are shorter than stored.

use std::ops::Range;

use reactsim_scene::{Frame, Length, LightState, Scenario};

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
    // Frames that are not recorded are the last ones.
    if let Some(missing) = scenario.repairs.remove(UNRECORDED_FRAMES) {
        let left = missing.saturating_sub((own.future - length.future) as u32);
        scenario.repairs.extend((left > 0).then(|| (UNRECORDED_FRAMES.to_owned(), left)));
    }
}

/// Removes the entries outside of a range from a list, which may be shorter.
pub(crate) fn keep<T>(list: &mut Vec<T>, range: Range<usize>) {
    list.truncate(range.end);
    list.drain(..range.start.min(list.len()));
}
