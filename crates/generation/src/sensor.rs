//! How a vehicle's sensors record a scenario: noise of tracks, frames in which agents and lights are hidden,
//! and a map with less content than the generator draws.
//!
//! The constants are aggregates of the Waymo Open Motion Dataset (417 windows of the training set, kept
//! outside this repository). Tracks of moving agents have the third differences of independent errors; parked
//! vehicles have none. Of the vehicles that are present at the current frame, 86 % are seen in all frames
//! before it, and 44 % in all frames after it. 38 % of the windows have no speed limits. Where lights are
//! recorded, 28 % of them are known in all frames, 12 % in none, and all together in 55 % of the frames. Its
//! maps do not tell junctions from other lanes, and have neither give-way lines nor drivable areas.

use reactsim_geometry::{Vec2, direction, left, math, wrap};
use reactsim_rollout::Stream;
use reactsim_scene::{
    AgentKind, DT, Frame, LANE_HALF_WIDTH, LaneArea, LaneKind, LightParts, LoggedAgent, MapParts,
    ScenarioParts, StopKind,
};

use super::Draw;

/// Share of scenarios whose map has no speed limits.
const UNLIMITED_SHARE: f64 = 0.38;
/// Share of scenarios in which no light is recorded.
const UNLIT_SHARE: f64 = 0.25;
/// Weights of lights that are known in all frames, in none, and in a part of the frames.
const LIGHT_WEIGHTS: [f64; 3] = [0.28, 0.12, 0.6];
/// Distance in metres beyond which agents are hidden: bounds of a uniform draw per scenario.
const RANGE: [f64; 2] = [70.0, 85.0];
/// Rate at which visible agents become hidden at [`RATE_DISTANCE`], per second; it grows with the square of
/// the distance.
const LOSS_RATE: f64 = 0.12;
/// Distance at which [`LOSS_RATE`] applies, metres.
const RATE_DISTANCE: f64 = 45.0;
/// Rate at which hidden agents become visible, per second.
const RETURN_RATE: f64 = 0.15;
/// Standard deviation of the logarithm of an agent's factor on both rates.
const RATE_SPREAD: f64 = 0.7;
/// Speed in m/s from which agents have noise.
const MOVING_SPEED: f64 = 0.1;
/// Standard deviation of the logarithm of an agent's noise.
const NOISE_SPREAD: f64 = 0.63;

/// Median noise of a class of agents: along and across the heading in metres, and of the heading in radians.
struct Noise {
    along: f64,
    across: f64,
    heading: f64,
}

impl Noise {
    const fn of(kind: AgentKind) -> Self {
        match kind {
            AgentKind::Pedestrian => Self { along: 0.0061, across: 0.0057, heading: 0.0043 },
            AgentKind::Cyclist => Self { along: 0.018, across: 0.0076, heading: 0.0039 },
            _ => Self { along: 0.009, across: 0.0032, heading: 0.0012 },
        }
    }
}

/// Reduces a scenario to what the sensors of its first agent record. Agents that are never visible are
/// removed.
pub(super) fn record(parts: &mut ScenarioParts, rng: &mut Stream) {
    hide_lights(&mut parts.lights, rng);
    let is_lit = |lane: &str| parts.lights.iter().any(|light| light.lane == lane);
    reduce(&mut parts.map, is_lit, rng.chance(UNLIMITED_SHARE));
    let Some((av, others)) = parts.agents.split_first_mut() else { return };
    let range = rng.uniform(RANGE[0], RANGE[1]);
    for agent in others {
        add_noise(agent, rng);
        hide(agent, &av.track, range, rng);
        set_velocities(&mut agent.track);
    }
    parts.agents.retain(|agent| agent.track.iter().any(Option::is_some));
}

/// Removes all lights, or the states of some lights in some frames.
fn hide_lights(lights: &mut Vec<LightParts>, rng: &mut Stream) {
    if rng.chance(UNLIT_SHARE) {
        lights.clear();
    }
    for light in lights {
        let frames = light.states.len();
        let known = match rng.weighted(&LIGHT_WEIGHTS) {
            0 => 0..frames,
            1 => 0..0,
            _ => {
                let (a, b) = (rng.count(0, frames), rng.count(0, frames));
                a.min(b)..a.max(b)
            }
        };
        let hidden = (0..frames).filter(|frame| !known.contains(frame));
        hidden.for_each(|frame| light.states[frame] = None);
    }
}

/// Removes from the map what recordings do not contain: the difference between junctions and other lanes,
/// outlines of lanes, junctions and drivable ground, give-way lines, lines of lights that are not recorded,
/// and, where `unlimited`, speed limits.
fn reduce(map: &mut MapParts, is_lit: impl Fn(&str) -> bool, unlimited: bool) {
    for lane in &mut map.lanes {
        lane.kind = LaneKind::Connector;
        lane.area = LaneArea::Corridor { half_width: LANE_HALF_WIDTH };
        if unlimited {
            lane.speed_limit = None;
        }
    }
    map.stop_lines.retain(|line| match line.kind {
        StopKind::Light => is_lit(&line.lane),
        StopKind::Sign => true,
        StopKind::Yield => false,
    });
    map.intersections.clear();
    map.drivable_area = None;
    map.heights.drivable_area.clear();
}

