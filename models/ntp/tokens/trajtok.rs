//! TrajTok: one token per cell of a grid of end points that is cleaned and filled (2506.21618).

use std::collections::BTreeMap;

use reactsim_geometry::{Vec2, direction, heading_of, wrap};
use reactsim_nn::perception::Class;
use reactsim_scene::dynamics::Pose;
use serde::Serialize;

use super::k_disks::{mean, mirror};
use super::{BuildError, ORIGIN, Segments, TOKEN_FRAMES, TOKEN_POSES, TokenPoses, Tokenizer};

/// One token per cell of a grid of end points: the mean of the motions that end there, or a smooth curve
/// to it.
///
/// Differences from the published generator: the grid is symmetric and has a cell of exact standstill,
/// curves have tangents as long as the chord, and the shift of a mean to the centre of its cell is
/// spread over its poses.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TrajTok {
    /// Grids per class in the order of [`Class::ALL`].
    pub grids: [EndGrid; 3],
    /// Reach of the window around a cell, in cells to each side.
    pub window: i32,
    /// Threshold of supported cells in the window: a cell without enough motions is added if more cells
    /// of its window have enough; one with enough is removed if fewer do.
    pub company: usize,
}

/// Grid of end points of one class.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct EndGrid {
    /// Reach to the back, metres (negative).
    pub back: f64,
    /// Reach ahead, metres.
    pub ahead: f64,
    /// Spacing along x, metres.
    pub step: f64,
    /// Reach to each side, metres.
    pub side: f64,
    /// Spacing along y, metres.
    pub side_step: f64,
    /// Number of motions that a cell needs, including mirrored ones.
    pub count: usize,
}

/// Name of the method in files and messages.
const METHOD: &str = "trajtok";
/// Largest heading change per frame of a token, radians (10 degrees).
const MAX_TURN_PER_FRAME: f64 = 10.0 * std::f64::consts::PI / 180.0;
/// Largest plausible number of cells per side.
const MAX_CELLS: f64 = 5000.0;

impl Default for TrajTok {
    fn default() -> Self {
        let grid =
            |back, ahead, step, side, side_step, count| EndGrid { back, ahead, step, side, side_step, count };
        Self {
            grids: [
                grid(-5.0, 20.0, 0.1, 2.5, 0.0625, 3),
                grid(-1.5, 4.5, 0.05, 2.0, 0.05, 1),
                grid(-1.0, 8.0, 0.05, 1.0, 0.05, 1),
            ],
            window: 4,
            company: 20,
        }
    }
}

/// A cell: steps ahead and steps to the left.
type Cell = (i32, i32);

impl EndGrid {
    fn check(&self) -> Result<(), BuildError> {
        let wrong =
            |name, value, expected| Err(BuildError::Setting { method: METHOD, name, value, expected });
        let cells = |reach: f64, step: f64| reach / step <= MAX_CELLS;
        for (name, step) in [("step", self.step), ("side_step", self.side_step)] {
            if !(step > 0.0 && step.is_finite()) {
                return wrong(name, step, "a length above 0");
            }
        }
        for (name, reach, step) in [
            ("back", -self.back, self.step),
            ("ahead", self.ahead, self.step),
            ("side", self.side, self.side_step),
        ] {
            if !(reach >= 0.0 && cells(reach, step)) {
                return wrong(name, reach, "a length of at most 5000 steps");
            }
        }
        Ok(())
    }

    /// Returns the cell of an end point, if it is on the grid.
    fn cell(&self, end: Vec2) -> Option<Cell> {
        let (x, y) = (end.x / self.step, end.y / self.side_step);
        let (back, ahead, side) = (self.back / self.step, self.ahead / self.step, self.side / self.side_step);
        let inside =
            x.round() >= back.round() && x.round() <= ahead.round() && y.round().abs() <= side.round();
        inside.then(|| (x.round() as i32, y.round() as i32))
    }

    fn middle(&self, cell: Cell) -> Vec2 {
        Vec2::new(f64::from(cell.0) * self.step, f64::from(cell.1) * self.side_step)
    }

    /// Returns all cells on the axis and to the left of it; those to the right are their mirror images.
    fn left_cells(&self) -> impl Iterator<Item = Cell> {
        let steps = |reach: f64, step: f64| (reach / step).round() as i32;
        let (back, ahead) = (steps(self.back, self.step), steps(self.ahead, self.step));
        let side = steps(self.side, self.side_step);
        (back..=ahead).flat_map(move |x| (0..=side).map(move |y| (x, y)))
    }
}

