//! Initial placement of people, arrivals and departures.

use rand::{RngExt, SeedableRng};
use reactsim_geometry::Vec2;
use reactsim_rollout::Stream;

use super::motion::{BODY_CLEARANCE, StepBuffers};
use super::network::Network;
use super::walker::{Activity, Walker};
use super::{Crossing, Crowd, crossing};
use crate::{Draw, Layout};

/// A class of maps by the density of people on their footways.
struct Busyness {
    /// Minimum density, people per 100 m at density 1.
    low: f64,
    /// Maximum density, people per 100 m at density 1.
    high: f64,
    /// Share of maps.
    share: f64,
}

/// Classes of maps, chosen so that numbers of people near the AV are distributed as in the recording (see
/// the module).
const BUSYNESS: [Busyness; 4] = [
    Busyness { low: 0.0, high: 0.25, share: 0.45 },
    Busyness { low: 0.25, high: 1.0, share: 0.35 },
    Busyness { low: 1.0, high: 2.5, share: 0.16 },
    Busyness { low: 2.5, high: 5.0, share: 0.04 },
];
/// Maximum number of people.
const MAX_PEOPLE: usize = 60;
/// Share of groups that stand at the beginning. 9 % of the recorded people stand throughout.
const STANDING_SHARE: f64 = 0.1;
/// Minimum time for which such groups stand, seconds.
const STANDING_TIME_MIN: f64 = 20.0;
/// Maximum time for which such groups stand, seconds.
const STANDING_TIME_MAX: f64 = 150.0;
/// Maximum number of attempts to place a group.
const MAX_TRIES: usize = 8;
/// Mean time until a missing person is replaced, seconds.
const RENEWAL_TIME: f64 = 12.0;

pub(super) fn crowd(layout: &Layout, density: f64, rng: &mut Stream) -> Crowd {
    let network = Network::new(layout);
    let crossings: Vec<Crossing> = network
        .crossings
        .iter()
        .map(|&footway| Crossing {
            footway,
            kerbs: crossing::kerbs(layout, footway),
            light: !layout.footways[footway].waits_for.is_empty(),
            people: Vec::new(),
        })
        .collect();
    let depths = network.crossings.iter().map(|&f| layout.footways[f].width).collect();
    let at = (0..crossings.len())
        .filter_map(|c| network.stretches.iter().position(|s| s.crossing == Some(c)))
        .collect();
    let lengths = network.stretches.iter().map(|s| if s.crossing.is_some() { 0.0 } else { s.line.length() });
    let lengths: Vec<f64> = lengths.collect();
    let total: f64 = lengths.iter().sum();
    let Busyness { low, high, .. } = BUSYNESS[rng.weighted(&BUSYNESS.map(|b| b.share))];
    let expected = rng.uniform(low, high) * density * total / 100.0;
    let wanted = ((expected + rng.uniform(0.0, 1.0)) as usize).min(MAX_PEOPLE);
    let mut crowd = Crowd {
        network,
        crossings,
        depths,
        at,
        walkers: Vec::new(),
        pending: Vec::new(),
        wanted,
        next_id: 0,
        rng: Stream::seed_from_u64(rng.random()),
        buffers: StepBuffers::default(),
    };
    if total > 0.0 {
        // Attempts are bounded: a short footway may hold fewer people.
        for _ in 0..4 * wanted {
            if crowd.walkers.len() >= wanted {
                break;
            }
            crowd.add(&lengths);
        }
    }
    crowd
}

impl Crowd {
    /// Draws a group, without goals yet.
    fn group(&mut self) -> Vec<Walker> {
        let group = Walker::group(self.next_id, &mut self.rng);
        self.next_id += group.len() as u64;
        group
    }

    /// Places a group somewhere on a footway, if there is room.
    fn add(&mut self, lengths: &[f64]) {
        let group = self.group();
        let standing = self.rng.chance(STANDING_SHARE);
        for _ in 0..MAX_TRIES {
            let stretch = self.rng.weighted(lengths);
            let goal = self.rng.count(0, self.network.goals.len() - 1);
            let Some(forward) = self.walking_direction(stretch, goal) else { continue };
            let s = self.rng.uniform(0.0, lengths[stretch]);
            let stay = self.rng.uniform(STANDING_TIME_MIN, STANDING_TIME_MAX);
            let mut placed = group.clone();
            for w in &mut placed {
                self.place(w, stretch, forward, s);
                w.goal = goal;
                if standing {
                    w.side = if w.side < 0.0 { -1.0 } else { 1.0 };
                    w.activity = Activity::Standing(stay);
                }
            }
            if standing {
                self.stand(&mut placed, s);
            }
            let room = |w: &Walker, o: &Walker| {
                (w.position - o.position).norm() > w.radius + o.radius + 2.0 * BODY_CLEARANCE
                    || self.are_apart(w, o)
            };
            let free = placed.iter().enumerate().all(|(i, w)| {
                self.walkers.iter().chain(&placed[..i]).all(|o| room(w, o)) && self.on_ground(w) == w.position
            });
            if free {
                self.walkers.extend(placed);
                return;
            }
        }
    }

