//! Heights that contradict one another, which are not used.
//!
//! Only scenarios that would have several levels are examined: in all others heights have no meaning.

use std::ops::Range;

use reactsim_geometry::{Vec2, direction, heading_of, wrap};

use super::ground::{self, Ground, Segment};
use super::{LEVEL_GAP, MapHeights, apart};
use crate::{AgentKind, AgentState, Frame, LoggedAgent, RoadMap, Scenario};

/// Repair: third coordinates that are the direction of the line or of the agent.
pub(crate) const DIRECTIONS: &str = "third coordinates that are directions, not heights";
/// Repair: heights of points and agents that differ from the ground around them.
pub(crate) const OUTLIERS: &str = "heights that contradict the ground around them";
/// Repair: agents that differ from the ground, if they are so many that no heights are used.
pub(crate) const NO_AGREEMENT: &str = "agents whose heights contradict the map, so that no heights are used";

/// Distance in metres to a lane or an edge up to which an agent is on the ground that these describe: cars
/// are parked next to bridges, on ground without lanes.
const UNDER_DISTANCE: f64 = 4.0;
/// Largest difference of an agent's height from the ground under it, metres: recorded boxes are less wrong.
const GROUND_TOLERANCE: f64 = 2.0;
/// Largest share of agents whose heights may contradict the ground, if they are more than one.
const MAX_CONTRADICTING: f64 = 0.1;
/// Largest share of the frames of an agent at which its height may contradict the ground.
const MAX_OUTLIERS: f64 = 0.5;
/// Cosine of the largest angle between a vehicle and the road that it is on.
const PARALLEL_COSINE: f64 = 0.8;
/// Slope of the ground, metres per metre, beyond which successive points of a line contradict each other. The
/// steepest streets rise by 0.35 over short distances.
const MAX_POINT_SLOPE: f64 = 0.4;
/// The same for points that are more than 10 m apart.
const MAX_LONG_SLOPE: f64 = 0.3;
/// Error of the height of a point, metres.
const POINT_NOISE: f64 = 0.5;
/// Distance in metres between points of a line from which an outlier of one level rises plausibly.
const SPARSE_SPACING: f64 = 6.0;
/// Distance in metres between the points of a line at which other lines are compared.
const SUPPORT_SPACING: f64 = 8.0;
/// Maximum number of parts of a line between jumps of its heights; the heights of other lines are unknown.
const MAX_RUNS: usize = 200;
/// Largest difference of a third coordinate from a direction, radians.
const DIRECTION_TOLERANCE: f64 = 0.1;
/// Smallest share of third coordinates that are directions.
const MIN_DIRECTIONS: f64 = 0.95;
/// Largest angle that a file contains, radians.
const MAX_ANGLE: f64 = 6.4;
/// Angle in radians from which a direction is not also the height of flat ground at 0.
const TELLING_ANGLE: f64 = 0.3;
/// Share of third coordinates that must be directions beyond this angle.
const MIN_TELLING: f64 = 0.1;
/// One degree in radians.
const DEGREE: f64 = std::f64::consts::PI / 180.0;
/// Smallest turn of an agent, radians, that shows whether its height is its heading.
const MIN_TURN: f64 = 0.5;

impl Scenario {
    /// Drops the heights of a scenario of one level. In others, replaces or drops the heights that contradict
    /// others, and counts them in [`Scenario::repairs`]. A scenario that is mended does not change. Returns
    /// whether there were heights.
    pub(crate) fn mend_heights(&mut self) -> bool {
        if !self.start.has_levels() {
            return false;
        }
        if self.levels() == 1 {
            self.drop_heights();
            return true;
        }
        let directions = self.drop_directions();
        let mut ground = Ground::new(&self.start.map);
        let mut outliers = mend_lines(self.start.map.edit(), &ground);
        if outliers > 0 {
            ground = Ground::new(&self.start.map);
        }
        let votes = self.agents_mut().map(|agent| agent.mend(&ground)).fold(Votes::default(), Votes::and);
        outliers += votes.replaced;
        let is_denied =
            votes.against > 1 && f64::from(votes.against) > MAX_CONTRADICTING * f64::from(votes.all);
        let contradicting = if is_denied { (NO_AGREEMENT, votes.against) } else { (OUTLIERS, outliers) };
        for (what, count) in [(DIRECTIONS, directions), contradicting].into_iter().filter(|r| r.1 > 0) {
            *self.repairs.entry(what.to_owned()).or_default() += count;
        }
        self.find_obstacle_heights();
        let changes = directions + outliers > 0;
        if is_denied || (changes && self.levels() == 1) {
            self.drop_heights();
        }
        true
    }