impl Tokenizer for TrajTok {
    fn method(&self) -> &'static str {
        METHOD
    }

    fn settings(&self) -> serde_json::Value {
        serde_json::json!(self)
    }

    fn tokens(&self, class: Class, segments: &Segments) -> Result<Vec<TokenPoses>, BuildError> {
        let grid = &self.grids[class.index()];
        grid.check()?;
        // Motions to the right are mirrored; those that end on the axis count for both sides.
        let mut motions: BTreeMap<Cell, Vec<TokenPoses>> = BTreeMap::new();
        for motion in segments.of(class).iter().filter(|m| within(grid, m)) {
            let Some(cell) = grid.cell(motion[TOKEN_FRAMES].position) else { continue };
            let motion = if cell.1 < 0 { mirror(motion) } else { *motion };
            motions.entry((cell.0, cell.1.abs())).or_default().push(motion);
        }
        let enough = |cell: Cell| {
            let seen = motions.get(&(cell.0, cell.1.abs())).map_or(0, Vec::len);
            seen * (if cell.1 == 0 { 2 } else { 1 }) >= grid.count.max(1)
        };
        let supported = |cell: Cell| self.count_supported(cell, enough);
        let mut tokens = vec![[ORIGIN; TOKEN_POSES]];
        let (mut ends, mut added) = (BTreeMap::new(), Vec::new());
        for cell in grid.left_cells().filter(|c| *c != (0, 0)) {
            match (enough(cell), supported(cell)) {
                (true, n) if n >= self.company => {
                    let token = mean_token(grid, cell, &motions[&cell], class);
                    ends.insert(cell, token[TOKEN_FRAMES].heading);
                    push(&mut tokens, cell, token);
                }
                (false, n) if n > self.company => added.push(cell),
                _ => {}
            }
        }
        if tokens.len() == 1 {
            let needed = format!("{} neighbouring cells with {} motions each", self.company, grid.count);
            return Err(BuildError::NoData {
                class,
                segments: segments.of(class).len(),
                method: METHOD,
                needed,
            });
        }
        for cell in added {
            let heading = if cell.1 == 0 { 0.0 } else { nearest_heading(&ends, cell) };
            push(&mut tokens, cell, curve(grid.middle(cell), heading, class));
        }
        Ok(tokens)
    }
}

impl TrajTok {
    /// Counts the cells with enough motions in the window of a cell, including the cell itself.
    fn count_supported(&self, cell: Cell, enough: impl Fn(Cell) -> bool) -> usize {
        let reach = -self.window..=self.window;
        let window = reach.clone().flat_map(|dx| reach.clone().map(move |dy| (dx, dy)));
        window.filter(|(dx, dy)| enough((cell.0 + dx, cell.1 + dy))).count()
    }
}

/// Returns whether the mean position of a motion is within reach of the grid.
fn within(grid: &EndGrid, motion: &TokenPoses) -> bool {
    let mean = motion.iter().map(|p| p.position.map(f64::abs)).sum::<Vec2>() / TOKEN_POSES as f64;
    mean.x < grid.ahead && mean.y < grid.side
}

/// Adds a token, and its mirror image unless the token is symmetric.
fn push(tokens: &mut Vec<TokenPoses>, cell: Cell, token: TokenPoses) {
    tokens.push(token);
    if cell.1 != 0 {
        tokens.push(mirror(&token));
    }
}

/// Returns the mean of the motions that end in a cell, shifted to end at its centre.
fn mean_token(grid: &EndGrid, cell: Cell, motions: &[TokenPoses], class: Class) -> TokenPoses {
    let mut token = mean(motions, &motions[0]);
    if cell.1 == 0 {
        // Mean of the motions and of their mirror images.
        token = token.map(|p| Pose { position: Vec2::new(p.position.x, 0.0), heading: 0.0 });
    }
    let middle = grid.middle(cell);
    let shift = middle - token[TOKEN_FRAMES].position;
    for (i, pose) in token.iter_mut().enumerate() {
        pose.position += shift * (i as f64 / TOKEN_FRAMES as f64);
    }
    token[TOKEN_FRAMES].position = middle;
    if turns_too_fast(&token) { curve(middle, token[TOKEN_FRAMES].heading, class) } else { token }
}

/// Returns whether the heading turns by more than [`MAX_TURN_PER_FRAME`] within a frame.
fn turns_too_fast(token: &TokenPoses) -> bool {
    token.windows(2).any(|w| wrap(w[1].heading - w[0].heading).abs() > MAX_TURN_PER_FRAME)
}

/// Returns the heading at the end of the nearest token, with distances counted in cells along the axes;
/// the first of equally near ones.
fn nearest_heading(ends: &BTreeMap<Cell, f64>, cell: Cell) -> f64 {
    let far = |c: &Cell| c.0.abs_diff(cell.0) + c.1.abs_diff(cell.1);
    ends.iter().min_by_key(|(c, _)| far(c)).map_or(0.0, |(_, heading)| *heading)
}

/// Returns a cubic Hermite curve to a point, with tangents as long as the chord. Vehicles and cyclists
/// point along it (against it in reverse). Pedestrians turn at a constant rate, as do agents that would
/// turn too fast, which happens on short sideways motions.
fn curve(to: Vec2, heading: f64, class: Class) -> TokenPoses {
    let gear = if to.x < 0.0 { -1.0 } else { 1.0 };
    let chord = to.norm() * gear;
    let (start, end) = (Vec2::new(chord, 0.0), direction(heading) * chord);
    let mut poses = [ORIGIN; TOKEN_POSES];
    for (i, pose) in poses.iter_mut().enumerate().skip(1) {
        let u = i as f64 / TOKEN_FRAMES as f64;
        let (u2, u3) = (u * u, u * u * u);
        let position = start * (u3 - 2.0 * u2 + u) + to * (3.0 * u2 - 2.0 * u3) + end * (u3 - u2);
        let along =
            start * (3.0 * u2 - 4.0 * u + 1.0) + to * (6.0 * u - 6.0 * u2) + end * (3.0 * u2 - 2.0 * u);
        *pose = Pose { position, heading: heading_of(along * gear) };
    }
    poses[TOKEN_FRAMES] = Pose { position: to, heading };
    if class == Class::Pedestrian || turns_too_fast(&poses) {
        for (i, pose) in poses.iter_mut().enumerate() {
            pose.heading = heading * (i as f64 / TOKEN_FRAMES as f64);
        }
    }
    poses
}
