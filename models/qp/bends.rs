//! Path planning: a quadratic program over curvatures, linearised about the previous path.
//!
//! The curvature of the rear axle's path is linear between knots; its first value is the present
//! curvature. The lateral position of the box centre at a station is linear in small changes of the
//! curvatures: turns add up to headings, and headings to lateral offsets. The path is driven exactly
//! with the solution, and linearised again where it moved much.

use reactsim_geometry::{Polyline, Vec2, left};
use reactsim_scene::dynamics::Pose;

use super::path::{Path, STATIONS};
use super::program::{CONTROLS, Controls, Pattern, Program, Quadratic, Solve, unit};
use super::settings::Settings;

/// Stations at which the curvature is a control. At station 0 the curvature is given.
const KNOTS: [usize; CONTROLS] = [1, 2, 4, 6, 9, 12, 16, 20, 25, 30];
/// Number of stations with lateral bounds: every second one.
pub(super) const LATERAL_BOUNDS: usize = STATIONS / 2;
/// Lateral acceleration, in m/s², that costs as much as a lateral jerk of [`JERK_SCALE`].
const ACCELERATION_SCALE: f64 = 9.0;
/// Lateral jerk, in m/s³, that costs as much as a lateral acceleration of [`ACCELERATION_SCALE`].
const JERK_SCALE: f64 = 12.0;
/// Smallest speed, in m/s, at which comfort is judged: at lower speeds bends would cost nothing.
const MIN_COMFORT_SPEED: f64 = 4.0;
/// Penalty per metre by which a lateral bound is exceeded.
const BOUND_PENALTY: f64 = 150.0;
/// Displacement in metres below which the path is not linearised again.
const CONVERGED_SHIFT: f64 = 0.25;
/// Largest number of linearisations.
const MAX_ROUNDS: usize = 4;
/// Largest change of the curvature per second, 1/(m s).
const MAX_CURVATURE_SPEED: f64 = 0.4;
/// Largest change of the curvature per metre of path, 1/m².
const MAX_CURVATURE_RATE: f64 = 0.25;
/// Deceleration with which the vehicle can slow down before a bend, m/s².
const BRAKING_BEFORE_BEND: f64 = 4.5;
/// Least square of the speed in a bend, m²/s².
const MIN_SQUARED_SPEED: f64 = 1.0;

/// Smallest and largest lateral offset of the box centre at each bounded station, metres, left
/// positive.
pub(super) type LateralBounds = [(f64, f64); LATERAL_BOUNDS];

/// Returns the station of a lateral bound.
pub(super) fn station_of_bound(side: usize) -> usize {
    2 * side + 2
}

/// Input of the path program.
pub(super) struct PathProblem<'a> {
    pub(super) from: Pose,
    /// Distance from the rear axle forward to the box centre, metres.
    pub(super) rear: f64,
    /// Present curvature, 1/m; `None` if it is free (a vehicle at standstill).
    pub(super) curvature: Option<f64>,
    /// Present speed, m/s.
    pub(super) speed: f64,
    /// Line that the box centre follows.
    pub(super) guide: &'a Polyline,
    /// Length of the path, metres.
    pub(super) reach: f64,
    /// Lateral standard deviation of the guide at each station, metres.
    pub(super) sigma: &'a [f64; STATIONS + 1],
}

/// Solution of the path program.
pub(super) struct PathSolution {
    pub(super) path: Path,
    pub(super) solve: Solve,
    /// Number of programs minimised.
    pub(super) programs: u64,
    /// Solver iterations, one entry per program that needed the solver.
    pub(super) iterations: Vec<u32>,
}

/// The path program and its limits.
pub(super) struct PathProgram {
    program: Program,
    /// Largest curvature, 1/m.
    max_curvature: f64,
    /// Largest lateral acceleration, m/s².
    max_lateral_acceleration: f64,
}

