//! Windows of scenarios, as long as the scenarios that networks are trained with.

use std::borrow::Cow;

use rand::RngExt;
use reactsim_geometry::OrientedBox;
use reactsim_scene::{
    Agent, AgentKind, CURRENT, FRAMES, FUTURE, Frame, HISTORY, Length, LightState, MAX_AGENTS, Scenario,
    Start,
};

use crate::training::Stream;

/// A window of a scenario: 91 frames, of which frame 10 is the current one.
#[derive(Clone, Debug)]
pub struct Window<'s> {
    /// The information known at the current frame: 11 frames of history.
    pub start: Cow<'s, Start>,
    /// 91 frames per agent.
    pub tracks: Vec<Vec<Frame>>,
    /// 91 states per light.
    pub lights: Vec<Vec<Option<LightState>>>,
}

impl<'s> Window<'s> {
    /// Returns a window of a scenario, drawn from the stream among all with an AV; without a stream, and if
    /// the scenario is shorter, that around its current frame. Frames before and after the scenario are
    /// absent. Agents are chosen as in scenarios. A scenario of 91 frames is its only window, and nothing is
    /// drawn.
    pub fn of(scenario: &'s Scenario, stream: Option<&mut Stream>) -> Self {
        let length = scenario.length();
        if length == Length::BENCHMARK {
            let start = &scenario.start;
            return Self {
                start: Cow::Borrowed(start),
                tracks: (0..start.agents.len()).map(|slot| scenario.logged(slot)).collect(),
                lights: (0..start.lights.len()).map(|light| scenario.light_states(light)).collect(),
            };
        }
        let last = length.frames().saturating_sub(FUTURE);
        let possible = (CURRENT..last).filter(|frame| scenario.logged_at(0, *frame).is_some());
        let possible: Vec<usize> = possible.collect();
        let current = match stream {
            Some(stream) if !possible.is_empty() => possible[stream.random_range(0..possible.len())],
            _ => length.current(),
        };
        Self::around(scenario, current)
    }

    /// Returns the window around a frame at which the AV is present.
    fn around(scenario: &Scenario, current: usize) -> Self {
        let all = recorded(scenario);
        let selected = selected(&all, current);
        let mut start = scenario.start.clone();
        let tracks: Vec<Vec<Frame>> = selected.iter().map(|&i| cut(&all[i].track, current)).collect();
        let lights = (0..start.lights.len()).map(|light| cut(&scenario.light_states(light), current));
        let lights: Vec<Vec<Option<LightState>>> = lights.collect();
        start.agents = selected.iter().map(|&i| all[i].agent.clone()).collect();
        start.history = tracks.iter().map(|track| track[..HISTORY].to_vec()).collect();
        start.light_history = lights.iter().map(|states| states[..HISTORY].to_vec()).collect();
        let standing = all.iter().filter(|a| a.agent.kind == AgentKind::Other && a.agent.has_extent());
        let standing: Vec<(OrientedBox, Option<f64>)> = standing
            .filter_map(|a| Some((a.track[current]?.footprint(a.agent), a.height(current))))
            .collect();
        (start.obstacles, start.obstacle_heights) = standing.into_iter().unzip();
        if start.has_levels() {
            let heights = |&i: &usize| cut(&all[i].heights, current)[..HISTORY].to_vec();
            start.heights = selected.iter().map(heights).collect();
        } else {
            start.obstacle_heights.clear();
        }
        Self { start: Cow::Owned(start), tracks, lights }
    }
}

/// A recorded agent with all its frames.
struct Recorded<'s> {
    agent: &'s Agent,
    track: Cow<'s, [Frame]>,
    heights: Cow<'s, [Option<f64>]>,
}

impl Recorded<'_> {
    fn height(&self, frame: usize) -> Option<f64> {
        self.heights.get(frame).copied().flatten()
    }
}

/// Returns all recorded agents, the AV first.
fn recorded(scenario: &Scenario) -> Vec<Recorded<'_>> {
    let Scenario { start, log_future, unselected, .. } = scenario;
    let chosen = start.agents.iter().enumerate().map(|(slot, agent)| {
        let heights = start.heights.get(slot).into_iter().chain(log_future.heights.get(slot));
        let heights = Cow::Owned(heights.flatten().copied().collect());
        Recorded { agent, track: Cow::Owned(scenario.logged(slot)), heights }
    });
    let others = unselected.iter().map(|other| Recorded {
        agent: &other.agent,
        track: Cow::Borrowed(&other.track),
        heights: Cow::Borrowed(&other.heights),
    });
    chosen.chain(others).collect()
}

