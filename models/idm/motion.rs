//! The traffic of one episode: decisions at every planning interval, motion at every step.

use reactsim::dynamics::{DrivenPath, Pose};
use reactsim::geometry::{OrientedBox, Vec2, direction, heading_of, wrap};
use reactsim::rollout::{Observation, Planning, Stream};
use reactsim::scene::{Agent, AgentKind, AgentState, DT, Start};

use super::actor::Actor;
use super::corridor::{self, Corridor};
use super::decide::{Situation, decide};
use super::driver::{Driver, OnPath};
use super::evade::Surroundings;
use super::forecast::{Forecast, forecast_all};
use super::parameters::{Limits, Parameters};
use super::route::{self, Motion};
use super::signals::{self, MustStop};

/// Steps between two decisions; plans of fewer steps decide at every plan.
const DECIDE_EVERY: usize = 5;

/// Farther from the middle of its lane the AV may mean to be, metres.
const BESIDE: f64 = 0.5;
/// An AV at a larger angle comes head on, rad, if its curvature is less than this, 1/m.
const HEAD_ON: f64 = 2.3;
const TURNS: f64 = 0.03;
/// Slower drivers wait, m/s, if they would speed up by more than this, m/s².
const WAITING: f64 = 0.3;
const WILLING: f64 = 0.3;
/// Decisions without danger after which a driver who has kept aside goes back to the lane.
const QUIET: usize = 3;
/// At most so many ways are kept for the AV, those that cost at most so much more than the likeliest; for so many plans.
const RAILS: usize = 3;
const RAIL_DOUBT: f64 = 1.2;
const RAILS_LAST: usize = 3;
/// The AV keeps to a way when it is this close to it (metres, radians) and has this long to go on it (seconds).
const KEEPS: (f64, f64, f64) = (0.4, 0.1, 4.5);

/// What the model keeps of an episode.
#[derive(Debug)]
pub struct Traffic {
    drivers: Vec<Driver>,
    actors: Vec<Actor>,
    /// Ways along lanes that the AV may take.
    av_rails: Vec<DrivenPath>,
    rails_age: usize,
    av_curvature: f64,
}

/// What a driver does until the next decision.
#[derive(Clone, Debug, Default)]
struct Intent {
    corridor: Corridor,
    stop: Option<MustStop>,
    chosen: Option<f64>,
    /// Whether `chosen` is a way out that has been checked against everybody.
    escaping: bool,
    /// Whether `chosen` is faster than car following.
    hurries: bool,
}

impl Traffic {
    pub(super) fn begin(start: &Start, parameters: &Parameters, stream: &mut Stream) -> Self {
        let drivers: Vec<Driver> =
            (0..start.agents.len()).map(|i| Driver::begin(start, i, parameters, stream)).collect();
        let mut actors: Vec<Actor> = (0..start.agents.len())
            .map(|i| {
                let now = start.now(i);
                let speed = match &drivers[i] {
                    Driver::Parked => 0.0,
                    Driver::Reversing => now.forward_speed(),
                    _ => now.velocity().map_or(0.0, |v| v.norm()),
                };
                let acceleration =
                    if matches!(drivers[i], Driver::OnPath(_)) { recent(start, i) } else { 0.0 };
                actor(&start.agents[i], &now, speed, acceleration)
            })
            .collect();
        actors.extend(start.obstacles.iter().map(|o| Actor {
            kind: AgentKind::Other,
            is_av: false,
            pose: Pose { position: o.center, heading: heading_of(o.axis) },
            speed: 0.0,
            acceleration: 0.0,
            half_length: o.half_length,
            half_width: o.half_width,
        }));
        Self { drivers, actors, av_rails: Vec::new(), rails_age: 0, av_curvature: 0.0 }
    }

    /// Plans all steps that are asked for.
    pub(super) fn plan(&mut self, parameters: &Parameters, episode: &mut Planning<'_, '_>) {
        let seen = episode.seen;
        if !episode.moves_av {
            self.observe_av(&seen, parameters);
        }
        let agents = seen.start().agents.len();
        let mut intents: Vec<Intent> = vec![Intent::default(); agents];
        let mut walks = vec![true; agents];
        for k in 0..episode.plan.steps() {
            if k % DECIDE_EVERY == 0 {
                self.decide_all(&seen, parameters, &mut intents, &mut walks);
            }
            let since = (k % DECIDE_EVERY) as f64 * DT;
            for i in 0..agents {
                self.step(i, &intents[i], walks[i], since, parameters);
                let a = &self.actors[i];
                let velocity = direction(a.pose.heading) * a.speed;
                let state = AgentState {
                    x: a.pose.position.x,
                    y: a.pose.position.y,
                    heading: a.pose.heading,
                    vx: velocity.x,
                    vy: velocity.y,
                };
                episode.plan.set(i, k, Some(state));
            }
        }
    }