    /// Returns the histories of all agents.
    fn agents_mut(&mut self) -> impl Iterator<Item = History<'_>> {
        let frames = self.length().history;
        let start = &mut self.start;
        let chosen = start.agents.iter().zip(&start.history).zip(&mut start.heights);
        let chosen = chosen.map(|((agent, track), heights)| History { kind: agent.kind, track, heights });
        let others = self.unselected.iter_mut().filter(|other| !other.heights.is_empty());
        let others = others.map(move |LoggedAgent { agent, track, heights }| History {
            kind: agent.kind,
            track: &track[..frames],
            heights: &mut heights[..frames],
        });
        chosen.chain(others)
    }

    /// Drops third coordinates that are directions; returns the number of lines and agents.
    fn drop_directions(&mut self) -> u32 {
        let mut dropped = self.start.map.edit().drop_directions();
        let turning = |(i, track): (usize, &Vec<Frame>)| {
            let future = self.log_future.tracks[i].iter().zip(&self.log_future.heights[i]);
            is_heading(track.iter().zip(&self.start.heights[i]).chain(future))
        };
        let turning: Vec<bool> = self.start.history.iter().enumerate().filter_map(turning).collect();
        let headings = turning.iter().filter(|is_heading| **is_heading).count();
        if headings as f64 > MIN_DIRECTIONS * turning.len() as f64 {
            dropped += self.start.agents.len() as u32;
            self.start.heights.iter_mut().for_each(|heights| heights.fill(None));
            self.unselected.iter_mut().for_each(|other| other.heights.clear());
        }
        dropped
    }
}

/// Agents that confirm or contradict the heights of the map.
#[derive(Clone, Copy, Debug, Default)]
struct Votes {
    /// Agents on the ground with known heights.
    all: u32,
    /// Of these, agents at another height than any ground under them.
    against: u32,
    /// Heights that were replaced.
    replaced: u32,
}

impl Votes {
    fn and(self, other: Self) -> Self {
        Self {
            all: self.all + other.all,
            against: self.against + other.against,
            replaced: self.replaced + other.replaced,
        }
    }
}

/// Frames of an agent up to the current one, with its heights.
struct History<'a> {
    kind: AgentKind,
    track: &'a [Frame],
    heights: &'a mut [Option<f64>],
}

impl History<'_> {
    /// Replaces the heights that differ from the ground under the agent by that of the ground, on the level
    /// that most of them agree with.
    fn mend(self, ground: &Ground) -> Votes {
        let frames = self.track.iter().zip(self.heights.iter()).enumerate();
        let known: Vec<(usize, Vec2, f64)> =
            frames.filter_map(|(f, (state, z))| Some((f, (*state)?.position(), (*z)?))).rev().collect();
        let Some(&(_, last, height)) = known.first() else { return Votes::default() };
        let mut levels = ground.levels_at(last);
        levels.retain(|level| {
            let is_near = |segment: &Segment| segment.at(last).0 <= UNDER_DISTANCE * UNDER_DISTANCE;
            ground.find(last, |segment, z| is_near(segment) && !apart(z, *level, 0.0)).is_some()
        });
        // The ground on each level, followed back along the track.
        let follow = |level: &f64| {
            let mut height = *level;
            let at = |&(_, p, _): &(usize, Vec2, f64)| {
                height = ground.nearest(p, height);
                height
            };
            known.iter().map(at).collect::<Vec<f64>>()
        };
        // On ramps, heights between two levels are ground as well.
        let own = ground.find(last, |_, z| (z - height).abs() <= GROUND_TOLERANCE);
        let mut candidates: Vec<Vec<f64>> = levels.iter().chain(&own).map(follow).collect();
        if candidates.is_empty() {
            let mut sorted: Vec<f64> = known.iter().map(|k| k.2).collect();
            sorted.sort_by(f64::total_cmp);
            candidates.push(vec![sorted[sorted.len() / 2]; known.len()]);
        }
        let agrees = |(k, z): (&(usize, Vec2, f64), &f64)| (k.2 - z).abs() <= GROUND_TOLERANCE;
        let agreeing = |level: &Vec<f64>| known.iter().zip(level).filter(|pair| agrees(*pair)).count();
        let best = candidates.into_iter().max_by(|a, b| {
            let nearness = |level: &[f64]| -(level[0] - height).abs();
            agreeing(a).cmp(&agreeing(b)).then(nearness(a).total_cmp(&nearness(b)))
        });
        let Some(best) = best else { return Votes::default() };
        let outliers = known.len() - agreeing(&best);
        let is_against = outliers as f64 > MAX_OUTLIERS * known.len() as f64;
        let (current, now) = (self.track.len() - 1, self.track[self.track.len() - 1]);
        let votes = !levels.is_empty() && self.kind != AgentKind::Other && now.is_some();
        if is_against {
            self.heights.fill(None);
            self.heights[current] = now.and_then(|now| match levels[..] {
                [only] => Some(only),
                _ => ground.along(&now),
            });
        } else {
            for (k, z) in known.iter().zip(&best).filter(|pair| !agrees(*pair)) {
                self.heights[k.0] = Some(*z);
            }
        }
        Votes { all: u32::from(votes), against: u32::from(votes && is_against), replaced: outliers as u32 }
    }
}

