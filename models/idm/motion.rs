//! The traffic of one episode: decisions at every decision interval, motion at every step.

use reactsim_geometry::{OrientedBox, Vec2, direction, heading_of, wrap};
use reactsim_rollout::{Observation, Planning, Stream};
use reactsim_scene::dynamics::{DrivenPath, Pose, STANDSTILL_SPEED};
use reactsim_scene::{Agent, AgentKind, AgentState, DT, Frame, Road, Start};

use super::actor::Actor;
use super::corridor::{self, Corridor, View};
use super::decide::{Situation, decide};
use super::driver::{AgentBehaviour, PathFollower, REVERSING_SPEED, Sight};
use super::evade::{CONTACT_HORIZON, Surroundings};
use super::forecast::{Forecast, forecast_all};
use super::heights;
use super::parameters::{Limits, Parameters};
use super::route::{self, Motion};
use super::signals::{self, KnownLights, RequiredStop};

/// Steps between two decisions. A shorter plan makes one decision.
const DECISION_INTERVAL: usize = 5;

/// Offset of the AV from its lane, in metres, above which it may intend to keep that offset.
const CENTRED_OFFSET: f64 = 0.5;
/// Angle to the AV, in radians, above which it comes head on.
const HEAD_ON_ANGLE: f64 = 2.3;
/// Curvature in 1/m from which the AV turns across and does not count as head on.
const HEAD_ON_CURVATURE: f64 = 0.03;
/// Speed in m/s below which a driver may be waiting.
const WAITING_SPEED: f64 = 0.3;
/// Acceleration of car following, in m/s², above which a standing driver is waiting for others.
const WAITING_ACCELERATION: f64 = 0.3;
/// Number of decisions without danger after which an evading driver returns to the lane.
const QUIET_DECISIONS: usize = 3;
/// Largest number of lane routes that are considered for the AV.
const MAX_AV_ROUTES: usize = 3;
/// Largest cost of such a route above the cost of the likeliest one.
const AV_ROUTE_COST_MARGIN: f64 = 1.2;
/// Number of plans for which the AV's paths are reused.
const AV_PATHS_LIFETIME: usize = 3;

/// State of the model in an episode.
#[derive(Debug)]
pub struct Traffic {
    behaviours: Vec<AgentBehaviour>,
    actors: Vec<Actor>,
    /// Paths along lanes that the AV may take.
    av_paths: Vec<DrivenPath>,
    av_paths_age: usize,
    av_curvature: f64,
    lights: KnownLights,
}

/// Intent of a driver until the next decision.
#[derive(Clone, Debug, Default)]
struct Intent {
    corridor: Corridor,
    stop: Option<RequiredStop>,
    chosen: Option<f64>,
    /// Whether `chosen` is an evasion that has been checked against all agents.
    escaping: bool,
    /// Whether `chosen` is faster than car following.
    hurries: bool,
}

impl Traffic {
    pub(super) fn begin(start: &Start, parameters: &Parameters, stream: &mut Stream) -> Self {
        let agents = 0..start.agents.len();
        let heights: Vec<f64> = agents.clone().map(|i| start.height_now(i)).collect();
        let seen = Observation::new(start, &start.history, &start.light_history, None);
        let sights: Vec<Sight<'_>> = agents.map(|agent| Sight { seen, agent, heights: &heights }).collect();
        let behaviours: Vec<AgentBehaviour> =
            sights.iter().map(|sight| AgentBehaviour::begin(sight, parameters, stream)).collect();
        let mut actors: Vec<Actor> =
            sights.iter().zip(&behaviours).map(|(sight, behaviour)| present(sight, behaviour)).collect();
        actors.extend(start.obstacles.iter().enumerate().map(|(i, o)| Actor {
            kind: AgentKind::Other,
            is_av: false,
            pose: Pose { position: o.center, heading: heading_of(o.axis) },
            speed: 0.0,
            acceleration: 0.0,
            half_length: o.half_length,
            half_width: o.half_width,
            height: start.obstacle_height(i),
        }));
        let lights = KnownLights::default();
        Self { behaviours, actors, av_paths: Vec::new(), av_paths_age: 0, av_curvature: 0.0, lights }
    }

    /// Returns this state with the agents that were in another one before: drivers keep their paths and
    /// intents. `kept`: their slots there.
    pub(super) fn resumed(mut self, before: Self, kept: &[Option<usize>]) -> Self {
        let Self { behaviours, actors, av_paths, av_paths_age, av_curvature, lights } = before;
        let mut behaviours: Vec<Option<AgentBehaviour>> = behaviours.into_iter().map(Some).collect();
        for (slot, earlier) in kept.iter().enumerate() {
            let Some(earlier) = *earlier else { continue };
            if let Some(behaviour) = behaviours[earlier].take() {
                self.behaviours[slot] = behaviour;
                self.actors[slot] = actors[earlier];
            }
        }
        Self { av_paths, av_paths_age, av_curvature, lights: lights.of_new_tracks(), ..self }
    }