    /// Takes the AV as it is now, with the newest speed, turn and acceleration that may be seen.
    fn observe_av(&mut self, seen: &Observation<'_>, parameters: &Parameters) {
        self.drivers[0] = Driver::External;
        let Some(now) = seen.state(0) else { return };
        let track = seen.track(0);
        let mut recent: Vec<AgentState> =
            track[track.len().saturating_sub(4)..].iter().flatten().copied().collect();
        recent.extend(seen.av_next());
        let speeds: Vec<f64> =
            recent.windows(2).map(|w| (w[1].position() - w[0].position()).norm() / DT).collect();
        let speed = speeds.last().copied().unwrap_or_else(|| now.speed());
        let acceleration = match (speeds.first(), speeds.len()) {
            (Some(first), n) if n > 1 => (speed - first) / (DT * (n - 1) as f64),
            _ => 0.0,
        };
        let newest = recent.last().copied().unwrap_or(now);
        let way: f64 = speeds.iter().sum::<f64>() * DT;
        self.av_curvature = match recent.first() {
            Some(first) if way > 0.3 => (wrap(newest.heading - first.heading) / way).clamp(-0.3, 0.3),
            _ => 0.0,
        };
        let mut av = actor(&seen.start().agents[0], &now, speed, acceleration);
        av.pose.heading = newest.heading;
        av.is_av = true;
        self.actors[0] = av;
        self.find_rails(seen, &av, parameters);
    }

    /// Finds the ways along lanes that the AV may take: the likeliest, and those that are nearly as likely. They are kept while the
    /// AV keeps to one of them and can not have passed a branch.
    fn find_rails(&mut self, seen: &Observation<'_>, av: &Actor, parameters: &Parameters) {
        if self.rails_age < RAILS_LAST && !self.av_rails.is_empty() {
            let keeps = self.av_rails.iter().any(|rail| {
                let at = rail.project(av.pose.position, 0, usize::MAX, None);
                let heading = rail.points()[at.index].pose.heading;
                at.offset.abs() < KEEPS.0
                    && wrap(heading - av.pose.heading).abs() < KEEPS.1
                    && rail.length() - at.s > KEEPS.2 * av.speed
            });
            if keeps {
                self.rails_age += 1;
                return;
            }
        }
        self.rails_age = 0;
        let road = seen.start().road();
        let motion = Motion {
            position: av.pose.position,
            heading: av.pose.heading,
            speed: av.speed,
            curvature: self.av_curvature,
        };
        let mut ways = route::alternatives(&road, &motion, false);
        ways.sort_by(|a, b| a.0.total_cmp(&b.0));
        let least = ways.first().map_or(0.0, |w| w.0);
        ways.retain(|w| w.0 < least + RAIL_DOUBT);
        ways.truncate(RAILS);
        self.av_rails.clear();
        for (_, route) in ways {
            let length = 8.0 * av.speed + 20.0;
            let Some((line, _)) = route::center_line(&road, &route, length) else { continue };
            let pursuit = parameters.vehicle.pursuit(av.speed);
            let offset = line.project(av.pose.position).offset;
            self.av_rails.push(DrivenPath::pursue(av.pose, self.av_curvature, &line, length, &pursuit));
            // An AV beside the middle of its lane may come back to it, or mean to stay there.
            if offset.abs() > BESIDE {
                let beside = line.aside(offset);
                self.av_rails.push(DrivenPath::pursue(av.pose, self.av_curvature, &beside, length, &pursuit));
            }
        }
    }

    fn decide_all(
        &mut self,
        seen: &Observation<'_>,
        parameters: &Parameters,
        intents: &mut [Intent],
        walks: &mut [bool],
    ) {
        let settings = &parameters.conflict;
        let forecasts =
            forecast_all(&self.actors, &self.drivers, self.av_curvature, &self.av_rails, settings);
        for i in 0..self.drivers.len() {
            match &mut self.drivers[i] {
                Driver::OnPath(_) => intents[i] = self.decide_one(i, seen, &forecasts, parameters),
                Driver::Walking { velocity } => {
                    let velocity = *velocity;
                    walks[i] = self.may_walk(i, velocity, &forecasts, parameters);
                }
                Driver::Parked | Driver::Leaving { .. } | Driver::Reversing | Driver::External => {}
            }
        }
    }

