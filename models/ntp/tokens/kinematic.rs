//! Kinematic vocabulary: motions at constant speed and curvature on a grid of both. It needs no data.

use std::f64::consts::TAU;

use reactsim_geometry::{Vec2, direction, wrap};
use reactsim_nn::WeightsError;
use reactsim_nn::learning::Provenance;
use reactsim_nn::perception::Class;
use reactsim_scene::DT;
use reactsim_scene::dynamics::{Pose, REAR_AXLE};
use serde::Serialize;

use super::{BuildError, ORIGIN, Segments, TOKEN_FRAMES, TOKEN_POSES, TokenPoses, Tokenizer, Vocabulary};

/// A grid of motions at constant speed and curvature. Mirrored motions are mirrored tokens, and token 0
/// is an exact standstill.
///
/// Choosing actions from a kinematic grid follows KiGRAS (2407.12940); the levels are our own, fitted by
/// eye to recorded motion.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Kinematic {
    /// Cars, trucks, buses and the AV.
    pub vehicle: ArcGrid,
    /// People on foot.
    pub pedestrian: PolarGrid,
    /// People on bicycles.
    pub cyclist: ArcGrid,
}

/// Arcs: levels of speed, each with levels of curvature.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ArcGrid {
    /// Levels of speed, slow to fast.
    pub bands: Vec<Band>,
    /// Levels of speed in reverse.
    pub reverse: Vec<Band>,
    /// Largest curvature, 1/m.
    pub curvature: f64,
    /// Largest lateral acceleration, m/s².
    pub lateral: f64,
    /// Distance in metres of the rear axle, which drives along the arc, behind the box centre.
    pub axle: f64,
    /// Fraction of the curvature that is spaced evenly; the rest grows with the square, which makes
    /// levels denser near straight.
    pub even: f64,
}

/// Levels of speed with one spacing, starting at the end of the previous band (or 0).
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Band {
    /// Highest speed, m/s.
    pub to: f64,
    /// Spacing, m/s.
    pub step: f64,
    /// Number of curvatures (or directions) at each speed; an odd number includes straight on.
    pub turns: usize,
}

/// Grid of walking: levels of speed in all directions without turning, and ahead with turning; and turns
/// on the spot.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PolarGrid {
    /// Levels of speed, with `turns` directions each, spaced evenly over the circle, at constant
    /// heading.
    pub bands: Vec<Band>,
    /// Turns while walking ahead, radians in half a second, to both sides.
    pub walking_turns: Vec<f64>,
    /// Turns on the spot, radians in half a second, to both sides.
    pub standing_turns: Vec<f64>,
}

impl Default for Kinematic {
    fn default() -> Self {
        let band = |to, step, turns| Band { to, step, turns };
        Self {
            vehicle: ArcGrid {
                bands: vec![
                    band(0.8, 0.2, 9),
                    band(4.0, 0.2, 17),
                    band(8.0, 0.4, 19),
                    band(14.0, 0.4, 15),
                    band(20.0, 0.4, 11),
                    band(34.0, 0.8, 7),
                ],
                reverse: vec![band(2.0, 0.4, 3)],
                curvature: 0.3,
                lateral: 8.0,
                axle: REAR_AXLE * Class::Vehicle.matching_box().0,
                even: 0.2,
            },
            pedestrian: PolarGrid {
                bands: vec![band(2.1, 0.15, 24), band(3.9, 0.3, 24)],
                walking_turns: vec![0.08, 0.16, 0.26, 0.4, 0.6, 0.8],
                standing_turns: vec![0.15, 0.3, 0.5, 0.8, 1.2, 1.6, 2.2, 2.8],
            },
            cyclist: ArcGrid {
                bands: vec![band(4.0, 0.2, 11), band(12.0, 0.4, 11)],
                reverse: Vec::new(),
                curvature: 0.4,
                lateral: 6.0,
                axle: 0.0,
                even: 0.2,
            },
        }
    }
}

impl Kinematic {
    /// Builds the vocabulary of this grid.
    ///
    /// # Errors
    /// [`WeightsError`] if a setting is not finite.
    pub fn build(&self) -> Result<Vocabulary, WeightsError> {
        let (method, settings) = (self.method().to_owned(), self.settings());
        let provenance = Provenance { method, settings, ..Provenance::default() };
        Vocabulary::new(Class::ALL.map(|class| self.of(class)), provenance)
    }