/// Replaces heights that contradict the rest of their line, or other lines; returns their number.
fn mend_lines(map: &mut RoadMap, ground: &Ground) -> u32 {
    let mended: Vec<Option<Vec<f64>>> = ground::lines(map)
        .enumerate()
        .map(|(number, (points, heights))| {
            let mut arc = vec![0.0];
            points.windows(2).for_each(|w| arc.push(arc[arc.len() - 1] + (w[1] - w[0]).norm()));
            Line { ground, number: number as u32, points, heights, arc }.mended()
        })
        .collect();
    let MapHeights { lanes, road_edges, .. } = &mut map.heights;
    let known = lanes.iter_mut().chain(road_edges).filter(|heights| !heights.is_empty());
    let mut replaced = 0;
    for (heights, mended) in known.zip(mended) {
        let Some(mended) = mended else { continue };
        let differs = |(old, new): &(&f64, &f64)| old != new;
        replaced += heights.len() - mended.len() + heights.iter().zip(&mended).filter(differs).count();
        *heights = mended;
    }
    replaced as u32
}

/// A line whose heights are examined.
struct Line<'a> {
    ground: &'a Ground,
    /// Number of the line in the ground.
    number: u32,
    points: &'a [Vec2],
    heights: &'a [f64],
    /// Arc length at each point, metres.
    arc: Vec<f64>,
}

