//! The parts of an agent's path that are blocked, and when.

use reactsim_geometry::{Bounds, OrientedBox};

use super::own_path::OwnPath;
use super::traffic::{Boxes, is_nearer};

/// Spacing of the sampled positions of a path, metres.
const SAMPLE_SPACING: f64 = 0.5;
/// Number of halvings of the spacing when the ends of blocked intervals are located.
const EDGE_HALVINGS: usize = 5;

/// Boxes of an agent along its path, prepared for comparison with those of others.
pub(super) struct FootprintSamples<'p> {
    path: &'p OwnPath,
    boxes: Vec<OrientedBox>,
    /// Path segment of each box.
    segments: Vec<usize>,
    bounds: Bounds,
    /// First and last reachable arc length at each step.
    reach: Vec<(f64, f64)>,
}

/// Interval of a path that is blocked at one step. Ends that cannot be reached are infinite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct BlockedInterval {
    /// Step after the reaction step.
    pub(super) step: usize,
    /// First blocked arc length, metres.
    pub(super) from: f64,
    /// Last blocked arc length, metres.
    pub(super) to: f64,
}

/// Intervals blocked by one obstacle at successive steps: an agent stays behind all of them or ahead of
/// all of them.
#[derive(Clone, Debug)]
pub(super) struct BlockedRegion {
    /// Slot of the obstacle.
    pub(super) by: usize,
    pub(super) intervals: Vec<BlockedInterval>,
}

impl<'p> FootprintSamples<'p> {
    /// Samples the boxes along a path. `reach` holds, per step (0 is the reaction step), the arc lengths
    /// of the hardest braking and the hardest acceleration.
    pub(super) fn new(path: &'p OwnPath, reach: Vec<(f64, f64)>) -> Self {
        let length = reach.iter().fold(0.0_f64, |a, r| a.max(r.1));
        let (boxes, segments) = path.footprints(SAMPLE_SPACING, length + SAMPLE_SPACING);
        let around = boxes.first().map_or(0.0, OrientedBox::radius);
        let bounds = Bounds::of(boxes.iter().map(|b| b.center)).inflated(around);
        Self { path, boxes, segments, bounds, reach }
    }

    /// Returns the regions where the obstacle (boxes at the steps from `first` on) comes closer than
    /// `clearance`, at steps that are not `exempt`.
    pub(super) fn regions(
        &self,
        by: usize,
        obstacle: &Boxes,
        extent: &Bounds,
        first: usize,
        clearance: f64,
        exempt: impl Fn(usize) -> bool,
    ) -> Vec<BlockedRegion> {
        if !self.bounds.intersects(&extent.inflated(clearance)) {
            return Vec::new();
        }
        let mut regions: Vec<BlockedRegion> = Vec::new();
        for step in 1..self.reach.len() {
            let Some(other) = obstacle[first + step].as_ref().filter(|_| !exempt(first + step)) else {
                continue;
            };
            let found = self.intervals(step, other, clearance);
            for interval in found {
                // Regions that touch this interval at the previous step become one.
                let touches = |b: &BlockedRegion| {
                    b.intervals
                        .iter()
                        .rev()
                        .take_while(|s| s.step + 1 >= step)
                        .any(|s| s.step + 1 == step && s.from <= interval.to && interval.from <= s.to)
                };
                let touched = regions.extract_if(.., |region| touches(region));
                let mut intervals: Vec<BlockedInterval> =
                    touched.flat_map(|region| region.intervals).collect();
                intervals.push(interval);
                intervals.sort_by_key(|s| s.step);
                regions.push(BlockedRegion { by, intervals });
            }
        }
        regions
    }

    fn intervals(&self, step: usize, other: &OrientedBox, clearance: f64) -> Vec<BlockedInterval> {
        let (low, high) = self.reach[step];
        let first = (low / SAMPLE_SPACING).floor() as usize;
        let last = ((high / SAMPLE_SPACING).ceil() as usize).min(self.boxes.len() - 1);
        let reach = self.boxes[first].radius() + other.radius() + clearance;
        let mut found = Vec::new();
        let mut open: Option<f64> = None;
        let mut i = first;
        while i <= last {
            let apart = (self.boxes[i].center - other.center).norm();
            // The centre moves by no more than the arc length (a shift adds a little).
            if apart > reach && open.is_none() {
                i += 1.max(((apart - reach) / (1.2 * SAMPLE_SPACING)) as usize);
                continue;
            }
            let hit = apart <= reach && is_nearer(&self.boxes[i], other, clearance);
            match (hit, open) {
                (true, None) => {
                    let from =
                        if i == first { f64::NEG_INFINITY } else { self.edge(i, i - 1, other, clearance) };
                    open = Some(from);
                }
                (false, Some(from)) => {
                    found.push(BlockedInterval { step, from, to: self.edge(i - 1, i, other, clearance) });
                    open = None;
                }
                _ => {}
            }
            i += 1;
        }
        if let Some(from) = open {
            found.push(BlockedInterval { step, from, to: f64::INFINITY });
        }
        found
    }

