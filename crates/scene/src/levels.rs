//! Levels: roads above one another, such as a bridge and the road below it.
//!
//! Heights are those of the ground: of the map's points, and of the bottom of an agent's box. They are metres
//! above any datum, and only their differences count. A scenario keeps them only if it has several levels at
//! one place; every other scenario is flat, and all of its objects are on one level.

use std::borrow::Cow;
use std::collections::{BTreeMap, HashMap};
use std::ops::Range;

use reactsim_geometry::{Projection, Vec2, floor};

use super::{AgentKind, AgentState, Frame, Road, RoadMap, Scenario, Start};

mod contradictions;
mod ground;

pub(crate) use contradictions::{NO_AGREEMENT, OUTLIERS};
pub(crate) use ground::Ground;

/// Difference of the heights of two things at one place, in metres, above which they are on different
/// levels.
///
/// A bridge leaves 4.1 m or more for the traffic below (of 473 recorded windows, those with roads above one
/// another have 4.6 m or more between them), and within one level heights at one place differ by less than
/// 2 m: by the curb, the slope over the width of a road, and the error of a recorded box.
pub const LEVEL_GAP: f64 = 3.0;
/// Slope that roads rise by at most, metres per metre: things on one level that are apart differ by more.
pub const MAX_SLOPE: f64 = 0.06;

/// Size in metres of the places at which levels are counted.
const PLACE_SIZE: f64 = 8.0;
/// Distance in metres between the points of a line at which levels are counted.
const SAMPLE_DISTANCE: f64 = 2.0;
/// Maximum number of such points of a segment.
const MAX_SAMPLES: f64 = 1000.0;

/// Returns whether two heights that are `distance` metres apart in the plane are on different levels of flat
/// ground; [`Road::is_apart`] also considers the ground between. A NaN (unknown) height is on every level.
#[inline]
pub fn apart(a: f64, b: f64, distance: f64) -> bool {
    (a - b).abs() > LEVEL_GAP + MAX_SLOPE * distance
}

/// Heights of the ground at the points of a map, metres.
///
/// Each list has an entry per item of the map, or none at all; each entry has a finite height per point, or
/// none where heights are unknown.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MapHeights {
    /// Baselines of lanes.
    pub lanes: Vec<Vec<f64>>,
    /// Road edges.
    pub road_edges: Vec<Vec<f64>>,
    /// Painted lines.
    pub road_lines: Vec<Vec<f64>>,
    /// Outlines of crosswalks.
    pub crosswalks: Vec<Vec<f64>>,
    /// Outlines of speed bumps.
    pub speed_bumps: Vec<Vec<f64>>,
    /// Outlines of driveways.
    pub driveways: Vec<Vec<f64>>,
    /// Exteriors of drivable polygons.
    pub drivable_area: Vec<Vec<f64>>,
}

impl MapHeights {
    /// Returns whether no height is known.
    pub fn is_empty(&self) -> bool {
        self.lists().into_iter().all(|list| list.iter().all(Vec::is_empty))
    }

    /// Returns all lists, in the order of the fields.
    pub fn lists(&self) -> [&Vec<Vec<f64>>; 7] {
        [
            &self.lanes,
            &self.road_edges,
            &self.road_lines,
            &self.crosswalks,
            &self.speed_bumps,
            &self.driveways,
            &self.drivable_area,
        ]
    }

    /// Returns the height of a lane at a projection onto its baseline, metres; NaN if unknown.
    pub(super) fn of_lane(&self, lane: usize, at: &Projection) -> f64 {
        self.lanes.get(lane).map_or(f64::NAN, |heights| between(heights, at.segment, at.t))
    }
}