impl PathProgram {
    /// Creates the program; `None` if the solver rejects its pattern.
    pub(super) fn new(settings: &Settings) -> Option<Self> {
        let mut patterns = Vec::new();
        for i in 0..CONTROLS {
            patterns.extend([i..i + 1, i..i + 1].map(|controls| Pattern { controls, slack: None }));
        }
        for i in 0..CONTROLS {
            let controls = i.saturating_sub(1)..i + 1;
            patterns.extend([controls.clone(), controls].map(|controls| Pattern { controls, slack: None }));
        }
        for side in 0..LATERAL_BOUNDS {
            let station = station_of_bound(side);
            let last = KNOTS.partition_point(|&knot| knot < station).min(CONTROLS - 1);
            let controls = 0..last + 1;
            patterns
                .extend([controls.clone(), controls].map(|controls| Pattern { controls, slack: Some(0) }));
        }
        let program = Program::new(patterns, vec![BOUND_PENALTY])?;
        Some(Self {
            program,
            max_curvature: settings.curvature,
            max_lateral_acceleration: settings.lateral_acceleration,
        })
    }

    /// Plans a path along the guide. `sides` returns the lateral bounds at the stations of a path.
    pub(super) fn plan(
        &mut self,
        problem: &PathProblem<'_>,
        mut sides: impl FnMut(&Path) -> LateralBounds,
    ) -> PathSolution {
        let spacing = problem.reach / STATIONS as f64;
        let (mut controls, start) = self.pursue(problem, spacing);
        let problem = PathProblem { curvature: Some(start), ..*problem };
        let limits = self.limits(&problem, spacing, start);
        let scale = 10.0 / (problem.reach * problem.reach);
        let mut path = drive(&problem, spacing, start, &controls);
        let mut outcome = (Solve::ClosedForm, Vec::new());
        let mut programs = 0;
        let mut narrowed = false;
        let mut before: Option<(Path, LateralBounds)> = None;
        for round in 0..MAX_ROUNDS {
            let gains = gains(&path, problem.rear);
            let errors = errors(&path, problem.guide);
            let mut bounds = sides(&path);
            if let Some((before, kept)) = &before {
                bounds = narrowed_by(&bounds, &path, kept, before);
            }
            // If bounds narrow the path, the first round never counts as converged.
            narrowed |= bounds.iter().any(|s| s.0 > -1e3 || s.1 < 1e3);
            let speed = problem.speed.max(MIN_COMFORT_SPEED);
            let mut cost = Quadratic::ZERO;
            let share = 1.0 / STATIONS as f64;
            for j in 1..=STATIONS {
                let row = gains[j].map(|g| g * scale);
                let now: f64 = gains[j].iter().zip(&controls).map(|(g, c)| g * c).sum();
                cost.add(&row, errors[j] + now, share / (problem.sigma[j] * problem.sigma[j]));
            }
            self.comfort(&mut cost, speed, spacing, start, scale);
            self.bound(&limits, spacing, start, scale, problem.speed);
            let mut row = 4 * CONTROLS;
            for (side, (low, high)) in bounds.into_iter().enumerate() {
                let j = station_of_bound(side);
                let values = gains[j].map(|g| g * scale);
                let now: f64 = gains[j].iter().zip(&controls).map(|(g, c)| g * c).sum();
                self.program.set(row, &values, high + now);
                self.program.set(row + 1, &values.map(|x| -x), -(low + now));
                row += 2;
            }
            programs += 1;
            let solution = self.program.solve(&cost, cost.minimum());
            if solution.iterations > 0 {
                outcome.1.push(solution.iterations);
            }
            outcome.0 = outcome.0.max(solution.solve);
            if solution.solve == Solve::Failed {
                break;
            }
            controls = std::array::from_fn(|i| (solution.controls[i] * scale).clamp(-limits[i], limits[i]));
            let next = drive(&problem, spacing, start, &controls);
            let moved = (1..=STATIONS)
                .map(|j| (next.stations[j].centre - path.stations[j].centre).norm())
                .fold(0.0_f64, f64::max);
            before = Some((std::mem::replace(&mut path, next), bounds));
            if moved < CONVERGED_SHIFT && !(narrowed && round == 0) {
                break;
            }
        }
        PathSolution { path, solve: outcome.0, programs, iterations: outcome.1 }
    }

