//! Behaviour of agents: parked, on a path, on foot.

use rand::RngExt;
use reactsim_geometry::{OrientedBox, Polyline, Vec2, direction, left, math};
use reactsim_rollout::{Observation, Stream};
use reactsim_scene::dynamics::{DrivenPath, Pose, Pursuit};
use reactsim_scene::{
    Agent, AgentKind, AgentState, DT, FUTURE, Frame, HISTORY, LaneClass, Road, Start, StopKind,
};

use super::actor::Actor;
use super::follow::Style;
use super::heights::PathHeights;
use super::parameters::{Class, Parameters};
use super::route::{self, Motion, Route};

/// Behaviour of an agent.
#[derive(Debug)]
pub(super) enum AgentBehaviour {
    /// Stays where it is.
    Parked,
    /// Drives a path.
    OnPath(Box<PathFollower>),
    /// Rolls back and comes to a stop (vehicles in reverse).
    Reversing,
    /// Walks at this velocity, m/s.
    Walking { velocity: Vec2 },
    /// Pedestrian inside the box of a vehicle: steps clear of it at this velocity, m/s, for the
    /// remaining distance, m; then walks at the velocity `then`, or stands.
    Leaving { velocity: Vec2, distance: f64, then: Vec2 },
    /// Not moved here: the AV as an external input.
    External,
    /// Not in the scene at present.
    Absent,
}

/// An agent as it is observed when its behaviour begins.
#[derive(Clone, Copy)]
pub(super) struct Sight<'a> {
    pub(super) seen: Observation<'a>,
    pub(super) agent: usize,
    /// Height of the road under each agent, metres.
    pub(super) heights: &'a [f64],
}

impl<'a> Sight<'a> {
    fn start(&self) -> &'a Start {
        self.seen.start()
    }

    pub(super) fn properties(&self) -> &'a Agent {
        &self.start().agents[self.agent]
    }

    pub(super) fn now(&self) -> AgentState {
        self.seen.state(self.agent).unwrap_or_else(|| self.start().now(self.agent))
    }

    pub(super) fn track(&self) -> &'a [Frame] {
        self.seen.track(self.agent)
    }

    pub(super) fn height(&self) -> f64 {
        self.heights[self.agent]
    }

    fn road(&self) -> Road<'a> {
        let height = if self.start().has_levels() { self.height() } else { f64::NAN };
        self.start().road().on_level(self.now().position(), height)
    }
}

/// A vehicle or cyclist with its path.
#[derive(Debug)]
pub(super) struct PathFollower {
    pub(super) path: DrivenPath,
    /// Reference line of the path if no agent is in the way.
    pub(super) home: Polyline,
    /// Route that the line follows; without lanes off the lanes.
    route: Route,
    /// Step of the episode at which the path was planned; it covers [`FUTURE`] steps.
    planned: usize,
    /// Offset from the home line, metres, while the driver evades an agent, and the number of decisions
    /// since the evasion was last needed.
    pub(super) aside: Option<(f64, usize)>,
    /// Desired speed at each point of the path, m/s, before curves are considered.
    desired: Vec<f64>,
    /// Largest speed at each point of the path, m/s: limits, curves, and braking in time for them.
    pub(super) ceiling: Vec<f64>,
    /// Stop lines on the path, in order of arc length.
    pub(super) stops: Vec<PathStop>,
    /// Parameters of the driver.
    pub(super) style: Style,
    /// Arc length at which the path leaves the drivable area, metres, if it does.
    pub(super) ground_ends: Option<f64>,
    /// Present arc length, metres.
    pub(super) s: f64,
    /// Whether the vehicle stands although car following lets it go: it only waits for others, and may
    /// set off at any time.
    pub(super) waits: bool,
    /// Heights along the path ahead, in scenarios with several levels.
    pub(super) heights: PathHeights,
}

/// A stop line on a path.
#[derive(Clone, Copy, Debug)]
pub(super) struct PathStop {
    /// Arc length of the line, metres.
    pub(super) s: f64,
    pub(super) kind: StopKind,
    /// Lane of the stop line.
    pub(super) lane: usize,
    /// Whether the vehicle has stopped at the line.
    pub(super) done: bool,
}

