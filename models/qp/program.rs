//! Small quadratic programs of a fixed sparsity pattern, solved by clarabel again and again.
//!
//! A program is `minimise ½ uᵀPu + qᵀu + Σ ρᵢ ξᵢ` over controls `u` and slacks `ξ ≥ 0`, with rows
//! `aᵀu − ξᵢ ≤ b`.
//! States are eliminated: a row has the controls up to its time and no more. The pattern, the ordering
//! and the symbolic factorisation are computed once. clarabel's own equilibration is off, because it
//! would be that of the first problem: a solution must depend on its problem alone, not on earlier
//! ones.

use std::ops::Range;

use clarabel::algebra::CscMatrix;
use clarabel::solver::SupportedConeT::NonnegativeConeT;
use clarabel::solver::{DefaultSettings, DefaultSolver, IPSolver, SolverStatus};
use nalgebra::{Cholesky, Const, SMatrix, SVector};

/// Number of controls of every program.
pub(super) const CONTROLS: usize = 10;

/// One number per control: a row of coefficients, or the values of the controls.
pub(super) type Controls = [f64; CONTROLS];

/// Returns the row that has the value of one control.
pub(super) fn unit(control: usize) -> Controls {
    std::array::from_fn(|c| if c == control { 1.0 } else { 0.0 })
}

/// Value of an absent bound; the numbers of the programs are much smaller.
const NO_BOUND: f64 = 1e3;

/// Unknowns that a row may have.
#[derive(Clone, Debug)]
pub(super) struct Pattern {
    /// Range of controls.
    pub(super) controls: Range<usize>,
    /// Slack that relaxes the row.
    pub(super) slack: Option<usize>,
}

/// Outcome of a solve.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Solve {
    /// The unconstrained minimum satisfies all rows.
    ClosedForm,
    /// Solved to the solver's full tolerance.
    Solved,
    /// Solved to the solver's reduced tolerance.
    AlmostSolved,
    /// The solver gave up or found the program infeasible.
    Failed,
}

/// Solution of a program.
#[derive(Clone, Debug)]
pub(super) struct Solution {
    pub(super) controls: Controls,
    pub(super) solve: Solve,
    /// Iterations of the interior-point method.
    pub(super) iterations: u32,
}

/// A convex quadratic function of the controls without its constant: `½ uᵀPu + qᵀu`.
#[derive(Clone, Debug)]
pub(super) struct Quadratic {
    pub(super) p: [Controls; CONTROLS],
    pub(super) q: Controls,
}

impl Quadratic {
    pub(super) const ZERO: Self = Self { p: [[0.0; CONTROLS]; CONTROLS], q: [0.0; CONTROLS] };

    /// Adds `weight · (row · u − target)²`.
    pub(super) fn add(&mut self, row: &Controls, target: f64, weight: f64) {
        let double = 2.0 * weight;
        for (i, &ri) in row.iter().enumerate() {
            if ri == 0.0 {
                continue;
            }
            let w = double * ri;
            for (p, rj) in self.p[i].iter_mut().zip(row) {
                *p += w * rj;
            }
            self.q[i] -= w * target;
        }
    }

    /// Returns the minimiser; `None` unless `P` is positive definite.
    pub(super) fn minimum(&self) -> Option<Controls> {
        Some(Factor::of(&self.p)?.solve(&self.q.map(|q| -q)))
    }
}

/// Cholesky factor of a positive definite matrix.
#[derive(Clone, Debug)]
pub(super) struct Factor(Cholesky<f64, Const<CONTROLS>>);

impl Factor {
    /// Factorises a symmetric matrix; `None` unless it is positive definite.
    pub(super) fn of(p: &[Controls; CONTROLS]) -> Option<Self> {
        Cholesky::new(SMatrix::from(*p)).map(Self)
    }

    /// Solves the system of equations with this matrix.
    pub(super) fn solve(&self, right: &Controls) -> Controls {
        self.0.solve(&SVector::from(*right)).into()
    }
}

/// A program of a fixed pattern.
pub(super) struct Program {
    solver: DefaultSolver<f64>,
    patterns: Vec<Pattern>,
    /// Start of row `r` in `places`.
    starts: Vec<usize>,
    /// Index into the values of `A` of every entry, row by row.
    places: Vec<usize>,
    p: Vec<f64>,
    q: Vec<f64>,
    a: Vec<f64>,
    b: Vec<f64>,
    penalties: Vec<f64>,
}

