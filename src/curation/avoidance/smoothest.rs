//! The smoothest speed profile between bounds: a quadratic program.

use clarabel::algebra::CscMatrix;
use clarabel::solver::SupportedConeT::{NonnegativeConeT, ZeroConeT};
use clarabel::solver::{DefaultSettings, DefaultSolver, IPSolver, SolverStatus};

use super::profile::{Corridor, Limits, Motion, Profile};
use crate::scene::DT;

/// Steps per interval of constant jerk.
const KNOT: usize = 3;
/// Speeds below this are rests of the solver: the agent stands, m/s.
const STANDING: f64 = 2e-3;
/// Weights of squared acceleration (m/s²), change of acceleration per step (m/s²) and distance from the wanted speed (m/s).
const WEIGHTS: (f64, f64, f64) = (1.0, 2.0, 0.1);

/// Arc length and speed a few steps after a knot are linear in arc length and speed there and in the accelerations of this knot
/// and the next. The weights of these two accelerations in speed and arc length, after 1 to `KNOT` steps.
fn shares() -> [[f64; 4]; KNOT] {
    let mut shares = [[0.0; 4]; KNOT];
    let (mut va, mut vb, mut sa, mut sb) = (0.0, 0.0, 0.0, 0.0);
    for (m, share) in shares.iter_mut().enumerate() {
        let next = m as f64 / KNOT as f64;
        va += DT * (1.0 - next);
        vb += DT * next;
        sa += DT * va;
        sb += DT * vb;
        *share = [va, vb, sa, sb];
    }
    shares
}

/// Rows of a sparse matrix with their right-hand sides.
#[derive(Default)]
struct Rows {
    entries: (Vec<usize>, Vec<usize>, Vec<f64>),
    bounds: Vec<f64>,
}

impl Rows {
    fn push(&mut self, row: &[(usize, f64)], bound: f64) {
        for &(column, value) in row {
            self.entries.0.push(self.bounds.len());
            self.entries.1.push(column);
            self.entries.2.push(value);
        }
        self.bounds.push(bound);
    }
}