impl RoadMap {
    /// Returns the map in layers, the lowest first, for pictures: what is above hides what is below. Lanes,
    /// edges, lines and surfaces are in the layer of their mean height; what has no height is in the lowest.
    /// A map of one level is one layer. Layers have no stop lines and no heights.
    pub fn layers(&self) -> Vec<Cow<'_, Self>> {
        if self.heights.is_empty() {
            return vec![Cow::Borrowed(self)];
        }
        let heights = &self.heights;
        let known = heights.lists().into_iter().flatten().flatten().copied();
        let lowest = known.fold(f64::INFINITY, f64::min);
        let mut layers = Layers { lowest, maps: BTreeMap::new() };
        layers.add(&self.lanes, &heights.lanes, |map| &mut map.lanes);
        layers.add(&self.road_edges, &heights.road_edges, |map| &mut map.road_edges);
        layers.add(&self.road_lines, &heights.road_lines, |map| &mut map.road_lines);
        layers.add(&self.crosswalks, &heights.crosswalks, |map| &mut map.crosswalks);
        layers.add(&self.speed_bumps, &heights.speed_bumps, |map| &mut map.speed_bumps);
        layers.add(&self.driveways, &heights.driveways, |map| &mut map.driveways);
        layers.add(&self.intersections, &[], |map| &mut map.intersections);
        if let Some(area) = &self.drivable_area {
            layers.add(area, &heights.drivable_area, |map| map.drivable_area.get_or_insert_default());
            for map in layers.maps.values_mut() {
                map.drivable_area.get_or_insert_default();
            }
        }
        layers.maps.into_values().map(Cow::Owned).collect()
    }
}

/// Parts of a map by level.
struct Layers {
    /// Lowest height of the map, metres.
    lowest: f64,
    maps: BTreeMap<usize, RoadMap>,
}

impl Layers {
    /// Adds each item of a list to the layer of its mean height.
    fn add<T: Clone>(
        &mut self,
        items: &[T],
        heights: &[Vec<f64>],
        list_of: impl Fn(&mut RoadMap) -> &mut Vec<T>,
    ) {
        for (i, item) in items.iter().enumerate() {
            let layer = heights.get(i).map_or(0, |heights| {
                let mean = heights.iter().sum::<f64>() / heights.len() as f64;
                // The cast turns NaN into 0.
                ((mean - self.lowest) / LEVEL_GAP) as usize
            });
            list_of(self.maps.entry(layer).or_default()).push(item.clone());
        }
    }
}

/// Returns the height on a segment of a line at the parameter `t`, 0 to 1; NaN if unknown.
pub(super) fn between(heights: &[f64], segment: usize, t: f64) -> f64 {
    match heights.get(segment..segment + 2) {
        Some([a, b]) => a + (b - a) * t,
        _ => f64::NAN,
    }
}

/// Returns the heights of the points that [`reactsim_geometry::Polyline::new`] keeps of `points`.
pub(super) fn of_polyline(points: &[Vec2], heights: &[f64]) -> Vec<f64> {
    let mut last: Option<Vec2> = None;
    let mut kept = Vec::with_capacity(heights.len());
    for (&p, &height) in points.iter().zip(heights) {
        if last.is_none_or(|last| (p - last).norm() != 0.0) {
            kept.push(height);
            last = Some(p);
        }
    }
    kept
}

/// Returns the largest number of levels at one place of a map with agents at some points, at least 1. Without
/// heights of the map it is 1: nothing tells the later heights of agents.
pub(super) fn count(map: &RoadMap, agents: &[(Vec2, f64)]) -> usize {
    let heights = &map.heights;
    let lowest_first = |range: (f64, f64), z: f64| (range.0.min(z), range.1.max(z));
    let known = heights.lists().into_iter().flatten().flatten().chain(agents.iter().map(|a| &a.1));
    if heights.is_empty() {
        return 1;
    }
    let (low, high) = known.copied().fold((f64::INFINITY, f64::NEG_INFINITY), lowest_first);
    if !(high - low > LEVEL_GAP) {
        return 1;
    }
    let mut samples = Vec::new();
    ground::lines(map).for_each(|(points, heights)| sample(points, heights, &mut samples));
    samples.extend(agents.iter().filter(|a| a.1.is_finite()));
    [0.0, 0.5 * PLACE_SIZE].into_iter().map(|shift| count_shifted(&samples, shift)).max().unwrap_or(1)
}

/// Adds points of a line with their heights.
fn sample(points: &[Vec2], heights: &[f64], samples: &mut Vec<(Vec2, f64)>) {
    for (i, ends) in points.windows(2).enumerate() {
        let parts = ((ends[1] - ends[0]).norm() / SAMPLE_DISTANCE).ceil().clamp(1.0, MAX_SAMPLES);
        for k in 0..=parts as usize {
            let t = k as f64 / parts;
            let z = between(heights, i, t);
            if z.is_finite() {
                samples.push((ends[0] + (ends[1] - ends[0]) * t, z));
            }
        }
    }
}

