//! The path: a quadratic program over curvatures, linearised about the path that was found last.
//!
//! The curvature of the rear axle's path is linear between knots; the first one is what the wheel is at now. Where the box centre comes
//! to lie aside of a station is linear in small changes of the curvatures: turns add up to headings, headings to ways aside. The path is
//! driven exactly with what is found, and linearised anew where it moved much.

use reactsim::dynamics::Pose;
use reactsim::geometry::{Polyline, Vec2, left};

use super::program::{CONTROLS, Controls, Pattern, Program, Quadratic, Solve};
use super::settings::Settings;
use super::way::{STATIONS, Way};

/// Stations at which the curvature is a control; at station 0 it is known.
const KNOTS: [usize; CONTROLS] = [1, 2, 4, 6, 9, 12, 16, 20, 25, 30];
/// Stations at which the sides are kept.
pub(super) const SIDES: usize = STATIONS / 2;
/// Errors that cost as much as one another: of the acceleration across, m/s², and of its change, m/s³.
const ACCELERATION_SCALE: f64 = 9.0;
const JERK_SCALE: f64 = 12.0;
/// Slower vehicles are taken to be so fast, m/s: otherwise bends would cost nothing.
const SLOWEST: f64 = 4.0;
/// Penalty of a metre aside.
const PENALTY: f64 = 150.0;
/// A path that moved less than this is not linearised anew, metres.
const SETTLED: f64 = 0.25;
/// Times that a path is linearised.
const ROUNDS: usize = 4;
/// Largest change of the curvature per second and per metre, 1/m.
const STEERING_SPEED: f64 = 0.4;
const STEERING_RATE: f64 = 0.25;

/// How far the box centre may go aside of a station, metres, left positive: the least and the most.
pub(super) type Sides = [(f64, f64); SIDES];

/// The station whose sides these are.
pub(super) fn station_of_side(side: usize) -> usize {
    2 * side + 2
}

/// What a path has to do.
pub(super) struct Course<'a> {
    pub(super) from: Pose,
    /// How far the rear axle lies behind the centre, metres.
    pub(super) rear: f64,
    /// Curvature now, 1/m; `None` for one that may be chosen (a vehicle that stands).
    pub(super) curvature: Option<f64>,
    /// Present speed, m/s.
    pub(super) speed: f64,
    /// What is followed by the box centre.
    pub(super) guide: &'a Polyline,
    /// Length of the path, metres.
    pub(super) reach: f64,
    /// How uncertain the guide is at each station, metres.
    pub(super) sigma: &'a [f64; STATIONS + 1],
}

/// A path, and how it was found.
pub(super) struct Laid {
    pub(super) way: Way,
    pub(super) solve: Solve,
    /// How often it was minimised.
    pub(super) programs: u64,
    /// Iterations of every time that the solver was needed.
    pub(super) iterations: Vec<u32>,
}

pub(super) struct Bends {
    program: Program,
    limit: f64,
    lateral: f64,
}

impl Bends {
    /// `None` where the solver refuses the pattern.
    pub(super) fn new(settings: &Settings) -> Option<Self> {
        let mut patterns = Vec::new();
        for i in 0..CONTROLS {
            patterns.extend([i..i + 1, i..i + 1].map(|controls| Pattern { controls, slack: None }));
        }
        for i in 0..CONTROLS {
            let controls = i.saturating_sub(1)..i + 1;
            patterns.extend([controls.clone(), controls].map(|controls| Pattern { controls, slack: None }));
        }
        for side in 0..SIDES {
            let station = station_of_side(side);
            let last = KNOTS.partition_point(|&knot| knot < station).min(CONTROLS - 1);
            let controls = 0..last + 1;
            patterns
                .extend([controls.clone(), controls].map(|controls| Pattern { controls, slack: Some(0) }));
        }
        let program = Program::new(patterns, vec![PENALTY])?;
        Some(Self { program, limit: settings.curvature, lateral: settings.lateral_acceleration })
    }