/// The smoothest profile in a corridor that stays close to `wanted` speeds (entry 0: the reaction step). `None` where the solver finds
/// none. What it finds is integrated anew: accelerations, their changes and speeds at the knots are clamped to the limits, and where
/// a speed is clamped the acceleration of that step changes by rests of the solver, at most 0.02 m/s².
pub(super) fn smoothest(
    start: Motion,
    limits: &Limits,
    wanted: &[f64],
    corridor: &Corridor,
) -> Option<Profile> {
    let steps = wanted.len() - 1;
    let knots = steps.div_ceil(KNOT) + 1;
    let (s, v, a) = (|i: usize| 3 * i, |i: usize| 3 * i + 1, |i: usize| 3 * i + 2);
    let shares = shares();
    let mut rows = Rows::default();
    rows.push(&[(s(0), 1.0)], 0.0);
    rows.push(&[(v(0), 1.0)], start.speed);
    for i in 0..knots - 1 {
        let [va, vb, sa, sb] = shares[KNOT - 1];
        rows.push(&[(v(i + 1), -1.0), (v(i), 1.0), (a(i), va), (a(i + 1), vb)], 0.0);
        let dt = DT * KNOT as f64;
        rows.push(&[(s(i + 1), -1.0), (s(i), 1.0), (v(i), dt), (a(i), sa), (a(i + 1), sb)], 0.0);
    }
    let equalities = rows.bounds.len();
    let first = limits.jerk * DT;
    rows.push(&[(a(0), 1.0)], (start.acceleration + first).min(limits.accelerate));
    rows.push(&[(a(0), -1.0)], -(start.acceleration - first).max(limits.brake));
    let change = limits.jerk * DT * KNOT as f64;
    for i in 1..knots {
        rows.push(&[(a(i), 1.0)], limits.accelerate);
        rows.push(&[(a(i), -1.0)], -limits.brake);
        rows.push(&[(a(i), 1.0), (a(i - 1), -1.0)], change);
        rows.push(&[(a(i), -1.0), (a(i - 1), 1.0)], change);
        rows.push(&[(v(i), 1.0)], limits.speed.max(start.speed));
    }
    // Arc length + gap · speed at a step, times a sign.
    let at = |step: usize, sign: f64, gap: f64| -> Vec<(usize, f64)> {
        let (i, m) = ((step - 1) / KNOT, (step - 1) % KNOT);
        let along = (m + 1) as f64 * DT;
        let [va, vb, sa, sb] = shares[m];
        let row = [(s(i), 1.0), (v(i), along + gap), (a(i), sa + gap * va), (a(i + 1), sb + gap * vb)];
        row.map(|(column, value)| (column, sign * value)).to_vec()
    };
    for step in 1..=steps {
        let (i, m) = ((step - 1) / KNOT, (step - 1) % KNOT);
        let [va, vb, ..] = shares[m];
        rows.push(&[(v(i), -1.0), (a(i), -va), (a(i + 1), -vb)], 0.0);
        if corridor.speeds[step].is_finite() {
            rows.push(&[(v(i), 1.0), (a(i), va), (a(i + 1), vb)], corridor.speeds[step]);
        }
        // Nobody goes back: of equal bounds the last, or the first, is enough.
        let later = corridor.upper.get(step + 1).copied().unwrap_or(f64::INFINITY);
        if corridor.upper[step] < later {
            rows.push(&at(step, 1.0, 0.0), corridor.upper[step]);
        }
        if corridor.lower[step] > corridor.lower[step - 1].max(0.0) {
            rows.push(&at(step, -1.0, 0.0), -corridor.lower[step]);
        }
    }
    for &(step, gap, bound) in &corridor.gaps {
        rows.push(&at(step, 1.0, gap), bound);
    }
    let (p, q) = objective(knots, wanted);
    let n = 3 * knots;
    let (count, (i, j, values)) = (rows.bounds.len(), rows.entries);
    let matrix = CscMatrix::new_from_triplets(count, n, i, j, values);
    let cones = [ZeroConeT(equalities), NonnegativeConeT(count - equalities)];
    let settings = DefaultSettings {
        verbose: false,
        max_iter: 40,
        direct_solve_method: "qdldl".to_owned(),
        tol_gap_abs: 1e-5,
        tol_gap_rel: 1e-5,
        tol_feas: 1e-7,
        presolve_enable: false,
        ..DefaultSettings::default()
    };
    let mut solver = DefaultSolver::new(&p, &q, &matrix, &rows.bounds, &cones, settings).ok()?;
    solver.solve();
    if !matches!(solver.solution.status, SolverStatus::Solved | SolverStatus::AlmostSolved) {
        return None;
    }
    let x = &solver.solution.x;
    let (mut before, mut most) = (start.acceleration, first);
    let accelerations = (0..knots).map(|i| {
        let within = x[a(i)].clamp(limits.brake, limits.accelerate);
        before = within.clamp(before - most, before + most);
        most = change;
        before
    });
    Some(integrate(start, limits, &accelerations.collect::<Vec<_>>(), steps))
}

/// The upper triangle of the quadratic part of the costs, and the linear part.
fn objective(knots: usize, wanted: &[f64]) -> (CscMatrix<f64>, Vec<f64>) {
    let (hard, rough, off) = WEIGHTS;
    let mut q = vec![0.0; 3 * knots];
    let (mut rows, mut columns, mut values) = (Vec::new(), Vec::new(), Vec::new());
    let mut put = |i: usize, j: usize, value: f64| {
        rows.push(i);
        columns.push(j);
        values.push(value);
    };
    for i in 0..knots {
        let inner = if i == 0 || i + 1 == knots { 1.0 } else { 2.0 };
        put(3 * i + 1, 3 * i + 1, 2.0 * off);
        put(3 * i + 2, 3 * i + 2, 2.0 * (hard + inner * rough));
        if i > 0 {
            put(3 * i - 1, 3 * i + 2, -2.0 * rough);
        }
        q[3 * i + 1] = -2.0 * off * wanted[(KNOT * i).min(wanted.len() - 1)];
    }
    (CscMatrix::new_from_triplets(3 * knots, 3 * knots, rows, columns, values), q)
}

