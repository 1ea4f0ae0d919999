//! Observations as arrays of fixed shape.
//!
//! Everything is in the frame of the observing agent: origin at its box centre, x axis along its heading.
//! Metres and m/s. Rows that do not exist are 0, and their flag `valid` is 0.

use serde::{Deserialize, Serialize};

use crate::geometry::{Polyline, Vec2, direction, left};
use crate::rollout::Observation;
use crate::scene::{AgentKind, AgentState, Frame, LaneKind, Length, LightState, Scenario};

/// Distance between points of lanes, metres.
const LANE_SPACING: f64 = 2.0;
/// Distance between points of the route, metres.
const ROUTE_SPACING: f64 = 2.0;
/// Smallest distance between recorded points of a route, metres: closer ones have a noisy direction.
const MIN_POINT_SPACING: f64 = 0.5;

/// Sizes of the arrays.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Sizes {
    /// Number of the nearest other agents.
    pub agents: usize,
    /// Number of frames up to now, 1 to 100; those before the first frame are absent.
    pub frames: usize,
    /// Number of the nearest pieces of lanes.
    pub lanes: usize,
    /// Number of points of a piece of a lane, at least 2.
    pub points: usize,
    /// Number of the nearest traffic lights.
    pub lights: usize,
    /// Number of points of the route ahead.
    pub route: usize,
}

/// Values of a state: x, y, cosine and sine of the heading, vx, vy, valid.
const STATE: usize = 7;
/// Values of an agent: length, width, and whether it is a vehicle, pedestrian, cyclist or anything else.
const AGENT: usize = 6;
/// Values of a point of a lane: x, y, cosine and sine of its direction.
const POINT: usize = 4;
/// Values of a piece of a lane: valid, connector, speed limit (0 if unknown), red, yellow, green.
const LANE: usize = 6;
/// Values of a light: x and y of its stop point, red, yellow, green, valid.
const LIGHT: usize = 6;
/// Values of a point of the route: x, y, cosine and sine of its direction, valid.
const ROUTE: usize = 5;

/// Number of arrays.
const ARRAYS: usize = 8;

impl Sizes {
    /// Returns the reason why sizes are refused, if they are.
    pub(super) fn fault(&self) -> Option<String> {
        let limits = [
            ("agents", self.agents, 0, 1024),
            ("frames", self.frames, 1, Length::MAX_HISTORY),
            ("lanes", self.lanes, 0, 4096),
            ("points", self.points, 2, 1024),
            ("lights", self.lights, 0, 1024),
            ("route", self.route, 0, 1024),
        ];
        let beyond = limits.into_iter().find(|(_, n, least, most)| !(least..=most).contains(&n));
        beyond.map(|(name, n, least, most)| format!("`{name}` is {n}, expected {least} to {most}"))
    }

    /// Returns the number of values of each array of an observation.
    fn lengths(&self) -> [usize; ARRAYS] {
        [
            self.frames * STATE,
            2,
            self.agents * self.frames * STATE,
            self.agents * AGENT,
            self.lanes * self.points * POINT,
            self.lanes * LANE,
            self.lights * LIGHT,
            self.route * ROUTE,
        ]
    }