impl Program {
    /// Creates a program with these rows; `penalties` are the costs of a slack of 1. `None` if clarabel
    /// rejects it, which a test rules out.
    pub(super) fn new(patterns: Vec<Pattern>, penalties: Vec<f64>) -> Option<Self> {
        let (rows, slacks) = (patterns.len(), penalties.len());
        let (n, m) = (CONTROLS + slacks, rows + slacks);
        let has = |r: usize, c: usize| {
            let pattern = &patterns[r];
            pattern.controls.contains(&c) || pattern.slack.is_some_and(|s| CONTROLS + s == c)
        };
        let (mut colptr, mut rowval, mut a) = (vec![0], Vec::new(), Vec::new());
        let mut places: Vec<Vec<usize>> = vec![Vec::new(); rows];
        for c in 0..n {
            for (r, places) in places.iter_mut().enumerate() {
                if has(r, c) {
                    if c < CONTROLS {
                        places.push(rowval.len());
                    }
                    rowval.push(r);
                    a.push(if c < CONTROLS { 1.0 } else { -1.0 });
                }
            }
            if c >= CONTROLS {
                rowval.push(rows + c - CONTROLS);
                a.push(-1.0);
            }
            colptr.push(rowval.len());
        }
        let matrix = CscMatrix::new(m, n, colptr, rowval, a.clone());
        let (mut colptr, mut rowval, mut p) = (vec![0], Vec::new(), Vec::new());
        for c in 0..n {
            if c < CONTROLS {
                rowval.extend(0..=c);
                p.extend((0..=c).map(|r| if r == c { 1.0 } else { 0.0 }));
            }
            colptr.push(rowval.len());
        }
        let quadratic = CscMatrix::new(n, n, colptr, rowval, p.clone());
        let mut q = vec![0.0; n];
        q[CONTROLS..].copy_from_slice(&penalties);
        let mut b = vec![NO_BOUND; m];
        b[rows..].fill(0.0);
        let settings = DefaultSettings {
            verbose: false,
            max_iter: 40,
            direct_solve_method: "qdldl".to_owned(),
            equilibrate_enable: false,
            presolve_enable: false,
            tol_gap_abs: 1e-6,
            tol_gap_rel: 1e-6,
            tol_feas: 1e-6,
            iterative_refinement_max_iter: 2,
            ..DefaultSettings::default()
        };
        let cones = [NonnegativeConeT(m)];
        let solver = DefaultSolver::new(&quadratic, &q, &matrix, &b, &cones, settings).ok()?;
        let mut starts = vec![0];
        starts.extend(places.iter().scan(0, |end, p| {
            *end += p.len();
            Some(*end)
        }));
        let places = places.concat();
        Some(Self { solver, patterns, starts, places, p, q, a, b, penalties })
    }

    /// Sets a row; entries outside its pattern count as 0. A bound of [`NO_BOUND`] or more, or one that
    /// is not a number, removes the row.
    pub(super) fn set(&mut self, row: usize, values: &Controls, bound: f64) {
        let none = !(bound < NO_BOUND);
        let places = &self.places[self.starts[row]..self.starts[row + 1]];
        for (&place, c) in places.iter().zip(self.patterns[row].controls.clone()) {
            self.a[place] = if none { 0.0 } else { values[c] };
        }
        self.b[row] = if none { NO_BOUND } else { bound };
    }

    /// Returns by how much controls violate a row without slack; at most 0 if they satisfy it.
    fn excess(&self, row: usize, controls: &Controls) -> f64 {
        let places = &self.places[self.starts[row]..self.starts[row + 1]];
        let range = self.patterns[row].controls.clone();
        let sum: f64 = places.iter().zip(range).map(|(&p, c)| self.a[p] * controls[c]).sum();
        sum - self.b[row]
    }

    /// Returns whether controls satisfy every row without slack.
    fn satisfies(&self, controls: &Controls) -> bool {
        (0..self.patterns.len()).all(|row| self.excess(row, controls) <= 1e-9)
    }

