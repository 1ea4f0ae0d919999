//! The speed along a path: a quadratic program over accelerations.
//!
//! Time runs in steps of 0.1 s. The acceleration of a step is the change of speed over it, as metrics take it: the speed of a step is the
//! way of the box centre over 0.1 s. Accelerations are linear between knots, which lie closer now than later: what is executed before the
//! next plan has a knot every 0.2 s. Costs and bounds are taken at single steps.

use reactsim::scene::DT;

use super::program::{CONTROLS, Cholesky, Controls, Found, Pattern, Program, Quadratic};
use super::settings::Settings;

/// Steps that are planned: 5 s.
pub const STEPS: usize = 50;
/// Steps at which the acceleration is a control.
const KNOTS: [usize; CONTROLS] = [0, 2, 4, 7, 10, 15, 20, 27, 36, 49];
/// Knots whose distance is so short that the jerk can be too large between them.
const JERKY: usize = 5;
/// Steps at which bounds of the way are kept, counted from 1: every 0.1 s for half a second, then every 0.2 s.
pub(super) const CHECKED: [usize; 28] =
    [1, 2, 3, 4, 5, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30, 32, 34, 36, 38, 40, 42, 44, 46, 48, 50];
/// Steps at which speeds are kept from being negative.
const FORWARD: [usize; 13] = [2, 4, 7, 10, 14, 18, 22, 27, 31, 36, 40, 45, 50];
/// Errors that cost as much as one another: of the acceleration, m/s², and of the jerk, m/s³.
const ACCELERATION_SCALE: f64 = 5.0;
const JERK_SCALE: f64 = 8.0;
/// Penalty of a metre that a bound of the way is left by, and of one by which a braking AV could no longer be answered.
const PENALTIES: [f64; 2] = [400.0, 12.0];
/// Rows for what would have to be done should the AV brake.
pub(super) const ANSWERS: usize = 2;

/// How uncertain a wish is after so many steps where nothing is said, metres.
pub(super) fn usual_sigma(step: usize) -> f64 {
    0.5 + 0.2 * DT * step as f64
}

/// A bound of the way: `way + time · speed ≤ bound` after a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Bound {
    pub(super) step: usize,
    /// Seconds.
    pub(super) time: f64,
    /// Metres.
    pub(super) bound: f64,
}

/// What is known and wanted of the speed.
#[derive(Clone, Debug)]
pub(super) struct Wanted<'a> {
    /// Speed of the last step, m/s, not negative.
    pub(super) speed: f64,
    /// Acceleration of the last step, m/s².
    pub(super) acceleration: f64,
    /// Way after every step, metres.
    pub(super) way: &'a [f64; STEPS],
    /// How uncertain that is, metres; `None` for what is usual.
    pub(super) sigma: Option<&'a [f64; STEPS]>,
    /// One per entry of [`CHECKED`]; infinite where there is none.
    pub(super) ahead: &'a [Bound; CHECKED.len()],
    /// What must remain possible should the AV brake.
    pub(super) answers: &'a [Bound],
}

/// What does not depend on the problem, and the program.
pub(super) struct Speeds {
    /// Acceleration of each step as a row of the controls.
    accelerations: [Controls; STEPS],
    /// Speed after each step, without what the present speed gives.
    speeds: [Controls; STEPS],
    /// Way after each step, without what the present speed gives.
    ways: [Controls; STEPS],
    /// The cost without that of the way.
    comfort: Quadratic,
    /// The whole quadratic part, with the usual uncertainty, and its factor.
    usual: ([Controls; CONTROLS], Cholesky),
    program: Program,
    limit: f64,
    jerk: f64,
}

