//! Speed planning along a path: a quadratic program over accelerations.
//!
//! Time runs in steps of 0.1 s. As in the metrics, the speed of a step is the distance that the box
//! centre moves divided by 0.1 s, and the acceleration of a step is its change of speed. Accelerations
//! are linear between knots, which are denser early on: the part that is executed before the next plan
//! has a knot every 0.2 s. Costs and bounds apply to single steps.

use reactsim_scene::DT;

use super::program::{CONTROLS, Controls, Factor, Pattern, Program, Quadratic, Solution, unit};
use super::settings::Settings;

/// Number of planned steps: 5 s.
pub const STEPS: usize = 50;
/// Steps at which the acceleration is a control.
const KNOTS: [usize; CONTROLS] = [0, 2, 4, 7, 10, 15, 20, 27, 36, 49];
/// Number of knots, from the start, at which the jerk is bounded. Later knots are so far apart that the
/// bound on the acceleration suffices.
const JERK_BOUNDS: usize = 5;
/// Steps, counted from 1, at which distance bounds apply: every 0.1 s up to 0.6 s, then every 0.2 s.
pub(super) const CHECKED: [usize; 28] =
    [1, 2, 3, 4, 5, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30, 32, 34, 36, 38, 40, 42, 44, 46, 48, 50];
/// Steps at which speeds are bounded to be non-negative.
const NON_NEGATIVE_SPEED: [usize; 13] = [2, 4, 7, 10, 14, 18, 22, 27, 31, 36, 40, 45, 50];
/// Acceleration, in m/s², that costs as much as a jerk of [`JERK_SCALE`].
const ACCELERATION_SCALE: f64 = 5.0;
/// Jerk, in m/s³, that costs as much as an acceleration of [`ACCELERATION_SCALE`].
const JERK_SCALE: f64 = 8.0;
/// Penalties per metre of violation: of the distance bounds, and of the bounds for a braking AV.
const PENALTIES: [f64; 2] = [400.0, 12.0];
/// Number of bounds for a braking AV.
pub(super) const AV_BRAKING_BOUNDS: usize = 2;

/// Default standard deviation of a mode along its motion at a step, metres.
pub(super) fn default_sigma(step: usize) -> f64 {
    0.5 + 0.2 * DT * step as f64
}

/// A bound on the distance: `distance + time · speed ≤ bound` after a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Bound {
    /// Step, counted from 1.
    pub(super) step: usize,
    /// Time gap, seconds.
    pub(super) time: f64,
    /// Bound, metres.
    pub(super) bound: f64,
}

/// Input of the speed program.
#[derive(Clone, Debug)]
pub(super) struct SpeedProblem<'a> {
    /// Speed of the last step, m/s, not negative.
    pub(super) speed: f64,
    /// Acceleration of the last step, m/s².
    pub(super) acceleration: f64,
    /// Desired distance after every step, metres.
    pub(super) distances: &'a [f64; STEPS],
    /// Standard deviation of these distances, metres; `None` for default values.
    pub(super) sigma: Option<&'a [f64; STEPS]>,
    /// One bound per entry of [`CHECKED`]; infinite if there is none.
    pub(super) ahead: &'a [Bound; CHECKED.len()],
    /// Bounds that leave room for a response if the AV brakes.
    pub(super) av_braking: &'a [Bound],
}

/// The speed program, with everything that does not depend on the problem.
pub(super) struct SpeedProgram {
    /// Acceleration of each step as a row of the controls.
    accelerations: [Controls; STEPS],
    /// Speed after each step as a row of the controls, without the contribution of the present speed.
    speeds: [Controls; STEPS],
    /// Distance after each step as a row of the controls, without the contribution of the present
    /// speed.
    distances: [Controls; STEPS],
    /// Cost of accelerations and jerks.
    comfort: Quadratic,
    /// Quadratic part of the whole cost for the default standard deviations, and its factor.
    default_cost: ([Controls; CONTROLS], Factor),
    program: Program,
    /// Largest magnitude of the acceleration, m/s².
    limit: f64,
    /// Largest magnitude of the jerk, m/s³.
    jerk: f64,
}