    /// Lays a path along the guide; `sides` says how far aside of the stations of a path it may go.
    pub(super) fn lay(&mut self, course: &Course<'_>, mut sides: impl FnMut(&Way) -> Sides) -> Laid {
        let spacing = course.reach / STATIONS as f64;
        let (mut controls, start) = self.pursue(course, spacing);
        let course = Course { curvature: Some(start), ..*course };
        let limits = self.limits(&course, spacing, start);
        let scale = 10.0 / (course.reach * course.reach);
        let mut way = drive(&course, spacing, start, &controls);
        let mut laid = (Solve::ClosedForm, Vec::new());
        let mut programs = 0;
        let mut narrowed = false;
        for round in 0..ROUNDS {
            let gains = gains(&way, course.rear);
            let errors = errors(&way, course.guide);
            let asides = sides(&way);
            // A path that was pushed aside is not let go of again.
            narrowed |= asides.iter().any(|s| s.0 > -1e3 || s.1 < 1e3);
            let speed = course.speed.max(SLOWEST);
            let mut cost = Quadratic::ZERO;
            let share = 1.0 / STATIONS as f64;
            for j in 1..=STATIONS {
                let row = gains[j].map(|g| g * scale);
                let now: f64 = gains[j].iter().zip(&controls).map(|(g, c)| g * c).sum();
                cost.add(&row, errors[j] + now, share / (course.sigma[j] * course.sigma[j]));
            }
            self.comfort(&mut cost, speed, spacing, start, scale);
            self.bound(&limits, spacing, start, scale, course.speed);
            let mut row = 4 * CONTROLS;
            for (side, (low, high)) in asides.into_iter().enumerate() {
                let j = station_of_side(side);
                let values = gains[j].map(|g| g * scale);
                let now: f64 = gains[j].iter().zip(&controls).map(|(g, c)| g * c).sum();
                self.program.set(row, &values, high + now);
                self.program.set(row + 1, &values.map(|x| -x), -(low + now));
                row += 2;
            }
            programs += 1;
            let found = match cost.minimum() {
                Some(free) => self.program.solve(&cost, &free),
                None => self.program.solve_by_solver(&cost),
            };
            if found.iterations > 0 {
                laid.1.push(found.iterations);
            }
            laid.0 = laid.0.max(found.solve);
            if found.solve == Solve::Failed {
                break;
            }
            controls = std::array::from_fn(|i| (found.controls[i] * scale).clamp(-limits[i], limits[i]));
            let next = drive(&course, spacing, start, &controls);
            let moved = (1..=STATIONS)
                .map(|j| (next.stations[j].centre - way.stations[j].centre).norm())
                .fold(0.0_f64, f64::max);
            way = next;
            if moved < SETTLED && !(narrowed && round == 0) {
                break;
            }
        }
        Laid { way, solve: laid.0, programs, iterations: laid.1 }
    }

    /// A first path, by pure pursuit from station to station (Coulter, 1992): curvatures at the knots, and the one now.
    fn pursue(&self, course: &Course<'_>, spacing: f64) -> (Controls, f64) {
        let mut axis = reactsim::geometry::direction(course.from.heading);
        let mut axle = course.from.position - axis * course.rear;
        let ahead = (0.6 * course.speed).clamp(3.0, 12.0).max(1.5 * spacing);
        let limit = self.limit;
        let mut known = course.curvature.map(|c| c.clamp(-2.0 * limit, 2.0 * limit));
        let (mut bends, mut segment) = ([0.0; STATIONS + 1], 0);
        for (j, bend) in bends.iter_mut().enumerate() {
            let near = course.guide.project_between(axle, segment, segment + 12);
            segment = near.segment;
            let to = course.guide.at(near.s + ahead) - axle;
            let wanted = (2.0 * axis.perp(&to) / to.norm_squared().max(1.0)).clamp(-limit, limit);
            *bend = if j == 0 { known.take().unwrap_or(wanted) } else { wanted };
            let turn = *bend * spacing;
            let half = turned(axis, 0.5 * turn);
            axle += half * spacing;
            axis = turned(half, 0.5 * turn);
        }
        (KNOTS.map(|knot| bends[knot]), bends[0])
    }