    /// Returns the arrays with their shapes, in the order in which they are written.
    pub fn shapes(&self) -> [(&'static str, Vec<usize>); ARRAYS] {
        [
            ("av", vec![self.frames, STATE]),
            ("av_size", vec![2]),
            ("agents", vec![self.agents, self.frames, STATE]),
            ("agent_features", vec![self.agents, AGENT]),
            ("lanes", vec![self.lanes, self.points, POINT]),
            ("lane_features", vec![self.lanes, LANE]),
            ("lights", vec![self.lights, LIGHT]),
            ("route", vec![self.route, ROUTE]),
        ]
    }
}

/// Arrays of a batch of observations, each with all its rows one after the other. Numbers are `f32`, as
/// little-endian bytes.
#[derive(Clone, Debug)]
pub struct Arrays(pub [Vec<[u8; 4]>; ARRAYS]);

impl Arrays {
    /// Creates arrays without rows, with room for this number of observations.
    pub(super) fn with_capacity(sizes: &Sizes, observations: usize) -> Self {
        Self(sizes.lengths().map(|length| Vec::with_capacity(observations * length)))
    }
}

/// A piece of a lane.
#[derive(Clone, Debug)]
struct Piece {
    lane: usize,
    /// Points with the direction there.
    points: Vec<(Vec2, Vec2)>,
    is_connector: bool,
    speed_limit: f64,
}

/// The parts of a scenario that observations need and that do not change.
#[derive(Clone, Debug)]
pub(super) struct SceneArrays {
    pieces: Vec<Piece>,
    /// Middle of each piece, metres.
    middles: Vec<Vec2>,
    /// Lights per lane that has some.
    lights_of_lane: Vec<Vec<usize>>,
    route: Option<Route>,
}

/// The path of the logged AV, without its times.
#[derive(Clone, Debug)]
struct Route {
    path: Polyline,
    /// Direction of each segment.
    ahead: Vec<Vec2>,
}

/// What successive observations of an episode share.
#[derive(Clone, Debug, Default)]
pub(super) struct Kept {
    /// Directions of the headings of each agent at all frames so far. They are computed once per frame, since
    /// every observation has many frames of many agents.
    directions: Vec<Vec<Vec2>>,
    /// Pieces of lanes near each agent that observes.
    near: Vec<NearPieces>,
}

/// The pieces of lanes among which are the nearest ones of an agent, until it has moved away.
#[derive(Clone, Debug, Default)]
struct NearPieces {
    /// Position of the agent when they were found, metres.
    origin: Option<Vec2>,
    /// Indices of the pieces, ascending.
    pieces: Vec<usize>,
}

/// Distance beyond the farthest of the nearest pieces up to which others are kept, metres: they can be among
/// the nearest once an agent has moved half of it.
const KEPT_BEYOND: f64 = 16.0;
/// Margin of that half for rounding, metres.
const KEPT_MARGIN: f64 = 0.01;

impl Kept {
    /// Adds the frames since the last call.
    pub(super) fn follow(&mut self, seen: &Observation<'_>) {
        let agents = seen.tracks().len();
        self.directions.resize_with(agents, Vec::new);
        self.near.resize_with(agents, NearPieces::default);
        for (known, track) in self.directions.iter_mut().zip(seen.tracks()) {
            // The tracks have room for all frames.
            known.reserve(track.capacity() - known.len());
            for k in known.len()..track.len() {
                let before =
                    k.checked_sub(1).and_then(|before| Some((track[before]?.heading, known[before])));
                known.push(match (track[k], before) {
                    (None, _) => Vec2::zeros(),
                    // Many agents stand.
                    (Some(at), Some((heading, same))) if at.heading.to_bits() == heading.to_bits() => same,
                    (Some(at), _) => direction(at.heading),
                });
            }
        }
    }
}

impl NearPieces {
    /// Returns up to `most` pieces, the nearest to `p` first. `middles`: the middle of each piece.
    fn nearest(&mut self, most: usize, middles: &[Vec2], p: Vec2) -> Vec<usize> {
        let distance2 = |i: usize| (middles[i] - p).norm_squared();
        let is_near = |origin: Vec2| (p - origin).norm() <= 0.5 * KEPT_BEYOND - KEPT_MARGIN;
        if self.origin.is_some_and(is_near) {
            let found = nearest(most, self.pieces.len(), |k| Some(distance2(self.pieces[k])));
            return found.into_iter().map(|k| self.pieces[k]).collect();
        }
        let found = nearest(most, middles.len(), |i| Some(distance2(i)));
        let reach = found.last().map_or(0.0, |&last| distance2(last).sqrt() + KEPT_BEYOND);
        self.pieces.clear();
        self.pieces.extend((0..middles.len()).filter(|&i| distance2(i) <= reach * reach));
        self.origin = Some(p);
        found
    }
}

impl SceneArrays {
    /// Divides the lanes into pieces of `points` points. The route is the path of the logged AV, without its
    /// times.
    pub(super) fn new(scenario: &Scenario, points: usize) -> Self {
        let map = &scenario.start.map;
        let (mut pieces, mut middles) = (Vec::new(), Vec::new());
        for (lane, recorded) in map.lanes.iter().enumerate() {
            let (line, length) = (&recorded.baseline, LANE_SPACING * (points - 1) as f64);
            let count = (line.length() / length).ceil().max(1.0);
            // Pieces of a lane have the same length.
            let spacing = line.length() / count / (points - 1) as f64;
            for piece in 0..count as usize {
                let first = piece * (points - 1);
                let at = |i: usize| {
                    let s = (first + i) as f64 * spacing;
                    (line.at(s), direction(line.heading_at(s)))
                };
                let points: Vec<_> = (0..points).map(at).collect();
                middles.push(line.at((first as f64 + 0.5 * (points.len() - 1) as f64) * spacing));
                pieces.push(Piece {
                    lane,
                    points,
                    is_connector: recorded.kind == LaneKind::Connector,
                    speed_limit: recorded.speed_limit.unwrap_or(0.0),
                });
            }
        }
        let mut lights_of_lane = vec![Vec::new(); map.lanes.len()];
        for (i, light) in scenario.start.lights.iter().enumerate() {
            if let Some(lights) = lights_of_lane.get_mut(light.lane) {
                lights.push(i);
            }
        }
        let route = logged_path(scenario).map(|path| {
            let ahead = (0..path.segments()).map(|segment| direction(path.heading(segment))).collect();
            Route { path, ahead }
        });
        Self { pieces, middles, lights_of_lane, route }
    }

