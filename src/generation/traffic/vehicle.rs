//! A vehicle or bicycle on its way: state and motion.

use super::driver::{Driver, MOTORWAY};
use super::fleet::Size;
use super::following::{HARDEST, Leader};
use super::network::Network;
use crate::dynamics::Pose;
use crate::generation::Draw;
use crate::geometry::{Vec2, direction, left, smooth_step};
use crate::rollout::Stream;

/// How fast accelerations grow and fall, m/s³.
const JERK: (f64, f64) = (2.5, 4.0);
/// The same when it is urgent.
const URGENT_JERK: f64 = 20.0;
/// From this braking on it is urgent, m/s².
const URGENT: f64 = 3.2;
/// How fast the wheel is turned: change of the curvature, 1/m per second; and lateral jerk, m/s³.
const STEERING: f64 = 0.35;
const LATERAL_JERK: f64 = 8.0;
/// Observations that are remembered, one per decision.
const MEMORY: usize = 8;
/// How long errors of perception and of lane keeping last, s.
const NOISE_TIME: f64 = 3.0;
const WANDER_TIME: f64 = 7.0;
const MOOD_TIME: f64 = 5.0;

/// What of a vehicle matters for its motion.
#[derive(Clone, Copy, Debug)]
pub(super) struct Body {
    /// Length and width, metres.
    pub(super) length: f64,
    pub(super) width: f64,
    /// How far the rear axle lies behind the box centre, metres.
    rear: f64,
    /// Largest curvature of the rear axle's way, 1/m.
    curvature: f64,
}

impl Body {
    pub(super) fn of(size: &Size) -> Self {
        let (rear, radius) = (size.rear_axle(), size.turning_radius());
        let curvature = 1.0 / (radius * radius - rear * rear).sqrt();
        Self { length: size.length, width: size.width, rear, curvature }
    }
}

/// Room that is left to the side of the lane at least, metres.
const SIDE_ROOM: f64 = 0.2;
/// Half of the width below which a lane is narrow, metres.
const NARROW: f64 = 1.6;

/// A lane change that is under way.
#[derive(Clone, Copy, Debug)]
pub(super) struct Change {
    /// The way that is left, while it is beside the one that the vehicle is on.
    pub(super) from: Option<usize>,
    /// Offset from the new way when it began, m.
    start: f64,
    /// Seconds since then, of which slow ones count less.
    age: f64,
}

/// One road user on wheels.
pub(super) struct Vehicle {
    pub(super) id: u32,
    pub(super) body: Body,
    pub(super) driver: Driver,
    /// The middle of the rear axle.
    rear: Pose,
    pub(super) speed: f64,
    pub(super) acceleration: f64,
    curvature: f64,
    /// The way it is on and the next ones.
    pub(super) path: Vec<usize>,
    pub(super) goal: usize,
    /// Arc length of the box centre on the first way of the path, metres.
    pub(super) s: f64,
    /// Lateral offset of the box centre there, metres.
    pub(super) offset: f64,
    pub(super) change: Option<Change>,
    /// The way before which it means to stop, by the last decision.
    pub(super) held: Option<usize>,
    /// The way before which it has stopped as the sign asks, and when.
    pub(super) stopped: Option<(usize, f64)>,
    /// Since when it stands, s of the simulation; infinite while it moves.
    pub(super) standing_since: f64,
    /// The way whose yellow light it has decided to pass.
    pub(super) passes_yellow: Option<usize>,
    /// Whether its front has just passed a red light.
    pub(super) passed_red: bool,
    /// When it last began a lane change, s.
    pub(super) changed_at: f64,
    wander: f64,
    /// How much more or less than the wanted speed is driven just now, in deviations.
    pub(super) mood: f64,
    noise: (f64, f64),
    /// The last speeds of leaders, with their ids.
    seen: [Option<(u32, f64)>; MEMORY],
    seen_next: usize,
}

