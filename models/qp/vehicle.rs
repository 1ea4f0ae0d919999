//! Planning of one vehicle: a path and the speed along it for each of its modes, until one is clear.

use reactsim_geometry::{Vec2, direction};
use reactsim_scene::DT;
use reactsim_scene::dynamics::{MotionLimits, Pose, STANDSTILL_SPEED, Tracker, VehicleMotion};

use super::bends::{PathProblem, PathProgram};
use super::drive::drive;
use super::ending::{Ending, Endings};
use super::mode::{Mode, Reference};
use super::obstacle::{Obstacle, Span, TIMES, spans, step_of};
use super::path::Path;
use super::planned_vehicle::PlannedVehicle;
use super::program::Solve;
use super::rows::{DistanceBounds, excess};
use super::settings::Settings;
use super::sides::{lateral_bounds, road_end};
use super::speed::{STEPS, SpeedProblem, SpeedProgram, hardest_braking};

/// Plan for one mode.
struct Attempt {
    moves: Vec<VehicleMotion>,
    path: Path,
    solve: Solve,
    /// Distance by which the plan enters obstacles, metres.
    excess: f64,
    spans: Vec<[Option<Span>; TIMES]>,
}

/// Planner of vehicles, one after another.
pub(super) struct Planner {
    pub(super) settings: Settings,
    speed_program: SpeedProgram,
    path_program: PathProgram,
    tracker: Tracker,
    pub(super) endings: Endings,
}

/// Distance in metres: a mode that ends nearer than this does not set off.
pub(super) const STANDSTILL_REACH: f64 = 0.15;
/// Speed in m/s: slower vehicles may change between forwards and reverse, faster reversing goes on.
const REVERSING_SPEED: f64 = 0.6;
/// Comfortable lateral acceleration, m/s².
const COMFORTABLE_LATERAL_ACCELERATION: f64 = 4.0;
/// Comfortable deceleration before bends, m/s².
const COMFORTABLE_DECELERATION: f64 = 2.5;
/// Deceleration from which the distance to the end of the road is judged, m/s².
const ROAD_END_DECELERATION: f64 = 4.0;

impl Planner {
    /// Creates a planner; `None` if the solver rejects the programs, which a test rules out.
    pub(super) fn new(settings: &Settings) -> Option<Self> {
        Some(Self {
            settings: settings.clone(),
            speed_program: SpeedProgram::new(settings)?,
            path_program: PathProgram::new(settings)?,
            tracker: Tracker::new(MotionLimits::of_vehicle(0.0)),
            endings: Endings::default(),
        })
    }

    /// Plans the next [`STEPS`] steps of a vehicle. `modes` are valid, at least one, the most probable
    /// first.
    pub(super) fn plan(
        &mut self,
        vehicle: &PlannedVehicle<'_>,
        modes: &[Mode],
        obstacles: &[&Obstacle],
    ) -> Vec<VehicleMotion> {
        if stays(vehicle, &modes[0]) {
            self.endings.count(Ending::Standing);
            return vec![VehicleMotion { speed: 0.0, acceleration: 0.0, ..vehicle.now }; STEPS];
        }
        if reverses(vehicle, &modes[0]) {
            self.endings.count(Ending::Backwards);
            return self.follow_backwards(vehicle, &modes[0], obstacles);
        }
        let vehicle = &PlannedVehicle {
            now: VehicleMotion { speed: vehicle.now.speed.abs(), ..vehicle.now },
            ..*vehicle
        };
        let mut best: Option<Attempt> = None;
        for (i, mode) in modes.iter().enumerate() {
            let Some(attempt) = self.attempt(vehicle, mode, obstacles) else { continue };
            let clear = attempt.excess <= self.settings.low_slack && attempt.solve != Solve::Failed;
            if clear {
                let ending = if i == 0 { Ending::of(attempt.solve) } else { Ending::OtherMode };
                self.endings.count(ending);
                return attempt.moves;
            }
            if best.as_ref().is_none_or(|b| attempt.excess < b.excess - 0.1) {
                best = Some(attempt);
            }
        }
        let Some(attempt) = best else {
            self.endings.count(Ending::Braking);
            return self.brake(vehicle, &straight(vehicle));
        };
        let braked = self.brake(vehicle, &attempt.path);
        let excess = excess(&vehicle.now, &braked, &attempt.spans);
        if attempt.solve == Solve::Failed || excess < attempt.excess - 0.2 {
            self.endings.count(Ending::Braking);
            return braked;
        }
        self.endings.count(Ending::HighSlack);
        attempt.moves
    }