    /// Returns the length of the route up to the point nearest to `p`, metres; 0 without a route. Points
    /// beyond an end count with their distance along it.
    pub(super) fn progress(&self, p: Vec2) -> f64 {
        self.route.as_ref().map_or(0.0, |Route { path: route, .. }| {
            let found = route.project(p);
            let last = route.at(route.length());
            let beyond = (p - last).dot(&direction(route.heading_at(route.length())));
            if found.s >= route.length() { route.length() + beyond.max(0.0) } else { found.s }
        })
    }

    /// Appends the observation of agent `own` to the arrays; zeros if it is absent. `kept` follows all frames
    /// that are seen.
    pub(super) fn write(
        &self,
        seen: &Observation<'_>,
        kept: &mut Kept,
        own: usize,
        sizes: &Sizes,
        arrays: &mut Arrays,
    ) {
        let lengths = sizes.lengths();
        let first: [usize; ARRAYS] = std::array::from_fn(|i| arrays.0[i].len());
        for (array, length) in arrays.0.iter_mut().zip(lengths) {
            array.resize(array.len() + length, 0.0_f32.to_le_bytes());
        }
        let Some(now) = seen.state(own) else { return };
        let frame = LocalFrame::new(now.position(), direction(now.heading));
        let Kept { directions, near } = kept;
        let track = |i: usize| (seen.track(i), directions[i].as_slice());
        let [av, av_size, agents, features, lanes, lane_features, lights, route] = &mut arrays.0;
        let agent = &seen.start().agents[own];
        write_track(&mut av[first[0]..], track(own), sizes.frames, &frame);
        av_size[first[1]..].copy_from_slice(&bytes([agent.length as f32, agent.width as f32]));
        let others = nearest(sizes.agents, seen.tracks().len(), |i| {
            let state = seen.state(i).filter(|_| i != own)?;
            Some((state.position() - frame.origin).norm_squared())
        });
        for (row, &i) in others.iter().enumerate() {
            let at = first[2] + row * sizes.frames * STATE;
            write_track(&mut agents[at..], track(i), sizes.frames, &frame);
            write_agent(&mut features[first[3] + row * AGENT..], seen, i);
        }
        let near = near[own].nearest(sizes.lanes, &self.middles, frame.origin);
        for (row, &i) in near.iter().enumerate() {
            let piece = &self.pieces[i];
            let at = first[4] + row * sizes.points * POINT;
            let points = lanes[at..].as_chunks_mut::<POINT>().0;
            for (values, &(p, ahead)) in points.iter_mut().zip(&piece.points) {
                let ([x, y], [cos, sin]) = (frame.point(p), frame.vector(ahead));
                *values = bytes([x, y, cos, sin]);
            }
            let mut of_lane = [0.0_f32; 3];
            for &light in &self.lights_of_lane[piece.lane] {
                of_lane.iter_mut().zip(colors(seen, light)).for_each(|(all, one)| *all = all.max(one));
            }
            let [red, yellow, green] = of_lane;
            let values =
                [1.0, f32::from(u8::from(piece.is_connector)), piece.speed_limit as f32, red, yellow, green];
            lane_features[first[5] + row * LANE..][..LANE].copy_from_slice(&bytes(values));
        }
        let all = &seen.start().lights;
        let near =
            nearest(sizes.lights, all.len(), |i| Some((all[i].stop_point - frame.origin).norm_squared()));
        for (row, &i) in near.iter().enumerate() {
            let ([x, y], [red, yellow, green]) = (frame.point(all[i].stop_point), colors(seen, i));
            let values = bytes([x, y, red, yellow, green, 1.0]);
            lights[first[6] + row * LIGHT..][..LIGHT].copy_from_slice(&values);
        }
        if let Some(Route { path, ahead }) = &self.route {
            let s = path.project(frame.origin).s;
            for (k, values) in route[first[7]..].chunks_mut(ROUTE).enumerate() {
                let s = s + ROUTE_SPACING * (k + 1) as f64;
                if s > path.length() {
                    break;
                }
                let segment = path.segment_at(s);
                let ([x, y], [cos, sin]) =
                    (frame.point(path.on_segment(s, segment)), frame.vector(ahead[segment]));
                values.copy_from_slice(&bytes([x, y, cos, sin, 1.0]));
            }
        }
    }
}

/// Returns the path of the logged AV from its first recorded position on; `None` if it does not move.
fn logged_path(scenario: &Scenario) -> Option<Polyline> {
    let mut points: Vec<Vec2> = Vec::new();
    for frame in 0..scenario.length().frames() {
        let Some(p) = scenario.logged_at(0, frame).map(|state| state.position()) else { continue };
        if points.last().is_none_or(|last| (p - last).norm() >= MIN_POINT_SPACING) {
            points.push(p);
        }
    }
    Polyline::new(&points).ok()
}

/// The frame of an agent.
struct LocalFrame {
    origin: Vec2,
    /// Components along x of the axes ahead and to the left.
    x: [f64; 2],
    /// Components along y of the same axes.
    y: [f64; 2],
}

impl LocalFrame {
    fn new(origin: Vec2, ahead: Vec2) -> Self {
        let left = left(ahead);
        Self { origin, x: [ahead.x, left.x], y: [ahead.y, left.y] }
    }