fn integrate(start: Motion, limits: &Limits, accelerations: &[f64], steps: usize) -> Profile {
    let (mut s, mut v) = (0.0, start.speed);
    let mut profile = Profile { s: vec![s], v: vec![v] };
    for k in 0..steps {
        let (i, share) = (k / KNOT, (k % KNOT) as f64 / KNOT as f64);
        v += DT * (accelerations[i] * (1.0 - share) + accelerations[i + 1] * share);
        v = v.clamp(0.0, limits.speed.max(start.speed));
        let driven = if v < STANDING { 0.0 } else { v };
        s += DT * driven;
        profile.s.push(s);
        profile.v.push(driven);
    }
    profile
}

#[cfg(test)]
mod tests {
    use super::super::profile::extreme;
    use super::*;

    const LIMITS: Limits = Limits { brake: -5.0, accelerate: 2.0, jerk: 10.0, speed: 20.0 };

    fn open(steps: usize) -> Corridor {
        Corridor {
            lower: vec![f64::NEG_INFINITY; steps + 1],
            upper: vec![f64::INFINITY; steps + 1],
            speeds: vec![f64::INFINITY; steps + 1],
            gaps: Vec::new(),
        }
    }

    fn check(start: Motion, profile: &Profile) {
        let mut before = start.acceleration;
        for w in profile.v.windows(2) {
            let a = (w[1] - w[0]) / DT;
            assert!((-5.0 - 0.021..=2.021).contains(&a), "{a}");
            // Twice the rests of a clamped speed, over one step.
            assert!(((a - before) / DT).abs() <= 10.0 + 0.42, "{before} to {a}");
            before = a;
            assert!((0.0..=LIMITS.speed.max(start.speed)).contains(&w[1]), "{}", w[1]);
        }
    }

    #[test]
    fn without_bounds_the_wanted_speed_is_kept() {
        let start = Motion { speed: 10.0, acceleration: 0.0 };
        let profile = smoothest(start, &LIMITS, &[10.0; 78], &open(77)).unwrap();
        assert!((profile.s[77] - 77.0).abs() < 1e-3, "{}", profile.s[77]);
        check(start, &profile);
    }

    #[test]
    fn stops_before_an_obstacle_and_stands_exactly() {
        let start = Motion { speed: 10.0, acceleration: 0.0 };
        for room in [14.0, 20.0, 40.0] {
            let mut corridor = open(77);
            corridor.upper.fill(room);
            let profile = smoothest(start, &LIMITS, &[10.0; 78], &corridor).unwrap();
            assert!(profile.s.iter().all(|s| *s <= room + 1e-3));
            check(start, &profile);
            let hardest = extreme(start, &LIMITS, 77, true);
            assert!(hardest.s.iter().zip(&profile.s).all(|(h, s)| *h <= s + 1e-3));
        }
        let mut corridor = open(77);
        corridor.upper.fill(11.0);
        assert!(smoothest(start, &LIMITS, &[10.0; 78], &corridor).is_none());
    }

    #[test]
    fn limits_hold_where_the_bounds_ask_for_all_that_is_possible() {
        let start = Motion { speed: 15.0, acceleration: 0.0 };
        let hardest = extreme(start, &LIMITS, 77, false);
        for share in [0.5, 0.8, 0.9] {
            let mut corridor = open(77);
            corridor.lower[40] = 15.0 * 4.0 + share * (hardest.s[40] - 15.0 * 4.0);
            let profile = smoothest(start, &LIMITS, &[10.0; 78], &corridor).unwrap();
            assert!(profile.s[40] >= corridor.lower[40] - 0.01);
            check(start, &profile);
        }
        let mut corridor = open(77);
        corridor.speeds[40..50].fill(6.0);
        let profile = smoothest(start, &LIMITS, &[15.0; 78], &corridor).unwrap();
        assert!(profile.v[40..50].iter().all(|v| *v <= 6.001));
        check(start, &profile);
    }

    #[test]
    fn a_standing_agent_that_has_no_reason_to_move_stands() {
        let start = Motion { speed: 0.0, acceleration: 0.0 };
        let profile = smoothest(start, &LIMITS, &[0.0; 71], &open(70)).unwrap();
        assert!(profile.s.iter().all(|s| *s == 0.0));
    }

    #[test]
    fn the_start_is_clamped_so_that_it_can_be_left() {
        let start = Motion { speed: 0.2, acceleration: -4.0 }.within(&LIMITS);
        let profile = smoothest(start, &LIMITS, &[0.0; 71], &open(70)).unwrap();
        check(start, &profile);
    }
}
