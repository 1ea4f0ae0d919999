//! Where on its path an agent can not be, and when.

use super::own_path::OwnPath;
use super::traffic::{Boxes, nearer};
use crate::geometry::{Bounds, OrientedBox};

/// Distance of the places of a path that are tried, metres.
const SPACING: f64 = 0.5;
/// How exactly the ends of blocked stretches are found: the spacing is halved so often.
const HALVINGS: usize = 5;

/// The boxes of an agent along its path, ready to be compared with those of others.
pub(super) struct Places<'p> {
    path: &'p OwnPath,
    boxes: Vec<OrientedBox>,
    /// The segment of the path at each of them.
    segments: Vec<usize>,
    bounds: Bounds,
    /// Per step the first and last arc length that can be reached.
    reach: Vec<(f64, f64)>,
}

/// A stretch of a path that is blocked at one step. Ends that can not be reached are infinite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Stretch {
    /// Step after the reaction step.
    pub(super) step: usize,
    /// Where it begins.
    pub(super) from: f64,
    /// Where it ends.
    pub(super) to: f64,
}

/// Stretches that one obstacle blocks at successive steps, joined: an agent stays behind all of them or ahead of all of them.
#[derive(Clone, Debug)]
pub(super) struct Blob {
    /// Slot of the obstacle.
    pub(super) by: usize,
    /// The stretches by step.
    pub(super) stretches: Vec<Stretch>,
}

impl<'p> Places<'p> {
    /// `reach`: per step (0 is the reaction step) the arc lengths of the hardest braking and the hardest acceleration.
    pub(super) fn new(path: &'p OwnPath, reach: Vec<(f64, f64)>) -> Self {
        let length = reach.iter().fold(0.0_f64, |a, r| a.max(r.1));
        let (boxes, segments) = path.footprints(SPACING, length + SPACING);
        let around = boxes.first().map_or(0.0, OrientedBox::radius);
        let bounds = Bounds::of(boxes.iter().map(|b| b.center)).inflated(around);
        Self { path, boxes, segments, bounds, reach }
    }

    /// Where the obstacle (boxes at the steps from `first` on) comes nearer than `clearance`, at steps that are not `exempt`.
    pub(super) fn blobs(
        &self,
        by: usize,
        obstacle: &Boxes,
        extent: &Bounds,
        first: usize,
        clearance: f64,
        exempt: impl Fn(usize) -> bool,
    ) -> Vec<Blob> {
        if !self.bounds.intersects(&extent.inflated(clearance)) {
            return Vec::new();
        }
        let mut blobs: Vec<Blob> = Vec::new();
        for step in 1..self.reach.len() {
            let Some(other) = obstacle[first + step].as_ref().filter(|_| !exempt(first + step)) else {
                continue;
            };
            let found = self.stretches(step, other, clearance);
            for stretch in found {
                // Blobs that reach this stretch from the step before become one.
                let touches = |b: &Blob| {
                    b.stretches
                        .iter()
                        .rev()
                        .take_while(|s| s.step + 1 >= step)
                        .any(|s| s.step + 1 == step && s.from <= stretch.to && stretch.from <= s.to)
                };
                let mut joined = Blob { by, stretches: Vec::new() };
                let mut k = 0;
                while k < blobs.len() {
                    if touches(&blobs[k]) {
                        joined.stretches.extend(blobs.remove(k).stretches);
                    } else {
                        k += 1;
                    }
                }
                joined.stretches.push(stretch);
                joined.stretches.sort_by_key(|s| s.step);
                blobs.push(joined);
            }
        }
        blobs
    }

    fn stretches(&self, step: usize, other: &OrientedBox, clearance: f64) -> Vec<Stretch> {
        let (low, high) = self.reach[step];
        let first = (low / SPACING).floor() as usize;
        let last = ((high / SPACING).ceil() as usize).min(self.boxes.len() - 1);
        let reach = self.boxes[first].radius() + other.radius() + clearance;
        let mut found = Vec::new();
        let mut open: Option<f64> = None;
        let mut i = first;
        while i <= last {
            let apart = (self.boxes[i].center - other.center).norm();
            // The centre moves by no more than the arc length (a nudge adds a little).
            if apart > reach && open.is_none() {
                i += 1.max(((apart - reach) / (1.2 * SPACING)) as usize);
                continue;
            }
            let hit = apart <= reach && nearer(&self.boxes[i], other, clearance);
            match (hit, open) {
                (true, None) => {
                    let from =
                        if i == first { f64::NEG_INFINITY } else { self.edge(i, i - 1, other, clearance) };
                    open = Some(from);
                }
                (false, Some(from)) => {
                    found.push(Stretch { step, from, to: self.edge(i - 1, i, other, clearance) });
                    open = None;
                }
                _ => {}
            }
            i += 1;
        }
        if let Some(from) = open {
            found.push(Stretch { step, from, to: f64::INFINITY });
        }
        found
    }