    fn point(&self, p: Vec2) -> [f32; 2] {
        self.vector(p - self.origin)
    }

    fn vector(&self, v: Vec2) -> [f32; 2] {
        [0, 1].map(|axis| (v.x * self.x[axis] + v.y * self.y[axis]) as f32)
    }
}

/// Returns up to `most` of `count` indices with a distance, 0 or more, nearest first.
fn nearest(most: usize, count: usize, distance: impl Fn(usize) -> Option<f64>) -> Vec<usize> {
    if most == 0 {
        return Vec::new();
    }
    // Distance and index in one number, which is compared at once. The bits of numbers that are not negative
    // are in the order of the numbers.
    let key = |i: usize| Some(u128::from(distance(i)?.to_bits()) << 64 | i as u128);
    let mut found: Vec<u128> = Vec::with_capacity(count);
    found.extend((0..count).filter_map(key));
    if found.len() > most {
        found.select_nth_unstable(most - 1);
        found.truncate(most);
    }
    found.sort_unstable();
    found.into_iter().map(|key| key as u64 as usize).collect()
}

/// Writes the last `frames` frames of an agent with the directions of its headings, oldest first; those
/// before its first frame stay 0.
fn write_track(
    values: &mut [[u8; 4]],
    (track, directions): (&[Frame], &[Vec2]),
    frames: usize,
    frame: &LocalFrame,
) {
    let (first, absent) = (track.len().saturating_sub(frames), frames.saturating_sub(track.len()));
    let rows = values.as_chunks_mut::<STATE>().0.iter_mut().skip(absent);
    for ((state, ahead), values) in track[first..].iter().zip(&directions[first..]).zip(rows) {
        let Some(state) = state else { continue };
        let ([x, y], [cos, sin]) = (frame.point(state.position()), frame.vector(*ahead));
        let [vx, vy] = frame.vector(AgentState::velocity(state).unwrap_or_default());
        *values = bytes([x, y, cos, sin, vx, vy, 1.0]);
    }
}

fn write_agent(values: &mut [[u8; 4]], seen: &Observation<'_>, agent: usize) {
    let agent = &seen.start().agents[agent];
    values[..2].copy_from_slice(&bytes([agent.length as f32, agent.width as f32]));
    let kind = match agent.kind {
        AgentKind::Vehicle => 0,
        AgentKind::Pedestrian => 1,
        AgentKind::Cyclist => 2,
        AgentKind::Other => 3,
    };
    values[2 + kind] = 1.0_f32.to_le_bytes();
}

/// Returns numbers as little-endian bytes.
fn bytes<const N: usize>(values: [f32; N]) -> [[u8; 4]; N] {
    values.map(f32::to_le_bytes)
}

/// Returns whether a light is red, yellow or green now.
fn colors(seen: &Observation<'_>, light: usize) -> [f32; 3] {
    match seen.light(light).last().copied().flatten() {
        Some(LightState::Stop | LightState::ArrowStop | LightState::FlashingStop) => [1.0, 0.0, 0.0],
        Some(LightState::Caution | LightState::ArrowCaution | LightState::FlashingCaution) => [0.0, 1.0, 0.0],
        Some(LightState::Go | LightState::ArrowGo) => [0.0, 0.0, 1.0],
        Some(LightState::Unknown) | None => [0.0; 3],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kept_pieces_have_the_nearest_ones_wherever_the_agent_is() {
        // Whole metres, so that there are ties.
        let middle = |i: u32| Vec2::new(f64::from(i * 37 % 211), f64::from(i * 61 % 197));
        let middles: Vec<Vec2> = (0..300).map(middle).collect();
        for (most, count) in [(0, 300), (1, 300), (20, 300), (20, 15)] {
            let (middles, mut near, mut kept) = (&middles[..count], NearPieces::default(), 0);
            for step in 0..400 {
                let p = Vec2::new(f64::from(step) * 0.5, 90.0 + 40.0 * (f64::from(step) * 0.02).sin());
                let before = near.origin;
                let all = nearest(most, count, |i| Some((middles[i] - p).norm_squared()));
                assert_eq!(near.nearest(most, middles, p), all, "{p}");
                kept += usize::from(near.origin == before);
            }
            assert!(kept > 350, "{kept}");
        }
    }
}
