//! The content of `begin`: agents, history, map, lights, obstacles.

use reactsim_geometry::{Vec2, math};
use reactsim_rollout::Identity;
use reactsim_scene::{AgentKind, AgentState, Frame, HISTORY, LaneArea, LaneKind, LightState, RoadMap, Start};

use super::document::{FrameWriter, Values};

/// Code of a light that was not observed, and of padding in place of a kind.
pub(super) const NONE: u8 = 255;

/// Adds the tensors of a batch of scenes to a document. All coordinates are in the frames of the scenarios,
/// whose histories have the same number of frames.
/// Returns the height of each point, metres, NaN if unknown; simulators do not receive heights.
pub(super) fn add_scenes(document: &mut FrameWriter, starts: &[&Start]) -> Vec<f64> {
    let history = starts.first().map_or(HISTORY, |start| start.current() + 1);
    add_agents(document, starts, history);
    let mut lines = Lines::default();
    let (mut links, mut lights, mut obstacles) = (Vec::new(), Lights::default(), Obstacles::default());
    for (episode, start) in starts.iter().enumerate() {
        let first = lines.kind.len();
        lines.add_map(episode as i32, &start.map);
        add_links(&mut links, first as i32, &start.map);
        for (light, states) in start.lights.iter().zip(&start.light_history) {
            lights.episode.push(episode as i32);
            lights.lane.push((first + light.lane) as i32);
            lights.stop.extend([light.stop_point.x, light.stop_point.y]);
            lights.states.extend((0..history).map(|frame| light_code(states.get(frame).copied().flatten())));
        }
        for obstacle in &start.obstacles {
            obstacles.episode.push(episode as i32);
            let (length, width) = (2.0 * obstacle.half_length, 2.0 * obstacle.half_width);
            let heading = math::atan2(obstacle.axis.y, obstacle.axis.x);
            obstacles.boxes.extend([obstacle.center.x, obstacle.center.y, heading, length, width]);
        }
    }
    let (line_count, point_count) = (lines.kind.len(), lines.points.len() / 2);
    document
        .tensor("points", Values::f64(&[point_count, 2], lines.points))
        .tensor("line_start", Values::i64(&[line_count + 1], std::iter::once(0).chain(lines.end)))
        .tensor("line_episode", Values::i32(&[line_count], lines.episode))
        .tensor("line_type", Values::u8(&[line_count], lines.kind))
        .tensor("line_class", Values::u8(&[line_count], lines.class))
        .tensor("line_lane", Values::i32(&[line_count], lines.lane))
        .tensor("line_value", Values::f64(&[line_count], lines.value))
        .tensor("link", Values::i32(&[links.len(), 7], links.into_iter().flatten()))
        .tensor("light_episode", Values::i32(&[lights.episode.len()], lights.episode.iter().copied()))
        .tensor("light_lane", Values::i32(&[lights.lane.len()], lights.lane))
        .tensor("light_stop", Values::f64(&[lights.stop.len() / 2, 2], lights.stop))
        .tensor("light_state", Values::u8(&[lights.episode.len(), history], lights.states))
        .tensor("obstacle_episode", Values::i32(&[obstacles.episode.len()], obstacles.episode))
        .tensor("obstacle", Values::f64(&[obstacles.boxes.len() / 5, 5], obstacles.boxes));
    lines.heights
}