/// Adds independent errors to the poses of all frames in which the agent moves.
fn add_noise(agent: &mut LoggedAgent, rng: &mut Stream) {
    let median = Noise::of(agent.agent.kind);
    let mut drawn = |median: f64| median * math::exp(NOISE_SPREAD * rng.normal());
    let noise =
        Noise { along: drawn(median.along), across: drawn(median.across), heading: drawn(median.heading) };
    for state in agent.track.iter_mut().flatten().filter(|state| state.speed() > MOVING_SPEED) {
        let ahead = direction(state.heading);
        let error: Vec2 = ahead * (noise.along * rng.normal()) + left(ahead) * (noise.across * rng.normal());
        (state.x, state.y) = (state.x + error.x, state.y + error.y);
        state.heading = wrap(state.heading + noise.heading * rng.normal());
    }
}

/// Removes the frames in which the agent is hidden from the AV: a process with two states whose rates depend
/// on their distance.
fn hide(agent: &mut LoggedAgent, av: &[Frame], range: f64, rng: &mut Stream) {
    let factor = DT * math::exp(RATE_SPREAD * rng.normal());
    let mut visible = None;
    for (f, (frame, av)) in agent.track.iter_mut().zip(av).enumerate() {
        let (Some(state), Some(av)) = (&frame, av) else { continue };
        let distance = (state.position() - av.position()).norm();
        let loss = LOSS_RATE * (distance / RATE_DISTANCE) * (distance / RATE_DISTANCE);
        let chance = match visible {
            None => RETURN_RATE / (RETURN_RATE + loss),
            Some(true) => 1.0 - factor * loss,
            Some(false) => factor * RETURN_RATE,
        };
        let seen = rng.chance(chance) && distance <= range;
        visible = Some(seen);
        if !seen {
            *frame = None;
            if let Some(height) = agent.heights.get_mut(f) {
                *height = None;
            }
        }
    }
}

/// Sets velocities to the differences of recorded positions, as recordings have them. Recordings state a velocity
/// even at the first frame of a track; `Scenario::assemble` would leave it unknown if it is the current one.
fn set_velocities(track: &mut [Frame]) {
    let position = |frame: Option<&Frame>| frame.copied().flatten().map(|state| state.position());
    let velocities: Vec<Option<Vec2>> = (0..track.len())
        .map(|f| {
            let here = position(track.get(f))?;
            let before = f.checked_sub(1).and_then(|b| position(track.get(b)));
            match (before, position(track.get(f + 1))) {
                (Some(before), _) => Some((here - before) / DT),
                (None, Some(after)) => Some((after - here) / DT),
                (None, None) => None,
            }
        })
        .collect();
    for (frame, velocity) in track.iter_mut().zip(velocities) {
        if let (Some(state), Some(velocity)) = (frame, velocity) {
            (state.vx, state.vy) = (velocity.x, velocity.y);
        }
    }
}

#[cfg(test)]
mod tests {
    use reactsim_rollout::{Purpose, stream};
    use reactsim_scene::{Agent, AgentState, CURRENT, FRAMES, HISTORY, LaneParts, LightState, StopLineParts};

    use super::*;

    /// Returns an agent that drives along the x axis at `speed`, m/s, at this distance beside it.
    fn agent(id: usize, speed: f64, y: f64) -> LoggedAgent {
        let state = |f: usize| AgentState { x: speed * DT * f as f64, y, heading: 0.0, vx: speed, vy: 0.0 };
        let agent = Agent { id: id.to_string(), kind: AgentKind::Vehicle, length: 4.6, width: 2.0 };
        LoggedAgent { agent, track: (0..FRAMES).map(|f| Some(state(f))).collect(), heights: Vec::new() }
    }

    /// Returns what the AV records of vehicles at this distance beside it.
    fn recorded(distance: f64, speed: f64, draw: u32) -> Vec<LoggedAgent> {
        let others = (1..40).map(|id| agent(id, speed, distance));
        let agents: Vec<LoggedAgent> = std::iter::once(agent(0, speed, 0.0)).chain(others).collect();
        let mut parts = ScenarioParts { agents, ..ScenarioParts::default() };
        record(&mut parts, &mut stream(0, "sensor", draw, Purpose::Traffic));
        parts.agents
    }

