//! What blocks a path, and on which side of it to pass.

use std::collections::BTreeSet;

use super::Unavoidable;
use super::blocked::{Blob, Places, Stretch};
use super::front::gap_to_front;
use super::own_path::OwnPath;
use super::profile::Corridor;
use super::respond::Courtesy;
use super::solver::{MARGIN, STOPS, Solver};

/// Combinations of sides that are tried on one path.
const MOST_COMBINATIONS: usize = 6;
/// Cosine of the heading difference up to which somebody behind is a follower (45 degrees).
const FOLLOWER_COS: f64 = 0.7;
/// Who has moved less than this since the reaction step stands there, metres.
const COMES_FROM: f64 = 1.0;

/// Which side of a blob an agent passes on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Side {
    Behind,
    Ahead,
}

/// A blob with what is possible there.
pub(super) struct Choice {
    pub(super) blob: Blob,
    pub(super) gaps: Vec<(usize, f64, f64)>,
    pub(super) preferred: Side,
    pub(super) behind: bool,
    pub(super) ahead: bool,
}

impl Solver<'_> {
    /// What blocks the path, with the sides that can be reached; and who only runs into this agent from behind: these answer for
    /// themselves.
    pub(super) fn choices(
        &self,
        path: &OwnPath,
        places: &Places<'_>,
        courtesy: Courtesy,
    ) -> Result<(Vec<Choice>, BTreeSet<usize>), Unavoidable> {
        let first = self.driver.reaction;
        let (boxes, extent) = self.traffic.boxes(0);
        let (mut choices, mut followers) = (Vec::new(), BTreeSet::new());
        for blob in places.blobs(0, boxes, extent, first, self.to_av + MARGIN, |_| false) {
            choices.push(self.choice(path, blob)?);
        }
        for other in &self.others {
            let (boxes, extent) = self.traffic.boxes(other.slot);
            let exempt = |step: usize| other.pair.exempt(step);
            for mut blob in places.blobs(other.slot, boxes, extent, first, other.clearance, exempt) {
                let all = blob.stretches.len();
                let later = courtesy == Courtesy::OfAllWhoComeLater
                    && self.comes_later(&blob)
                    && self.moves(other.slot, &blob);
                blob.stretches.retain(|s| !later && !self.followed_by(other.slot, first + s.step));
                if blob.stretches.len() < all {
                    followers.insert(other.slot);
                }
                if !blob.stretches.is_empty() {
                    choices.push(self.choice(path, blob)?);
                }
            }
        }
        Ok((choices, followers))
    }

    /// Whether the agent is past a blob in its log when that begins.
    fn comes_later(&self, blob: &Blob) -> bool {
        blob.stretches.first().is_some_and(|s| self.driver.logged[s.step] > s.from)
    }

    /// Whether the obstacle of a blob has come there from elsewhere since the reaction step, in its log.
    fn moves(&self, other: usize, blob: &Blob) -> bool {
        let logged = &self.traffic.logged[other];
        let then = blob.stretches.first().and_then(|s| logged[self.driver.reaction + s.step]);
        let now = logged[self.driver.reaction];
        now.zip(then).is_none_or(|(a, b)| (b.center - a.center).norm() > COMES_FROM)
    }

    /// Whether somebody comes from behind in the log: it must not run into this agent, whatever that does. Who never moves comes
    /// from nowhere.
    fn followed_by(&self, other: usize, step: usize) -> bool {
        if self.traffic.stands(other) {
            return false;
        }
        let logged = &self.traffic.logged;
        let (Some(me), Some(them)) = (&logged[self.driver.agent][step], &logged[other][step]) else {
            return false;
        };
        me.to_local(them.center).x < 0.0 && me.axis.dot(&them.axis) > FOLLOWER_COS
    }

    /// A blob with the sides that can be reached.
    fn choice(&self, path: &OwnPath, blob: Blob) -> Result<Choice, Unavoidable> {
        let gaps = if blob.by == 0 { self.gaps(path, &blob) } else { Vec::new() };
        let late = blob.stretches.iter().find(|s| s.from < self.slowest.s[s.step]).map(|s| s.step);
        let close = gaps
            .iter()
            .find(|(step, gap, bound)| self.slowest.s[*step] + gap * self.slowest.v[*step] > *bound);
        let late = late.or(close.map(|g| g.0));
        let ahead = blob.stretches.iter().all(|s| s.to <= self.fastest.s[s.step]);
        if let (Some(step), false) = (late, ahead) {
            return Err(Unavoidable::TooClose {
                agent: self.id(self.driver.agent),
                other: self.name(blob.by),
                step: self.driver.reaction + step,
            });
        }
        let preferred = if blob.by != 0 && self.comes_later(&blob) { Side::Ahead } else { Side::Behind };
        Ok(Choice { blob, gaps, preferred, behind: late.is_none(), ahead })
    }

    /// The time to collision with the AV as bounds, where the agent waits behind it.
    fn gaps(&self, path: &OwnPath, blob: &Blob) -> Vec<(usize, f64, f64)> {
        let of = |s: &Stretch| {
            let step = self.driver.reaction + s.step;
            let gap = gap_to_front(&path.footprint(s.from.max(0.0)), &self.traffic.av_box(step), 0.1)?;
            Some((
                s.step,
                self.settings.time_gap,
                s.from.max(0.0) + gap + self.settings.time_gap * self.av_speed(step),
            ))
        };
        blob.stretches.iter().filter(|s| s.from.is_finite()).filter_map(of).collect()
    }

    /// The bounds that sides mean; `None` where they contradict each other.
    pub(super) fn corridor(&self, choices: &[Choice], sides: &[Side], cap: f64) -> Option<Corridor> {
        let steps = self.driver.steps();
        let (mut lower, mut upper) = (vec![f64::NEG_INFINITY; steps + 1], vec![f64::INFINITY; steps + 1]);
        let mut gaps = Vec::new();
        if cap.is_finite() {
            // Who can not stop on the road need not.
            let stop = self.slowest.s[steps] + STOPS;
            upper.fill(cap.max(stop));
        }
        for (choice, side) in choices.iter().zip(sides) {
            for s in &choice.blob.stretches {
                match side {
                    Side::Behind => upper[s.step] = upper[s.step].min(s.from),
                    Side::Ahead => lower[s.step] = lower[s.step].max(s.to),
                }
            }
            if *side == Side::Behind {
                gaps.extend(choice.gaps.iter().copied());
            }
        }
        // Nobody goes back.
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

/// Sides for all blobs: those preferred, then with one changed, then with two.
pub(super) fn combinations(choices: &[Choice]) -> Vec<Vec<Side>> {
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
    all.truncate(MOST_COMBINATIONS);
    all
}