impl Vehicle {
    /// Somebody at `s` of the first way of a path.
    #[expect(clippy::too_many_arguments, reason = "all of it is what makes a vehicle")]
    pub(super) fn new(
        network: &Network,
        id: u32,
        body: Body,
        driver: Driver,
        path: Vec<usize>,
        goal: usize,
        s: f64,
        speed: f64,
    ) -> Self {
        let way = &network.ways[path[0]];
        let heading = way.line.heading_at(s);
        let along = direction(heading);
        let center = way.line.at(s) + left(along) * driver.bias;
        Self {
            id,
            body,
            driver,
            rear: Pose { position: center - along * body.rear, heading },
            speed,
            acceleration: 0.0,
            curvature: 0.0,
            path,
            goal,
            s,
            offset: driver.bias,
            change: None,
            held: None,
            stopped: None,
            standing_since: f64::INFINITY,
            passes_yellow: None,
            passed_red: false,
            changed_at: 0.0,
            wander: 0.0,
            mood: 0.0,
            noise: (0.0, 0.0),
            seen: [None; MEMORY],
            seen_next: 0,
        }
    }

    /// Puts a vehicle that has not moved yet elsewhere on the way.
    pub(super) fn place(&mut self, network: &Network, s: f64) {
        let line = &network.ways[self.path[0]].line;
        self.rear.position += line.at(s) - line.at(self.s);
        self.rear.heading = line.heading_at(s);
        self.s = s;
    }

    /// The box centre and the heading.
    pub(super) fn pose(&self) -> Pose {
        let Pose { position, heading } = self.rear;
        Pose { position: position + direction(heading) * self.body.rear, heading }
    }

    /// Velocity of the box centre, m/s: that of the rear axle and the turning.
    pub(super) fn velocity(&self) -> Vec2 {
        let along = direction(self.rear.heading);
        (along + left(along) * (self.curvature * self.body.rear)) * self.speed
    }

    /// Arc length of the front bumper on the first way of the path.
    pub(super) fn front(&self) -> f64 {
        self.s + 0.5 * self.body.length
    }

    /// Errors of perception and lane keeping go on (Ornstein-Uhlenbeck processes).
    pub(super) fn drift(&mut self, dt: f64, rng: &mut Stream) {
        let next = |value: f64, time: f64, rng: &mut Stream| {
            let keep = 1.0 - dt / time;
            value * keep + (1.0 - keep * keep).sqrt() * rng.normal()
        };
        self.noise.0 = next(self.noise.0, NOISE_TIME, rng);
        self.noise.1 = next(self.noise.1, NOISE_TIME, rng);
        self.mood = next(self.mood, MOOD_TIME, rng).clamp(-2.0, 2.0);
        self.wander = next(self.wander, WANDER_TIME, rng).clamp(-2.5, 2.5);
    }

    /// Notes what is seen of the leader now, and gives what the driver is aware of: its speed some time ago, with errors.
    pub(super) fn perceive(&mut self, leader: Option<(Leader, u32)>, dt: f64) -> Option<Leader> {
        self.seen[self.seen_next] = leader.map(|(l, id)| (id, l.speed));
        let age = ((self.driver.delay / dt).round() as usize).min(MEMORY - 1);
        let old = self.seen[(self.seen_next + MEMORY - age) % MEMORY];
        self.seen_next = (self.seen_next + 1) % MEMORY;
        let (now, id) = leader?;
        let then = old.filter(|o| o.0 == id).map_or(now.speed, |o| o.1);
        // Slow ones are told from standing ones.
        let speed = then + self.driver.noise.0 * self.noise.0 * (now.speed / 8.0).min(1.0);
        let error = (self.driver.noise.1 * self.noise.1 * now.gap).clamp(-2.0, 2.0);
        Some(Leader { gap: now.gap + error, speed: speed.max(0.0) })
    }

    /// Begins a lane change: from now on the vehicle is on `way`, at `s` and `offset` of it.
    pub(super) fn begin_change(&mut self, s: f64, offset: f64, path: Vec<usize>) {
        self.change = Some(Change { from: Some(self.path[0]), start: offset, age: 0.0 });
        (self.s, self.offset, self.path) = (s, offset, path);
    }

