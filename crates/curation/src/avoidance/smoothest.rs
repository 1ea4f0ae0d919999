//! The smoothest speed profile within bounds: a quadratic program.

use clarabel::algebra::CscMatrix;
use clarabel::solver::SupportedConeT::{NonnegativeConeT, ZeroConeT};
use clarabel::solver::{DefaultSettings, DefaultSolver, IPSolver, SolverStatus};
use reactsim_scene::DT;

use super::profile::{Corridor, Limits, Motion, Profile};

/// Number of steps per interval of constant jerk.
const STEPS_PER_KNOT: usize = 3;
/// Speed below which the agent is stationary, m/s: lower speeds are solver residuals.
const STANDSTILL_SPEED: f64 = 2e-3;
/// Cost weight of the squared acceleration (m/s²).
const ACCELERATION_WEIGHT: f64 = 1.0;
/// Cost weight of the squared change of acceleration per step (m/s²).
const ACCELERATION_CHANGE_WEIGHT: f64 = 2.0;
/// Cost weight of the squared deviation from the desired speed (m/s).
const SPEED_WEIGHT: f64 = 0.1;

/// Returns the weights of the accelerations of a knot and the next one in speed and arc length, after 1
/// to [`STEPS_PER_KNOT`] steps.
///
/// Arc length and speed a few steps after a knot are linear in arc length and speed there and in these
/// two accelerations.
fn shares() -> [[f64; 4]; STEPS_PER_KNOT] {
    let mut shares = [[0.0; 4]; STEPS_PER_KNOT];
    let (mut va, mut vb, mut sa, mut sb) = (0.0, 0.0, 0.0, 0.0);
    for (m, share) in shares.iter_mut().enumerate() {
        let next = m as f64 / STEPS_PER_KNOT as f64;
        va += DT * (1.0 - next);
        vb += DT * next;
        sa += DT * va;
        sb += DT * vb;
        *share = [va, vb, sa, sb];
    }
    shares
}

/// Rows of a sparse constraint matrix with their right-hand sides.
#[derive(Default)]
struct ConstraintRows {
    entries: (Vec<usize>, Vec<usize>, Vec<f64>),
    bounds: Vec<f64>,
}

impl ConstraintRows {
    fn push(&mut self, row: &[(usize, f64)], bound: f64) {
        for &(column, value) in row {
            self.entries.0.push(self.bounds.len());
            self.entries.1.push(column);
            self.entries.2.push(value);
        }
        self.bounds.push(bound);
    }
}