    /// Returns an initial path by pure pursuit from station to station (Coulter, 1992): the curvatures
    /// at the knots, and the present curvature.
    fn pursue(&self, problem: &PathProblem<'_>, spacing: f64) -> (Controls, f64) {
        let mut axis = reactsim_geometry::direction(problem.from.heading);
        let mut axle = problem.from.position - axis * problem.rear;
        let ahead = (0.6 * problem.speed).clamp(3.0, 12.0).max(1.5 * spacing);
        let limit = self.max_curvature;
        let mut known = problem.curvature.map(|c| c.clamp(-2.0 * limit, 2.0 * limit));
        let (mut bends, mut segment) = ([0.0; STATIONS + 1], 0);
        for (j, bend) in bends.iter_mut().enumerate() {
            let near = problem.guide.project_between(axle, segment, segment + 12);
            segment = near.segment;
            let to = problem.guide.at(near.s + ahead) - axle;
            let curvature = (2.0 * axis.perp(&to) / to.norm_squared().max(1.0)).clamp(-limit, limit);
            *bend = if j == 0 { known.take().unwrap_or(curvature) } else { curvature };
            let turn = *bend * spacing;
            let half = turned(axis, 0.5 * turn);
            axle += half * spacing;
            axis = turned(half, 0.5 * turn);
        }
        (KNOTS.map(|knot| bends[knot]), bends[0])
    }

    /// Returns the largest curvatures at the knots: the limit at the lowest speed that the vehicle can
    /// have reached there, but at least what remains of the present curvature after straightening at
    /// the largest rate.
    fn limits(&self, problem: &PathProblem<'_>, spacing: f64, start: f64) -> Controls {
        let rate = curvature_rate(problem.speed);
        KNOTS.map(|knot| {
            let distance = spacing * knot as f64;
            let slowest =
                (problem.speed * problem.speed - 2.0 * BRAKING_BEFORE_BEND * distance).max(MIN_SQUARED_SPEED);
            let most = self.max_curvature.min(self.max_lateral_acceleration / slowest);
            most.max(start.abs() - rate * distance)
        })
    }

    fn comfort(&self, cost: &mut Quadratic, speed: f64, spacing: f64, start: f64, scale: f64) {
        let across = speed * speed;
        let total = STATIONS as f64;
        let mut before = 0;
        for (i, &knot) in KNOTS.iter().enumerate() {
            let length = (knot - before) as f64;
            let mut one = [0.0; CONTROLS];
            one[i] = across * scale;
            cost.add(&one, 0.0, length / (total * ACCELERATION_SCALE * ACCELERATION_SCALE));
            // Lateral jerk at this speed per unit of curvature change.
            let per = across * speed / (length * spacing);
            let mut change = [0.0; CONTROLS];
            change[i] = per * scale;
            if i > 0 {
                change[i - 1] = -per * scale;
            }
            let target = if i == 0 { per * start } else { 0.0 };
            cost.add(&change, target, length / (total * JERK_SCALE * JERK_SCALE));
            before = knot;
        }
    }

    fn bound(&mut self, limits: &Controls, spacing: f64, start: f64, scale: f64, speed: f64) {
        for (i, &limit) in limits.iter().enumerate() {
            self.program.set(2 * i, &unit(i), limit / scale);
            self.program.set(2 * i + 1, &unit(i).map(|x| -x), limit / scale);
        }
        let rate = curvature_rate(speed);
        let mut before = 0;
        for (i, &knot) in KNOTS.iter().enumerate() {
            let max_change = rate * spacing * (knot - before) as f64 / scale;
            let mut change = unit(i);
            let from = if i == 0 { start / scale } else { 0.0 };
            if i > 0 {
                change[i - 1] = -1.0;
            }
            let row = 2 * CONTROLS + 2 * i;
            self.program.set(row, &change, max_change + from);
            self.program.set(row + 1, &change.map(|x| -x), max_change - from);
            before = knot;
        }
    }
}