    /// Brakes as hard as possible along a path.
    fn brake(&self, vehicle: &PlannedVehicle<'_>, path: &Path) -> Vec<VehicleMotion> {
        let mut a = self.speed_program.initial_acceleration(vehicle.now.speed, vehicle.now.acceleration);
        let accelerations = [(); STEPS].map(|()| {
            a = (a - self.settings.jerk * DT).max(-self.settings.acceleration);
            a
        });
        drive(vehicle.now, vehicle.rear, path, &accelerations, &self.settings)
    }

    /// Follows a mode that leads backwards; halts if an obstacle is in the path.
    fn follow_backwards(
        &mut self,
        vehicle: &PlannedVehicle<'_>,
        mode: &Mode,
        obstacles: &[&Obstacle],
    ) -> Vec<VehicleMotion> {
        let heading = vehicle.now.pose.heading;
        let poses: Vec<Pose> = mode
            .centres(vehicle.now.pose.position)
            .into_iter()
            .map(|position| Pose { position, heading })
            .collect();
        let limits = MotionLimits {
            acceleration: self.settings.acceleration,
            curvature: self.settings.curvature,
            jerk: self.settings.jerk,
            rear: vehicle.rear,
        };
        self.tracker.set_limits(limits);
        let mut moves = Vec::with_capacity(STEPS);
        self.tracker.track(vehicle.now, &poses, &mut moves);
        let hits = |time: usize, pose: Pose| {
            let mine = vehicle.extent.at(pose.position, direction(pose.heading));
            obstacles.iter().any(|o| {
                let b = &o.boxes[time];
                (b.center - mine.center).norm() < b.radius() + mine.radius() && b.separation(&mine) < 0.3
            })
        };
        let meets = (1..TIMES).any(|t| hits(t, moves[step_of(t) - 1].pose));
        if meets && !hits(0, vehicle.now.pose) {
            let still = vec![vehicle.now.pose; STEPS];
            self.tracker.track(vehicle.now, &still, &mut moves);
        }
        moves
    }

    /// Plans a path and the speed along it for one mode; `None` if its points are no line.
    fn attempt(
        &mut self,
        vehicle: &PlannedVehicle<'_>,
        mode: &Mode,
        obstacles: &[&Obstacle],
    ) -> Option<Attempt> {
        let settings = &self.settings;
        let VehicleMotion { pose, speed, acceleration } = vehicle.now;
        let reference = Reference::new(mode, pose.position);
        let guide = reference.guide(pose.position, direction(pose.heading), vehicle.rear)?;
        let stop = speed * speed / (2.0 * settings.acceleration) + 0.3 * speed;
        let reach = (reference.arc[STEPS - 1].max(stop) + 2.0).clamp(6.0, 300.0);
        let sigma = reference.lateral_sigma(reach);
        let path_problem = PathProblem {
            from: pose,
            rear: vehicle.rear,
            curvature: vehicle.curvature,
            speed,
            guide: &guide,
            reach,
            sigma: &sigma,
        };
        let planned = self
            .path_program
            .plan(&path_problem, |path| lateral_bounds(path, vehicle, &reference, obstacles, settings));
        self.endings.programs += planned.programs + 1;
        for iterations in &planned.iterations {
            *self.endings.iterations.entry(*iterations).or_default() += 1;
        }
        let path = planned.path;
        let braking =
            hardest_braking(speed, self.speed_program.initial_acceleration(speed, acceleration), settings);
        let mut bounds = DistanceBounds::new(braking);
        let mut desired = reference.arcs_along(&path);
        slow_down_for_bends(&mut desired, speed, &path);
        if let Some(end) = vehicle.road.and_then(|road| road_end(&path, road))
            && end < speed * speed / (2.0 * ROAD_END_DECELERATION) + 0.7 * speed + 1.0
        {
            bounds.stop_at(end - 0.3);
        }
        let mut all = Vec::new();
        for obstacle in obstacles {
            let occupied = spans(&path, vehicle.extent, obstacle);
            if bounds.keep_clear(vehicle, obstacle, &occupied, &desired, settings) {
                all.push(occupied);
            }
        }
        bounds.cap(&mut desired);
        let problem = SpeedProblem {
            speed,
            acceleration,
            distances: &desired,
            sigma: reference.along.as_ref(),
            ahead: &bounds.ahead,
            av_braking: &bounds.av_braking,
        };
        let (solution, accelerations) = self.speed_program.solve(&problem);
        if solution.iterations > 0 {
            *self.endings.iterations.entry(solution.iterations).or_default() += 1;
        }
        for solve in [planned.solve, solution.solve] {
            self.endings.failed += u64::from(solve == Solve::Failed);
        }
        let moves = drive(vehicle.now, vehicle.rear, &path, &accelerations, settings);
        let excess = excess(&vehicle.now, &moves, &all);
        // If the solver gave up on the path, the path is that of the round before, which can be driven.
        let planned = if planned.solve == Solve::Failed { Solve::AlmostSolved } else { planned.solve };
        Some(Attempt { moves, path, solve: solution.solve.max(planned), excess, spans: all })
    }
}