/// Counts levels over places that are shifted by some metres, so that things close to one another share one.
fn count_shifted(samples: &[(Vec2, f64)], shift: f64) -> usize {
    let place = |p: Vec2| (floor((p.x + shift) / PLACE_SIZE), floor((p.y + shift) / PLACE_SIZE));
    // Successive points mostly share a place.
    let mut runs: Vec<((i64, i64), Range<usize>)> = Vec::new();
    for (i, &(p, _)) in samples.iter().enumerate() {
        let at = place(p);
        match runs.last_mut() {
            Some((last, run)) if *last == at => run.end = i + 1,
            _ => runs.push((at, i..i + 1)),
        }
    }
    // Most maps are flat, so that the range of heights at each place decides.
    let mut ranges: HashMap<(i64, i64), (f64, f64)> = HashMap::new();
    for (at, run) in &runs {
        let range = ranges.entry(*at).or_insert((f64::INFINITY, f64::NEG_INFINITY));
        *range = samples[run.clone()].iter().fold(*range, |(low, high), (_, z)| (low.min(*z), high.max(*z)));
    }
    ranges.retain(|_, (low, high)| *high - *low > LEVEL_GAP);
    let mut heights: BTreeMap<(i64, i64), Vec<f64>> = BTreeMap::new();
    for (at, run) in runs.iter().filter(|(at, _)| ranges.contains_key(at)) {
        heights.entry(*at).or_default().extend(samples[run.clone()].iter().map(|sample| sample.1));
    }
    let levels = |mut at: Vec<f64>| {
        at.sort_by(f64::total_cmp);
        1 + at.windows(2).filter(|w| w[1] - w[0] > LEVEL_GAP).count()
    };
    heights.into_values().map(levels).max().unwrap_or(1)
}

/// Heights of moving agents: each has its recorded height at the current frame, and then that of the road
/// under it.
impl Start {
    /// Returns whether the scenario has several levels at one place. All others have no heights.
    pub fn has_levels(&self) -> bool {
        !self.map.heights.is_empty()
    }

    /// Returns the road on the level that an agent is on at the current frame.
    pub fn road_at(&self, agent: usize) -> Road<'_> {
        let height = if self.has_levels() { self.height_now(agent) } else { f64::NAN };
        self.road().on_level(self.now(agent).position(), height)
    }

    /// Returns the height of an obstacle, metres; NaN if unknown.
    pub fn obstacle_height(&self, obstacle: usize) -> f64 {
        self.obstacle_heights.get(obstacle).copied().flatten().unwrap_or(f64::NAN)
    }

    /// Returns the recorded height of an agent at a frame up to the current one, metres; NaN if unknown.
    pub fn recorded_height(&self, agent: usize, frame: usize) -> f64 {
        self.heights.get(agent).and_then(|h| *h.get(frame)?).unwrap_or(f64::NAN)
    }

    /// Returns the height of an agent at the current frame, metres: the recorded height, else that of the
    /// road if it has one level there, else NaN.
    pub fn height_now(&self, agent: usize) -> f64 {
        let recorded = self.recorded_height(agent, self.current());
        match self.history[agent][self.current()] {
            Some(now) if recorded.is_nan() && self.has_levels() => {
                self.road().ground_height(now.position(), f64::NAN)
            }
            _ => recorded,
        }
    }

    /// Returns the height of an agent at each frame of its track, metres; NaN where unknown or absent. The
    /// first frame of `track` is the current one. Without levels the result is empty.
    pub fn heights_along(&self, agent: usize, track: &[Frame]) -> Vec<f64> {
        if !self.has_levels() {
            return Vec::new();
        }
        let mut last = self.height_now(agent);
        let height = |(k, frame)| self.follow_height(frame, &mut last, k == 0);
        track.iter().enumerate().map(height).collect()
    }

    /// Returns the height of an agent at each of these states, metres, which follow its current one; NaN
    /// where unknown. Without levels the result is empty.
    pub fn heights_on_way(&self, agent: usize, future: &[AgentState]) -> Vec<f64> {
        if !self.has_levels() {
            return Vec::new();
        }
        let track: Vec<Frame> = std::iter::once(&self.now(agent)).chain(future).copied().map(Some).collect();
        self.heights_along(agent, &track).split_off(1)
    }

    /// Returns the height of the road below an agent at a frame, metres; NaN if unknown, or if the agent is
    /// absent. `last` is the height where it was last seen, which is `known` to be its present one.
    pub fn follow_height(&self, frame: &Frame, last: &mut f64, known: bool) -> f64 {
        let Some(state) = frame else { return f64::NAN };
        if !known {
            *last = self.road().ground_height(state.position(), *last);
        }
        *last
    }
}