/// Speed in m/s of a pedestrian who steps clear of a vehicle.
const STEPPING_SPEED: f64 = 1.0;
/// Speed in m/s against the heading from which a vehicle reverses.
pub(super) const REVERSING_SPEED: f64 = 0.3;
/// Speed in m/s above which reversing counts as an error of the recording.
const MAX_REVERSE_SPEED: f64 = 4.0;
/// Comfortable deceleration before slower parts of the path, m/s².
const APPROACH_DECELERATION: f64 = 1.6;
/// Lateral acceleration of a swerve, m/s².
const SWERVE_ACCELERATION: f64 = 4.0;
/// Length of path with which an evasion goes on at standstill, metres; at speed it is that of 5 s more.
const EVASION_LENGTH: f64 = 20.0;
/// Smallest speed in curves, m/s.
const MIN_CURVE_SPEED: f64 = 2.0;

impl AgentBehaviour {
    /// Chooses the behaviour of an agent and plans its path.
    pub(super) fn begin(sight: &Sight<'_>, parameters: &Parameters, stream: &mut Stream) -> Self {
        // Every agent draws the same count of numbers, so that one agent's choices do not shift
        // another's.
        let (headway, speed) = (stream.random::<f64>() * 2.0 - 1.0, stream.random::<f64>() * 2.0 - 1.0);
        let seed: u64 = stream.random();
        let mut own = <Stream as rand::SeedableRng>::seed_from_u64(seed);
        let now = sight.now();
        match sight.properties().kind {
            AgentKind::Pedestrian => {
                let velocity = mean_velocity(sight);
                if let Some((leave, distance)) = path_out(sight) {
                    return Self::Leaving { velocity: leave * STEPPING_SPEED, distance, then: velocity };
                }
                if velocity.norm() < parameters.pedestrian.standing_speed {
                    Self::Parked
                } else {
                    Self::Walking { velocity }
                }
            }
            AgentKind::Vehicle | AgentKind::Cyclist => {
                let kind = sight.properties().kind;
                let (cyclist, class) = (kind == AgentKind::Cyclist, parameters.class(kind));
                if now.forward_speed() < -REVERSING_SPEED {
                    // No vehicle reverses fast: a velocity against the heading is an error of the
                    // recording.
                    return if now.speed() < MAX_REVERSE_SPEED { Self::Reversing } else { Self::Parked };
                }
                let motion = Motion {
                    pose: Pose::from(now),
                    speed: now.velocity().map_or(0.0, |v| v.norm()),
                    curvature: curvature_now(sight.track()).clamp(-class.max_curvature, class.max_curvature),
                };
                if is_parked(sight, &motion, cyclist, parameters) {
                    return Self::Parked;
                }
                let variation = parameters.styles.as_ref().map(|styles| styles.draw(&own));
                let style = Style::of(class, headway, speed, variation.unwrap_or_default());
                Self::OnPath(Box::new(PathFollower::plan(sight, &motion, class, style, None, &mut own)))
            }
            AgentKind::Other => Self::Parked,
        }
    }
}

/// Returns whether a standing vehicle is parked: it has not moved, and it is next to the lanes or at an
/// angle to them.
fn is_parked(sight: &Sight<'_>, motion: &Motion, cyclist: bool, parameters: &Parameters) -> bool {
    let first = sight.track().iter().flatten().next().map_or(motion.pose.position, |s| s.position());
    let bounds = &parameters.parked;
    if (motion.pose.position - first).norm() > bounds.travel || motion.speed > bounds.speed {
        return false;
    }
    match route::nearest_lane(&sight.road(), motion.pose.position, motion.pose.heading, cyclist) {
        None => true,
        Some(hit) => {
            let lane = sight.road().lane(hit.lane).baseline.heading(hit.projection.segment);
            hit.projection.distance > bounds.offset
                || reactsim_geometry::wrap(lane - motion.pose.heading).abs() > bounds.heading
        }
    }
}