    /// Largest curvatures at the knots: those that the vehicle is able to have at the least speed that it can have there, and those that
    /// the wheel can have reached.
    fn limits(&self, course: &Course<'_>, spacing: f64, start: f64) -> Controls {
        let rate = rate(course.speed);
        KNOTS.map(|knot| {
            let way = spacing * knot as f64;
            let slowest = (course.speed * course.speed - 2.0 * 4.5 * way).max(1.0);
            let most = self.limit.min(self.lateral / slowest);
            most.max(start.abs() - rate * way)
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
            // The change of the acceleration across per second, at this speed.
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
        let one = |i: usize| -> Controls { std::array::from_fn(|c| if c == i { 1.0 } else { 0.0 }) };
        for (i, &limit) in limits.iter().enumerate() {
            self.program.set(2 * i, &one(i), limit / scale);
            self.program.set(2 * i + 1, &one(i).map(|x| -x), limit / scale);
        }
        let rate = rate(speed);
        let mut before = 0;
        for (i, &knot) in KNOTS.iter().enumerate() {
            let most = rate * spacing * (knot - before) as f64 / scale;
            let mut change = one(i);
            let from = if i == 0 { start / scale } else { 0.0 };
            if i > 0 {
                change[i - 1] = -1.0;
            }
            let row = 2 * CONTROLS + 2 * i;
            self.program.set(row, &change, most + from);
            self.program.set(row + 1, &change.map(|x| -x), most - from);
            before = knot;
        }
    }
}

/// Largest change of the curvature per metre.
fn rate(speed: f64) -> f64 {
    STEERING_RATE.min(STEERING_SPEED / speed.max(0.1))
}

/// A unit vector turned by a small angle.
fn turned(v: Vec2, angle: f64) -> Vec2 {
    let w = v + left(v) * angle;
    w / w.norm()
}

/// The path with these curvatures at the knots.
fn drive(course: &Course<'_>, spacing: f64, start: f64, controls: &Controls) -> Way {
    let mut curvatures = [start; STATIONS + 1];
    let (mut before, mut from) = (0, start);
    for (&knot, &to) in KNOTS.iter().zip(controls) {
        for (m, curvature) in curvatures[before + 1..=knot].iter_mut().enumerate() {
            *curvature = from + (to - from) * (m + 1) as f64 / (knot - before) as f64;
        }
        (before, from) = (knot, to);
    }
    Way::drive(course.from, course.rear, spacing, &curvatures)
}

/// How far the box centre goes to the left at each station for every curvature, metres per 1/m.
fn gains(way: &Way, rear: f64) -> [Controls; STATIONS + 1] {
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
        let (a, b) = (&way.stations[j], &way.stations[j + 1]);
        let across = left(a.axis + b.axis) * 0.5;
        let side = left(b.axis);
        for i in 0..CONTROLS {
            let bend = 0.5 * (weights[j][i] + weights[j + 1][i]) * way.spacing;
            axle[i] += across * ((turn[i] + 0.5 * bend) * way.spacing);
            turn[i] += bend;
            gains[j + 1][i] = axle[i].dot(&side) + rear * turn[i];
        }
    }
    gains
}

/// How far to the left of each station the guide lies, metres.
fn errors(way: &Way, guide: &Polyline) -> [f64; STATIONS + 1] {
    let mut segment = 0;
    std::array::from_fn(|j| {
        let station = &way.stations[j];
        let near = guide.project_between(station.centre, segment, segment + 16);
        segment = near.segment;
        let mut to = guide.on_segment(near.s, near.segment) - station.centre;
        if near.t >= 1.0 && near.segment + 1 == guide.segments() {
            // Beyond its end the guide goes on straight.
            let (a, b) = guide.segment(near.segment);
            let along = (b - a) / (b - a).norm();
            to += along * (station.centre - b).dot(&along);
        }
        to.dot(&way.side(j))
    })
}