/// Returns bounds at the stations of a path, narrowed by the bounds of the path before. A path that satisfies
/// bounds has no reason for them any more; without them, the next one would return to where they were
/// needed. Bounds that contradict them stay.
fn narrowed_by(bounds: &LateralBounds, path: &Path, kept: &LateralBounds, before: &Path) -> LateralBounds {
    std::array::from_fn(|side| {
        let j = station_of_bound(side);
        let moved = (path.stations[j].centre - before.stations[j].centre).dot(&before.side(j));
        let low = bounds[side].0.max(kept[side].0 - moved);
        let high = bounds[side].1.min(kept[side].1 - moved);
        if low <= high { (low, high) } else { bounds[side] }
    })
}

/// Returns the largest change of the curvature per metre at a speed, 1/m².
fn curvature_rate(speed: f64) -> f64 {
    MAX_CURVATURE_RATE.min(MAX_CURVATURE_SPEED / speed.max(0.1))
}

/// Rotates a unit vector by a small angle.
fn turned(v: Vec2, angle: f64) -> Vec2 {
    let w = v + left(v) * angle;
    w / w.norm()
}

/// Drives the path with these curvatures at the knots.
fn drive(problem: &PathProblem<'_>, spacing: f64, start: f64, controls: &Controls) -> Path {
    let mut curvatures = [start; STATIONS + 1];
    let (mut before, mut from) = (0, start);
    for (&knot, &to) in KNOTS.iter().zip(controls) {
        for (m, curvature) in curvatures[before + 1..=knot].iter_mut().enumerate() {
            *curvature = from + (to - from) * (m + 1) as f64 / (knot - before) as f64;
        }
        (before, from) = (knot, to);
    }
    Path::drive(problem.from, problem.rear, spacing, &curvatures)
}

/// Returns the sensitivity of the lateral position of the box centre at each station to each curvature,
/// metres per 1/m, left positive.
fn gains(path: &Path, rear: f64) -> [Controls; STATIONS + 1] {
    let mut weights = [[0.0; CONTROLS]; STATIONS + 1];
    let mut before = 0;
    for (i, &knot) in KNOTS.iter().enumerate() {
        for (m, row) in weights[before + 1..=knot].iter_mut().enumerate() {
            let t = (m + 1) as f64 / (knot - before) as f64;
            row[i] += t;
            if i > 0 {
                row[i - 1] += 1.0 - t;
            }
        }
        before = knot;
    }
    let mut gains = [[0.0; CONTROLS]; STATIONS + 1];
    let (mut turn, mut axle) = ([0.0; CONTROLS], [Vec2::zeros(); CONTROLS]);
    for j in 0..STATIONS {
        let (a, b) = (&path.stations[j], &path.stations[j + 1]);
        let across = left(a.axis + b.axis) * 0.5;
        let side = left(b.axis);
        for i in 0..CONTROLS {
            let bend = 0.5 * (weights[j][i] + weights[j + 1][i]) * path.spacing;
            axle[i] += across * ((turn[i] + 0.5 * bend) * path.spacing);
            turn[i] += bend;
            gains[j + 1][i] = axle[i].dot(&side) + rear * turn[i];
        }
    }
    gains
}

/// Returns the lateral offset of the guide from each station, metres, left positive.
fn errors(path: &Path, guide: &Polyline) -> [f64; STATIONS + 1] {
    let mut segment = 0;
    std::array::from_fn(|j| {
        let station = &path.stations[j];
        let near = guide.project_between(station.centre, segment, segment + 16);
        segment = near.segment;
        let mut to = guide.on_segment(near.s, near.segment) - station.centre;
        if near.t >= 1.0 && near.segment + 1 == guide.segments() {
            // The guide continues straight beyond its end.
            let (a, b) = guide.segment(near.segment);
            let along = (b - a) / (b - a).norm();
            to += along * (station.centre - b).dot(&along);
        }
        to.dot(&path.side(j))
    })
}