    fn decide_one(
        &mut self,
        i: usize,
        seen: &Observation<'_>,
        forecasts: &[Forecast],
        parameters: &Parameters,
    ) -> Intent {
        let own = self.actors[i];
        let settings = &parameters.conflict;
        let class = if own.kind == AgentKind::Cyclist { &parameters.cyclist } else { &parameters.vehicle };
        let around =
            Surroundings { index: i, actors: &self.actors, forecasts, road: seen.start().road(), settings };
        let Driver::OnPath(driver) = &mut self.drivers[i] else { return Intent::default() };
        if let Some((offset, quiet)) = driver.aside {
            // Back to the own lane when nothing has been in the way for a while, and nothing will be on the way back.
            driver.aside = Some((offset, quiet + 1));
            if quiet >= QUIET {
                let back = around.course(&own, driver, class, 0.0, f64::INFINITY);
                if !around.meets_av(&own, &back, 0.0, 0.0) {
                    driver.take(back, class);
                    driver.aside = None;
                }
            }
        }
        let stop = signals::next_stop(seen, &own, driver);
        let corridor = corridor::look(i, &own, driver, &self.actors, forecasts, settings);
        let mut intent = Intent { corridor, stop, chosen: None, ..Intent::default() };
        let wanted = following(driver, &own, &intent, 0.0);
        driver.waits = own.speed < WAITING && wanted > WILLING;
        let Driver::OnPath(driver) = &self.drivers[i] else { return intent };
        let situation = Situation {
            index: i,
            own: &own,
            driver,
            corridor: &intent.corridor,
            actors: &self.actors,
            drivers: &self.drivers,
            parameters,
        };
        intent.chosen = decide(&situation, wanted);
        intent.hurries = intent.chosen.is_some_and(|a| a > wanted);
        // Who would brake for an AV head on would stand in its way: first it is seen whether there is room to pass. Not so for one
        // that turns across.
        let av = self.actors.first().filter(|av| av.is_av && self.av_curvature.abs() < TURNS);
        let head_on = av.is_some_and(|av| wrap(av.pose.heading - own.pose.heading).abs() > HEAD_ON)
            && intent.corridor.crossings.iter().any(|c| c.actor == 0 && !c.from_behind);
        let planned = if head_on { wanted } else { intent.chosen.unwrap_or(wanted) };
        let a = planned.max(-parameters.limits.emergency_deceleration);
        let Some(escape) = around.escape(&own, driver, class, a, intent.stop) else { return intent };
        intent.chosen = Some(escape.acceleration);
        intent.escaping = true;
        let Driver::OnPath(driver) = &mut self.drivers[i] else { return intent };
        if let Some((offset, path)) = escape.course {
            driver.take(path, class);
            driver.aside = Some((offset, 0));
            let Driver::OnPath(driver) = &self.drivers[i] else { return intent };
            intent.corridor = corridor::look(i, &own, driver, &self.actors, forecasts, settings);
            intent.stop = None;
        } else if let Some((_, quiet)) = &mut driver.aside {
            *quiet = 0;
        }
        intent
    }

    /// Whether a walker can go on without walking into a vehicle or standing in the way of none.
    fn may_walk(
        &self,
        index: usize,
        velocity: Vec2,
        forecasts: &[Forecast],
        parameters: &Parameters,
    ) -> bool {
        let own = &self.actors[index];
        let settings = &parameters.pedestrian;
        let reach = velocity.norm() * settings.look_ahead + own.half_length + settings.clearance;
        let around = reactsim::geometry::Bounds::around(own.pose.position, reach);
        let meets = |forecast: &Forecast, velocity: Vec2, clearance: f64| {
            let other = &self.actors[forecast.actor];
            // Who stands is in the way for as long as it stands: one second ahead is soon enough to stop.
            let standing = forecast.samples.len() == 1;
            let last = if standing { 1.0 } else { settings.look_ahead };
            let steps = (last / parameters.conflict.sample).round() as usize;
            (1..=steps).any(|k| {
                let t = k as f64 * parameters.conflict.sample;
                let sample = forecast.samples[if standing { 0 } else { k.min(forecast.samples.len() - 1) }];
                let theirs = OrientedBox {
                    center: sample.center,
                    axis: sample.axis,
                    half_length: other.half_length + 0.5 * parameters.conflict.sample * sample.speed.abs(),
                    half_width: other.half_width,
                };
                let ours = OrientedBox { center: own.pose.position + velocity * t, ..own.footprint() };
                theirs.separation(&ours) < clearance
            })
        };
        for forecast in forecasts {
            let other = &self.actors[forecast.actor];
            if forecast.actor == index
                || !matches!(other.kind, AgentKind::Vehicle | AgentKind::Cyclist)
                || !around.intersects(&forecast.bounds)
                || other.footprint().separation(&own.footprint()) < 0.0
            {
                continue;
            }
            if meets(forecast, velocity, settings.clearance) && !meets(forecast, Vec2::zeros(), 0.1) {
                return false;
            }
        }
        true
    }

