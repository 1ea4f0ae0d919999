//! State and motion of a vehicle or bicycle.

use reactsim_geometry::{Vec2, direction, left, smooth_step};
use reactsim_rollout::Stream;
use reactsim_scene::dynamics::Pose;

use super::driver::{Driver, MOTORWAY_LIMIT};
use super::fleet::Size;
use super::following::{Leader, MAX_BRAKING};
use super::network::Network;
use crate::Draw;

/// Maximum rate at which accelerations grow, m/s³.
const JERK_UP: f64 = 2.5;
/// Maximum rate at which accelerations fall, m/s³.
const JERK_DOWN: f64 = 4.0;
/// Maximum rate at which accelerations fall in urgent braking, m/s³.
const URGENT_JERK: f64 = 20.0;
/// Braking above which it is urgent, m/s².
const URGENT_BRAKING: f64 = 3.2;
/// Maximum steering rate: change of the curvature, 1/m per second.
const STEERING_RATE: f64 = 0.35;
/// Maximum lateral jerk, m/s³.
const LATERAL_JERK: f64 = 8.0;
/// Number of remembered observations, one per decision.
const MEMORY_LENGTH: usize = 8;
/// Correlation time of perception errors, s.
const NOISE_TIME: f64 = 3.0;
/// Correlation time of lane-keeping errors, s.
const WANDER_TIME: f64 = 7.0;
/// Correlation time of the deviation from the desired speed, s.
const MOOD_TIME: f64 = 5.0;

/// Dimensions of a vehicle that matter for its motion.
#[derive(Clone, Copy, Debug)]
pub(super) struct Body {
    /// Length, metres.
    pub(super) length: f64,
    /// Width, metres.
    pub(super) width: f64,
    /// Distance of the rear axle behind the box centre, metres.
    rear: f64,
    /// Largest curvature of the path of the rear axle, 1/m.
    curvature: f64,
}

impl Body {
    pub(super) fn of(size: &Size) -> Self {
        let (rear, radius) = (size.rear_axle(), size.turning_radius());
        let curvature = 1.0 / (radius * radius - rear * rear).sqrt();
        Self { length: size.length, width: size.width, rear, curvature }
    }
}

/// Minimum lateral clearance to the border of the lane, metres.
const SIDE_CLEARANCE: f64 = 0.2;
/// Half width, metres, below which a lane is narrow.
const NARROW_HALF_WIDTH: f64 = 1.6;

/// A lane change in progress.
#[derive(Clone, Copy, Debug)]
pub(super) struct LaneChange {
    /// The lane that the vehicle is leaving, as long as it is next to the current one.
    pub(super) from: Option<usize>,
    /// Lateral offset from the new lane at the beginning of the change, m.
    start: f64,
    /// Seconds since then; time at low speed counts less.
    age: f64,
}

/// A road user on wheels.
pub(super) struct Vehicle {
    pub(super) id: u32,
    pub(super) body: Body,
    pub(super) driver: Driver,
    /// Middle of the rear axle.
    rear: Pose,
    pub(super) speed: f64,
    pub(super) acceleration: f64,
    curvature: f64,
    /// The current lane and the following ones.
    pub(super) path: Vec<usize>,
    pub(super) goal: usize,
    /// Arc length of the box centre on the first lane of the path, metres.
    pub(super) s: f64,
    /// Lateral offset of the box centre on that lane, metres.
    pub(super) offset: f64,
    pub(super) change: Option<LaneChange>,
    /// The lane in front of which it intends to stop, by the last decision.
    pub(super) held_before: Option<usize>,
    /// The lane in front of which it has stopped for a sign, and the time of the stop.
    pub(super) stopped: Option<(usize, f64)>,
    /// Time since which it has been standing, s of the simulation; infinite while it moves.
    pub(super) standing_since: f64,
    /// The lane whose yellow light it has decided to pass.
    pub(super) passes_yellow: Option<usize>,
    /// Whether its front has just passed a red light.
    pub(super) passed_red: bool,
    /// Time at which its last lane change began, s.
    pub(super) changed_at: f64,
    wander: f64,
    /// Current deviation from the desired speed, in standard deviations.
    pub(super) mood: f64,
    /// Current error of perceived speeds, in standard deviations.
    speed_noise: f64,
    /// Current error of perceived distances, in standard deviations.
    distance_noise: f64,
    /// Recent leader ids and speeds.
    seen: [Option<(u32, f64)>; MEMORY_LENGTH],
    seen_next: usize,
}