/// Returns direction and length, metres, of the shortest path out of the vehicle's box that a
/// pedestrian is in: people who get in or out. `None` if there is no such box.
fn path_out(sight: &Sight<'_>) -> Option<(Vec2, f64)> {
    let own = sight.now().footprint(sight.properties());
    let road = sight.road();
    let agents = sight.start().agents.iter().enumerate();
    let vehicles = agents.filter(|(_, agent)| agent.kind == AgentKind::Vehicle);
    let boxes = vehicles.filter_map(|(j, agent)| Some((j, sight.seen.state(j)?.footprint(agent))));
    let beside = boxes.filter(|(j, b)| !road.is_off_level(b.center, sight.heights[*j], 0.0));
    let boxes = beside.map(|(_, b)| b);
    let inside = boxes.filter(|b| b.separation(&own) < 0.0).min_by(|a, b| {
        (a.center - own.center).norm_squared().total_cmp(&(b.center - own.center).norm_squared())
    })?;
    let local = inside.to_local(own.center);
    let (aside, along) =
        (inside.half_width + own.radius() - local.y.abs(), inside.half_length + own.radius() - local.x.abs());
    let out = if aside <= along {
        (inside.left() * 1.0_f64.copysign(local.y), aside)
    } else {
        (inside.axis * 1.0_f64.copysign(local.x), along)
    };
    Some((out.0, out.1 + 0.1))
}

/// Returns the mean velocity over as many frames as the history has, m/s, because pedestrians sway from frame
/// to frame.
fn mean_velocity(sight: &Sight<'_>) -> Vec2 {
    let track = sight.track();
    let recent = track[track.len().saturating_sub(HISTORY)..].iter().enumerate();
    let mut ends = recent.filter_map(|(f, s)| Some((f, (*s)?.position())));
    let Some(first) = ends.next() else { return Vec2::zeros() };
    match ends.next_back() {
        Some(last) => (last.1 - first.1) / (DT * (last.0 - first.0) as f64),
        None => sight.now().velocity().unwrap_or_default(),
    }
}

/// Returns the curvature of the motion over the last half second, 1/m; 0 for slow vehicles, whose
/// headings are mostly noise.
fn curvature_now(track: &[Frame]) -> f64 {
    let [earlier @ .., Some(now)] = track else { return 0.0 };
    let Some((back, before)) = (1..=5).rev().find_map(|b| Some((b, earlier[earlier.len().checked_sub(b)?]?)))
    else {
        return 0.0;
    };
    let distance = (now.position() - before.position()).norm();
    if distance < 0.1 * back as f64 {
        return 0.0;
    }
    reactsim_geometry::wrap(now.heading - before.heading) / distance
}

impl PathFollower {
    /// Plans a path, along a route that is kept as far as it leads.
    fn plan(
        sight: &Sight<'_>,
        motion: &Motion,
        class: &Class,
        style: Style,
        kept: Option<&Route>,
        stream: &mut Stream,
    ) -> Self {
        let (road, cyclist) = (sight.road(), sight.properties().kind == AgentKind::Cyclist);
        let free = (class.speed_freeway * style.haste).max(motion.speed);
        // Cover the distance that the vehicle can travel within the horizon, and its look-ahead.
        let horizon = DT * FUTURE as f64;
        let coming = motion.speed * horizon + 0.5 * style.acceleration * horizon * horizon;
        let length = coming.min(free * horizon) + 40.0;
        let mut alternatives = route::alternatives(&road, motion, cyclist);
        if let Some(kept) = kept {
            route::keep_to(kept, &mut alternatives);
        }
        let planned = sight.seen.step();
        let Some(mut route) = route::choose(alternatives, stream) else {
            return Self::off_lane(&road, motion, class, style, planned);
        };
        route::extend(&road, &mut route, length, cyclist, stream);
        let Some((line, starts)) = route::center_line(&road, &route, length) else {
            return Self::off_lane(&road, motion, class, style, planned);
        };
        let agent = sight.properties();
        let line = around_obstacles(sight, &line, 0.5 * agent.width, motion.speed);
        let pursuit = class.pursuit(motion.speed);
        let path = DrivenPath::pursue(motion.pose, motion.curvature, &line, length, &pursuit);
        let offset = line.project(motion.pose.position).s;
        let starts: Vec<(f64, usize)> = starts.into_iter().map(|(s, l)| (s - offset, l)).collect();
        let desired = desired_speeds(&road, &path, &starts, motion.speed, class, &style);
        let stops = stops(sight.start(), &route, &starts, agent.length);
        Self { route, stops, ..Self::new(path, line, planned, desired, class, style) }
    }