/// Returns the way from the present position of a vehicle to the last centre of a mode, metres.
fn way(vehicle: &PlannedVehicle<'_>, mode: &Mode) -> Vec2 {
    let now = vehicle.now.pose.position;
    mode.centres(now)[STEPS - 1] - now
}

/// Returns whether a vehicle stands and does not set off.
pub(super) fn stays(vehicle: &PlannedVehicle<'_>, mode: &Mode) -> bool {
    vehicle.now.speed.abs() < STANDSTILL_SPEED && way(vehicle, mode).norm() < STANDSTILL_REACH
}

/// Returns whether a vehicle reverses, or its mode leads backwards.
pub(super) fn reverses(vehicle: &PlannedVehicle<'_>, mode: &Mode) -> bool {
    let (way, axis) = (way(vehicle, mode), direction(vehicle.now.pose.heading));
    vehicle.now.speed < -REVERSING_SPEED
        || vehicle.now.speed < REVERSING_SPEED && way.dot(&axis) < -0.7 * way.norm()
}

fn straight(vehicle: &PlannedVehicle<'_>) -> Path {
    Path::drive(vehicle.now.pose, vehicle.rear, 1.0, &[0.0; super::path::STATIONS + 1])
}

/// Lowers the desired distances where the bends of the path require a lower speed.
fn slow_down_for_bends(desired: &mut [f64; STEPS], speed: f64, path: &Path) {
    let fastest = desired.windows(2).map(|w| (w[1] - w[0]) / DT).fold(speed, f64::max);
    let sharpest = path.stations.iter().map(|s| s.curvature.abs()).fold(0.0, f64::max);
    if fastest * fastest * sharpest <= COMFORTABLE_LATERAL_ACCELERATION {
        return;
    }
    let mut allowed =
        path.stations.map(|s| (COMFORTABLE_LATERAL_ACCELERATION / s.curvature.abs().max(1e-6)).sqrt());
    for j in (0..allowed.len() - 1).rev() {
        let length = path.stations[j + 1].arc - path.stations[j].arc;
        let before = (allowed[j + 1] * allowed[j + 1] + 2.0 * COMFORTABLE_DECELERATION * length).sqrt();
        allowed[j] = allowed[j].min(before);
    }
    let (mut arc, mut desired_before) = (0.0, 0.0);
    for w in desired.iter_mut() {
        let (j, t) = path.locate(arc);
        let most = allowed[j] + (allowed[j + 1] - allowed[j]) * t.clamp(0.0, 1.0);
        let step = (*w - desired_before).min(most * DT);
        desired_before = *w;
        arc += step.max(0.0);
        *w = arc;
    }
}
