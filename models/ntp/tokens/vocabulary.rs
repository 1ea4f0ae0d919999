//! The vocabulary: per class the motions that an agent may choose from.

use reactsim::dynamics::Pose;
use reactsim::geometry::Vec2;
use safetensors::{Dtype, SafeTensorError};
use serde::{Deserialize, Serialize};

use super::token_set::{TokenSet, corner_distance};
use super::{Class, TOKEN_POSES, TokenPoses};

/// How far the first pose of a token may be off the origin (metres, radians): what 32-bit contours leave.
const START: f64 = 1e-4;

/// Per class the motions of half a second that an agent may choose from.
///
/// Poses are kept to 32 bits, as in files, so that a vocabulary that was just made is the one that is read back.
#[derive(Clone, Debug, PartialEq)]
pub struct Vocabulary {
    classes: [TokenSet; 3],
    provenance: Provenance,
}

/// What a vocabulary was made of.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Provenance {
    /// The builder: `k-disks`, `trajtok`, `kinematic`, or `foreign`.
    pub method: String,
    /// Its settings.
    pub settings: serde_json::Value,
    /// Seed of its random choices.
    pub seed: u64,
    /// Scenarios from which motions were taken.
    pub scenarios: u64,
    /// BLAKE3 digest over the digests of these scenarios in their order; empty where there were none.
    pub data: String,
}

/// Why something is no vocabulary.
#[derive(Debug, thiserror::Error)]
pub enum VocabularyError {
    /// No safetensors file.
    #[error("the vocabulary is no whole safetensors file: {0}")]
    File(#[from] SafeTensorError),
    /// A tensor beside weights that can not be read.
    #[error("{0}")]
    Table(String),
    /// The tensors of no known layout.
    #[error(
        "the file holds no vocabulary: expected the tensors {expected}, found {found}; \
         `reactsim train vocabulary` makes vocabularies"
    )]
    Layout {
        /// Names of one layout.
        expected: String,
        /// Names in the file.
        found: String,
    },
    /// A tensor of another element type.
    #[error("tensor `{tensor}` is of type {found:?}, expected F32")]
    Type {
        /// Name.
        tensor: String,
        /// Type in the file.
        found: Dtype,
    },
    /// A tensor of another shape.
    #[error("tensor `{tensor}` has the shape {found:?}, expected {expected}")]
    Shape {
        /// Name.
        tensor: String,
        /// Shape in the file.
        found: Vec<usize>,
        /// What it should be, such as `[tokens, 6, 3]`.
        expected: &'static str,
    },
    /// What is said of its making can not be read.
    #[error("what the file says of the vocabulary's making can not be read: {0}")]
    Provenance(serde_json::Error),
    /// A class without tokens.
    #[error("class `{0}` has no tokens; every class needs at least one")]
    Empty(Class),
    /// NaN or infinite.
    #[error("class `{class}`, token {token}, pose {pose}: {value:?} (x, y, heading) is not finite")]
    NotFinite {
        /// Class.
        class: Class,
        /// Index of the token.
        token: usize,
        /// Index of the pose.
        pose: usize,
        /// x, y, heading.
        value: [f64; 3],
    },
    /// A vocabulary of the map without curves.
    #[error("the map vocabulary has no curves; give scenarios with maps")]
    NoCurves,
    /// A curve of the map with a coordinate that is NaN or infinite.
    #[error("curve {token} of the map vocabulary: {value:?} (x, y) is not finite")]
    CurveNotFinite {
        /// Index of the token.
        token: usize,
        /// x, y.
        value: [f64; 2],
    },
    /// A token that does not start at the origin.
    #[error(
        "class `{class}`, token {token} starts at {value:?} (x, y, heading), expected 0, 0, 0: poses are in the \
         frame of the first one"
    )]
    Start {
        /// Class.
        class: Class,
        /// Index of the token.
        token: usize,
        /// x, y, heading.
        value: [f64; 3],
    },
}

impl Vocabulary {
    /// A vocabulary of these tokens, per class in the order of [`Class::ALL`].
    ///
    /// # Errors
    /// [`VocabularyError`] where a class is empty, a pose is not finite, or a token does not start at the origin.
    pub fn new(tokens: [Vec<TokenPoses>; 3], provenance: Provenance) -> Result<Self, VocabularyError> {
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

    /// What it was made of.
    pub fn provenance(&self) -> &Provenance {
        &self.provenance
    }

    /// How many tokens a class has; at least one.
    pub fn tokens(&self, class: Class) -> usize {
        self.of(class).poses.len()
    }

    /// How many tokens the largest class has.
    pub fn most_tokens(&self) -> usize {
        Class::ALL.into_iter().map(|class| self.tokens(class)).max().unwrap_or(0)
    }

    /// The poses of a token at 0, 0.1 … 0.5 s, in the frame of the first; metres, radians.
    pub fn poses(&self, class: Class, token: usize) -> &TokenPoses {
        &self.of(class).poses[token]
    }

    /// Where a token ends: the motion of the whole half second.
    pub fn end(&self, class: Class, token: usize) -> Pose {
        self.poses(class, token)[TOKEN_POSES - 1]
    }

    /// The corners of the class's matching box at the end of a token: left front, right front, right back, left back.
    pub fn contour(&self, class: Class, token: usize) -> [Vec2; 4] {
        self.of(class).contours[token]
    }

    /// The token nearest to a motion of half a second, and the sum of its four corner distances, metres. Of equally near ones it is the
    /// first. A motion that is not finite has no nearest token: it gives the first one, at an infinite distance.
    pub fn nearest_with_distance(&self, class: Class, motion: Pose) -> (usize, f64) {
        let (token, distance) = self.of(class).nearest(motion);
        if token == usize::MAX { (0, f64::INFINITY) } else { (token, distance) }
    }

    /// The token of [`Self::nearest_with_distance`].
    pub fn nearest(&self, class: Class, motion: Pose) -> usize {
        self.nearest_with_distance(class, motion).0
    }

    /// The `k` tokens nearest to a motion of half a second with their summed corner distances, nearest first; fewer where the class has
    /// fewer, and none for a motion that is not finite.
    pub fn nearest_k(&self, class: Class, motion: Pose, k: usize) -> Vec<(usize, f64)> {
        self.of(class).nearest_k(motion, k)
    }

    /// The summed corner distance of a token to a motion, metres.
    pub fn distance(&self, class: Class, token: usize, motion: Pose) -> f64 {
        corner_distance(&self.contour(class, token), &class.contour(motion))
    }

    fn of(&self, class: Class) -> &TokenSet {
        &self.classes[class.index()]
    }
}

fn check(class: Class, tokens: &[TokenPoses]) -> Result<(), VocabularyError> {
    if tokens.is_empty() {
        return Err(VocabularyError::Empty(class));
    }
    for (token, poses) in tokens.iter().enumerate() {
        for (pose, p) in poses.iter().enumerate() {
            let value = [p.position.x, p.position.y, p.heading];
            if !value.iter().all(|v| v.is_finite()) {
                return Err(VocabularyError::NotFinite { class, token, pose, value });
            }
            if pose == 0 && value.iter().any(|v| v.abs() > START) {
                return Err(VocabularyError::Start { class, token, value });
            }
        }
    }
    Ok(())
}

/// A token to the precision of files, starting exactly at the origin.
fn rounded(poses: &TokenPoses) -> TokenPoses {
    let round = |v: f64| f64::from(v as f32);
    let mut rounded = poses.map(|p| Pose { position: p.position.map(round), heading: round(p.heading) });
    rounded[0] = super::ORIGIN;
    rounded
}