impl Line<'_> {
    /// Returns the heights without outliers, which are interpolated; none if the whole line is on another
    /// level than the lines around it, and `None` if nothing changes.
    fn mended(&self) -> Option<Vec<f64>> {
        let runs = self.runs();
        if runs.len() > MAX_RUNS || (runs.len() == 1 && self.is_denied(&runs[0])) {
            return Some(Vec::new());
        }
        let is_kept = self.longest_chain(&runs);
        let (first, last) = (is_kept.iter().position(|k| *k)?, is_kept.iter().rposition(|k| *k)?);
        let mut is_outlier = self.sparse_outliers();
        for (i, run) in runs.iter().enumerate().filter(|(i, _)| !is_kept[*i]) {
            // The end of a line may be on another level if other lines are there as well.
            if (first < i && i < last) || self.is_denied(run) {
                is_outlier[run.clone()].fill(true);
            }
        }
        let mended = self.interpolated(&is_outlier);
        (mended != self.heights).then_some(mended)
    }

    /// Returns whether the heights of two points contradict each other.
    fn jumps(&self, i: usize, k: usize) -> bool {
        let distance = self.arc[k] - self.arc[i];
        let steep = (POINT_NOISE + MAX_POINT_SLOPE * distance).min(LEVEL_GAP);
        (self.heights[k] - self.heights[i]).abs() > steep.max(MAX_LONG_SLOPE * distance)
    }

    /// Returns the parts of the line without jumps.
    fn runs(&self) -> Vec<Range<usize>> {
        let n = self.heights.len();
        let mut runs: Vec<Range<usize>> = Vec::new();
        for end in (1..=n).filter(|&i| i == n || self.jumps(i - 1, i)) {
            runs.push(runs.last().map_or(0, |before| before.end)..end);
        }
        runs
    }

    /// Returns per run whether it is in the longest chain of runs that do not contradict one another.
    fn longest_chain(&self, runs: &[Range<usize>]) -> Vec<bool> {
        let mut chains: Vec<(f64, Option<usize>)> = Vec::new();
        let longest = |chains: &[(f64, Option<usize>)], among: &mut dyn Iterator<Item = usize>| {
            among.max_by(|&a, &b| chains[a].0.total_cmp(&chains[b].0))
        };
        for (i, run) in runs.iter().enumerate() {
            let before = longest(&chains, &mut (0..i).filter(|&k| !self.jumps(runs[k].end - 1, run.start)));
            // A point represents half of the segments next to it.
            let to = self.arc[run.end.min(self.arc.len() - 1)] + self.arc[run.end - 1];
            let from = self.arc[run.start] + self.arc[run.start.saturating_sub(1)];
            chains.push((0.5 * (to - from) + before.map_or(0.0, |k| chains[k].0), before));
        }
        let mut is_kept = vec![false; runs.len()];
        let mut at = longest(&chains, &mut (0..runs.len()));
        while let Some(i) = at {
            is_kept[i] = true;
            at = chains[i].1;
        }
        is_kept
    }

    /// Returns whether a part of the line is on another level than all other lines along most of it.
    fn is_denied(&self, run: &Range<usize>) -> bool {
        let (mut next, mut all, mut against) = (f64::NEG_INFINITY, 0, 0);
        for i in run.clone() {
            if self.arc[i] < next && i + 1 < run.end {
                continue;
            }
            next = self.arc[i] + SUPPORT_SPACING;
            all += 1;
            match self.is_supported(i) {
                Some(true) => return false,
                Some(false) => against += 1,
                None => {}
            }
        }
        2 * against > all
    }

    /// Returns per point whether it is an outlier among points so far apart that it is no jump: it is on
    /// another level than all other lines there, which the points before and after are not.
    fn sparse_outliers(&self) -> Vec<bool> {
        let n = self.points.len();
        let is_sparse = |i: usize| {
            self.arc[i] - self.arc[i.saturating_sub(1)] > SPARSE_SPACING
                || self.arc[(i + 1).min(n - 1)] - self.arc[i] > SPARSE_SPACING
        };
        let mut is_outlier = vec![false; n];
        let mut supported: Option<usize> = None;
        for i in 0..n {
            match if is_sparse(i) { self.is_supported(i) } else { None } {
                Some(true) => {
                    if let Some(before) = supported {
                        is_outlier[before + 1..i].fill(true);
                    }
                    supported = Some(i);
                }
                Some(false) => {}
                None => supported = None,
            }
        }
        is_outlier
    }

    /// Returns whether another line near a point is on the same level; `None` without other lines.
    fn is_supported(&self, i: usize) -> Option<bool> {
        let is_same = self.other_line(i, |z| !apart(z, self.heights[i], 0.0)).is_some();
        (is_same || self.other_line(i, |_| true).is_some()).then_some(is_same)
    }

    /// Returns the height of the nearest other line near a point, of those whose height there `keep` accepts.
    fn other_line(&self, i: usize, keep: impl Fn(f64) -> bool) -> Option<f64> {
        self.ground.find(self.points[i], |segment, z| segment.line != self.number && keep(z))
    }

    /// Returns the heights with those of outliers interpolated between the points around them; at the end of
    /// the line they are those of the nearest other line.
    fn interpolated(&self, is_outlier: &[bool]) -> Vec<f64> {
        let (heights, arc) = (self.heights, &self.arc);
        let height = |p: usize| {
            let before = is_outlier[..p].iter().rposition(|o| !o);
            let after = is_outlier[p..].iter().position(|o| !o).map(|k| p + k);
            match (before, after) {
                (_, Some(here)) if here == p => heights[p],
                (Some(a), Some(b)) => {
                    heights[a] + (heights[b] - heights[a]) * (arc[p] - arc[a]) / (arc[b] - arc[a])
                }
                _ => self.other_line(p, |_| true).unwrap_or(heights[p]),
            }
        };
        (0..heights.len()).map(height).collect()
    }
}