    /// Moves one agent by one step.
    fn step(&mut self, i: usize, intent: &Intent, walks: bool, since: f64, parameters: &Parameters) {
        let own = &mut self.actors[i];
        match &mut self.drivers[i] {
            Driver::Parked | Driver::External => own.speed = if i == 0 { own.speed } else { 0.0 },
            Driver::Reversing => {
                let slower = (own.speed + 2.0 * DT).min(0.0);
                let way = 0.5 * (own.speed + slower) * DT;
                own.speed = slower;
                own.pose = own.pose.advance(way, 0.0);
            }
            Driver::Walking { velocity } => {
                // A walker stops and starts within half a second.
                let full = velocity.norm();
                let change = 2.0 * full * DT;
                own.speed = (own.speed + if walks { change } else { -2.0 * change }).clamp(0.0, full);
                own.pose.position += *velocity * (own.speed / full * DT);
            }
            Driver::Leaving { velocity, way, then } => {
                let step = *velocity * DT;
                own.pose.position += step;
                *way -= step.norm();
                if *way <= 0.0 {
                    own.speed = 0.0;
                    let then = *then;
                    let walks = then.norm() >= parameters.pedestrian.standing_speed;
                    self.drivers[i] = if walks { Driver::Walking { velocity: then } } else { Driver::Parked };
                }
            }
            Driver::OnPath(driver) => {
                let mut wanted = following(driver, own, intent, since);
                if let Some(chosen) = intent.chosen {
                    // An escape may be faster than car following would go, but never into a leader.
                    wanted = if chosen > wanted && intent.corridor.leaders.is_empty() {
                        chosen
                    } else {
                        wanted.min(chosen)
                    };
                }
                let a = limited(own.acceleration, wanted, intent.escaping, &parameters.limits);
                let next = (own.speed + a * DT).max(0.0);
                let way = 0.5 * (own.speed + next) * DT;
                own.acceleration = if next > 0.0 { a } else { 0.0 };
                own.speed = next;
                driver.s += way;
                own.pose = driver.path.at(driver.s);
            }
        }
    }
}

/// The acceleration that leaders, stops and the road ask for, `since` seconds after they were looked at.
fn following(driver: &OnPath, own: &Actor, intent: &Intent, since: f64) -> f64 {
    let style = &driver.style;
    let v = own.speed;
    let front = driver.s + own.half_length;
    let ceiling = |s: f64| driver.ceiling[driver.path.index(s).min(driver.ceiling.len() - 1)];
    let mut a = style.free(v, ceiling(driver.s));
    let soon = ceiling(driver.s + 0.5 * v);
    if soon < v {
        a = a.min(((soon - v) / 0.5).max(-3.5));
    }
    for leader in &intent.corridor.leaders {
        let lasting =
            if leader.acceleration < 0.0 { since.min(leader.speed / -leader.acceleration) } else { since };
        let rear =
            leader.rear + leader.speed * lasting + 0.5 * leader.acceleration.min(0.0) * lasting * lasting;
        let speed = (leader.speed + leader.acceleration.min(0.0) * lasting).max(0.0);
        a = a.min(style.behind(v, rear - front, speed, leader.acceleration));
    }
    if let Some(stop) = intent.stop {
        a = a.min(style.stop_in(v, stop.s - front));
    }
    a
}

/// The acceleration of the next step: within the limits, and not too far from the last one.
fn limited(last: f64, wanted: f64, escaping: bool, limits: &Limits) -> f64 {
    let wanted = wanted.clamp(-limits.emergency_deceleration, 3.5);
    let jerk = if wanted < -3.0 || escaping { limits.emergency_jerk } else { limits.jerk };
    // Brakes are let go faster than comfort asks when the reason is gone.
    let up = if escaping || last < 0.0 { 2.5 * limits.jerk } else { limits.jerk };
    wanted.clamp(last - jerk * DT, last + up * DT)
}

fn actor(agent: &Agent, now: &AgentState, speed: f64, acceleration: f64) -> Actor {
    Actor {
        kind: agent.kind,
        is_av: false,
        pose: Pose::from(*now),
        speed,
        acceleration,
        half_length: 0.5 * agent.length,
        half_width: 0.5 * agent.width,
    }
}

/// Acceleration over the last half second, within what drivers do on purpose, m/s².
fn recent(start: &Start, agent: usize) -> f64 {
    let track = &start.history[agent];
    let last = track.len() - 1;
    match (track[last], track[last - 5]) {
        (Some(now), Some(before)) => {
            let a = (now.speed() - before.speed()) / (5.0 * DT);
            if a.is_finite() { a.clamp(-4.0, 2.0) } else { 0.0 }
        }
        _ => 0.0,
    }
}