impl Vehicle {
    /// Creates a vehicle at `s` of the first lane of a path.
    #[expect(clippy::too_many_arguments, reason = "a vehicle needs all of them")]
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
        let lane = &network.lanes[path[0]];
        let heading = lane.line.heading_at(s);
        let along = direction(heading);
        let center = lane.line.at(s) + left(along) * driver.bias;
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
            held_before: None,
            stopped: None,
            standing_since: f64::INFINITY,
            passes_yellow: None,
            passed_red: false,
            changed_at: 0.0,
            wander: 0.0,
            mood: 0.0,
            speed_noise: 0.0,
            distance_noise: 0.0,
            seen: [None; MEMORY_LENGTH],
            seen_next: 0,
        }
    }

    /// Moves a vehicle that has not driven yet to another place on its lane.
    pub(super) fn place(&mut self, network: &Network, s: f64) {
        let line = &network.lanes[self.path[0]].line;
        self.rear.position += line.at(s) - line.at(self.s);
        self.rear.heading = line.heading_at(s);
        self.s = s;
    }

    /// Returns the box centre and the heading.
    pub(super) fn pose(&self) -> Pose {
        let Pose { position, heading } = self.rear;
        Pose { position: position + direction(heading) * self.body.rear, heading }
    }

    /// Returns the velocity of the box centre, m/s: that of the rear axle plus the rotation.
    pub(super) fn velocity(&self) -> Vec2 {
        let along = direction(self.rear.heading);
        (along + left(along) * (self.curvature * self.body.rear)) * self.speed
    }

    /// Returns the arc length of the front bumper on the first lane of the path.
    pub(super) fn front(&self) -> f64 {
        self.s + 0.5 * self.body.length
    }

    /// Advances the errors of perception and lane keeping (Ornstein-Uhlenbeck processes).
    pub(super) fn drift(&mut self, dt: f64, rng: &mut Stream) {
        let next = |value: f64, time: f64, rng: &mut Stream| {
            let keep = 1.0 - dt / time;
            value * keep + (1.0 - keep * keep).sqrt() * rng.normal()
        };
        self.speed_noise = next(self.speed_noise, NOISE_TIME, rng);
        self.distance_noise = next(self.distance_noise, NOISE_TIME, rng);
        self.mood = next(self.mood, MOOD_TIME, rng).clamp(-2.0, 2.0);
        self.wander = next(self.wander, WANDER_TIME, rng).clamp(-2.5, 2.5);
    }

    /// Records the current leader, and returns the leader as the driver perceives it: with a delayed speed,
    /// and with errors.
    pub(super) fn perceive(&mut self, leader: Option<(Leader, u32)>, dt: f64) -> Option<Leader> {
        self.seen[self.seen_next] = leader.map(|(l, id)| (id, l.speed));
        let age = ((self.driver.delay / dt).round() as usize).min(MEMORY_LENGTH - 1);
        let old = self.seen[(self.seen_next + MEMORY_LENGTH - age) % MEMORY_LENGTH];
        self.seen_next = (self.seen_next + 1) % MEMORY_LENGTH;
        let (now, id) = leader?;
        let then = old.filter(|o| o.0 == id).map_or(now.speed, |o| o.1);
        // Slow leaders are distinguished from standing ones.
        let speed = then + self.driver.speed_noise * self.speed_noise * (now.speed / 8.0).min(1.0);
        let error = (self.driver.distance_noise * self.distance_noise * now.gap).clamp(-2.0, 2.0);
        Some(Leader { gap: now.gap + error, speed: speed.max(0.0) })
    }

    /// Begins a lane change: from now on the vehicle is on the first lane of `path`, at `s` and `offset` of
    /// it.
    pub(super) fn begin_change(&mut self, s: f64, offset: f64, path: Vec<usize>) {
        self.change = Some(LaneChange { from: Some(self.path[0]), start: offset, age: 0.0 });
        (self.s, self.offset, self.path) = (s, offset, path);
    }

    /// Advances by `dt` seconds, approaching the acceleration that was decided.
    pub(super) fn advance(&mut self, network: &Network, decided: f64, dt: f64) {
        let decided = decided.max(-MAX_BRAKING);
        let urgent = decided < -URGENT_BRAKING;
        let (up, down) = if urgent { (JERK_UP, URGENT_JERK) } else { (JERK_UP, JERK_DOWN) };
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
        self.follow_path(network, distance);
        if let Some(change) = &mut self.change {
            // Crawling vehicles change lanes more slowly.
            change.age += dt * (self.speed / 3.0).min(1.0);
            if change.age > self.driver.change_time + 1.0 {
                self.change = None;
            }
        }
    }

    /// Steers by pure pursuit of a point on the path (Coulter 1992), from the rear axle.
    fn steer(&mut self, network: &Network, dt: f64) {
        let (fixed, per_speed) = (self.driver.preview_distance, self.driver.preview_time);
        let reach = (fixed + per_speed * self.speed).max(0.75 * self.body.length - 1.0);
        let lane = &network.lanes[self.path[0]];
        let at = self.s - self.body.rear + reach;
        let on = network.ahead(&self.path, at);
        let along = {
            let d = network.ahead(&self.path, at + 0.5) - network.ahead(&self.path, at - 0.5);
            d / d.norm().max(1e-9)
        };
        let room = (lane.half_width - 0.5 * self.body.width - SIDE_CLEARANCE).max(0.05);
        // Drivers keep to their lane more closely in junctions, on narrow lanes and at high speed.
        let calm = if lane.connector {
            0.5
        } else if lane.limit > MOTORWAY_LIMIT {
            0.7
        } else if lane.half_width < NARROW_HALF_WIDTH {
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
        let rate = STEERING_RATE.min(LATERAL_JERK / (self.speed * self.speed).max(0.01)) * dt;
        self.curvature += (wanted.clamp(-most, most) - self.curvature).clamp(-rate, rate);
    }

    /// Updates the position on the path, and moves on to the next lane at the end of one.
    fn follow_path(&mut self, network: &Network, distance: f64) {
        let center = self.pose().position;
        loop {
            let line = &network.lanes[self.path[0]].line;
            let near = line.segment_from((self.s + distance).max(0.0), line.segment_at(self.s.max(0.0)));
            let found = line.project_between(center, near.saturating_sub(2), near + 3);
            let last = line.points()[line.segments()];
            let over = (center - last).dot(&network.lanes[self.path[0]].end);
            self.offset = found.offset;
            if found.s >= line.length() - 1e-9 && over >= 0.0 && self.path.len() > 1 {
                let length = line.length();
                self.path.remove(0);
                self.s -= length;
                if let Some(change) = &mut self.change {
                    // The lane that is being left ends here too; the rest of the change continues on the
                    // next lane.
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