    /// Returns the direction along a stretch that leads to a goal: `true` along its line.
    fn walking_direction(&self, stretch: usize, goal: usize) -> Option<bool> {
        let ends = self.network.stretches[stretch].ends;
        let [begin, end] = ends.map(|n| self.network.next(goal, n));
        if begin == Some(stretch) {
            Some(true)
        } else if end == Some(stretch) {
            Some(false)
        } else {
            [true, false].into_iter().find(|&f| self.network.leads(goal, ends[usize::from(f)]))
        }
    }

    /// Places a pedestrian on a stretch, walking.
    fn place(&self, w: &mut Walker, stretch: usize, forward: bool, s: f64) {
        let on = &self.network.stretches[stretch];
        let length = on.line.length();
        (w.stretch, w.forward) = (stretch, forward);
        w.s = (s - w.sign() * w.lag(on.half)).clamp(0.0, length);
        w.segment = on.line.segment_at(w.s);
        w.position = on.point(w.s, w.offset(on, forward), w.segment);
        w.facing = on.along(w.segment) * w.sign();
        w.velocity = w.facing * w.desired_speed;
    }

    /// Places a standing group at the edge of a footway: a single person looks around, several face each
    /// other.
    fn stand(&mut self, group: &mut [Walker], s: f64) {
        for (k, w) in group.iter_mut().enumerate() {
            let on = &self.network.stretches[w.stretch];
            w.velocity = Vec2::zeros();
            w.s = (s + 1.1 * k as f64).min(on.line.length());
            w.segment = on.line.segment_at(w.s);
            w.position = on.point(w.s, w.side * on.half, w.segment);
        }
        let middle = group.iter().map(|w| w.position).sum::<Vec2>() / group.len() as f64;
        for w in group.iter_mut() {
            let towards = middle - w.position;
            let wobble = Vec2::new(w.rng().normal(), w.rng().normal()) * 0.15;
            let look = if towards.norm() > 0.1 { towards / towards.norm() } else { w.facing } + wobble;
            if look.norm() > 0.1 {
                w.facing = look / look.norm();
            }
        }
    }

    /// Lets people enter the map to replace those who left.
    pub(super) fn arrive(&mut self, dt: f64) {
        let pending: usize = self.pending.iter().map(Vec::len).sum();
        let missing = self.wanted.saturating_sub(self.walkers.len() + pending);
        if missing > 0
            && !self.network.exits.is_empty()
            && self.rng.chance(missing as f64 * dt / RENEWAL_TIME)
        {
            self.summon();
        }
        let mut pending = std::mem::take(&mut self.pending);
        for group in &mut pending {
            // Companions who walk abreast enter together, others one after the other.
            while let Some(w) = group.first() {
                let clear = |o: &Walker| {
                    (o.position - w.position).norm() > o.radius + w.radius + 0.2 || self.are_apart(w, o)
                };
                if !self.walkers.iter().all(clear) {
                    break;
                }
                self.walkers.push(group.remove(0));
            }
        }
        pending.retain(|group| !group.is_empty());
        self.pending = pending;
    }

    /// Creates a group that will enter at one of the exits.
    fn summon(&mut self) {
        let exit = self.network.exits[self.rng.count(0, self.network.exits.len() - 1)];
        let goal = self.rng.count(0, self.network.goals.len() - 1);
        let Some(stretch) = self.network.next(goal, exit) else { return };
        let mut group = self.group();
        let forward = self.network.stretches[stretch].ends[0] == exit;
        let length = self.network.stretches[stretch].line.length();
        for w in &mut group {
            w.goal = goal;
            self.place(w, stretch, forward, if forward { 0.0 } else { length });
        }
        self.pending.push(group);
    }

    /// Removes people who have reached the border, and gives others who have reached their goal a new one.
    pub(super) fn leave(&mut self) {
        let network = &self.network;
        let leaves_at = |goal: usize| network.exits.contains(&network.goals[goal]);
        self.walkers.retain(|w| {
            let (left, node) = network.ahead(w);
            !(left < 0.05 && node == network.goals[w.goal] && leaves_at(w.goal))
        });
        for w in &mut self.walkers {
            let (left, node) = network.ahead(w);
            if left < 0.4 && network.next(w.goal, node).is_none() && !leaves_at(w.goal) {
                let goals: Vec<usize> =
                    (0..network.goals.len()).filter(|&g| network.next(g, node).is_some()).collect();
                if !goals.is_empty() {
                    w.goal = *w.rng().pick(&goals);
                }
            }
        }
    }
}