    /// Creates a driver at the beginning of a path, without a route.
    fn new(
        path: DrivenPath,
        home: Polyline,
        planned: usize,
        desired: Vec<f64>,
        class: &Class,
        style: Style,
    ) -> Self {
        Self {
            ceiling: ceiling(&path, &desired, class),
            path,
            home,
            route: Route::default(),
            planned,
            aside: None,
            desired,
            stops: Vec::new(),
            style,
            ground_ends: None,
            s: 0.0,
            waits: false,
            heights: PathHeights::default(),
        }
    }

    /// Plans a path for a vehicle off the lanes: it goes on slowly with its present curvature, and
    /// stops before it leaves the drivable area.
    fn off_lane(road: &Road<'_>, motion: &Motion, class: &Class, style: Style, planned: usize) -> Self {
        let length = motion.speed * DT * FUTURE as f64 + 30.0;
        let path = DrivenPath::fade(motion.pose, motion.curvature, 8.0, length);
        let desired = vec![motion.speed.max(MIN_CURVE_SPEED); path.points().len()];
        let points: Vec<Vec2> = path.points().iter().map(|p| p.pose.position).collect();
        let home = Polyline::new(&points).expect("a path has at least two distinct points");
        let mut hint = None;
        let ground_ends = match road.drivable(motion.pose.position, &mut hint) {
            Some(true) => (1..path.points().len())
                .find(|&i| road.drivable(path.points()[i].pose.position, &mut hint) == Some(false))
                .map(|i| i as f64 * DrivenPath::STEP),
            _ => None,
        };
        Self { ground_ends, ..Self::new(path, home, planned, desired, class, style) }
    }

    /// Returns whether the path has to be planned on before a plan of `steps` steps, which begins at step
    /// `now` of the episode. An evasion is ended first, if the path is long enough for it.
    pub(super) fn needs_path(&self, own: &Actor, now: usize, steps: usize) -> bool {
        let evades = self.aside.is_some() && self.path.length() - self.s > EVASION_LENGTH + 5.0 * own.speed;
        now > self.planned && now + steps > self.planned + FUTURE && !evades
    }

    /// Plans the path on from where the vehicle is now, along its route as far as that leads.
    pub(super) fn renew(&mut self, sight: &Sight<'_>, own: &Actor, class: &Class, stream: &mut Stream) {
        let motion =
            Motion { pose: own.pose, speed: own.speed, curvature: self.path.point_at(self.s).curvature };
        let mut next = Self::plan(sight, &motion, class, self.style, Some(&self.route), stream);
        for stop in &mut next.stops {
            stop.done = self.stops.iter().any(|before| before.done && before.lane == stop.lane);
        }
        *self = next;
    }

    /// Continues from where the vehicle is now, towards its home line. Returns false, and changes nothing, if
    /// it has left its path.
    pub(super) fn resume(&mut self, own: &Actor, class: &Class) -> bool {
        let Some(s) = own.arc_on(&self.path) else { return false };
        (self.s, self.waits) = (s, false);
        let target = self.aside.map_or(0.0, |(offset, _)| offset);
        self.take(self.path_at_offset(own, class, target, f64::INFINITY), class);
        true
    }

