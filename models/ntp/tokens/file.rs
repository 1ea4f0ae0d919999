//! Vocabulary files: the native format and foreign layouts.

use reactsim_geometry::{Vec2, heading_of};
use reactsim_nn::learning::Provenance;
use reactsim_nn::perception::Class;
use reactsim_nn::weights::{Tables, save_tables};
use reactsim_nn::{Tensors, WeightsError};
use reactsim_scene::dynamics::Pose;

use super::{ORIGIN, TOKEN_POSES, TokenPoses, Vocabulary};

/// Key of the metadata entry that holds the provenance, as JSON. A single entry, so that equal
/// vocabularies give equal bytes.
const PROVENANCE_KEY: &str = "reactsim.vocabulary";
/// Prefix of the names of native tensors.
pub(crate) const PREFIX: &str = "vocabulary.";
/// Names of native tensors `[tokens, 6, 3]`: x, y, heading.
const NATIVE_TENSORS: [&str; 3] = ["vocabulary.vehicle", "vocabulary.pedestrian", "vocabulary.cyclist"];
/// Names in files of poses taken from the releases of SMART and CATK, `[tokens, 6, 3]`.
const POSE_TENSORS: [&str; 3] = ["veh.poses", "ped.poses", "cyc.poses"];
/// Names in files of contours as CATK stores them, `[tokens, 6, 4, 2]`: corners of each pose, left
/// front, right front, right back, left back.
const CONTOUR_TENSORS: [&str; 3] = ["agent_token_all_veh", "agent_token_all_ped", "agent_token_all_cyc"];

impl Vocabulary {
    /// Reads a vocabulary: native files, weights of networks that contain one, and the foreign layouts of
    /// poses and contours.
    ///
    /// # Errors
    /// [`WeightsError`] naming tensor and value if the bytes are cut short, tensors are missing or
    /// have another type or shape, or tokens are not finite or do not start at the origin.
    pub fn read(bytes: &[u8]) -> Result<Self, WeightsError> {
        let file = Tensors::read(bytes)?;
        if holds(&file, &POSE_TENSORS) {
            return Self::new(each(&file, &POSE_TENSORS, poses)?, Provenance::foreign());
        }
        if holds(&file, &CONTOUR_TENSORS) {
            return Self::new(each(&file, &CONTOUR_TENSORS, contours)?, Provenance::foreign());
        }
        Self::from_tables(&file)
    }

    /// Reads a vocabulary from a file that also holds other tensors: the tensors of [`Self::tables`],
    /// and the provenance in the metadata.
    ///
    /// # Errors
    /// [`WeightsError`], as [`Self::read`].
    pub fn from_tables(file: &Tensors<'_>) -> Result<Self, WeightsError> {
        let names: Vec<&str> = file.shapes().map(|(name, _)| name).collect();
        // Files with another number of classes are rejected.
        let classes = names.iter().filter(|name| name.starts_with(PREFIX)).count();
        let is_whole = classes == NATIVE_TENSORS.len() && holds(file, &NATIVE_TENSORS);
        let Some(provenance) = Provenance::of(file, PROVENANCE_KEY)?.filter(|_| is_whole) else {
            return Err(no_vocabulary(&NATIVE_TENSORS, &names));
        };
        Self::new(each(file, &NATIVE_TENSORS, poses)?, provenance)
    }

    /// Returns the tokens as tensors `[tokens, 6, 3]` by name, and the metadata entry with their
    /// provenance. Both are stored with the weights of a network trained with them.
    ///
    /// # Errors
    /// [`WeightsError`] if the provenance cannot be written as text.
    pub fn tables(&self) -> Result<(Tables, (String, String)), WeightsError> {
        let tables = Class::ALL.into_iter().map(|class| {
            let tokens = (0..self.tokens(class)).flat_map(|t| self.poses(class, t));
            let values = tokens.flat_map(|p| [p.position.x, p.position.y, p.heading].map(|v| v as f32));
            let shape = vec![self.tokens(class), TOKEN_POSES, 3];
            (NATIVE_TENSORS[class.index()].to_owned(), (shape, values.collect()))
        });
        Ok((tables.collect(), self.provenance().entry(PROVENANCE_KEY)?))
    }