impl Speeds {
    /// `None` where the solver refuses the pattern.
    pub(super) fn new(settings: &Settings) -> Option<Self> {
        let mut accelerations = [[0.0; CONTROLS]; STEPS];
        for (k, row) in accelerations.iter_mut().enumerate() {
            let i = KNOTS.partition_point(|&knot| knot <= k).clamp(1, CONTROLS - 1) - 1;
            let t = (k - KNOTS[i]) as f64 / (KNOTS[i + 1] - KNOTS[i]) as f64;
            (row[i], row[i + 1]) = (1.0 - t, t);
        }
        let (mut speeds, mut ways) = ([[0.0; CONTROLS]; STEPS], [[0.0; CONTROLS]; STEPS]);
        let (mut speed, mut way) = ([0.0; CONTROLS], [0.0; CONTROLS]);
        for k in 0..STEPS {
            for i in 0..CONTROLS {
                speed[i] += DT * accelerations[k][i];
                way[i] += DT * speed[i];
            }
            (speeds[k], ways[k]) = (speed, way);
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
        for (k, row) in ways.iter().enumerate() {
            whole.add(row, 0.0, way_weight(usual_sigma(k + 1)));
        }
        let factor = Cholesky::of(&whole.p)?;
        let upto = |step: usize| {
            let last = KNOTS.partition_point(|&knot| knot < step).min(CONTROLS - 1);
            0..last + 1
        };
        let mut patterns = Vec::new();
        for i in 0..CONTROLS {
            patterns.extend([i..i + 1, i..i + 1].map(|controls| Pattern { controls, slack: None }));
        }
        for i in 0..JERKY {
            let controls = i.saturating_sub(1)..i + 1;
            patterns.extend([controls.clone(), controls].map(|controls| Pattern { controls, slack: None }));
        }
        patterns.extend(FORWARD.map(|step| Pattern { controls: upto(step), slack: None }));
        patterns.extend(CHECKED.map(|step| Pattern { controls: upto(step), slack: Some(0) }));
        patterns.extend([(); ANSWERS].map(|()| Pattern { controls: 0..CONTROLS, slack: Some(1) }));
        Some(Self {
            accelerations,
            speeds,
            ways,
            comfort,
            usual: (whole.p, factor),
            program: Program::new(patterns, PENALTIES.to_vec())?,
            limit: settings.acceleration,
            jerk: settings.jerk,
        })
    }

    /// The acceleration that a vehicle goes on from: that of the last step, as far as it can be left in time.
    pub(super) fn going_on(&self, speed: f64, acceleration: f64) -> f64 {
        acceleration.clamp((-speed / (3.0 * DT)).max(-self.limit), self.limit)
    }

    /// The best accelerations of the steps.
    pub(super) fn solve(&mut self, wanted: &Wanted<'_>) -> (Found, [f64; STEPS]) {
        let (cost, free) = self.cost(wanted);
        self.bound(wanted);
        let found = match free {
            Some(free) => self.program.solve(&cost, &free),
            None => self.program.solve_by_solver(&cost),
        };
        let steps = self.accelerations.map(|row| dot(&row, &found.controls));
        (found, steps)
    }

    /// The same by the solver, whether or not the closed form would do.
    #[cfg(test)]
    pub(super) fn solve_by_solver(&mut self, wanted: &Wanted<'_>) -> (Found, [f64; STEPS]) {
        let (cost, _) = self.cost(wanted);
        self.bound(wanted);
        let found = self.program.solve_by_solver(&cost);
        let steps = self.accelerations.map(|row| dot(&row, &found.controls));
        (found, steps)
    }

    /// The cost and where it is smallest.
    pub(super) fn cost(&self, wanted: &Wanted<'_>) -> (Quadratic, Option<Controls>) {
        let mut cost = self.comfort.clone();
        let share = 1.0 / STEPS as f64;
        // The first change is one from the acceleration that there is.
        let first = 2.0 * share / (JERK_SCALE * JERK_SCALE * DT * DT);
        let last = self.going_on(wanted.speed, wanted.acceleration);
        for i in 0..CONTROLS {
            cost.q[i] -= first * self.accelerations[0][i] * last;
        }
        let rest = |k: usize| wanted.way[k] - wanted.speed * DT * (k + 1) as f64;
        match wanted.sigma {
            None => {
                for (k, row) in self.ways.iter().enumerate() {
                    let w = 2.0 * way_weight(usual_sigma(k + 1)) * rest(k);
                    for (q, r) in cost.q.iter_mut().zip(row) {
                        *q -= w * r;
                    }
                }
                cost.p = self.usual.0;
                let free = self.usual.1.solve(&cost.q.map(|q| -q));
                (cost, Some(free))
            }
            Some(sigma) => {
                for (k, row) in self.ways.iter().enumerate() {
                    cost.add(row, rest(k), way_weight(sigma[k]));
                }
                let free = cost.minimum();
                (cost, free)
            }
        }
    }

    /// Sets all rows.
    fn bound(&mut self, wanted: &Wanted<'_>) {
        let last = self.going_on(wanted.speed, wanted.acceleration);
        let mut row = 0;
        let mut put = |values: &Controls, bound: f64| {
            self.program.set(row, values, bound);
            row += 1;
        };
        for i in 0..CONTROLS {
            let one: Controls = std::array::from_fn(|c| if c == i { 1.0 } else { 0.0 });
            put(&one, self.limit);
            put(&one.map(|x| -x), self.limit);
        }
        for i in 0..JERKY {
            let mut change: Controls = std::array::from_fn(|c| if c == i { 1.0 } else { 0.0 });
            let (from, steps) = if i == 0 {
                (last, 1)
            } else {
                change[i - 1] = -1.0;
                (0.0, KNOTS[i] - KNOTS[i - 1])
            };
            let most = self.jerk * DT * steps as f64;
            put(&change, most + from);
            put(&change.map(|x| -x), most - from);
        }
        for step in FORWARD {
            put(&self.speeds[step - 1].map(|x| -x), wanted.speed);
        }
        let along = |bound: &Bound| -> (Controls, f64) {
            let k = bound.step - 1;
            let values = std::array::from_fn(|i| self.ways[k][i] + bound.time * self.speeds[k][i]);
            (values, bound.bound - wanted.speed * (DT * bound.step as f64 + bound.time))
        };
        for bound in wanted.ahead {
            let (values, rest) = along(bound);
            put(&values, rest);
        }
        for i in 0..ANSWERS {
            match wanted.answers.get(i) {
                Some(bound) => {
                    let (values, rest) = along(bound);
                    put(&values, rest);
                }
                None => put(&[0.0; CONTROLS], f64::INFINITY),
            }
        }
    }
}

fn way_weight(sigma: f64) -> f64 {
    1.0 / (STEPS as f64 * sigma * sigma)
}

fn dot(a: &Controls, b: &Controls) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Way and speed after every step of the hardest braking that a vehicle of this speed and acceleration is able to do.
pub(super) fn hardest_braking(speed: f64, acceleration: f64, settings: &Settings) -> [(f64, f64); STEPS] {
    let (mut way, mut speed, mut a) = (0.0, speed, acceleration);
    std::array::from_fn(|_| {
        a = (a - settings.jerk * DT).max(-settings.acceleration);
        speed = f64::max(speed + a * DT, 0.0);
        way += speed * DT;
        (way, speed)
    })
}

#[cfg(test)]
mod tests {
    use super::super::program::Solve;
    use super::*;