/// Returns the AV and the agents nearest to it at a frame, by distance, as scenarios have them.
fn selected(all: &[Recorded<'_>], current: usize) -> Vec<usize> {
    let Some(av) = all[0].track[current] else { return vec![0] };
    let mut near: Vec<(f64, usize)> = Vec::new();
    for (i, other) in all.iter().enumerate().skip(1) {
        if let Some(now) = other.track[current]
            && other.agent.kind != AgentKind::Other
            && other.agent.has_extent()
        {
            near.push(((now.position() - av.position()).norm(), i));
        }
    }
    near.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    near.truncate(MAX_AGENTS - 1);
    std::iter::once(0).chain(near.into_iter().map(|near| near.1)).collect()
}

/// Returns the 91 values around a frame, `None` beyond the ends of the list.
fn cut<T: Copy>(all: &[Option<T>], current: usize) -> Vec<Option<T>> {
    let at = |k: usize| (current + k).checked_sub(CURRENT).and_then(|frame| *all.get(frame)?);
    (0..FRAMES).map(at).collect()
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use reactsim_scene::{AgentState, LoggedAgent, ScenarioParts};

    use super::*;

    /// A scenario in which the AV drives at 10 m/s past cars that are there from 40 m before they are
    /// reached.
    fn scenario(length: Length) -> Scenario {
        let at = |x: f64, vx: f64| Some(AgentState { x, y: 0.0, heading: 0.0, vx, vy: 0.0 });
        let agent = |id: String| Agent { id, kind: AgentKind::Vehicle, length: 4.0, width: 2.0 };
        let frames = length.frames();
        let av = (0..frames).map(|f| at(f as f64, 10.0)).collect();
        let mut agents = vec![LoggedAgent { agent: agent("av".into()), track: av, heights: Vec::new() }];
        for k in 0..frames / 20 {
            let x = 20.0 * k as f64;
            let track = (0..frames).map(|f| at(x, 0.0).filter(|_| (x - f as f64).abs() < 40.0)).collect();
            agents.push(LoggedAgent { agent: agent(format!("{k}")), track, heights: Vec::new() });
        }
        Scenario::assemble(ScenarioParts { id: "long".into(), length, agents, ..Default::default() }).unwrap()
    }

    #[test]
    fn a_scenario_of_the_benchmark_is_its_only_window() {
        let scenario = scenario(Length::BENCHMARK);
        let mut stream = Stream::seed_from_u64(3);
        let window = Window::of(&scenario, Some(&mut stream));
        assert!(matches!(window.start, Cow::Borrowed(_)));
        let logged: Vec<_> = (0..scenario.start.agents.len()).map(|slot| scenario.logged(slot)).collect();
        assert_eq!(window.tracks, logged);
        assert_eq!(stream, Stream::seed_from_u64(3), "nothing is drawn");
    }

    #[test]
    fn windows_of_a_long_scenario_are_drawn_from_all_of_it() {
        let scenario = scenario(Length { history: 21, future: 600 });
        let mut stream = Stream::seed_from_u64(3);
        let mut starts = Vec::new();
        for _ in 0..200 {
            let window = Window::of(&scenario, Some(&mut stream));
            // The AV moves by 1 m per frame, and is at the origin at the current frame.
            starts.push(20 + window.start.now(0).x.round() as i64);
            assert!(window.tracks.iter().all(|track| track.len() == FRAMES));
            assert!(window.tracks[0].iter().all(Option::is_some));
            assert_eq!(window.start.current(), CURRENT);
            assert_eq!(window.start.history[0][..], window.tracks[0][..HISTORY]);
            // The cars that are there now, the nearest first.
            let away = |slot: usize| (window.start.now(slot).x - window.start.now(0).x).abs();
            assert!((2..window.start.agents.len()).all(|slot| away(slot - 1) <= away(slot)));
            assert!(
                (3..=5).contains(&window.start.agents.len()) && away(window.start.agents.len() - 1) < 40.0
            );
        }
        let (first, last) = (starts.iter().min().unwrap(), starts.iter().max().unwrap());
        assert!((10..40).contains(first) && (500..=540).contains(last), "{first} to {last}");
        let plain = Window::of(&scenario, None);
        assert_eq!(plain.start.now(0), scenario.start.now(0));
        assert_eq!(plain.tracks[0], scenario.logged(0)[10..101]);
    }

    #[test]
    fn short_scenarios_have_one_window_with_absent_frames() {
        let scenario = scenario(Length { history: 2, future: 30 });
        for stream in [None, Some(&mut Stream::seed_from_u64(3))] {
            let window = Window::of(&scenario, stream);
            let present: Vec<usize> = (0..FRAMES).filter(|f| window.tracks[0][*f].is_some()).collect();
            assert_eq!(present, (9..41).collect::<Vec<_>>());
            assert_eq!(window.start.now(0), scenario.start.now(0));
        }
    }
}