    /// Returns the median standard deviation of y among the agents other than the AV, metres.
    fn noise(agents: &[LoggedAgent], y: f64) -> f64 {
        let deviation = |agent: &LoggedAgent| {
            let errors: Vec<f64> = agent.track.iter().flatten().map(|s| (s.y - y) * (s.y - y)).collect();
            (errors.iter().sum::<f64>() / errors.len() as f64).sqrt()
        };
        let mut all: Vec<f64> = agents[1..].iter().map(deviation).collect();
        all.sort_by(f64::total_cmp);
        all[all.len() / 2]
    }

    #[test]
    fn moving_agents_have_noise_and_the_av_has_none() {
        let agents = recorded(5.0, 10.0, 0);
        assert_eq!(agents[0].track, agent(0, 10.0, 0.0).track);
        let across = noise(&agents, 5.0);
        assert!((0.002..0.005).contains(&across), "{across}");
        for agent in &agents[1..] {
            for pair in agent.track.windows(2) {
                let (Some(a), Some(b)) = (pair[0], pair[1]) else { continue };
                assert!((Vec2::new(b.vx, b.vy) - (b.position() - a.position()) / DT).norm() < 1e-9);
            }
        }
        assert!(noise(&recorded(5.0, 0.0, 0), 5.0) == 0.0, "parked vehicles have noise");
    }

    /// Returns the shares of the agents present at the current frame that are visible throughout the history,
    /// and throughout the future.
    fn visible(distance: f64) -> [f64; 2] {
        let all: Vec<LoggedAgent> = (0..30).flat_map(|d| recorded(distance, 10.0, d).split_off(1)).collect();
        let now: Vec<&LoggedAgent> = all.iter().filter(|a| a.track[CURRENT].is_some()).collect();
        [0..HISTORY, HISTORY..FRAMES].map(|frames| {
            let whole = |a: &&&LoggedAgent| a.track[frames.clone()].iter().all(Option::is_some);
            now.iter().filter(whole).count() as f64 / now.len().max(1) as f64
        })
    }

    #[test]
    fn far_agents_are_hidden_more_often_than_near_ones() {
        let [near, far] = [visible(10.0), visible(50.0)];
        assert!(near[0] > 0.98 && near[1] > 0.92, "{near:?}");
        assert!((0.78..0.92).contains(&far[0]) && (0.25..0.45).contains(&far[1]), "{far:?}");
        let beyond = recorded(RANGE[1] + 1.0, 10.0, 0);
        assert_eq!(beyond.len(), 1, "agents out of range are recorded");
    }

    /// Returns a scenario with a light, as it is recorded.
    fn lit(draw: u32) -> ScenarioParts {
        let lane = LaneParts {
            id: "lane".to_owned(),
            speed_limit: Some(15.0),
            area: LaneArea::Polygon(Vec::new()),
            ..LaneParts::default()
        };
        let states = vec![Some(LightState::Stop); FRAMES];
        let light = LightParts { lane: "lane".to_owned(), stop_point: Vec2::zeros(), states };
        let line = |kind| StopLineParts { kind, lane: "lane".to_owned(), at: Vec2::zeros() };
        let stop_lines = [StopKind::Light, StopKind::Sign, StopKind::Yield].map(line).to_vec();
        let drivable_area = Some(Vec::new());
        let map = MapParts { lanes: vec![lane], stop_lines, drivable_area, ..MapParts::default() };
        let mut parts = ScenarioParts { map, lights: vec![light], ..ScenarioParts::default() };
        record(&mut parts, &mut stream(0, "map", draw, Purpose::Traffic));
        parts
    }

    #[test]
    fn maps_and_lights_are_recorded_in_part() {
        const DRAWS: u32 = 2000;
        let (mut unlimited, mut unlit, mut known) = (0, 0, 0);
        for parts in (0..DRAWS).map(lit) {
            let lane = &parts.map.lanes[0];
            assert_eq!((lane.kind, &parts.map.drivable_area), (LaneKind::Connector, &None));
            let kinds: Vec<StopKind> = parts.map.stop_lines.iter().map(|line| line.kind).collect();
            assert_eq!(kinds.contains(&StopKind::Light), !parts.lights.is_empty());
            assert!(kinds.contains(&StopKind::Sign) && !kinds.contains(&StopKind::Yield));
            unlimited += u32::from(lane.speed_limit.is_none());
            unlit += u32::from(parts.lights.is_empty());
            known += parts.lights.iter().flat_map(|light| &light.states).flatten().count();
        }
        let share = |count: u32| f64::from(count) / f64::from(DRAWS);
        assert!((share(unlimited) - UNLIMITED_SHARE).abs() < 0.04, "{unlimited}");
        assert!((share(unlit) - UNLIT_SHARE).abs() < 0.04, "{unlit}");
        // A third of the frames of lights that are known in a part of them.
        let frames = f64::from(DRAWS - unlit) * FRAMES as f64;
        let expected = LIGHT_WEIGHTS[0] + LIGHT_WEIGHTS[2] / 3.0;
        assert!((known as f64 / frames - expected).abs() < 0.04, "{}", known as f64 / frames);
    }
}