impl Ground {
    /// Returns the height of the nearest ground within 10 m of an agent that runs along its heading, metres.
    fn along(&self, agent: &AgentState) -> Option<f64> {
        let ahead = direction(agent.heading);
        self.find(agent.position(), |segment, _| {
            let way = segment.ends[1] - segment.ends[0];
            way.dot(&ahead).abs() > PARALLEL_COSINE * way.norm()
        })
    }
}

impl RoadMap {
    /// Drops the heights of each kind of line whose heights are its directions; returns the number of lines.
    fn drop_directions(&mut self) -> u32 {
        let areas = self.drivable_area.as_deref().unwrap_or_default();
        let heights = &mut self.heights;
        drop_directions_of(&self.lanes, |l| l.baseline.points(), &mut heights.lanes)
            + drop_directions_of(&self.road_edges, |e| &e.points, &mut heights.road_edges)
            + drop_directions_of(&self.road_lines, |l| &l.points, &mut heights.road_lines)
            + drop_directions_of(&self.crosswalks, |c| &c.outline, &mut heights.crosswalks)
            + drop_directions_of(&self.speed_bumps, |b| &b.outline, &mut heights.speed_bumps)
            + drop_directions_of(&self.driveways, |d| &d.outline, &mut heights.driveways)
            + drop_directions_of(areas, |a| &a.exterior, &mut heights.drivable_area)
    }
}

/// Drops the heights of lines if they are the directions of the lines; returns the number of lines.
fn drop_directions_of<T>(items: &[T], points: fn(&T) -> &[Vec2], heights: &mut [Vec<f64>]) -> u32 {
    let is_direction = |unit: f64| {
        let lines = items.iter().map(points).zip(heights.iter());
        let known = lines.filter(|line| line.0.len() == line.1.len());
        let all: usize = known.clone().map(|line| line.1.len()).sum();
        let (mut matching, mut telling) = (all, 0_usize);
        for (points, heights) in known {
            for (i, angle) in heights.iter().map(|z| z * unit).enumerate() {
                let is_match = angle.abs() < MAX_ANGLE && points_along(points, i, angle);
                matching -= usize::from(!is_match);
                telling += usize::from(is_match && angle.abs() > TELLING_ANGLE);
            }
            if (matching as f64) < MIN_DIRECTIONS * all as f64 {
                return false;
            }
        }
        telling as f64 > MIN_TELLING * all as f64
    };
    if ![1.0, DEGREE].into_iter().any(is_direction) {
        return 0;
    }
    let dropped = heights.iter().filter(|heights| !heights.is_empty()).count();
    heights.iter_mut().for_each(Vec::clear);
    dropped as u32
}

/// Returns whether a line at a point, by index, has the direction `angle`, radians.
fn points_along(points: &[Vec2], i: usize, angle: f64) -> bool {
    let way = |a: usize, b: usize| Some(heading_of(points.get(b)? - points.get(a)?));
    let (before, after) = (i.checked_sub(1).and_then(|a| way(a, i)), way(i, i + 1));
    let turn = before.zip(after).map_or(0.0, |(a, b)| wrap(b - a).abs());
    let is_along = |way: f64| wrap(angle - way).abs() <= DIRECTION_TOLERANCE + 0.5 * turn;
    [before, after].into_iter().flatten().any(is_along)
}

/// Returns whether the height of an agent that turns is its heading, less a constant; `None` if it does not
/// turn.
fn is_heading<'a>(frames: impl Iterator<Item = (&'a Frame, &'a Option<f64>)>) -> Option<bool> {
    let known: Vec<(f64, f64)> =
        frames.filter_map(|(state, z)| Some((state.as_ref()?.heading, (*z)?))).collect();
    let (first, z) = *known.first()?;
    let turned = |k: &(f64, f64)| wrap(k.0 - first).abs() > MIN_TURN;
    let is_equal = |unit: f64| {
        let same = |k: &&(f64, f64)| wrap((k.1 - z) * unit - (k.0 - first)).abs() <= DIRECTION_TOLERANCE;
        known.iter().filter(same).count() as f64 >= MIN_DIRECTIONS * known.len() as f64
    };
    known.iter().any(turned).then(|| is_equal(1.0) || is_equal(DEGREE))
}

#[cfg(test)]
mod tests;