    /// Minimises a cost subject to the rows; `free` is its unconstrained minimum, without which the solver
    /// is always used.
    pub(super) fn solve(&mut self, cost: &Quadratic, free: Option<Controls>) -> Solution {
        if let Some(controls) = free.filter(|free| self.satisfies(free)) {
            return Solution { controls, solve: Solve::ClosedForm, iterations: 0 };
        }
        let mut k = 0;
        for c in 0..CONTROLS {
            for r in 0..=c {
                self.p[k] = cost.p[r][c];
                k += 1;
            }
        }
        self.q[..CONTROLS].copy_from_slice(&cost.q);
        self.q[CONTROLS..].copy_from_slice(&self.penalties);
        let failed = Solution { controls: [0.0; CONTROLS], solve: Solve::Failed, iterations: 0 };
        let solver = &mut self.solver;
        if solver.update_data(&self.p, &self.q, &self.a, &self.b).is_err() {
            return failed;
        }
        solver.solve();
        let result = &solver.solution;
        let solve = match result.status {
            SolverStatus::Solved => Solve::Solved,
            SolverStatus::AlmostSolved => Solve::AlmostSolved,
            _ => Solve::Failed,
        };
        let mut controls = [0.0; CONTROLS];
        controls.copy_from_slice(&result.x[..CONTROLS]);
        if controls.iter().any(|c| !c.is_finite()) {
            return Solution { iterations: result.iterations, ..failed };
        }
        Solution { controls, solve, iterations: result.iterations }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{DMatrix, DVector};
    use proptest::prelude::*;

    use super::*;

    /// Number of free controls of a tiny problem; the cost keeps the others at 0.
    const LIVE: usize = 3;

    fn rows(count: usize) -> Vec<Pattern> {
        vec![Pattern { controls: 0..LIVE, slack: None }; count]
    }

    /// Returns the solution by brute force: the best feasible point among the minima with some rows as
    /// equalities.
    fn by_brute_force(cost: &Quadratic, rows: &[(Controls, f64)]) -> Option<(f64, Vec<f64>)> {
        let value = |x: &[f64]| -> f64 {
            let quadratic: f64 = (0..LIVE)
                .flat_map(|i| (0..LIVE).map(move |j| (i, j)))
                .map(|(i, j)| cost.p[i][j] * x[i] * x[j])
                .sum();
            0.5 * quadratic + (0..LIVE).map(|i| cost.q[i] * x[i]).sum::<f64>()
        };
        let mut best: Option<(f64, Vec<f64>)> = None;
        for active in 0..1_u32 << rows.len() {
            let set: Vec<_> = (0..rows.len()).filter(|r| active >> r & 1 == 1).map(|r| rows[r]).collect();
            if set.len() > LIVE {
                continue;
            }
            let n = LIVE + set.len();
            let (mut m, mut b) = (DMatrix::zeros(n, n), DVector::zeros(n));
            for i in 0..LIVE {
                for j in 0..LIVE {
                    m[(i, j)] = cost.p[i][j];
                }
                b[i] = -cost.q[i];
            }
            for (k, (row, bound)) in set.iter().enumerate() {
                for i in 0..LIVE {
                    m[(LIVE + k, i)] = row[i];
                    m[(i, LIVE + k)] = row[i];
                }
                b[LIVE + k] = *bound;
            }
            let Some(x) = m.lu().solve(&b) else { continue };
            let x: Vec<f64> = x.iter().take(LIVE).copied().collect();
            let satisfied = |(row, bound): &(Controls, f64)| {
                (0..LIVE).map(|i| row[i] * x[i]).sum::<f64>() <= bound + 1e-9
            };
            if x.iter().all(|v| v.is_finite()) && rows.iter().all(satisfied) {
                let v = value(&x);
                if best.as_ref().is_none_or(|b| v < b.0) {
                    best = Some((v, x));
                }
            }
        }
        best
    }

    fn cost(entries: &[f64]) -> Quadratic {
        let mut cost = Quadratic::ZERO;
        for i in 0..CONTROLS {
            cost.add(&unit(i), 0.0, 0.5);
        }
        for chunk in entries.chunks(LIVE + 1) {
            let row: Controls = std::array::from_fn(|c| if c < LIVE { chunk[c] } else { 0.0 });
            cost.add(&row, chunk[LIVE], 1.0);
        }
        cost
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(300))]

        #[test]
        fn tiny_programs_are_solved_as_by_brute_force(
            entries in prop::collection::vec(-3.0..3.0_f64, 8),
            bounds in prop::collection::vec((prop::array::uniform3(-2.0..2.0_f64), -0.5..2.0_f64), 6),
        ) {
            let cost = cost(&entries);
            let mut program = Program::new(rows(6), vec![1.0]).unwrap();
            let rows: Vec<(Controls, f64)> = bounds
                .iter()
                .map(|(r, b)| (std::array::from_fn(|c| if c < LIVE { r[c] } else { 0.0 }), *b))
                .collect();
            for (i, (values, bound)) in rows.iter().enumerate() {
                program.set(i, values, *bound);
            }
            let solution = program.solve(&cost, cost.minimum());
            match by_brute_force(&cost, &rows) {
                Some((_, x)) => {
                    prop_assert!(solution.solve <= Solve::AlmostSolved, "{solution:?}");
                    for i in 0..LIVE {
                        prop_assert!((solution.controls[i] - x[i]).abs() < 2e-3, "{solution:?} and {x:?}");
                    }
                }
                None => prop_assert_eq!(solution.solve, Solve::Failed),
            }
            // Earlier solves leave no trace.
            let mut again = Program::new(self::rows(6), vec![1.0]).unwrap();
            for (i, (values, bound)) in rows.iter().enumerate() {
                again.set(i, values, *bound);
            }
            let (first, second) = (program.solve(&cost, None), again.solve(&cost, None));
            prop_assert_eq!(first.controls.map(f64::to_bits), second.controls.map(f64::to_bits));
        }
    }

    #[test]
    fn a_slack_is_as_small_as_possible() {
        let patterns =
            vec![Pattern { controls: 0..1, slack: None }, Pattern { controls: 0..1, slack: Some(0) }];
        let mut program = Program::new(patterns, vec![100.0]).unwrap();
        program.set(0, &unit(0).map(|x| -x), -2.0);
        program.set(1, &unit(0), 1.0);
        let cost = cost(&[1.0, 0.0, 0.0, 5.0]);
        let solution = program.solve(&cost, cost.minimum());
        assert!(
            solution.solve <= Solve::AlmostSolved && (solution.controls[0] - 2.0).abs() < 1e-3,
            "{solution:?}"
        );
    }
}