    /// Plans a path to the home line shifted by `target` metres, at most `longest` metres long.
    pub(super) fn path_at_offset(&self, own: &Actor, class: &Class, target: f64, longest: f64) -> DrivenPath {
        let fast = own.speed.max(3.0);
        let limit = class.max_curvature.min(SWERVE_ACCELERATION / (fast * fast));
        let pursuit = Pursuit {
            look_ahead: (0.7 * own.speed).clamp(4.0, 14.0),
            // A curve of the road itself must remain drivable.
            max_curvature: limit.max(self.sharpest_ahead()).min(class.max_curvature),
            max_curvature_rate: class.curvature_rate.min(12.0 / (fast * fast)).max(0.01),
        };
        let line = self.home.aside(target);
        let left = (self.path.length() - self.s).max(20.0).min(longest);
        let curvature = self.path.points()[self.path.index(self.s)].curvature;
        DrivenPath::pursue(own.pose, curvature, &line, left, &pursuit)
    }

    /// Switches to a new path that begins at the present position.
    pub(super) fn take(&mut self, path: DrivenPath, class: &Class) {
        let gone = self.path.index(self.s).min(self.desired.len() - 1);
        let last = self.desired[self.desired.len() - 1];
        self.desired.drain(..gone);
        self.desired.resize(path.points().len(), last);
        for stop in &mut self.stops {
            stop.s -= self.s;
        }
        self.ground_ends = self.ground_ends.map(|end| end - self.s);
        self.ceiling = ceiling(&path, &self.desired, class);
        self.path = path;
        self.heights = PathHeights::default();
        self.s = 0.0;
    }

    /// Returns the largest curvature of the path in the next 40 m, 1/m.
    fn sharpest_ahead(&self) -> f64 {
        let from = self.path.index(self.s);
        self.path.points()[from..].iter().take(40).map(|p| p.curvature.abs()).fold(0.0, f64::max)
    }
}

fn curve_speed(curvature: f64, class: &Class) -> f64 {
    (class.lateral_acceleration / curvature.abs().max(1e-6)).sqrt().max(MIN_CURVE_SPEED)
}

/// Returns the desired speed at each point of a path by the limits of its lanes.
fn desired_speeds(
    road: &Road<'_>,
    path: &DrivenPath,
    starts: &[(f64, usize)],
    speed: f64,
    class: &Class,
    style: &Style,
) -> Vec<f64> {
    let mut lane = 0;
    let of = |i: usize| {
        let s = i as f64 * DrivenPath::STEP;
        while lane + 1 < starts.len() && starts[lane + 1].0 <= s {
            lane += 1;
        }
        let here = road.lane(starts[lane].1);
        let limit = match (here.speed_limit, here.class) {
            (Some(limit), _) => limit.min(class.speed_freeway),
            (None, LaneClass::Freeway) => class.speed_freeway,
            (None, _) => class.speed_unknown_limit,
        };
        // A vehicle that exceeds the limit keeps its speed: logged drivers exceed limits, and do not
        // brake for that alone.
        (limit * style.speed_factor).max(speed)
    };
    (0..path.points().len()).map(of).collect()
}

/// Returns the largest speed at each point: the desired speed, the curve, and braking in time for later
/// points.
fn ceiling(path: &DrivenPath, desired: &[f64], class: &Class) -> Vec<f64> {
    let points = path.points().iter().zip(desired);
    let mut top: Vec<f64> =
        points.map(|(p, &desired)| desired.min(curve_speed(p.curvature, class))).collect();
    for i in (0..top.len() - 1).rev() {
        let reachable = (top[i + 1] * top[i + 1] + 2.0 * APPROACH_DECELERATION * DrivenPath::STEP).sqrt();
        top[i] = top[i].min(reachable);
    }
    top
}

/// Returns the stop lines along a route that are ahead of the vehicle's front.
fn stops(start: &Start, route: &Route, starts: &[(f64, usize)], length: f64) -> Vec<PathStop> {
    let mut found: Vec<PathStop> = Vec::new();
    for &(begins, lane) in starts.iter().filter(|(_, l)| route.lanes.contains(l)) {
        for line in start.map.stop_lines.iter().filter(|line| line.lane == lane) {
            let s = begins + line.s;
            // A line behind the front no longer counts.
            if s > 0.5 * length - 0.3 {
                found.push(PathStop { s, kind: line.kind, lane, done: false });
            }
        }
    }
    found.sort_by(|a, b| a.s.total_cmp(&b.s));
    found
}

