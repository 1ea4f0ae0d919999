//! Velocities that a recording does not state, estimated from positions.

use reactsim_geometry::Vec2;

use super::limits::MAX_VELOCITY;
use super::{AgentKind, AgentState, DT, Frame, LoggedAgent, Scenario, VelocityContradiction};

/// Beginning of the repair that counts agents whose velocities were replaced.
pub(super) const REPLACED: &str = "velocities that contradict positions, ";

/// Distance in metres within which an object of kind `other` stays at one place: more than the noise of
/// tracked boxes.
const STATIC_EXTENT: f64 = 1.0;

impl Scenario {
    /// Replaces the unknown velocities of all agents by estimates; the only place that decides about them.
    ///
    /// The estimate is the difference from the position one frame earlier, else the difference to the
    /// position one frame later. In the history, frames after the current one are never used. Velocities that
    /// cannot be estimated stay unknown, as do those of objects of kind `other` that stay at one place.
    /// Returns whether velocities were written.
    pub(super) fn estimate_velocities(&mut self) -> bool {
        let mut is_changed = self.forget_contradicting_velocities();
        let times = self.timestamps.clone();
        for (group, [history, future]) in self.split_tracks() {
            is_changed |= estimate_track(group.kind, history, future, |frame| seconds_before(&times, frame));
        }
        is_changed
    }

    /// Makes velocities unknown that contradict positions: of the AV, or of all other agents of a kind, if
    /// most of these that move are wrong. Frames after the current one are never used for the history.
    /// Returns whether there are any.
    fn forget_contradicting_velocities(&mut self) -> bool {
        let times = self.timestamps.clone();
        let tracks = self.split_tracks().map(|(group, track)| (group, track.concat()));
        let (groups, tracks): (Vec<Group>, Vec<Vec<Frame>>) = tracks.unzip();
        let find = |frames: usize| {
            let tracks = tracks.iter().map(|track| &track[..frames]);
            VelocityContradiction::find(tracks, |frame| seconds_before(&times, frame))
        };
        let (past, whole) = (find(self.length().history), find(self.length().frames()));
        let wrong_past: Vec<Group> = past.iter().flat_map(|found| wrong_groups(found, &groups)).collect();
        let wrong_ever: Vec<Group> = whole.iter().flat_map(|found| wrong_groups(found, &groups)).collect();
        for (group, [history, future]) in self.split_tracks() {
            let is_past = wrong_past.contains(&group);
            let frames = history.iter_mut().filter(|_| is_past);
            let future = future.iter_mut().filter(|_| is_past || wrong_ever.contains(&group));
            for state in frames.chain(future).flatten() {
                (state.vx, state.vy) = (f64::NAN, f64::NAN);
            }
        }
        for (found, wrong) in [(past, &wrong_past), (whole, &wrong_ever)] {
            let Some(found) = found else { continue };
            let count = found.agents.iter().filter(|i| wrong.contains(&groups[**i])).count() as u32;
            if count > 0 {
                self.repairs.retain(|what, _| !what.starts_with(REPLACED));
                self.repairs.insert(
                    format!("{REPLACED}replaced by differences of positions: {}", found.likely),
                    count,
                );
            }
        }
        !(wrong_past.is_empty() && wrong_ever.is_empty())
    }

    /// Returns all tracks, split after the current frame.
    fn split_tracks(&mut self) -> impl Iterator<Item = (Group, [&mut [Frame]; 2])> {
        let now = self.length().history;
        let tracks = self.start.history.iter_mut().zip(&mut self.log_future.tracks);
        let selected =
            self.start.agents.iter().zip(tracks).enumerate().map(|(i, (agent, (past, future)))| {
                (Group { is_av: i == 0, kind: agent.kind }, [past.as_mut_slice(), future.as_mut_slice()])
            });
        let others = self.unselected.iter_mut().map(move |LoggedAgent { agent, track, .. }| {
            let (past, future) = track.split_at_mut(now);
            (Group { is_av: false, kind: agent.kind }, [past, future])
        });
        selected.chain(others)
    }
}

/// The AV, or the other agents of a kind: their velocities have one source.
#[derive(Clone, Copy, PartialEq)]
struct Group {
    is_av: bool,
    kind: AgentKind,
}