    fn of(&self, class: Class) -> Vec<TokenPoses> {
        match class {
            Class::Vehicle => self.vehicle.tokens(),
            Class::Pedestrian => self.pedestrian.tokens(),
            Class::Cyclist => self.cyclist.tokens(),
        }
    }
}

impl Tokenizer for Kinematic {
    fn method(&self) -> &'static str {
        "kinematic"
    }

    fn settings(&self) -> serde_json::Value {
        serde_json::json!(self)
    }

    fn tokens(&self, class: Class, _: &Segments) -> Result<Vec<TokenPoses>, BuildError> {
        Ok(self.of(class))
    }
}

/// Returns every speed of some bands, with its number of turns.
fn levels(bands: &[Band]) -> Vec<(f64, usize)> {
    let (mut levels, mut from) = (Vec::new(), 0.0);
    for band in bands {
        // Half a thousandth of a step compensates for rounding.
        let count = ((band.to - from) / band.step + 5e-4).floor();
        let count = if count.is_finite() { count.clamp(0.0, 1e4) as usize } else { 0 };
        levels.extend((1..=count).map(|i| (from + band.step * i as f64, band.turns)));
        from += band.step * count as f64;
    }
    levels
}

impl ArcGrid {
    fn tokens(&self) -> Vec<TokenPoses> {
        let mut tokens = vec![[ORIGIN; TOKEN_POSES]];
        let forward = levels(&self.bands);
        let reverse = levels(&self.reverse).into_iter().map(|(speed, turns)| (-speed, turns));
        for (speed, turns) in forward.into_iter().chain(reverse) {
            let most = self.curvature.min(self.lateral / (speed * speed));
            // From the right to the left.
            for i in 0..turns {
                let u = if turns > 1 { (2 * i) as f64 / (turns - 1) as f64 - 1.0 } else { 0.0 };
                tokens.push(self.arc(speed, most * u * (self.even + (1.0 - self.even) * u.abs())));
            }
        }
        tokens
    }

    /// Returns the poses of the box centre while the rear axle drives along an arc.
    fn arc(&self, speed: f64, curvature: f64) -> TokenPoses {
        let axle = Pose { position: Vec2::new(-self.axle, 0.0), heading: 0.0 };
        let mut poses = [ORIGIN; TOKEN_POSES];
        for (i, pose) in poses.iter_mut().enumerate().skip(1) {
            let at = axle.advance(speed * DT * i as f64, curvature);
            *pose = Pose { position: at.position + direction(at.heading) * self.axle, ..at };
        }
        poses
    }
}

impl PolarGrid {
    fn tokens(&self) -> Vec<TokenPoses> {
        let mut tokens = vec![[ORIGIN; TOKEN_POSES]];
        let mut both = |displacement: Vec2, turn: f64| {
            for side in [-1.0, 1.0] {
                tokens.push(walk(Vec2::new(displacement.x, displacement.y * side), turn * side));
                if displacement.y == 0.0 && turn == 0.0 {
                    break;
                }
            }
        };
        for &turn in &self.standing_turns {
            both(Vec2::zeros(), turn);
        }
        for (speed, directions) in levels(&self.bands) {
            let distance = speed * DT * TOKEN_FRAMES as f64;
            // Half of the circle: the other half is its mirror image.
            for i in 0..=directions / 2 {
                let straight = i == 0 || 2 * i == directions;
                let to = direction(TAU * i as f64 / directions.max(1) as f64);
                both(if straight { Vec2::new(to.x.round(), 0.0) } else { to } * distance, 0.0);
            }
            for &turn in &self.walking_turns {
                both(direction(0.5 * turn) * distance, turn);
            }
        }
        tokens
    }
}

/// Returns a straight motion to a point, turning at a constant rate.
fn walk(displacement: Vec2, turn: f64) -> TokenPoses {
    let mut poses = [ORIGIN; TOKEN_POSES];
    for (i, pose) in poses.iter_mut().enumerate().skip(1) {
        let share = i as f64 / TOKEN_FRAMES as f64;
        *pose = Pose { position: displacement * share, heading: wrap(turn * share) };
    }
    poses
}
