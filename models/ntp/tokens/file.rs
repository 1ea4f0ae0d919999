//! Vocabulary files: the native format and foreign layouts.

use std::collections::HashMap;

use reactsim_geometry::{Vec2, heading_of};
use reactsim_nn::learning::Provenance;
use reactsim_nn::perception::Class;
use reactsim_nn::{Tensors, WeightsError, weights::Tables};
use reactsim_scene::dynamics::Pose;
use safetensors::{Dtype, SafeTensorError, SafeTensors, tensor::TensorView};

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
        let file = SafeTensors::deserialize(bytes).map_err(incomplete)?;
        let (_, header) = SafeTensors::read_metadata(bytes).map_err(incomplete)?;
        let mut names = file.names();
        names.sort_unstable();
        let has = |layout: &[&str; 3]| layout.iter().all(|name| names.contains(name));
        let foreign = Provenance { method: "foreign".to_owned(), ..Provenance::default() };
        if has(&POSE_TENSORS) {
            return Self::new(each(&file, &POSE_TENSORS, poses)?, foreign);
        }
        if has(&CONTOUR_TENSORS) {
            return Self::new(each(&file, &CONTOUR_TENSORS, contours)?, foreign);
        }
        // Files with another number of classes are rejected.
        let classes = names.iter().filter(|name| name.starts_with(PREFIX)).count();
        let made = header.metadata().as_ref().and_then(|m| m.get(PROVENANCE_KEY));
        let Some(made) = made.filter(|_| classes == NATIVE_TENSORS.len() && has(&NATIVE_TENSORS)) else {
            return Err(no_vocabulary(&listed(&NATIVE_TENSORS), &listed(&names)));
        };
        let provenance = serde_json::from_str(made).map_err(damaged_provenance)?;
        Self::new(each(&file, &NATIVE_TENSORS, poses)?, provenance)
    }

    /// Reads a vocabulary from a file that also holds other tensors: the tensors of [`Self::tables`],
    /// and the provenance in the metadata.
    ///
    /// # Errors
    /// [`WeightsError`], as [`Self::read`].
    pub fn from_tables(tensors: &Tensors<'_>) -> Result<Self, WeightsError> {
        let found: Vec<&str> = tensors.shapes().map(|(name, _)| name).collect();
        let Some(made) =
            tensors.metadata().get(PROVENANCE_KEY).filter(|_| found.len() == NATIVE_TENSORS.len())
        else {
            return Err(no_vocabulary(&listed(&NATIVE_TENSORS), &listed(&found)));
        };
        let provenance = serde_json::from_str(made).map_err(damaged_provenance)?;
        let table = |name: &'static str| {
            let (shape, values) = tensors.floats(name)?;
            if shape.len() != 3 || shape[1..] != [TOKEN_POSES, 3] {
                return Err(wrong_shape(name, shape, "[tokens, 6, 3]"));
            }
            let values: Vec<f64> = values.into_iter().map(f64::from).collect();
            let pose = |v: &[f64]| Pose { position: Vec2::new(v[0], v[1]), heading: v[2] };
            Ok(values.chunks_exact(TOKEN_POSES * 3).map(|token| token_of(token, 3, pose)).collect())
        };
        Self::new(
            [table(NATIVE_TENSORS[0])?, table(NATIVE_TENSORS[1])?, table(NATIVE_TENSORS[2])?],
            provenance,
        )
    }

    /// Returns the tokens as tensors `[tokens, 6, 3]` by name, and the metadata entry with their
    /// provenance. Both are stored with the weights of a network trained with them.
    ///
    /// # Errors
    /// [`WeightsError`] if the provenance cannot be written as text.
    pub fn tables(&self) -> Result<(Tables, (String, String)), WeightsError> {
        let made = serde_json::to_string(self.provenance()).map_err(damaged_provenance)?;
        let tables = Class::ALL.into_iter().map(|class| {
            let tokens = (0..self.tokens(class)).flat_map(|t| self.poses(class, t));
            let values = tokens.flat_map(|p| [p.position.x, p.position.y, p.heading].map(|v| v as f32));
            let shape = vec![self.tokens(class), TOKEN_POSES, 3];
            (NATIVE_TENSORS[class.index()].to_owned(), (shape, values.collect()))
        });
        Ok((tables.collect(), (PROVENANCE_KEY.to_owned(), made)))
    }

    /// Returns the bytes of a file that [`Self::read`] reads back as the same vocabulary.
    ///
    /// # Errors
    /// [`WeightsError`] if the vocabulary is too large for such a file.
    pub fn write(&self) -> Result<Vec<u8>, WeightsError> {
        let made = serde_json::to_string(self.provenance()).map_err(damaged_provenance)?;
        let data = Class::ALL.map(|class| {
            let tokens = (0..self.tokens(class)).flat_map(|t| self.poses(class, t));
            let values = tokens.flat_map(|p| [p.position.x, p.position.y, p.heading]);
            values.flat_map(|v| (v as f32).to_le_bytes()).collect::<Vec<u8>>()
        });
        let mut tensors = Vec::new();
        for (class, data) in Class::ALL.into_iter().zip(&data) {
            let shape = vec![self.tokens(class), TOKEN_POSES, 3];
            let view = TensorView::new(Dtype::F32, shape, data).map_err(incomplete)?;
            tensors.push((NATIVE_TENSORS[class.index()], view));
        }
        let metadata = HashMap::from([(PROVENANCE_KEY.to_owned(), made)]);
        safetensors::serialize(tensors, Some(metadata)).map_err(incomplete)
    }
}