/// Adds the names of the episodes of a batch, and the world coordinates of their origins.
pub(super) fn add_identities(document: &mut FrameWriter, identities: &[Identity<'_>], starts: &[&Start]) {
    let scenarios: Vec<&str> = identities.iter().map(|i| i.scenario).collect();
    let agents: Vec<Vec<&str>> =
        starts.iter().map(|start| start.agents.iter().map(|a| a.id.as_str()).collect()).collect();
    let origins: Vec<[f64; 2]> = identities.iter().map(|i| [i.origin.x, i.origin.y]).collect();
    let rollouts: Vec<u32> = identities.iter().map(|i| i.rollout).collect();
    document
        .text("scenario_ids", json(&scenarios))
        .text("agent_ids", json(&agents))
        .text("origins", json(&origins))
        .text("rollouts", json(&rollouts));
}

fn json(value: &impl serde::Serialize) -> String {
    serde_json::to_string(value).expect("lists of texts and finite numbers are JSON")
}

/// Returns the numbers of a frame: x, y, heading, vx, vy; 0 where absent.
pub(super) fn frame_numbers(frame: Frame) -> [f64; 5] {
    frame.map_or([0.0; 5], state_numbers)
}

/// Returns the numbers of a state: x, y, heading, vx, vy.
pub(super) fn state_numbers(state: AgentState) -> [f64; 5] {
    [state.x, state.y, state.heading, state.vx, state.vy]
}

/// Returns the code of an observed light.
pub(super) fn light_code(state: Option<LightState>) -> u8 {
    state.map_or(NONE, LightState::code)
}

fn add_agents(document: &mut FrameWriter, starts: &[&Start], history: usize) {
    let (b, n) = (starts.len(), starts.iter().map(|s| s.agents.len()).max().unwrap_or(0));
    let slots = || starts.iter().flat_map(|start| (0..n).map(move |slot| (*start, slot)));
    let kind = |(start, slot): (&Start, usize)| match start.agents.get(slot).map(|a| a.kind) {
        Some(AgentKind::Vehicle) => 0,
        Some(AgentKind::Pedestrian) => 1,
        Some(AgentKind::Cyclist) => 2,
        Some(AgentKind::Other) => 3,
        None => NONE,
    };
    let size = |(start, slot): (&Start, usize)| {
        start.agents.get(slot).map_or([0.0; 2], |agent| [agent.length, agent.width])
    };
    let frame = |start: &Start, slot: usize, k: usize| start.history.get(slot).and_then(|track| track[k]);
    let frames = || slots().flat_map(|(start, slot)| (0..history).map(move |k| frame(start, slot, k)));
    document
        .tensor("n_agents", Values::i32(&[b], starts.iter().map(|s| s.agents.len() as i32)))
        .tensor("kind", Values::u8(&[b, n], slots().map(kind)))
        .tensor("size", Values::f64(&[b, n, 2], slots().flat_map(size)))
        .tensor("history", Values::f64(&[b, n, history, 5], frames().flat_map(frame_numbers)))
        .tensor("valid", Values::u8(&[b, n, history], frames().map(|f| u8::from(f.is_some()))));
}

/// Lines of all maps of a batch, one after the other.
#[derive(Default)]
struct Lines {
    points: Vec<f64>,
    /// Height of each point, NaN if unknown.
    heights: Vec<f64>,
    /// Number of points up to the end of each line.
    end: Vec<i64>,
    episode: Vec<i32>,
    kind: Vec<u8>,
    class: Vec<u8>,
    lane: Vec<i32>,
    value: Vec<f64>,
}

#[derive(Default)]
struct Lights {
    episode: Vec<i32>,
    lane: Vec<i32>,
    stop: Vec<f64>,
    states: Vec<u8>,
}

#[derive(Default)]
struct Obstacles {
    episode: Vec<i32>,
    boxes: Vec<f64>,
}

/// Properties of a line other than its points.
struct Line {
    /// Code of `line_type` in `docs/external-protocol.md`.
    kind: u8,
    class: u8,
    lane: i32,
    value: f64,
}

impl Line {
    const fn of(kind: u8) -> Self {
        Self { kind, class: 0, lane: -1, value: f64::NAN }
    }
}

impl Lines {
    /// Adds a line, with the heights of its points if they are known.
    fn add(&mut self, episode: i32, line: &Line, points: &[Vec2], heights: Option<&Vec<f64>>) {
        self.points.extend(points.iter().flat_map(|p| [p.x, p.y]));
        match heights.filter(|heights| !heights.is_empty()) {
            Some(heights) => self.heights.extend(heights),
            None => self.heights.extend(points.iter().map(|_| f64::NAN)),
        }
        self.end.push((self.points.len() / 2) as i64);
        self.episode.push(episode);
        self.kind.push(line.kind);
        self.class.push(line.class);
        self.lane.push(line.lane);
        self.value.push(line.value);
    }

    /// Adds a map: its lanes first, in their order, so that lane i of the map is line `first` + i.
    fn add_map(&mut self, episode: i32, map: &RoadMap) {
        let first = self.kind.len() as i32;
        let heights = &map.heights;
        for (i, lane) in map.lanes.iter().enumerate() {
            let kind = match lane.kind {
                LaneKind::Lane => 0,
                LaneKind::Connector => 1,
            };
            let value = lane.speed_limit.unwrap_or(f64::NAN);
            let line = Line { class: lane.class as u8, value, ..Line::of(kind) };
            self.add(episode, &line, lane.baseline.points(), heights.lanes.get(i));
        }
        for (i, lane) in map.lanes.iter().enumerate() {
            let line = Line { lane: first + i as i32, ..Line::of(2) };
            match &lane.area {
                LaneArea::Polygon(ring) => self.add(episode, &line, ring, None),
                LaneArea::Corridor { half_width } => {
                    self.add(episode, &Line { value: *half_width, ..line }, &[], None);
                }
            }
        }
        for (i, edge) in map.road_edges.iter().enumerate() {
            let line = Line { class: edge.kind as u8, ..Line::of(3) };
            self.add(episode, &line, &edge.points, heights.road_edges.get(i));
        }
        for (i, painted) in map.road_lines.iter().enumerate() {
            let line = Line { class: painted.paint, ..Line::of(4) };
            self.add(episode, &line, &painted.points, heights.road_lines.get(i));
        }
        for stop in &map.stop_lines {
            let lane = first + stop.lane as i32;
            let line = Line { kind: 5, class: stop.kind as u8, lane, value: stop.s };
            self.add(episode, &line, &stop.ends, None);
        }
        for (i, crosswalk) in map.crosswalks.iter().enumerate() {
            self.add(episode, &Line::of(6), &crosswalk.outline, heights.crosswalks.get(i));
        }
        for (i, bump) in map.speed_bumps.iter().enumerate() {
            self.add(episode, &Line::of(7), &bump.outline, heights.speed_bumps.get(i));
        }
        for (i, driveway) in map.driveways.iter().enumerate() {
            self.add(episode, &Line::of(8), &driveway.outline, heights.driveways.get(i));
        }
        map.intersections.iter().for_each(|ring| self.add(episode, &Line::of(9), ring, None));
        for (i, polygon) in map.drivable_area.iter().flatten().enumerate() {
            self.add(episode, &Line::of(10), &polygon.exterior, heights.drivable_area.get(i));
            polygon.holes.iter().for_each(|hole| self.add(episode, &Line::of(11), hole, None));
        }
    }
}

/// Adds the links of a map whose lanes begin at line `first`.
fn add_links(links: &mut Vec<[i32; 7]>, first: i32, map: &RoadMap) {
    for (i, lane) in map.lanes.iter().enumerate() {
        let from = first + i as i32;
        // The relations of `link` in `docs/external-protocol.md`.
        for (relation, lanes) in [(0, &lane.successors), (1, &lane.predecessors)] {
            links.extend(lanes.iter().map(|to| [from, first + *to as i32, relation, 0, 0, 0, 0]));
        }
        for (relation, neighbours) in [(2, &lane.left), (3, &lane.right)] {
            links.extend(neighbours.iter().map(|n| {
                let stretch = [n.self_start, n.self_end, n.other_start, n.other_end].map(|v| v as i32);
                let [a, b, c, d] = stretch;
                [from, first + n.lane as i32, relation, a, b, c, d]
            }));
        }
    }
}