/// Returns the groups in which most agents that move contradict, at least two apart from the AV. If most of
/// all agents contradict, one is sufficient, or none if none shows whether it does.
fn wrong_groups(found: &VelocityContradiction, groups: &[Group]) -> Vec<Group> {
    let most = found.agents.len() > found.consistent.len().max(1);
    let is_wrong = |group: &Group| {
        let count = |agents: &[usize]| agents.iter().filter(|i| groups[**i] == *group).count();
        match (count(&found.agents), count(&found.consistent)) {
            (0, 0) => most,
            (1, 0) => most || group.is_av,
            (wrong, consistent) => wrong > consistent,
        }
    };
    groups.iter().copied().filter(is_wrong).collect()
}

/// Returns the time from the frame before to a frame, seconds.
pub(super) fn seconds_before(times: &[f64], frame: usize) -> f64 {
    let earlier = frame.checked_sub(1).and_then(|f| times.get(f));
    earlier.zip(times.get(frame)).map_or(DT, |(earlier, now)| now - earlier)
}

/// Replaces the unknown velocities of an AV trajectory that continues from the state `now`, one frame
/// earlier, by differences of its positions.
pub fn estimate_av_velocities(now: &AgentState, track: &mut [AgentState]) {
    if track.iter().all(|state| state.velocity().is_some()) {
        return;
    }
    let mut frames: Vec<Frame> = track.iter().copied().map(Some).collect();
    fill(&mut frames, Some(*now), |_| DT);
    for (state, estimated) in track.iter_mut().zip(frames.into_iter().flatten()) {
        *state = estimated;
    }
}

/// Fills a track that is split after the current frame. `step` is the time from the frame before to a frame,
/// seconds. Returns whether states were written.
fn estimate_track(
    kind: AgentKind,
    history: &mut [Frame],
    future: &mut [Frame],
    step: impl Fn(usize) -> f64,
) -> bool {
    if history.iter().chain(future.iter()).flatten().all(|state| state.velocity().is_some()) {
        return false;
    }
    let is_static = |states: &[&[Frame]]| kind == AgentKind::Other && stays(states);
    let is_past_filled = !is_static(&[history]) && fill(history, None, &step);
    if is_static(&[history, future]) {
        return is_past_filled;
    }
    // The first future frame is compared with the current one.
    let now = history.last().copied().flatten();
    fill(future, now, |i| step(history.len() + i)) || is_past_filled
}

/// Returns whether all states are at one place.
fn stays(parts: &[&[Frame]]) -> bool {
    let mut states = parts.iter().copied().flatten().flatten();
    let Some(first) = states.next() else { return true };
    states.all(|state| (state.position() - first.position()).norm() < STATIC_EXTENT)
}

/// Fills the unknown velocities of successive frames. `before` is the frame before the first one, and
/// `step(i)` the time from frame `i - 1` to frame `i` of the slice, seconds, where `before` is frame −1.
/// Returns whether there were any that could be estimated.
fn fill(track: &mut [Frame], before: Frame, step: impl Fn(usize) -> f64) -> bool {
    let mut is_changed = false;
    for i in 0..track.len() {
        let Some(state) = track[i].filter(|state| state.velocity().is_none()) else { continue };
        let earlier = if i == 0 { before } else { track[i - 1] };
        let later = track.get(i + 1).copied().flatten();
        let backward = earlier.and_then(|b| difference(&b, &state, step(i)));
        let forward = || later.and_then(|l| difference(&state, &l, step(i + 1)));
        if let Some(v) = backward.or_else(forward) {
            track[i] = Some(AgentState { vx: v.x, vy: v.y, ..state });
            is_changed = true;
        }
    }
    is_changed
}