type Decode = fn(&str, &TensorView<'_>) -> Result<Vec<TokenPoses>, WeightsError>;

/// Decodes the tokens of every class from its tensor.
fn each(
    file: &SafeTensors<'_>,
    names: &[&str; 3],
    decode: Decode,
) -> Result<[Vec<TokenPoses>; 3], WeightsError> {
    let tokens = |i: usize| decode(names[i], &file.tensor(names[i]).map_err(incomplete)?);
    Ok([tokens(0)?, tokens(1)?, tokens(2)?])
}

/// Decodes the tokens of a tensor of poses.
fn poses(name: &str, tensor: &TensorView<'_>) -> Result<Vec<TokenPoses>, WeightsError> {
    let expected = "[tokens, 6, 3]";
    let values = values(name, tensor, &[TOKEN_POSES, 3], expected)?;
    let pose = |v: &[f64]| Pose { position: Vec2::new(v[0], v[1]), heading: v[2] };
    Ok(values.chunks_exact(TOKEN_POSES * 3).map(|token| token_of(token, 3, pose)).collect())
}

/// Decodes the tokens of a tensor of contours: the centre is the mean of the corners, and the heading
/// points from the left back corner to the left front one.
fn contours(name: &str, tensor: &TensorView<'_>) -> Result<Vec<TokenPoses>, WeightsError> {
    let expected = "[tokens, 6, 4, 2]";
    let values = values(name, tensor, &[TOKEN_POSES, 4, 2], expected)?;
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
fn values(
    name: &str,
    tensor: &TensorView<'_>,
    inner: &[usize],
    expected: &'static str,
) -> Result<Vec<f64>, WeightsError> {
    if tensor.dtype() != Dtype::F32 {
        return Err(wrong_type(name, tensor.dtype()));
    }
    let shape = tensor.shape();
    if shape.len() != inner.len() + 1 || shape[1..] != *inner {
        return Err(wrong_shape(name, shape, expected));
    }
    let number = |b: &[u8]| f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]]));
    Ok(tensor.data().chunks_exact(4).map(number).collect())
}

/// Refuses a vocabulary with a text.
pub(super) fn refused(text: String) -> WeightsError {
    WeightsError::Refused(text)
}

pub(super) fn incomplete(error: SafeTensorError) -> WeightsError {
    refused(format!("the vocabulary is not a complete safetensors file: {error}"))
}

pub(super) fn damaged_provenance(error: serde_json::Error) -> WeightsError {
    refused(format!("the provenance of the vocabulary cannot be read: {error}"))
}

/// Refuses a file with tensors of no known layout.
pub(super) fn no_vocabulary(expected: &str, found: &str) -> WeightsError {
    refused(format!(
        "the file holds no vocabulary: expected the tensors {expected}, found {found}; \
         `reactsim train vocabulary` makes vocabularies"
    ))
}

pub(super) fn wrong_type(tensor: &str, found: Dtype) -> WeightsError {
    refused(format!("tensor `{tensor}` is of type {found:?}, expected F32"))
}

pub(super) fn wrong_shape(tensor: &str, found: &[usize], expected: &str) -> WeightsError {
    refused(format!("tensor `{tensor}` has the shape {found:?}, expected {expected}"))
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
