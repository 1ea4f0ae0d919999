//! Vocabulary: the motions of each class that an agent can choose from.

use reactsim_geometry::Vec2;
use reactsim_nn::WeightsError;
use reactsim_nn::learning::Provenance;
use reactsim_nn::perception::Class;
use reactsim_scene::dynamics::Pose;

use super::token_set::{TokenSet, corner_distance};
use super::{TOKEN_POSES, TokenPoses};

/// Largest deviation of the first pose of a token from the origin (metres, radians): the rounding of
/// 32-bit contours.
const START_TOLERANCE: f64 = 1e-4;

/// Motions of half a second of each class that an agent can choose from.
///
/// Poses are rounded to 32 bits, as in files, so that a new vocabulary equals the one that is read back.
#[derive(Clone, Debug, PartialEq)]
pub struct Vocabulary {
    classes: [TokenSet; 3],
    provenance: Provenance,
}

impl Vocabulary {
    /// Builds a vocabulary of these tokens, per class in the order of [`Class::ALL`].
    ///
    /// # Errors
    /// [`WeightsError`] if a class is empty, a pose is not finite, or a token does not start at the
    /// origin.
    pub fn new(tokens: [Vec<TokenPoses>; 3], provenance: Provenance) -> Result<Self, WeightsError> {
        for (class, tokens) in Class::ALL.into_iter().zip(&tokens) {
            check(class, tokens)?;
        }
        let mut classes = Class::ALL.into_iter();
        let classes = tokens.map(|tokens| {
            let class = classes.next().unwrap_or(Class::Vehicle);
            TokenSet::new(class, tokens.iter().map(rounded).collect())
        });
        Ok(Self { classes, provenance })
    }

    /// Returns its provenance.
    pub fn provenance(&self) -> &Provenance {
        &self.provenance
    }

    /// Returns the number of tokens of a class; at least one.
    pub fn tokens(&self, class: Class) -> usize {
        self.of(class).poses.len()
    }

    /// Returns the poses of a token at 0, 0.1 … 0.5 s, in the frame of the first; metres, radians.
    pub fn poses(&self, class: Class, token: usize) -> &TokenPoses {
        &self.of(class).poses[token]
    }

    /// Returns the end of a token: the motion of the whole half second.
    pub fn end(&self, class: Class, token: usize) -> Pose {
        self.poses(class, token)[TOKEN_POSES - 1]
    }

    /// Returns the corners of the class's matching box at the end of a token: left front, right front,
    /// right back, left back.
    pub fn contour(&self, class: Class, token: usize) -> [Vec2; 4] {
        self.of(class).contours[token]
    }

    /// Returns the token nearest to a motion of half a second, and the sum of its four corner distances,
    /// metres. Of equally near tokens it is the first. For a motion that is not finite, returns the
    /// first token at an infinite distance.
    pub fn nearest_with_distance(&self, class: Class, motion: Pose) -> (usize, f64) {
        let (token, distance) = self.of(class).nearest(motion);
        if token == usize::MAX { (0, f64::INFINITY) } else { (token, distance) }
    }

    /// Returns the token of [`Self::nearest_with_distance`].
    pub fn nearest(&self, class: Class, motion: Pose) -> usize {
        self.nearest_with_distance(class, motion).0
    }

    /// Returns the `k` tokens nearest to a motion of half a second with their summed corner distances,
    /// nearest first; fewer if the class has fewer, and none for a motion that is not finite.
    pub fn nearest_k(&self, class: Class, motion: Pose, k: usize) -> Vec<(usize, f64)> {
        self.of(class).nearest_k(motion, k)
    }

    /// Returns the summed corner distance of a token to a motion, metres.
    pub fn distance(&self, class: Class, token: usize, motion: Pose) -> f64 {
        corner_distance(&self.contour(class, token), &class.contour(motion))
    }

    fn of(&self, class: Class) -> &TokenSet {
        &self.classes[class.index()]
    }
}

fn check(class: Class, tokens: &[TokenPoses]) -> Result<(), WeightsError> {
    if tokens.is_empty() {
        return Err(WeightsError::Refused(format!(
            "class `{class}` has no tokens; every class needs at least one"
        )));
    }
    for (token, poses) in tokens.iter().enumerate() {
        for (pose, p) in poses.iter().enumerate() {
            let value = [p.position.x, p.position.y, p.heading];
            if !value.iter().all(|v| v.is_finite()) {
                return Err(WeightsError::Refused(format!(
                    "class `{class}`, token {token}, pose {pose}: {value:?} (x, y, heading) is not finite"
                )));
            }
            if pose == 0 && value.iter().any(|v| v.abs() > START_TOLERANCE) {
                return Err(WeightsError::Refused(format!(
                    "class `{class}`, token {token} starts at {value:?} (x, y, heading), expected 0, 0, 0: \
                     poses are in the frame of the first one"
                )));
            }
        }
    }
    Ok(())
}

/// Rounds a token to the precision of files, starting exactly at the origin.
fn rounded(poses: &TokenPoses) -> TokenPoses {
    let round = |v: f64| f64::from(v as f32);
    let mut rounded = poses.map(|p| Pose { position: p.position.map(round), heading: round(p.heading) });
    rounded[0] = super::ORIGIN;
    rounded
}