    /// Returns the bytes of a file that [`Self::read`] reads back as the same vocabulary.
    ///
    /// # Errors
    /// [`WeightsError`] if the provenance cannot be written as text.
    pub fn write(&self) -> Result<Vec<u8>, WeightsError> {
        let (tables, entry) = self.tables()?;
        Ok(save_tables(&tables, &[entry].into()))
    }
}

/// Returns whether a file has the tensors of a layout.
fn holds(file: &Tensors<'_>, layout: &[&str; 3]) -> bool {
    layout.iter().all(|name| file.shapes().any(|(found, _)| found == *name))
}

type Decode = fn(&Tensors<'_>, &str) -> Result<Vec<TokenPoses>, WeightsError>;

/// Decodes the tokens of every class from its tensor.
fn each(file: &Tensors<'_>, names: &[&str; 3], decode: Decode) -> Result<[Vec<TokenPoses>; 3], WeightsError> {
    Ok([decode(file, names[0])?, decode(file, names[1])?, decode(file, names[2])?])
}

/// Decodes the tokens of a tensor of poses.
fn poses(file: &Tensors<'_>, name: &str) -> Result<Vec<TokenPoses>, WeightsError> {
    let values = values(file, name, &[TOKEN_POSES, 3], "[tokens, 6, 3]")?;
    let pose = |v: &[f64]| Pose { position: Vec2::new(v[0], v[1]), heading: v[2] };
    Ok(values.chunks_exact(TOKEN_POSES * 3).map(|token| token_of(token, 3, pose)).collect())
}

/// Decodes the tokens of a tensor of contours: the centre is the mean of the corners, and the heading
/// points from the left back corner to the left front one.
fn contours(file: &Tensors<'_>, name: &str) -> Result<Vec<TokenPoses>, WeightsError> {
    let values = values(file, name, &[TOKEN_POSES, 4, 2], "[tokens, 6, 4, 2]")?;
    let pose = |v: &[f64]| {
        let corner = |i: usize| Vec2::new(v[2 * i], v[2 * i + 1]);
        Pose {
            position: (corner(0) + corner(1) + corner(2) + corner(3)) / 4.0,
            heading: heading_of(corner(0) - corner(3)),
        }
    };
    Ok(values.chunks_exact(TOKEN_POSES * 8).map(|token| token_of(token, 8, pose)).collect())
}

/// Builds the poses of one token from `each` values per pose.
fn token_of(values: &[f64], each: usize, pose: impl Fn(&[f64]) -> Pose) -> TokenPoses {
    let mut poses = [ORIGIN; TOKEN_POSES];
    for (to, from) in poses.iter_mut().zip(values.chunks_exact(each)) {
        *to = pose(from);
    }
    poses
}

/// Returns the values of a tensor of tokens; `inner` holds its dimensions after the first.
fn values(file: &Tensors<'_>, name: &str, inner: &[usize], expected: &str) -> Result<Vec<f64>, WeightsError> {
    let (shape, values) = file.floats(name)?;
    if shape.len() != inner.len() + 1 || shape[1..] != *inner {
        return Err(wrong_shape(name, shape, expected));
    }
    Ok(values.into_iter().map(f64::from).collect())
}

/// Refuses a file with tensors of no known layout.
pub(super) fn no_vocabulary(expected: &[&str], found: &[&str]) -> WeightsError {
    let (expected, found) = (listed(expected), listed(found));
    WeightsError::Refused(format!(
        "the file holds no vocabulary: expected the tensors {expected}, found {found}; \
         `reactsim train vocabulary` makes vocabularies"
    ))
}

pub(super) fn wrong_shape(tensor: &str, found: &[usize], expected: &str) -> WeightsError {
    WeightsError::Refused(format!("tensor `{tensor}` has the shape {found:?}, expected {expected}"))
}

/// Formats the first names of a list for a message.
fn listed(names: &[&str]) -> String {
    const SHOWN: usize = 8;
    let mut text = names.iter().take(SHOWN).map(|n| format!("`{n}`")).collect::<Vec<_>>().join(", ");
    if names.len() > SHOWN {
        text.push_str(&format!(" and {} more", names.len() - SHOWN));
    }
    if names.is_empty() { "none".to_owned() } else { text }
}