/// Returns the mean velocity between two states; `None` if it is beyond those of any agent.
fn difference(from: &AgentState, to: &AgentState, seconds: f64) -> Option<Vec2> {
    let v = (to.position() - from.position()) / seconds;
    (v.x.abs() < MAX_VELOCITY && v.y.abs() < MAX_VELOCITY).then_some(v)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{CURRENT, FRAMES, HISTORY, ScenarioParts};

    /// Returns an agent with positions along the x axis and unknown velocities.
    fn unknown(id: &str, kind: AgentKind, x: impl Fn(usize) -> Option<f64>) -> LoggedAgent {
        let state = |x: f64| AgentState { x, y: 5.0, heading: 0.0, vx: f64::NAN, vy: 0.0 };
        let agent = crate::Agent { id: id.to_owned(), kind, length: 4.0, width: 2.0 };
        LoggedAgent { agent, track: (0..FRAMES).map(|f| x(f).map(state)).collect(), heights: Vec::new() }
    }

    fn assembled(agents: Vec<LoggedAgent>, timestamps: Vec<f64>) -> Scenario {
        let parts = ScenarioParts {
            id: "made".into(),
            origin: Some(Vec2::zeros()),
            agents,
            timestamps,
            ..ScenarioParts::default()
        };
        Scenario::assemble(parts).unwrap()
    }

    fn velocities(scenario: &Scenario, agent: usize) -> Vec<Option<f64>> {
        scenario.logged(agent).iter().map(|f| f.and_then(|s| s.velocity()).map(|v| v.x)).collect()
    }

    #[test]
    fn unknown_velocities_are_differences_over_recorded_times() {
        // Each step is one metre; the step to frame 6 takes 0.2 s.
        let times = (0..FRAMES).map(|f| 0.1 * f as f64 + if f > 5 { 0.1 } else { 0.0 }).collect();
        let av = unknown("av", AgentKind::Vehicle, |f| Some(f as f64));
        for (times, late) in [(times, 5.0), (Vec::new(), 10.0)] {
            let s = assembled(vec![av.clone()], times);
            for (f, v) in velocities(&s, 0).into_iter().enumerate() {
                let expected = if f == 6 { late } else { 10.0 };
                assert!((v.unwrap() - expected).abs() < 1e-9, "frame {f}: {v:?}");
            }
            assert!(
                s.notes().contains_key("no-drivable-area") && !s.notes().contains_key("velocity-unknown")
            );
            assert!(s.repairs.is_empty());
        }
    }

    #[test]
    fn the_future_is_not_used_for_the_history() {
        let av = unknown("av", AgentKind::Vehicle, |f| Some(if f <= CURRENT { 0.0 } else { f as f64 }));
        let new = unknown("new", AgentKind::Vehicle, |f| (f >= CURRENT).then_some(f as f64));
        let s = assembled(vec![av, new], Vec::new());
        assert_eq!(velocities(&s, 0)[CURRENT], Some(0.0));
        // An agent that appears now has no earlier position: its velocity is unknown, and noted.
        let seen = velocities(&s, 1);
        assert_eq!(seen[CURRENT], None);
        assert!((seen[CURRENT + 1].unwrap() - 10.0).abs() < 1e-9);
        assert_eq!(s.notes()["velocity-unknown"], crate::Note { count: 1, detail: None });
        let hidden = s.clone().without_future();
        assert_eq!(velocities(&hidden, 1)[..HISTORY], seen[..HISTORY]);
    }

    #[test]
    fn known_velocities_jumps_and_static_objects_are_left_as_they_are() {
        let mut av = unknown("av", AgentKind::Vehicle, |f| Some(f as f64));
        av.track.iter_mut().flatten().for_each(|state| state.vx = 7.0);
        let jump = unknown("jump", AgentKind::Cyclist, |f| (f == 0 || f > 3).then_some(1e3 * f as f64));
        let cone = unknown("cone", AgentKind::Other, |f| Some(0.1 * (f % 2) as f64));
        let cart = unknown("cart", AgentKind::Other, |f| Some(f as f64));
        let s = assembled(vec![av, jump, cone, cart], Vec::new());
        assert_eq!(velocities(&s, 0), [Some(7.0); FRAMES]);
        assert_eq!(velocities(&s, 1), [None; FRAMES], "ten times beyond the velocity of any agent");
        let of = |id: &str| s.unselected.iter().find(|a| a.agent.id == id).unwrap().track[CURRENT].unwrap();
        assert!(of("cone").vx.is_nan());
        assert!((of("cart").vx - 10.0).abs() < 1e-9);
        assert_eq!(s.notes()["velocity-unknown"].count, 1);
        // What is complete does not change.
        let mut again = s.clone();
        again.complete();
        assert_eq!(again.digest(), s.digest());
    }

    #[test]
    fn trajectories_begin_with_the_difference_from_now() {
        let now = AgentState { x: 0.0, y: 0.0, heading: 0.0, vx: 8.0, vy: 0.0 };
        let mut track: Vec<AgentState> = (1..4)
            .map(|k| AgentState { x: f64::from(k), vx: if k == 2 { 3.0 } else { f64::NAN }, ..now })
            .collect();
        estimate_av_velocities(&now, &mut track);
        assert_eq!(track.iter().map(|s| s.vx).collect::<Vec<_>>(), [10.0, 3.0, 10.0]);
    }
}