/// Heights of the road under agents at the latest frames of tracks that grow: each frame is looked up once.
/// In scenarios of one level there are none.
#[derive(Clone, Debug, Default)]
pub struct RoadHeights {
    /// First frame that is kept.
    first: usize,
    /// Height of each agent where it was last seen, metres; NaN if unknown.
    last: Vec<f64>,
    /// Height of each agent at each kept frame, metres; NaN if unknown, or if the agent is absent.
    kept: Vec<Vec<f64>>,
}

impl RoadHeights {
    /// Follows the road under all agents to the ends of their tracks, which begin at frame 0 and with those
    /// of the last call, and forgets frames before `first`, but not the last one.
    pub fn follow(&mut self, start: &Start, tracks: &[impl AsRef<[Frame]>], first: usize) {
        if !start.has_levels() {
            return;
        }
        if self.last.is_empty() {
            self.last = (0..start.agents.len()).map(|agent| start.height_now(agent)).collect();
            self.kept = vec![Vec::new(); start.agents.len()];
            self.first = start.current();
        }
        for ((last, kept), track) in self.last.iter_mut().zip(&mut self.kept).zip(tracks) {
            let next = self.first + kept.len();
            for (f, frame) in (next..).zip(track.as_ref().get(next..).unwrap_or_default()) {
                kept.push(start.follow_height(frame, last, f == start.current()));
            }
        }
        let frames = self.kept.iter().map(Vec::len).min().unwrap_or_default();
        let forgotten = first.saturating_sub(self.first).min(frames.saturating_sub(1));
        self.kept.iter_mut().for_each(|kept| drop(kept.drain(..forgotten)));
        self.first += forgotten;
    }

    /// Follows the road as [`Self::follow`] does, and returns the height of each agent at the last frame of
    /// its track, metres; NaN if unknown or absent. Without levels the result is empty.
    pub fn at_end(&mut self, start: &Start, tracks: &[impl AsRef<[Frame]>]) -> Vec<f64> {
        self.follow(start, tracks, usize::MAX);
        let is_there = |track: &[Frame]| track.last().is_some_and(Option::is_some);
        let heights = self.last.iter().zip(tracks);
        heights.map(|(last, track)| if is_there(track.as_ref()) { *last } else { f64::NAN }).collect()
    }

    /// Returns the height of an agent at a frame from the first kept one on, metres; NaN if unknown. `track`
    /// has its frames up to this one, from frame `from` on; those after the followed ones are planned.
    pub fn at(&self, start: &Start, agent: usize, frame: usize, track: &[Frame], from: usize) -> f64 {
        let Some(kept) = self.kept.get(agent) else { return f64::NAN };
        let next = self.first + kept.len();
        if frame < next {
            return frame.checked_sub(self.first).map_or(f64::NAN, |k| kept[k]);
        }
        let mut last = self.last[agent];
        let planned = next.checked_sub(from).and_then(|k| track.get(k..=frame - from)).unwrap_or_default();
        let heights = planned.iter().map(|frame| start.follow_height(frame, &mut last, false));
        heights.last().unwrap_or(f64::NAN)
    }
}

impl Scenario {
    /// Returns the largest number of levels at one place at the current frame, at least 1.
    pub fn levels(&self) -> usize {
        if !self.start.has_levels() {
            return 1;
        }
        let (start, now) = (&self.start, self.start.current());
        let slots = 0..start.agents.len();
        let chosen = slots.map(|i| (start.now(i).position(), start.recorded_height(i, start.current())));
        let others = self.unselected.iter().filter(|a| a.agent.kind != AgentKind::Other);
        let others =
            others.filter_map(|a| Some((a.track[now]?.position(), a.heights.get(now).copied().flatten()?)));
        count(&start.map, &chosen.chain(others).collect::<Vec<_>>())
    }
}

#[cfg(test)]
mod tests;