impl SpeedProgram {
    /// Creates the program; `None` if the solver rejects its pattern.
    pub(super) fn new(settings: &Settings) -> Option<Self> {
        let mut accelerations = [[0.0; CONTROLS]; STEPS];
        for (k, row) in accelerations.iter_mut().enumerate() {
            let i = KNOTS.partition_point(|&knot| knot <= k).clamp(1, CONTROLS - 1) - 1;
            let t = (k - KNOTS[i]) as f64 / (KNOTS[i + 1] - KNOTS[i]) as f64;
            (row[i], row[i + 1]) = (1.0 - t, t);
        }
        let (mut speeds, mut distances) = ([[0.0; CONTROLS]; STEPS], [[0.0; CONTROLS]; STEPS]);
        let (mut speed, mut distance) = ([0.0; CONTROLS], [0.0; CONTROLS]);
        for k in 0..STEPS {
            for i in 0..CONTROLS {
                speed[i] += DT * accelerations[k][i];
                distance[i] += DT * speed[i];
            }
            (speeds[k], distances[k]) = (speed, distance);
        }
        let share = 1.0 / STEPS as f64;
        let mut comfort = Quadratic::ZERO;
        let mut before = [0.0; CONTROLS];
        for row in &accelerations {
            comfort.add(row, 0.0, share / (ACCELERATION_SCALE * ACCELERATION_SCALE));
            let change: Controls = std::array::from_fn(|i| (row[i] - before[i]) / DT);
            comfort.add(&change, 0.0, share / (JERK_SCALE * JERK_SCALE));
            before = *row;
        }
        let mut whole = comfort.clone();
        for (k, row) in distances.iter().enumerate() {
            whole.add(row, 0.0, distance_weight(default_sigma(k + 1)));
        }
        let factor = Factor::of(&whole.p)?;
        let upto = |step: usize| {
            let last = KNOTS.partition_point(|&knot| knot < step).min(CONTROLS - 1);
            0..last + 1
        };
        let mut patterns = Vec::new();
        for i in 0..CONTROLS {
            patterns.extend([i..i + 1, i..i + 1].map(|controls| Pattern { controls, slack: None }));
        }
        for i in 0..JERK_BOUNDS {
            let controls = i.saturating_sub(1)..i + 1;
            patterns.extend([controls.clone(), controls].map(|controls| Pattern { controls, slack: None }));
        }
        patterns.extend(NON_NEGATIVE_SPEED.map(|step| Pattern { controls: upto(step), slack: None }));
        patterns.extend(CHECKED.map(|step| Pattern { controls: upto(step), slack: Some(0) }));
        patterns.extend([(); AV_BRAKING_BOUNDS].map(|()| Pattern { controls: 0..CONTROLS, slack: Some(1) }));
        Some(Self {
            accelerations,
            speeds,
            distances,
            comfort,
            default_cost: (whole.p, factor),
            program: Program::new(patterns, PENALTIES.to_vec())?,
            limit: settings.acceleration,
            jerk: settings.jerk,
        })
    }

    /// Returns the acceleration that planning starts from: that of the last step, limited so that it
    /// can end before the vehicle stands.
    pub(super) fn initial_acceleration(&self, speed: f64, acceleration: f64) -> f64 {
        acceleration.clamp((-speed / (3.0 * DT)).max(-self.limit), self.limit)
    }

    /// Returns the solution and the acceleration of every step.
    pub(super) fn solve(&mut self, problem: &SpeedProblem<'_>) -> (Solution, [f64; STEPS]) {
        let (cost, free) = self.cost(problem);
        self.bound(problem);
        let solution = self.program.solve(&cost, free);
        let steps = self.accelerations.map(|row| dot(&row, &solution.controls));
        (solution, steps)
    }

    /// Returns the cost and its minimiser.
    fn cost(&self, problem: &SpeedProblem<'_>) -> (Quadratic, Option<Controls>) {
        let mut cost = self.comfort.clone();
        let share = 1.0 / STEPS as f64;
        // The first jerk is relative to the present acceleration.
        let first = 2.0 * share / (JERK_SCALE * JERK_SCALE * DT * DT);
        let last = self.initial_acceleration(problem.speed, problem.acceleration);
        for i in 0..CONTROLS {
            cost.q[i] -= first * self.accelerations[0][i] * last;
        }
        let rest = |k: usize| problem.distances[k] - problem.speed * DT * (k + 1) as f64;
        match problem.sigma {
            None => {
                for (k, row) in self.distances.iter().enumerate() {
                    let w = 2.0 * distance_weight(default_sigma(k + 1)) * rest(k);
                    for (q, r) in cost.q.iter_mut().zip(row) {
                        *q -= w * r;
                    }
                }
                cost.p = self.default_cost.0;
                let free = self.default_cost.1.solve(&cost.q.map(|q| -q));
                (cost, Some(free))
            }
            Some(sigma) => {
                for (k, row) in self.distances.iter().enumerate() {
                    cost.add(row, rest(k), distance_weight(sigma[k]));
                }
                let free = cost.minimum();
                (cost, free)
            }
        }
    }