/// Shifts the reference line where a standing vehicle or obstacle reaches into it and there is room to
/// pass.
fn around_obstacles(sight: &Sight<'_>, line: &Polyline, half_width: f64, speed: f64) -> Polyline {
    /// Largest lateral shift, metres.
    const MAX_SHIFT: f64 = 1.5;
    /// Lateral clearance to a standing vehicle, metres.
    const CLEARANCE: f64 = 0.45;
    let (road, start) = (sight.road(), sight.start());
    let ramp = (1.2 * speed).max(10.0);
    let mut berths: Vec<(f64, f64, f64)> = Vec::new();
    let others = (1..start.agents.len()).filter(|&j| j != sight.agent);
    let boxes = others.filter_map(|j| {
        let now = stands(sight.seen.track(j))?;
        Some((now.footprint(&start.agents[j]), sight.heights[j]))
    });
    let obstacles = start.obstacles.iter().enumerate().map(|(k, &o)| (o, start.obstacle_height(k)));
    for (o, its_height) in boxes.chain(obstacles) {
        let Some((from, to, low, high)) = extent_along(line, &o) else { continue };
        if road.is_off_level(o.center, its_height, 0.0) {
            continue;
        }
        let (to_left, to_right) = (high + half_width + CLEARANCE, half_width + CLEARANCE - low);
        if to_left <= 0.0 || to_right <= 0.0 {
            continue;
        }
        let shift = if to_left < to_right { to_left } else { -to_right };
        if shift.abs() > MAX_SHIFT {
            continue;
        }
        let middle = 0.5 * (from + to);
        let heading = line.heading_at(middle);
        let left = left(direction(heading));
        let edge = line.at(middle) + left * (shift + half_width.copysign(shift));
        if road.drivable(edge, &mut None) == Some(false) {
            continue;
        }
        berths.push((from, to, shift));
    }
    let widest_left = berths.iter().map(|b| b.2).fold(0.0, f64::max);
    let widest_right = berths.iter().map(|b| b.2).fold(0.0, f64::min);
    // Obstacles on both sides: a gap to pass slowly or not at all, which car following handles.
    if berths.is_empty() || (widest_left > 0.0 && widest_right < 0.0) {
        return line.clone();
    }
    let moved: Vec<Vec2> = line
        .points()
        .iter()
        .zip(line.arc())
        .enumerate()
        .map(|(i, (&p, &s))| {
            let mut shift = 0.0_f64;
            for &(from, to, berth) in &berths {
                let away = (from - s).max(s - to).max(0.0);
                let share =
                    if away < ramp { 0.5 + 0.5 * math::cos(std::f64::consts::PI * away / ramp) } else { 0.0 };
                if (share * berth).abs() > shift.abs() {
                    shift = share * berth;
                }
            }
            let heading = line.heading(i.min(line.segments() - 1));
            p + left(direction(heading)) * shift
        })
        .collect();
    Polyline::new(&moved).unwrap_or_else(|_| line.clone())
}

/// Returns the present state of an agent that has stood so far.
fn stands(track: &[Frame]) -> Option<AgentState> {
    let now = track.last().copied().flatten()?;
    let first = track.iter().flatten().next().map_or(now.position(), |s| s.position());
    let still = (now.position() - first).norm() < 0.3 && now.velocity().is_none_or(|v| v.norm() < 0.3);
    still.then_some(now)
}

/// Returns the extent of a box along a line: first and last arc length, smallest and largest lateral
/// offset. `None` if it is far from the line.
fn extent_along(line: &Polyline, o: &OrientedBox) -> Option<(f64, f64, f64, f64)> {
    let center = line.project_within(o.center, o.radius() + 2.5)?;
    let axis = direction(line.heading(center.segment));
    let (cos, sin) = (axis.dot(&o.axis).abs(), axis.perp(&o.axis).abs());
    let along = o.half_length * cos + o.half_width * sin;
    let across = o.half_length * sin + o.half_width * cos;
    Some((center.s - along, center.s + along, center.offset - across, center.offset + across))
}