    /// Moves on for `dt` seconds towards the acceleration that was decided.
    pub(super) fn advance(&mut self, network: &Network, decided: f64, dt: f64) {
        let decided = decided.max(-HARDEST);
        let urgent = decided < -URGENT;
        let (up, down) = if urgent { (JERK.0, URGENT_JERK) } else { JERK };
        let up = if self.acceleration < 0.0 { up * 2.5 } else { up };
        self.acceleration += (decided - self.acceleration).clamp(-down * dt, up * dt);
        if self.speed < 0.05 && self.acceleration <= 0.0 {
            (self.speed, self.acceleration) = (0.0, self.acceleration.max(-0.2));
            return;
        }
        let speed = (self.speed + self.acceleration * dt).max(0.0);
        let distance = 0.5 * (self.speed + speed) * dt;
        self.speed = speed;
        self.steer(network, dt);
        self.rear = self.rear.advance(distance, self.curvature);
        self.follow_way(network, distance);
        if let Some(change) = &mut self.change {
            // Who crawls gets over more slowly.
            change.age += dt * (self.speed / 3.0).min(1.0);
            if change.age > self.driver.change_time + 1.0 {
                self.change = None;
            }
        }
    }

    /// Pure pursuit of a point on the path (Coulter 1992), by the rear axle.
    fn steer(&mut self, network: &Network, dt: f64) {
        let (fixed, per_speed) = self.driver.preview;
        let reach = (fixed + per_speed * self.speed).max(0.75 * self.body.length - 1.0);
        let way = &network.ways[self.path[0]];
        let at = self.s - self.body.rear + reach;
        let on = network.ahead(&self.path, at);
        let along = {
            let d = network.ahead(&self.path, at + 0.5) - network.ahead(&self.path, at - 0.5);
            d / d.norm().max(1e-9)
        };
        let room = (way.half_width - 0.5 * self.body.width - SIDE_ROOM).max(0.05);
        // In junctions, on narrow lanes and at speed drivers keep to their lane more closely.
        let calm = if way.connector {
            0.5
        } else if way.limit > MOTORWAY {
            0.7
        } else if way.half_width < NARROW {
            0.8
        } else {
            1.0
        };
        let place = calm * (self.driver.bias + self.driver.wandering * self.wander);
        let mut offset = place.clamp(-room, room);
        if let Some(change) = self.change {
            let left_to_do =
                1.0 - smooth_step((change.age + reach / self.speed.max(3.0) * 0.5) / self.driver.change_time);
            offset += change.start * left_to_do;
        }
        let target = on + left(along) * offset;
        let ahead = direction(self.rear.heading);
        let to = target - self.rear.position;
        let wanted = 2.0 * ahead.perp(&to) / to.norm_squared().max(1.0);
        let most = self.body.curvature;
        let rate = STEERING.min(LATERAL_JERK / (self.speed * self.speed).max(0.01)) * dt;
        self.curvature += (wanted.clamp(-most, most) - self.curvature).clamp(-rate, rate);
    }

    /// Finds the place on the way anew, and goes over to the next way at the end of one.
    fn follow_way(&mut self, network: &Network, distance: f64) {
        let center = self.pose().position;
        loop {
            let line = &network.ways[self.path[0]].line;
            let near = line.segment_from((self.s + distance).max(0.0), line.segment_at(self.s.max(0.0)));
            let found = line.project_between(center, near.saturating_sub(2), near + 3);
            let last = line.points()[line.segments()];
            let over = (center - last).dot(&network.ways[self.path[0]].end);
            self.offset = found.offset;
            if found.s >= line.length() - 1e-9 && over >= 0.0 && self.path.len() > 1 {
                let length = line.length();
                self.path.remove(0);
                self.s -= length;
                if let Some(change) = &mut self.change {
                    // The neighbour that is left ends here too; what remains of the change goes on beside the next way.
                    change.from = None;
                }
                continue;
            }
            self.s =
                if over >= 0.0 && found.s >= line.length() - 1e-9 { line.length() + over } else { found.s };
            return;
        }
    }
}