    /// Plans all steps of an episode's plan.
    pub(super) fn plan(&mut self, parameters: &Parameters, episode: &mut Planning<'_, '_>) {
        let seen = episode.seen;
        if episode.moves_av || episode.shares_traffic {
            self.take_over(parameters, episode);
        }
        if !episode.moves_av {
            self.observe_av(&seen, parameters);
        }
        self.lights.follow(&seen);
        self.renew_paths(parameters, episode);
        let agents = seen.start().agents.len();
        let mut intents: Vec<Intent> = vec![Intent::default(); agents];
        let mut walks = vec![true; agents];
        for k in 0..episode.plan.steps() {
            if k % DECISION_INTERVAL == 0 {
                self.decide_all(&seen, parameters, &mut intents, &mut walks);
            }
            let since = (k % DECISION_INTERVAL) as f64 * DT;
            for i in 0..agents {
                if matches!(self.behaviours[i], AgentBehaviour::Absent) {
                    continue;
                }
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

    /// Takes over the realised states of agents that did not execute their plans: as a planner of the AV and
    /// in mixed traffic the model merely imagines what others do.
    fn take_over(&mut self, parameters: &Parameters, episode: &mut Planning<'_, '_>) {
        let seen = episode.seen;
        let heights: Vec<f64> = self.actors.iter().map(|a| a.height).collect();
        let first = usize::from(!episode.moves_av);
        for (agent, behaviour) in self.behaviours.iter_mut().enumerate().skip(first) {
            let Some(now) = seen.state(agent) else {
                *behaviour = AgentBehaviour::Absent;
                continue;
            };
            let is_back = matches!(behaviour, AgentBehaviour::Absent);
            if !is_back && Pose::from(now) == self.actors[agent].pose {
                continue;
            }
            let sight = Sight { seen, agent, heights: &heights };
            let own = present(&sight, behaviour);
            let class = parameters.class(own.kind);
            let resumes = match behaviour {
                AgentBehaviour::OnPath(driver) if now.forward_speed() >= -REVERSING_SPEED => {
                    driver.resume(&own, class)
                }
                _ => false,
            };
            if !resumes {
                *behaviour = AgentBehaviour::begin(&sight, parameters, episode.stream);
            }
            self.actors[agent] = present(&sight, behaviour);
        }
    }

    /// Plans the paths of drivers on that are not long enough for this plan.
    fn renew_paths(&mut self, parameters: &Parameters, episode: &mut Planning<'_, '_>) {
        let (seen, steps) = (episode.seen, episode.plan.steps());
        let heights: Vec<f64> = self.actors.iter().map(|a| a.height).collect();
        for (agent, behaviour) in self.behaviours.iter_mut().enumerate() {
            let AgentBehaviour::OnPath(driver) = behaviour else { continue };
            let own = &self.actors[agent];
            if driver.needs_path(own, seen.step(), steps) {
                let sight = Sight { seen, agent, heights: &heights };
                driver.renew(&sight, own, parameters.class(own.kind), episode.stream);
            }
        }
    }

    /// Updates the AV from the observation, with the newest visible speed, curvature and acceleration.
    fn observe_av(&mut self, seen: &Observation<'_>, parameters: &Parameters) {
        self.behaviours[0] = AgentBehaviour::External;
        let Some(now) = seen.state(0) else { return };
        let track = seen.track(0);
        let mut recent: Vec<AgentState> =
            track[track.len().saturating_sub(4)..].iter().flatten().copied().collect();
        recent.extend(seen.av_next());
        let speeds = signed_speeds(&recent);
        let speed = speeds.last().copied().unwrap_or_else(|| now.speed());
        let acceleration = match (speeds.first(), speeds.len()) {
            (Some(first), n) if n > 1 => (speed - first) / (DT * (n - 1) as f64),
            _ => 0.0,
        };
        let newest = recent.last().copied().unwrap_or(now);
        let distance: f64 = speeds.iter().sum::<f64>() * DT;
        self.av_curvature = match recent.first() {
            Some(first) if distance.abs() > 0.3 => {
                (wrap(newest.heading - first.heading) / distance).clamp(-0.3, 0.3)
            }
            _ => 0.0,
        };
        let mut av = actor(&seen.start().agents[0], &now, speed, acceleration);
        av.pose.heading = newest.heading;
        av.is_av = true;
        av.height = self.actors[0].height;
        self.actors[0] = av;
        self.find_av_paths(seen, &av, parameters);
    }

    /// Finds the paths along lanes that the AV may take: the likeliest, and those that are nearly as
    /// likely. They are reused while the AV keeps to one of them and cannot have passed a branch. An AV in
    /// reverse has none.
    fn find_av_paths(&mut self, seen: &Observation<'_>, av: &Actor, parameters: &Parameters) {
        if av.speed < 0.0 {
            self.av_paths.clear();
            return;
        }
        if self.av_paths_age < AV_PATHS_LIFETIME && self.av_paths.iter().any(|path| av.arc_on(path).is_some())
        {
            self.av_paths_age += 1;
            return;
        }
        self.av_paths_age = 0;
        self.av_paths.clear();
        let road = seen.start().road().on_level(av.pose.position, av.height);
        let motion = Motion { pose: av.pose, speed: av.speed, curvature: self.av_curvature };
        let mut routes = route::alternatives(&road, &motion, false);
        routes.sort_by(|a, b| a.0.total_cmp(&b.0));
        let least = routes.first().map_or(0.0, |w| w.0);
        routes.retain(|w| w.0 < least + AV_ROUTE_COST_MARGIN);
        routes.truncate(MAX_AV_ROUTES);
        for (_, route) in routes {
            let length = 8.0 * av.speed + 20.0;
            let Some((line, _)) = route::center_line(&road, &route, length) else { continue };
            let pursuit = parameters.vehicle.pursuit(av.speed);
            let offset = line.project(av.pose.position).offset;
            // An AV off the centre line may return to it, or intend to stay there.
            let aside = (offset.abs() > CENTRED_OFFSET).then(|| line.aside(offset));
            let lines = std::iter::once(line).chain(aside);
            let path = |line| DrivenPath::pursue(av.pose, self.av_curvature, &line, length, &pursuit);
            self.av_paths.extend(lines.map(path));
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
        let road = seen.start().road();
        if seen.start().has_levels() {
            heights::follow(&road, &mut self.actors);
        }
        let mut forecasts =
            forecast_all(&self.actors, &self.behaviours, self.av_curvature, &self.av_paths, settings);
        if seen.start().has_levels() {
            heights::forecast(&road, &self.actors, &mut forecasts);
        }
        let footprints: Vec<OrientedBox> = self.actors.iter().map(Actor::footprint).collect();
        for i in 0..self.behaviours.len() {
            // A decision changes one driver, and reads the behaviour of the others.
            let mut behaviour = std::mem::replace(&mut self.behaviours[i], AgentBehaviour::Parked);
            match &mut behaviour {
                AgentBehaviour::OnPath(driver) => {
                    intents[i] = self.decide_one(i, driver, seen, &forecasts, &footprints, parameters);
                }
                AgentBehaviour::Walking { velocity } => {
                    walks[i] = self.may_walk(&road, i, *velocity, &forecasts, &footprints, parameters);
                }
                AgentBehaviour::Parked
                | AgentBehaviour::Leaving { .. }
                | AgentBehaviour::Reversing
                | AgentBehaviour::External
                | AgentBehaviour::Absent => {}
            }
            self.behaviours[i] = behaviour;
        }
    }

    fn decide_one(
        &self,
        i: usize,
        driver: &mut PathFollower,
        seen: &Observation<'_>,
        forecasts: &[Forecast],
        footprints: &[OrientedBox],
        parameters: &Parameters,
    ) -> Intent {
        let own = self.actors[i];
        let settings = &parameters.conflict;
        let class = parameters.class(own.kind);
        let road = seen.start().road().on_level(own.pose.position, own.height);
        // The AV is the first actor.
        let (of_av, of_others) =
            forecasts.split_at(forecasts.partition_point(|f| self.actors[f.actor].is_av));
        let mut around = Surroundings {
            index: i,
            actors: &self.actors,
            footprints,
            of_av,
            of_others,
            road,
            strip: None,
            heights: corridor::heights(seen.start(), &own, driver, CONTACT_HORIZON),
            settings,
        };
        if let Some((offset, quiet)) = driver.aside {
            // Return to the lane when nothing has been in the way for a while, and nothing will be on
            // the way back.
            driver.aside = Some((offset, quiet + 1));
            if quiet >= QUIET_DECISIONS {
                let back = driver.path_at_offset(&own, class, 0.0, f64::INFINITY);
                if !around.meets_av(&own, &back, 0.0, 0.0) {
                    driver.take(back, class);
                    driver.aside = None;
                }
            }
        }
        let stop = signals::next_stop(seen.start(), &self.lights, &own, driver);
        let strip = corridor::strip(&own, driver, CONTACT_HORIZON);
        around.strip = strip;
        let view = View { strip: strip.as_ref(), heights: &around.heights, road: &road };
        let corridor = corridor::look(i, &own, driver, &self.actors, forecasts, &view, settings);
        let mut intent = Intent { corridor, stop, chosen: None, ..Intent::default() };
        let wanted = following(driver, &own, &intent, 0.0);
        driver.waits = own.speed < WAITING_SPEED && wanted > WAITING_ACCELERATION;
        let situation = Situation {
            index: i,
            own: &own,
            driver,
            corridor: &intent.corridor,
            actors: &self.actors,
            behaviours: &self.behaviours,
            parameters,
        };
        intent.chosen = decide(&situation, wanted);
        intent.hurries = intent.chosen.is_some_and(|a| a > wanted);
        // A driver who brakes for an AV head on would block it. First it is checked whether there is
        // room to pass. This does not apply to an AV that turns across.
        let av = self.actors.first().filter(|av| av.is_av && self.av_curvature.abs() < HEAD_ON_CURVATURE);
        let head_on = av.is_some_and(|av| wrap(av.pose.heading - own.pose.heading).abs() > HEAD_ON_ANGLE)
            && intent.corridor.crossings.iter().any(|c| c.actor == 0 && !c.from_behind);
        let planned = if head_on { wanted } else { intent.chosen.unwrap_or(wanted) };
        let a = planned.max(-parameters.limits.emergency_deceleration);
        let Some(escape) = around.escape(&own, driver, class, a, intent.stop) else { return intent };
        intent.chosen = Some(escape.acceleration);
        intent.escaping = true;
        if let Some((offset, path)) = escape.course {
            driver.take(path, class);
            driver.aside = Some((offset, 0));
            let strip = corridor::strip(&own, driver, 0.0);
            around.heights = corridor::heights(seen.start(), &own, driver, 0.0);
            let view = View { strip: strip.as_ref(), heights: &around.heights, road: &road };
            intent.corridor = corridor::look(i, &own, driver, &self.actors, forecasts, &view, settings);
            intent.stop = None;
        } else if let Some((_, quiet)) = &mut driver.aside {
            *quiet = 0;
        }
        intent
    }

    /// Returns whether a pedestrian can go on: false if walking leads into a vehicle and standing does
    /// not.
    fn may_walk(
        &self,
        road: &Road<'_>,
        index: usize,
        velocity: Vec2,
        forecasts: &[Forecast],
        footprints: &[OrientedBox],
        parameters: &Parameters,
    ) -> bool {
        let own = &self.actors[index];
        let settings = &parameters.pedestrian;
        let reach = velocity.norm() * settings.look_ahead + own.half_length + settings.clearance;
        let around = reactsim_geometry::Bounds::around(own.pose.position, reach);
        let meets = |forecast: &Forecast, velocity: Vec2, clearance: f64| {
            let other = &self.actors[forecast.actor];
            // A standing vehicle stays in the way: looking one second ahead is soon enough to stop.
            let standing = forecast.samples.len() == 1;
            let last = if standing { 1.0 } else { settings.look_ahead };
            let steps = (last / parameters.conflict.sample).round() as usize;
            (1..=steps).any(|k| {
                let t = k as f64 * parameters.conflict.sample;
                let sample = forecast.samples[if standing { 0 } else { k.min(forecast.samples.len() - 1) }];
                let swept = 0.5 * parameters.conflict.sample * sample.speed.abs();
                let theirs = other.box_at(sample.center, sample.axis, (swept, 0.0));
                let ours = OrientedBox { center: own.pose.position + velocity * t, ..footprints[index] };
                theirs.separation(&ours) < clearance
            })
        };
        for forecast in forecasts {
            let other = &self.actors[forecast.actor];
            if forecast.actor == index
                || road.is_apart((own.pose.position, own.height), (other.pose.position, other.height))
                || !matches!(other.kind, AgentKind::Vehicle | AgentKind::Cyclist)
                || !around.intersects(&forecast.bounds)
                || footprints[forecast.actor].separation(&footprints[index]) < 0.0
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
        match &mut self.behaviours[i] {
            AgentBehaviour::Parked | AgentBehaviour::External | AgentBehaviour::Absent => {
                own.speed = if i == 0 { own.speed } else { 0.0 }
            }
            AgentBehaviour::Reversing => {
                let slower = (own.speed + 2.0 * DT).min(0.0);
                let distance = 0.5 * (own.speed + slower) * DT;
                own.speed = slower;
                own.pose = own.pose.advance(distance, 0.0);
            }
            AgentBehaviour::Walking { velocity } => {
                // A pedestrian stops and starts within half a second.
                let full = velocity.norm();
                let change = 2.0 * full * DT;
                own.speed = (own.speed + if walks { change } else { -2.0 * change }).clamp(0.0, full);
                own.pose.position += *velocity * (own.speed / full * DT);
            }
            AgentBehaviour::Leaving { velocity, distance, then } => {
                let step = *velocity * DT;
                own.pose.position += step;
                *distance -= step.norm();
                if *distance <= 0.0 {
                    own.speed = 0.0;
                    let then = *then;
                    let walks = then.norm() >= parameters.pedestrian.standing_speed;
                    self.behaviours[i] = if walks {
                        AgentBehaviour::Walking { velocity: then }
                    } else {
                        AgentBehaviour::Parked
                    };
                }
            }
            AgentBehaviour::OnPath(driver) => {
                let mut wanted = following(driver, own, intent, since);
                if let Some(chosen) = intent.chosen {
                    // An evasion may be faster than car following, but never into a leader.
                    wanted = if chosen > wanted && intent.corridor.leaders.is_empty() {
                        chosen
                    } else {
                        wanted.min(chosen)
                    };
                }
                let a = limited(own.acceleration, wanted, intent.escaping, &parameters.limits);
                let next = (own.speed + a * DT).max(0.0);
                let distance = 0.5 * (own.speed + next) * DT;
                own.acceleration = if next > 0.0 { a } else { 0.0 };
                own.speed = next;
                driver.s += distance;
                own.pose = driver.path.at(driver.s);
            }
        }
    }
}

/// Returns the acceleration required by leaders, stops and the road, `since` seconds after they were
/// observed.
fn following(driver: &PathFollower, own: &Actor, intent: &Intent, since: f64) -> f64 {
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
        let speed = (leader.speed + leader.acceleration.min(0.0) * lasting).max(leader.speed.min(0.0));
        a = a.min(style.behind(v, rear - front, speed, leader.acceleration));
    }
    if let Some(stop) = intent.stop {
        a = a.min(style.stop_in(v, stop.s - front));
    }
    a
}

/// Returns the acceleration of the next step: within the limits, and with bounded jerk.
fn limited(last: f64, wanted: f64, escaping: bool, limits: &Limits) -> f64 {
    let wanted = wanted.clamp(-limits.emergency_deceleration, 3.5);
    let jerk = if wanted < -3.0 || escaping { limits.emergency_jerk } else { limits.jerk };
    // Brakes are released faster than comfort requires once the reason is gone.
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
        height: f64::NAN,
    }
}

/// Returns an agent as its behaviour takes it to be at present.
fn present(sight: &Sight<'_>, behaviour: &AgentBehaviour) -> Actor {
    let now = sight.now();
    let (speed, acceleration) = match behaviour {
        AgentBehaviour::Parked => (0.0, 0.0),
        AgentBehaviour::Reversing => (now.forward_speed(), 0.0),
        AgentBehaviour::OnPath(_) => (now.velocity().map_or(0.0, |v| v.norm()), recent(sight.track())),
        _ => (now.velocity().map_or(0.0, |v| v.norm()), 0.0),
    };
    Actor { height: sight.height(), ..actor(sight.properties(), &now, speed, acceleration) }
}

/// Returns the speeds between consecutive states, m/s: along the heading, negative in reverse, of an agent
/// that reverses on the whole; otherwise never negative, since the positions of standing agents jitter.
fn signed_speeds(states: &[AgentState]) -> Vec<f64> {
    let along = |a: &AgentState, b: &AgentState| (b.position() - a.position()).dot(&direction(b.heading));
    let backs = states.windows(2).map(|w| along(&w[0], &w[1])).sum::<f64>()
        < -STANDSTILL_SPEED * DT * states.len().saturating_sub(1) as f64;
    let speed = |w: &[AgentState]| {
        let speed = (w[1].position() - w[0].position()).norm() / DT;
        if backs { speed.copysign(along(&w[0], &w[1])) } else { speed }
    };
    states.windows(2).map(speed).collect()
}

/// Returns the acceleration over the last half second, clamped to deliberate driving, m/s².
fn recent(track: &[Frame]) -> f64 {
    match track {
        [.., Some(before), _, _, _, _, Some(now)] => {
            let a = (now.speed() - before.speed()) / (5.0 * DT);
            if a.is_finite() { a.clamp(-4.0, 2.0) } else { 0.0 }
        }
        _ => 0.0,
    }
}