    /// Returns a free arc length between a blocked and a free sample, close to the blocked ones.
    fn edge(&self, blocked: usize, free: usize, other: &OrientedBox, clearance: f64) -> f64 {
        let (mut hit, mut clear) = (blocked as f64 * SAMPLE_SPACING, free as f64 * SAMPLE_SPACING);
        for _ in 0..EDGE_HALVINGS {
            let middle = 0.5 * (hit + clear);
            if is_nearer(
                &self.path.footprint_near(middle, self.segments[free.min(blocked)]),
                other,
                clearance,
            ) {
                hit = middle;
            } else {
                clear = middle;
            }
        }
        clear
    }
}

#[cfg(test)]
mod tests {
    use reactsim_geometry::Vec2;
    use reactsim_scene::{Agent, AgentKind, AgentState, Frame};

    use super::*;
    use crate::avoidance::traffic::{distance, extent};

    fn path() -> OwnPath {
        let agent = Agent { id: "a".to_owned(), kind: AgentKind::Vehicle, length: 4.0, width: 2.0 };
        let state = |x: f64| AgentState { x, y: 0.0, heading: 0.0, vx: 1.0, vy: 0.0 };
        let log: Vec<Frame> = (0..60).map(|k| Some(state(f64::from(k)))).collect();
        OwnPath::new(&agent, &state(0.0), &log).unwrap()
    }

    #[test]
    fn a_crossing_agent_blocks_one_region_and_its_ends_are_clear() {
        let path = path();
        let samples = FootprintSamples::new(&path, vec![(0.0, 40.0); 61]);
        // From the right at 5 m/s, across x = 20 after 3 s.
        let at = |k: usize| Some(OrientedBox::new(Vec2::new(20.0, -15.0 + 0.5 * k as f64), 1.57, 4.0, 2.0));
        let boxes: Boxes = (0..=60).map(at).collect();
        let regions = samples.regions(3, &boxes, &extent(&boxes), 0, 0.2, |_| false);
        assert_eq!(regions.len(), 1);
        assert_eq!(regions[0].by, 3);
        for s in &regions[0].intervals {
            for (end, inside) in [(s.from, 0.1), (s.to, -0.1)] {
                let other = &boxes[s.step].unwrap();
                let clear = distance(&path.footprint(end), other);
                assert!((0.2..0.25).contains(&clear), "{s:?}: {clear}");
                assert!(distance(&path.footprint(end + inside), other) < 0.2);
            }
        }
        let steps: Vec<usize> = regions[0].intervals.iter().map(|s| s.step).collect();
        assert!(steps.windows(2).all(|w| w[1] == w[0] + 1), "{steps:?}");
    }

    #[test]
    fn two_visits_are_two_regions_and_absent_boxes_block_nothing() {
        let path = path();
        let samples = FootprintSamples::new(&path, vec![(0.0, 40.0); 61]);
        let there = |k: usize| (5..15).contains(&k) || (30..40).contains(&k);
        let at = |k: usize| there(k).then(|| OrientedBox::new(Vec2::new(20.0, 0.0), 0.0, 4.0, 2.0));
        let boxes: Boxes = (0..=60).map(at).collect();
        let regions = samples.regions(1, &boxes, &extent(&boxes), 0, 0.0, |_| false);
        assert_eq!(regions.iter().map(|b| b.intervals.len()).collect::<Vec<_>>(), [10, 10]);
    }

    #[test]
    fn ends_out_of_reach_are_infinite() {
        let path = path();
        let samples = FootprintSamples::new(&path, vec![(18.0, 22.0); 3]);
        let boxes: Boxes = vec![Some(OrientedBox::new(Vec2::new(20.0, 0.0), 0.0, 4.0, 2.0)); 3];
        let regions = samples.regions(1, &boxes, &extent(&boxes), 0, 0.0, |_| false);
        let ends = regions[0].intervals[0];
        assert_eq!((ends.from, ends.to), (f64::NEG_INFINITY, f64::INFINITY));
    }
}