    /// A free arc length between a blocked and a free place, close to the blocked ones.
    fn edge(&self, blocked: usize, free: usize, other: &OrientedBox, clearance: f64) -> f64 {
        let (mut hit, mut clear) = (blocked as f64 * SPACING, free as f64 * SPACING);
        for _ in 0..HALVINGS {
            let middle = 0.5 * (hit + clear);
            if nearer(&self.path.footprint_near(middle, self.segments[free.min(blocked)]), other, clearance) {
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
    use super::*;
    use crate::curation::avoidance::traffic::{distance, extent};
    use crate::geometry::Vec2;
    use crate::scene::{Agent, AgentKind, AgentState, Frame};

    fn path() -> OwnPath {
        let agent = Agent { id: "a".to_owned(), kind: AgentKind::Vehicle, length: 4.0, width: 2.0 };
        let state = |x: f64| AgentState { x, y: 0.0, heading: 0.0, vx: 1.0, vy: 0.0 };
        let log: Vec<Frame> = (0..60).map(|k| Some(state(f64::from(k)))).collect();
        OwnPath::new(&agent, &state(0.0), &log).unwrap()
    }

    #[test]
    fn what_crosses_blocks_one_blob_and_its_ends_are_clear() {
        let path = path();
        let places = Places::new(&path, vec![(0.0, 40.0); 61]);
        // From the right at 5 m/s, over x = 20 after 3 s.
        let at = |k: usize| Some(OrientedBox::new(Vec2::new(20.0, -15.0 + 0.5 * k as f64), 1.57, 4.0, 2.0));
        let boxes: Boxes = (0..=60).map(at).collect();
        let blobs = places.blobs(3, &boxes, &extent(&boxes), 0, 0.2, |_| false);
        assert_eq!(blobs.len(), 1);
        assert_eq!(blobs[0].by, 3);
        for s in &blobs[0].stretches {
            for (end, inside) in [(s.from, 0.1), (s.to, -0.1)] {
                let other = &boxes[s.step].unwrap();
                let clear = distance(&path.footprint(end), other);
                assert!((0.2..0.25).contains(&clear), "{s:?}: {clear}");
                assert!(distance(&path.footprint(end + inside), other) < 0.2);
            }
        }
        let steps: Vec<usize> = blobs[0].stretches.iter().map(|s| s.step).collect();
        assert!(steps.windows(2).all(|w| w[1] == w[0] + 1), "{steps:?}");
    }

    #[test]
    fn two_visits_are_two_blobs_and_absent_boxes_block_nothing() {
        let path = path();
        let places = Places::new(&path, vec![(0.0, 40.0); 61]);
        let there = |k: usize| (5..15).contains(&k) || (30..40).contains(&k);
        let at = |k: usize| there(k).then(|| OrientedBox::new(Vec2::new(20.0, 0.0), 0.0, 4.0, 2.0));
        let boxes: Boxes = (0..=60).map(at).collect();
        let blobs = places.blobs(1, &boxes, &extent(&boxes), 0, 0.0, |_| false);
        assert_eq!(blobs.iter().map(|b| b.stretches.len()).collect::<Vec<_>>(), [10, 10]);
    }

    #[test]
    fn ends_out_of_reach_are_infinite() {
        let path = path();
        let places = Places::new(&path, vec![(18.0, 22.0); 3]);
        let boxes: Boxes = vec![Some(OrientedBox::new(Vec2::new(20.0, 0.0), 0.0, 4.0, 2.0)); 3];
        let blobs = places.blobs(1, &boxes, &extent(&boxes), 0, 0.0, |_| false);
        let ends = blobs[0].stretches[0];
        assert_eq!((ends.from, ends.to), (f64::NEG_INFINITY, f64::INFINITY));
    }
}
