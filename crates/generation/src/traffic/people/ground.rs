//! Ground that people walk on: footways, their joints, and the extension beyond the last end.

use reactsim_geometry::{Vec2, point_segment};

use super::Crowd;
use super::aim::LOOK_AHEAD;
use super::walker::Walker;

/// Remaining length of a stretch, metres, from which on people move on to the next one, wherever that is.
const END_DISTANCE: f64 = 0.4;

impl Crowd {
    /// Returns the point covered by footways that is nearest to a pedestrian.
    pub(super) fn on_ground(&self, w: &Walker) -> Vec2 {
        let p = w.position;
        let own = &self.network.stretches[w.stretch];
        let at = own.line.project_between(p, w.segment.saturating_sub(2), w.segment + 3);
        if at.distance <= own.half {
            return p;
        }
        let mut best = (at.distance - own.half, own.line.on_segment(at.s, at.segment));
        let mut offer = |distance: f64, room: f64, nearest: Vec2| {
            if distance - room < best.0 {
                best = (distance - room, nearest);
            }
        };
        if let Some(before) = w.before {
            let stretch = &self.network.stretches[before];
            let at = stretch.line.project(p);
            offer(at.distance, stretch.half, stretch.line.on_segment(at.s, at.segment));
        }
        match self.onward(w) {
            Some((next, forward)) => {
                let stretch = &self.network.stretches[next];
                let at = stretch.line.project(p);
                offer(at.distance, stretch.half, stretch.line.on_segment(at.s, at.segment));
                self.joint(p, (w.stretch, w.forward), (next, !forward), &mut offer);
            }
            // Beyond the end of the last stretch is the border of the map.
            None => {
                let (end, last) =
                    (self.end(w.stretch, w.forward), if w.forward { own.line.segments() - 1 } else { 0 });
                let out = end + own.along(last) * (2.0 * w.sign());
                let (square, t) = point_segment(p, end, out);
                offer(square.sqrt(), own.half, end + (out - end) * t);
            }
        }
        if let Some(before) = w.before {
            let node = own.ends[usize::from(!w.forward)];
            let last = self.network.stretches[before].ends[1] == node;
            self.joint(p, (before, last), (w.stretch, !w.forward), &mut offer);
        }
        let (over, nearest) = best;
        if over <= 0.0 {
            return p;
        }
        let out = p - nearest;
        p - out * (over / out.norm())
    }

    /// Offers the ground between two joined stretches.
    fn joint(&self, p: Vec2, a: (usize, bool), b: (usize, bool), offer: &mut impl FnMut(f64, f64, Vec2)) {
        let (from, to) = (self.end(a.0, a.1), self.end(b.0, b.1));
        let (square, t) = point_segment(p, from, to);
        let room = self.network.stretches[a.0].half.min(self.network.stretches[b.0].half);
        offer(square.sqrt(), room, from + (to - from) * t);
    }

    /// Updates the position of a pedestrian on the network after a move.
    pub(super) fn locate(&mut self, i: usize) {
        let w = &self.walkers[i];
        let own = &self.network.stretches[w.stretch].line;
        let at = own.project_between(w.position, w.segment.saturating_sub(2), w.segment + 3);
        self.walkers[i].s = at.s;
        self.walkers[i].segment = at.segment;
        let w = &self.walkers[i];
        let (remaining, _) = self.network.ahead(w);
        if remaining > LOOK_AHEAD {
            return;
        }
        if let Some((next, forward)) = self.onward(w) {
            let stretch = &self.network.stretches[next];
            let at = stretch.line.project(w.position);
            // A pedestrian who aims at the near side of the next stretch may reach it long before the end
            // of this one.
            if remaining > END_DISTANCE && at.distance > stretch.half {
                return;
            }
            let w = &mut self.walkers[i];
            (w.before, w.stretch, w.forward) = (Some(w.stretch), next, forward);
            (w.s, w.segment) = (at.s, at.segment);
        }
    }
}

#[cfg(test)]
mod tests {
    use reactsim_geometry::wrap;

    use super::super::tests::{crowd, street};
    use super::super::{Person, Surroundings};

    #[test]
    fn nobody_spins_at_the_corner_of_a_crossing() {
        let layout = street(false);
        let mut crowd = crowd(&layout, 21, 20);
        let (mut history, mut turned_off) = (Vec::<Vec<Person>>::new(), 0);
        for step in 0..1200 {
            crowd.step(0.1, &Surroundings::default());
            history.push(crowd.people().collect());
            turned_off += crowd.walkers.iter().filter(|w| w.before.is_some()).count();
            let Some(first) = history.len().checked_sub(31) else { continue };
            for p in &history[first] {
                let track = history[first..].iter().map(|now| now.iter().find(|q| q.id == p.id));
                let Some(track) = track.collect::<Option<Vec<&Person>>>() else { continue };
                let here = track.iter().all(|q| (q.position - p.position).norm() < 0.5);
                let turned: f64 = track.windows(2).map(|q| wrap(q[1].heading - q[0].heading).abs()).sum();
                assert!(!here || turned < 3.0, "{step}: turns by {turned} on the spot: {p:?}");
            }
        }
        assert!(turned_off > 0);
    }
}