    fn open() -> [Bound; CHECKED.len()] {
        CHECKED.map(|step| Bound { step, time: 0.0, bound: f64::INFINITY })
    }

    fn ways(speed: f64, accelerations: &[f64; STEPS]) -> [f64; STEPS] {
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
        let mut speeds = Speeds::new(&settings).unwrap();
        let ahead = open();
        for (speed, acceleration, change) in
            [(10.0, 0.0, 0.0), (8.0, 1.0, -1.0), (15.0, -2.0, 0.5), (4.0, 0.5, 1.5)]
        {
            for sigma in [None, Some(std::array::from_fn(|k| 0.3 + 0.05 * k as f64))] {
                let way = std::array::from_fn(|k| {
                    let t = DT * (k + 1) as f64;
                    speed * t + 0.5 * change * t * t
                });
                let sigma: Option<[f64; STEPS]> = sigma;
                let wanted = Wanted {
                    speed,
                    acceleration,
                    way: &way,
                    sigma: sigma.as_ref(),
                    ahead: &ahead,
                    answers: &[],
                };
                let (found, closed) = speeds.solve(&wanted);
                assert_eq!((found.solve, found.iterations), (Solve::ClosedForm, 0));
                let (found, solved) = speeds.solve_by_solver(&wanted);
                assert!(found.iterations > 0 && found.solve == Solve::Solved, "{found:?}");
                for (a, b) in ways(speed, &closed).iter().zip(ways(speed, &solved)) {
                    assert!((a - b).abs() < 1e-3, "{a} and {b} m");
                }
            }
        }
    }

    #[test]
    fn bounds_hold_at_all_times_where_they_can() {
        let settings = super::super::settings().unwrap();
        let mut speeds = Speeds::new(&settings).unwrap();
        for (speed, room) in [(10.0, 15.0), (20.0, 45.0), (5.0, 5.0)] {
            let ahead = CHECKED.map(|step| Bound { step, time: 0.0, bound: room });
            let way = std::array::from_fn(|k| f64::min(speed * DT * (k + 1) as f64, room));
            let wanted =
                Wanted { speed, acceleration: 0.0, way: &way, sigma: None, ahead: &ahead, answers: &[] };
            let (found, accelerations) = speeds.solve(&wanted);
            assert_eq!(found.solve, Solve::Solved);
            assert!(ways(speed, &accelerations).iter().all(|s| *s <= room + 0.01));
            let mut before = 0.0;
            for a in accelerations {
                assert!(a.abs() <= 5.5 + 1e-3 && (a - before) / DT <= 30.0 + 0.1, "{before} to {a}");
                before = a;
            }
        }
    }
}