/// Returns the smoothest profile in a corridor that stays close to the `desired` speeds (entry 0: the
/// reaction step); `None` if the solver finds none.
///
/// The solution is integrated again: accelerations, their changes and speeds at the knots are clamped to
/// the limits. Where a speed is clamped, solver residuals change the acceleration of that step by at
/// most 0.02 m/s².
pub(super) fn smoothest(
    start: Motion,
    limits: &Limits,
    desired: &[f64],
    corridor: &Corridor,
) -> Option<Profile> {
    let steps = desired.len() - 1;
    let knots = steps.div_ceil(STEPS_PER_KNOT) + 1;
    let (s, v, a) = (|i: usize| 3 * i, |i: usize| 3 * i + 1, |i: usize| 3 * i + 2);
    let shares = shares();
    let mut rows = ConstraintRows::default();
    rows.push(&[(s(0), 1.0)], 0.0);
    rows.push(&[(v(0), 1.0)], start.speed);
    for i in 0..knots - 1 {
        let [va, vb, sa, sb] = shares[STEPS_PER_KNOT - 1];
        rows.push(&[(v(i + 1), -1.0), (v(i), 1.0), (a(i), va), (a(i + 1), vb)], 0.0);
        let dt = DT * STEPS_PER_KNOT as f64;
        rows.push(&[(s(i + 1), -1.0), (s(i), 1.0), (v(i), dt), (a(i), sa), (a(i + 1), sb)], 0.0);
    }
    let equalities = rows.bounds.len();
    let first = limits.jerk * DT;
    rows.push(&[(a(0), 1.0)], (start.acceleration + first).min(limits.accelerate));
    rows.push(&[(a(0), -1.0)], -(start.acceleration - first).max(limits.brake));
    let change = limits.jerk * DT * STEPS_PER_KNOT as f64;
    for i in 1..knots {
        rows.push(&[(a(i), 1.0)], limits.accelerate);
        rows.push(&[(a(i), -1.0)], -limits.brake);
        rows.push(&[(a(i), 1.0), (a(i - 1), -1.0)], change);
        rows.push(&[(a(i), -1.0), (a(i - 1), 1.0)], change);
        rows.push(&[(v(i), 1.0)], limits.speed.max(start.speed));
    }
    // Row of arc length + gap · speed at a step, times a sign.
    let at = |step: usize, sign: f64, gap: f64| -> Vec<(usize, f64)> {
        let (i, m) = ((step - 1) / STEPS_PER_KNOT, (step - 1) % STEPS_PER_KNOT);
        let along = (m + 1) as f64 * DT;
        let [va, vb, sa, sb] = shares[m];
        let row = [(s(i), 1.0), (v(i), along + gap), (a(i), sa + gap * va), (a(i + 1), sb + gap * vb)];
        row.map(|(column, value)| (column, sign * value)).to_vec()
    };
    for step in 1..=steps {
        let (i, m) = ((step - 1) / STEPS_PER_KNOT, (step - 1) % STEPS_PER_KNOT);
        let [va, vb, ..] = shares[m];
        rows.push(&[(v(i), -1.0), (a(i), -va), (a(i + 1), -vb)], 0.0);
        if corridor.speeds[step].is_finite() {
            rows.push(&[(v(i), 1.0), (a(i), va), (a(i + 1), vb)], corridor.speeds[step]);
        }
        // Nobody reverses: of equal upper bounds the last suffices, of equal lower bounds the first.
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
    let (p, q) = objective(knots, desired);
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

/// Returns the upper triangle of the quadratic part of the costs, and the linear part.
fn objective(knots: usize, desired: &[f64]) -> (CscMatrix<f64>, Vec<f64>) {
    let mut q = vec![0.0; 3 * knots];
    let (mut rows, mut columns, mut values) = (Vec::new(), Vec::new(), Vec::new());
    let mut put = |i: usize, j: usize, value: f64| {
        rows.push(i);
        columns.push(j);
        values.push(value);
    };
    for i in 0..knots {
        let inner = if i == 0 || i + 1 == knots { 1.0 } else { 2.0 };
        put(3 * i + 1, 3 * i + 1, 2.0 * SPEED_WEIGHT);
        put(3 * i + 2, 3 * i + 2, 2.0 * (ACCELERATION_WEIGHT + inner * ACCELERATION_CHANGE_WEIGHT));
        if i > 0 {
            put(3 * i - 1, 3 * i + 2, -2.0 * ACCELERATION_CHANGE_WEIGHT);
        }
        q[3 * i + 1] = -2.0 * SPEED_WEIGHT * desired[(STEPS_PER_KNOT * i).min(desired.len() - 1)];
    }
    (CscMatrix::new_from_triplets(3 * knots, 3 * knots, rows, columns, values), q)
}

fn integrate(start: Motion, limits: &Limits, accelerations: &[f64], steps: usize) -> Profile {
    let (mut s, mut v) = (0.0, start.speed);
    let mut profile = Profile { s: vec![s], v: vec![v] };
    for k in 0..steps {
        let (i, share) = (k / STEPS_PER_KNOT, (k % STEPS_PER_KNOT) as f64 / STEPS_PER_KNOT as f64);
        v += DT * (accelerations[i] * (1.0 - share) + accelerations[i + 1] * share);
        v = v.clamp(0.0, limits.speed.max(start.speed));
        let driven = if v < STANDSTILL_SPEED { 0.0 } else { v };
        s += DT * driven;
        profile.s.push(s);
        profile.v.push(driven);
    }
    profile
}

#[cfg(test)]
mod tests {
    use super::super::profile::extreme_profile;
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
            // Twice the residual of a clamped speed, over one step.
            assert!(((a - before) / DT).abs() <= 10.0 + 0.42, "{before} to {a}");
            before = a;
            assert!((0.0..=LIMITS.speed.max(start.speed)).contains(&w[1]), "{}", w[1]);
        }
    }

    #[test]
    fn without_bounds_the_desired_speed_is_kept() {
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
            let hardest = extreme_profile(start, &LIMITS, 77, true);
            assert!(hardest.s.iter().zip(&profile.s).all(|(h, s)| *h <= s + 1e-3));
        }
        let mut corridor = open(77);
        corridor.upper.fill(11.0);
        assert!(smoothest(start, &LIMITS, &[10.0; 78], &corridor).is_none());
    }

    #[test]
    fn limits_hold_where_the_bounds_require_extreme_profiles() {
        let start = Motion { speed: 15.0, acceleration: 0.0 };
        let hardest = extreme_profile(start, &LIMITS, 77, false);
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
    fn a_stationary_agent_without_a_reason_to_move_stays() {
        let start = Motion { speed: 0.0, acceleration: 0.0 };
        let profile = smoothest(start, &LIMITS, &[0.0; 71], &open(70)).unwrap();
        assert!(profile.s.iter().all(|s| *s == 0.0));
    }

    #[test]
    fn the_initial_acceleration_is_clamped_to_a_feasible_one() {
        let start = Motion { speed: 0.2, acceleration: -4.0 }.within(&LIMITS);
        let profile = smoothest(start, &LIMITS, &[0.0; 71], &open(70)).unwrap();
        check(start, &profile);
    }
}
