//! Blocked regions of a path, and the side on which to pass each of them.

use std::collections::BTreeSet;

use super::Unavoidable;
use super::blocked::{BlockedInterval, BlockedRegion, FootprintSamples};
use super::front::gap_to_front;
use super::own_path::OwnPath;
use super::problem::{INTERVAL_MARGIN, Problem, STOP_SLACK, YieldAssumption};
use super::profile::Corridor;

/// Largest number of combinations of sides that are tried on one path.
const MAX_COMBINATIONS: usize = 6;
/// Smallest cosine of the heading difference at which an agent behind is a follower (45 degrees).
const MIN_FOLLOWER_COS: f64 = 0.7;
/// Displacement since the reaction step up to which an obstacle has not arrived from elsewhere, metres.
const ARRIVAL_DISPLACEMENT: f64 = 1.0;

/// Side on which an agent passes a blocked region.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Side {
    Behind,
    Ahead,
}

/// A blocked region with the sides that can be reached.
pub(super) struct SideChoice {
    pub(super) region: BlockedRegion,
    pub(super) gaps: Vec<(usize, f64, f64)>,
    pub(super) preferred: Side,
    pub(super) behind: bool,
    pub(super) ahead: bool,
}

impl Problem<'_> {
    /// Returns the regions that block the path, with the sides that can be reached, and the agents that
    /// only run into this one from behind: these must respond themselves.
    pub(super) fn choices(
        &self,
        path: &OwnPath,
        samples: &FootprintSamples<'_>,
        assumption: YieldAssumption,
    ) -> Result<(Vec<SideChoice>, BTreeSet<usize>), Unavoidable> {
        let first = self.responder.reaction;
        let (boxes, extent) = self.traffic.boxes(0);
        let (mut choices, mut followers) = (Vec::new(), BTreeSet::new());
        for region in samples.regions(0, boxes, extent, first, self.to_av + INTERVAL_MARGIN, |_| false) {
            choices.push(self.choice(path, region)?);
        }
        for other in &self.others {
            let (boxes, extent) = self.traffic.boxes(other.slot);
            let exempt = |step: usize| other.pair.exempt(step);
            for mut region in samples.regions(other.slot, boxes, extent, first, other.clearance, exempt) {
                let all = region.intervals.len();
                let later = assumption == YieldAssumption::FollowersAndLaterCrossers
                    && self.is_past_before(&region)
                    && self.has_arrived(other.slot, &region);
                region.intervals.retain(|s| !later && !self.is_followed_by(other.slot, first + s.step));
                if region.intervals.len() < all {
                    followers.insert(other.slot);
                }
                if !region.intervals.is_empty() {
                    choices.push(self.choice(path, region)?);
                }
            }
        }
        Ok((choices, followers))
    }

    /// Returns whether the agent has passed the region in its log when the region becomes blocked.
    fn is_past_before(&self, region: &BlockedRegion) -> bool {
        region.intervals.first().is_some_and(|s| self.responder.logged[s.step] > s.from)
    }

    /// Returns whether the obstacle of a region has arrived there since the reaction step, in its log.
    fn has_arrived(&self, other: usize, region: &BlockedRegion) -> bool {
        let logged = &self.traffic.logged[other];
        let then = region.intervals.first().and_then(|s| logged[self.responder.reaction + s.step]);
        let now = logged[self.responder.reaction];
        now.zip(then).is_none_or(|(a, b)| (b.center - a.center).norm() > ARRIVAL_DISPLACEMENT)
    }

    /// Returns whether another agent comes from behind in the log: it must avoid this agent, whatever
    /// that does. Parked agents do not count.
    fn is_followed_by(&self, other: usize, step: usize) -> bool {
        if self.traffic.is_parked(other) {
            return false;
        }
        let logged = &self.traffic.logged;
        let (Some(me), Some(them)) = (&logged[self.responder.agent][step], &logged[other][step]) else {
            return false;
        };
        me.to_local(them.center).x < 0.0 && me.axis.dot(&them.axis) > MIN_FOLLOWER_COS
    }

    /// Returns a region with the sides that can be reached.
    fn choice(&self, path: &OwnPath, region: BlockedRegion) -> Result<SideChoice, Unavoidable> {
        let gaps = if region.by == 0 { self.gaps(path, &region) } else { Vec::new() };
        let late = region.intervals.iter().find(|s| s.from < self.slowest.s[s.step]).map(|s| s.step);
        let close = gaps
            .iter()
            .find(|(step, gap, bound)| self.slowest.s[*step] + gap * self.slowest.v[*step] > *bound);
        let late = late.or(close.map(|g| g.0));
        let ahead = region.intervals.iter().all(|s| s.to <= self.fastest.s[s.step]);
        if let (Some(step), false) = (late, ahead) {
            return Err(Unavoidable::TooClose {
                agent: self.id(self.responder.agent),
                other: self.name(region.by),
                step: self.responder.reaction + step,
            });
        }
        let preferred =
            if region.by != 0 && self.is_past_before(&region) { Side::Ahead } else { Side::Behind };
        Ok(SideChoice { region, gaps, preferred, behind: late.is_none(), ahead })
    }

    /// Returns the time to collision with the AV as bounds, for an agent that waits behind the AV.
    fn gaps(&self, path: &OwnPath, region: &BlockedRegion) -> Vec<(usize, f64, f64)> {
        let of = |s: &BlockedInterval| {
            let step = self.responder.reaction + s.step;
            let gap = gap_to_front(&path.footprint(s.from.max(0.0)), &self.traffic.av_box(step), 0.1)?;
            Some((
                s.step,
                self.settings.time_gap,
                s.from.max(0.0) + gap + self.settings.time_gap * self.av_speed(step),
            ))
        };
        region.intervals.iter().filter(|s| s.from.is_finite()).filter_map(of).collect()
    }

    /// Returns the bounds for these sides; `None` if they contradict each other.
    pub(super) fn corridor(&self, choices: &[SideChoice], sides: &[Side], cap: f64) -> Option<Corridor> {
        let steps = self.responder.steps;
        let (mut lower, mut upper) = (vec![f64::NEG_INFINITY; steps + 1], vec![f64::INFINITY; steps + 1]);
        let mut gaps = Vec::new();
        if cap.is_finite() {
            // An agent that cannot stop on the road need not.
            let stop = self.slowest.s[steps] + STOP_SLACK;
            upper.fill(cap.max(stop));
        }
        for (choice, side) in choices.iter().zip(sides) {
            for s in &choice.region.intervals {
                match side {
                    Side::Behind => upper[s.step] = upper[s.step].min(s.from),
                    Side::Ahead => lower[s.step] = lower[s.step].max(s.to),
                }
            }
            if *side == Side::Behind {
                gaps.extend(choice.gaps.iter().copied());
            }
        }
        // Nobody reverses.
        for k in (0..steps).rev() {
            upper[k] = upper[k].min(upper[k + 1]);
        }
        for k in 1..=steps {
            lower[k] = lower[k].max(lower[k - 1]);
        }
        let possible =
            |k: usize| lower[k] <= upper[k] && self.slowest.s[k] <= upper[k] && lower[k] <= self.fastest.s[k];
        let speeds = vec![f64::INFINITY; steps + 1];
        (1..=steps).all(possible).then_some(Corridor { lower, upper, speeds, gaps })
    }
}

/// Returns combinations of sides for all regions: the preferred ones, then with one changed, then with
/// two.
pub(super) fn combinations(choices: &[SideChoice]) -> Vec<Vec<Side>> {
    let usual: Vec<Side> = choices
        .iter()
        .map(|c| match (c.behind, c.ahead) {
            (true, false) => Side::Behind,
            (false, _) => Side::Ahead,
            _ => c.preferred,
        })
        .collect();
    let free: Vec<usize> = (0..choices.len()).filter(|&i| choices[i].behind && choices[i].ahead).collect();
    let changed = |which: &[usize]| {
        let mut sides = usual.clone();
        for &i in which {
            sides[i] = if sides[i] == Side::Behind { Side::Ahead } else { Side::Behind };
        }
        sides
    };
    let mut all = vec![usual.clone()];
    all.extend(free.iter().map(|&i| changed(&[i])));
    for (n, &i) in free.iter().enumerate() {
        all.extend(free[n + 1..].iter().map(|&j| changed(&[i, j])));
    }
    all.truncate(MAX_COMBINATIONS);
    all
}