    /// Sets all rows.
    fn bound(&mut self, problem: &SpeedProblem<'_>) {
        let last = self.initial_acceleration(problem.speed, problem.acceleration);
        let mut row = 0;
        let mut put = |values: &Controls, bound: f64| {
            self.program.set(row, values, bound);
            row += 1;
        };
        for i in 0..CONTROLS {
            put(&unit(i), self.limit);
            put(&unit(i).map(|x| -x), self.limit);
        }
        for i in 0..JERK_BOUNDS {
            let mut change = unit(i);
            let (from, steps) = if i == 0 {
                (last, 1)
            } else {
                change[i - 1] = -1.0;
                (0.0, KNOTS[i] - KNOTS[i - 1])
            };
            let max_change = self.jerk * DT * steps as f64;
            put(&change, max_change + from);
            put(&change.map(|x| -x), max_change - from);
        }
        for step in NON_NEGATIVE_SPEED {
            put(&self.speeds[step - 1].map(|x| -x), problem.speed);
        }
        let row_of = |bound: &Bound| -> (Controls, f64) {
            let k = bound.step - 1;
            let values = std::array::from_fn(|i| self.distances[k][i] + bound.time * self.speeds[k][i]);
            (values, bound.bound - problem.speed * (DT * bound.step as f64 + bound.time))
        };
        for bound in problem.ahead {
            let (values, rest) = row_of(bound);
            put(&values, rest);
        }
        for i in 0..AV_BRAKING_BOUNDS {
            match problem.av_braking.get(i) {
                Some(bound) => {
                    let (values, rest) = row_of(bound);
                    put(&values, rest);
                }
                None => put(&[0.0; CONTROLS], f64::INFINITY),
            }
        }
    }
}

fn distance_weight(sigma: f64) -> f64 {
    1.0 / (STEPS as f64 * sigma * sigma)
}

fn dot(a: &Controls, b: &Controls) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Returns distance and speed after every step of the hardest braking that is possible from this speed
/// and acceleration.
pub(super) fn hardest_braking(speed: f64, acceleration: f64, settings: &Settings) -> [(f64, f64); STEPS] {
    let (mut distance, mut speed, mut a) = (0.0, speed, acceleration);
    std::array::from_fn(|_| {
        a = (a - settings.jerk * DT).max(-settings.acceleration);
        speed = f64::max(speed + a * DT, 0.0);
        distance += speed * DT;
        (distance, speed)
    })
}

#[cfg(test)]
mod tests {
    use super::super::program::Solve;
    use super::*;

    fn unbounded() -> [Bound; CHECKED.len()] {
        CHECKED.map(|step| Bound { step, time: 0.0, bound: f64::INFINITY })
    }

    fn distances(speed: f64, accelerations: &[f64; STEPS]) -> [f64; STEPS] {
        let (mut v, mut s) = (speed, 0.0);
        accelerations.map(|a| {
            v += a * DT;
            s += v * DT;
            s
        })
    }

    #[test]
    fn the_closed_form_is_the_solution_where_no_bound_is_met() {
        let settings = super::super::settings().unwrap();
        let mut speeds = SpeedProgram::new(&settings).unwrap();
        let ahead = unbounded();
        for (speed, acceleration, change) in
            [(10.0, 0.0, 0.0), (8.0, 1.0, -1.0), (15.0, -2.0, 0.5), (4.0, 0.5, 1.5)]
        {
            for sigma in [None, Some(std::array::from_fn(|k| 0.3 + 0.05 * k as f64))] {
                let desired = std::array::from_fn(|k| {
                    let t = DT * (k + 1) as f64;
                    speed * t + 0.5 * change * t * t
                });
                let sigma: Option<[f64; STEPS]> = sigma;
                let problem = SpeedProblem {
                    speed,
                    acceleration,
                    distances: &desired,
                    sigma: sigma.as_ref(),
                    ahead: &ahead,
                    av_braking: &[],
                };
                let (solution, closed) = speeds.solve(&problem);
                assert_eq!((solution.solve, solution.iterations), (Solve::ClosedForm, 0));
                let (cost, _) = speeds.cost(&problem);
                let solution = speeds.program.solve(&cost, None);
                let solved = speeds.accelerations.map(|row| dot(&row, &solution.controls));
                assert!(solution.iterations > 0 && solution.solve == Solve::Solved, "{solution:?}");
                for (a, b) in distances(speed, &closed).iter().zip(distances(speed, &solved)) {
                    assert!((a - b).abs() < 1e-3, "{a} and {b} m");
                }
            }
        }
    }

    #[test]
    fn bounds_hold_at_all_times_where_they_can() {
        let settings = super::super::settings().unwrap();
        let mut speeds = SpeedProgram::new(&settings).unwrap();
        for (speed, room) in [(10.0, 15.0), (20.0, 45.0), (5.0, 5.0)] {
            let ahead = CHECKED.map(|step| Bound { step, time: 0.0, bound: room });
            let desired = std::array::from_fn(|k| f64::min(speed * DT * (k + 1) as f64, room));
            let problem = SpeedProblem {
                speed,
                acceleration: 0.0,
                distances: &desired,
                sigma: None,
                ahead: &ahead,
                av_braking: &[],
            };
            let (solution, accelerations) = speeds.solve(&problem);
            assert_eq!(solution.solve, Solve::Solved);
            assert!(distances(speed, &accelerations).iter().all(|s| *s <= room + 0.01));
            let mut before = 0.0;
            for a in accelerations {
                assert!(a.abs() <= 5.5 + 1e-3 && (a - before) / DT <= 30.0 + 0.1, "{before} to {a}");
                before = a;
            }
        }
    }
}
