//! Vocabularies as bytes: our own files, and those of others.

use std::collections::HashMap;

use reactsim::dynamics::Pose;
use reactsim::geometry::{Vec2, heading_of};
use reactsim::models::nn::Tensors;
use reactsim::models::nn::weights::Tables;
use safetensors::{Dtype, SafeTensors, tensor::TensorView};

use super::{Class, ORIGIN, Provenance, TOKEN_POSES, TokenPoses, Vocabulary, VocabularyError};

/// The entry of the metadata that says what the vocabulary was made of, as JSON. One entry, so that equal vocabularies are equal bytes.
const MADE: &str = "reactsim.vocabulary";
/// What the names of our tensors begin with.
pub(crate) const PREFIX: &str = "vocabulary.";
/// Names of our tensors `[tokens, 6, 3]`: x, y, heading.
const OWN: [&str; 3] = ["vocabulary.vehicle", "vocabulary.pedestrian", "vocabulary.cyclist"];
/// Names in files of poses that were taken from the releases of SMART and CATK, `[tokens, 6, 3]`.
const POSES: [&str; 3] = ["veh.poses", "ped.poses", "cyc.poses"];
/// Names in files of contours as CATK keeps them, `[tokens, 6, 4, 2]`: per pose the corners left front, right front, right back, left back.
const CONTOURS: [&str; 3] = ["agent_token_all_veh", "agent_token_all_ped", "agent_token_all_cyc"];

impl Vocabulary {
    /// Reads a vocabulary: our own files, and the foreign layouts of poses and of contours.
    ///
    /// # Errors
    /// [`VocabularyError`] that names tensor and value where the bytes are cut short, tensors are missing, of another type or shape, or
    /// tokens are not finite or do not start at the origin.
    pub fn read(bytes: &[u8]) -> Result<Self, VocabularyError> {
        let file = SafeTensors::deserialize(bytes)?;
        let (_, header) = SafeTensors::read_metadata(bytes)?;
        let mut names = file.names();
        names.sort_unstable();
        let has = |layout: &[&str; 3]| layout.iter().all(|name| names.contains(name));
        let foreign = Provenance { method: "foreign".to_owned(), ..Provenance::default() };
        if has(&POSES) {
            return Self::new(each(&file, &POSES, poses)?, foreign);
        }
        if has(&CONTOURS) {
            return Self::new(each(&file, &CONTOURS, contours)?, foreign);
        }
        // A file of another count of classes is not for us.
        let made = header.metadata().as_ref().and_then(|m| m.get(MADE));
        let Some(made) = made.filter(|_| names.len() == OWN.len() && has(&OWN)) else {
            return Err(VocabularyError::Layout { expected: listed(&OWN), found: listed(&names) });
        };
        let provenance = serde_json::from_str(made).map_err(VocabularyError::Provenance)?;
        Self::new(each(&file, &OWN, poses)?, provenance)
    }

    /// Reads a vocabulary that lies beside other tensors, as [`Self::tables`] gave it, with the text of its making.
    ///
    /// # Errors
    /// [`VocabularyError`], as [`Self::read`].
    pub fn from_tables(tensors: &Tensors<'_>) -> Result<Self, VocabularyError> {
        let found: Vec<&str> = tensors.shapes().map(|(name, _)| name).collect();
        let Some(made) = tensors.metadata().get(MADE).filter(|_| found.len() == OWN.len()) else {
            return Err(VocabularyError::Layout { expected: listed(&OWN), found: listed(&found) });
        };
        let provenance = serde_json::from_str(made).map_err(VocabularyError::Provenance)?;
        let table = |name: &'static str| {
            let (shape, values) = tensors.floats(name).map_err(|e| VocabularyError::Table(e.to_string()))?;
            if shape.len() != 3 || shape[1..] != [TOKEN_POSES, 3] {
                let (tensor, found) = (name.to_owned(), shape.to_vec());
                return Err(VocabularyError::Shape { tensor, found, expected: "[tokens, 6, 3]" });
            }
            let values: Vec<f64> = values.into_iter().map(f64::from).collect();
            let pose = |v: &[f64]| Pose { position: Vec2::new(v[0], v[1]), heading: v[2] };
            Ok(values.chunks_exact(TOKEN_POSES * 3).map(|token| token_of(token, 3, pose)).collect())
        };
        Self::new([table(OWN[0])?, table(OWN[1])?, table(OWN[2])?], provenance)
    }

    /// The tokens as tensors `[tokens, 6, 3]` by name, and the entry of metadata that says what they were made of: what lies beside the
    /// weights of a network that was trained with them.
    ///
    /// # Errors
    /// [`VocabularyError::Provenance`].
    pub fn tables(&self) -> Result<(Tables, (String, String)), VocabularyError> {
        let made = serde_json::to_string(self.provenance()).map_err(VocabularyError::Provenance)?;
        let tables = Class::ALL.into_iter().map(|class| {
            let tokens = (0..self.tokens(class)).flat_map(|t| self.poses(class, t));
            let values = tokens.flat_map(|p| [p.position.x, p.position.y, p.heading].map(|v| v as f32));
            let shape = vec![self.tokens(class), TOKEN_POSES, 3];
            (OWN[class.index()].to_owned(), (shape, values.collect()))
        });
        Ok((tables.collect(), (MADE.to_owned(), made)))
    }

    /// The bytes of a file that [`Self::read`] reads back as the same vocabulary.
    ///
    /// # Errors
    /// [`VocabularyError`] where the vocabulary is too large for such a file.
    pub fn write(&self) -> Result<Vec<u8>, VocabularyError> {
        let made = serde_json::to_string(self.provenance()).map_err(VocabularyError::Provenance)?;
        let data = Class::ALL.map(|class| {
            let tokens = (0..self.tokens(class)).flat_map(|t| self.poses(class, t));
            let values = tokens.flat_map(|p| [p.position.x, p.position.y, p.heading]);
            values.flat_map(|v| (v as f32).to_le_bytes()).collect::<Vec<u8>>()
        });
        let mut tensors = Vec::new();
        for (class, data) in Class::ALL.into_iter().zip(&data) {
            let shape = vec![self.tokens(class), TOKEN_POSES, 3];
            tensors.push((OWN[class.index()], TensorView::new(Dtype::F32, shape, data)?));
        }
        Ok(safetensors::serialize(tensors, Some(HashMap::from([(MADE.to_owned(), made)])))?)
    }
}

type Decode = fn(&str, &TensorView<'_>) -> Result<Vec<TokenPoses>, VocabularyError>;

/// The tokens of every class, from its tensor.
fn each(
    file: &SafeTensors<'_>,
    names: &[&str; 3],
    decode: Decode,
) -> Result<[Vec<TokenPoses>; 3], VocabularyError> {
    let tokens = |i: usize| decode(names[i], &file.tensor(names[i])?);
    Ok([tokens(0)?, tokens(1)?, tokens(2)?])
}

/// The tokens of a tensor of poses.
fn poses(name: &str, tensor: &TensorView<'_>) -> Result<Vec<TokenPoses>, VocabularyError> {
    let expected = "[tokens, 6, 3]";
    let values = values(name, tensor, &[TOKEN_POSES, 3], expected)?;
    let pose = |v: &[f64]| Pose { position: Vec2::new(v[0], v[1]), heading: v[2] };
    Ok(values.chunks_exact(TOKEN_POSES * 3).map(|token| token_of(token, 3, pose)).collect())
}

/// The tokens of a tensor of contours: the centre is the mean of the corners, the heading points from the left back to the left front one.
fn contours(name: &str, tensor: &TensorView<'_>) -> Result<Vec<TokenPoses>, VocabularyError> {
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

/// The poses of one token, from so many values each.
fn token_of(values: &[f64], each: usize, pose: impl Fn(&[f64]) -> Pose) -> TokenPoses {
    let mut poses = [ORIGIN; TOKEN_POSES];
    for (to, from) in poses.iter_mut().zip(values.chunks_exact(each)) {
        *to = pose(from);
    }
    poses
}

/// The values of a tensor of tokens, the dimensions after the first of which are given.
fn values(
    name: &str,
    tensor: &TensorView<'_>,
    inner: &[usize],
    expected: &'static str,
) -> Result<Vec<f64>, VocabularyError> {
    if tensor.dtype() != Dtype::F32 {
        return Err(VocabularyError::Type { tensor: name.to_owned(), found: tensor.dtype() });
    }
    let shape = tensor.shape();
    if shape.len() != inner.len() + 1 || shape[1..] != *inner {
        return Err(VocabularyError::Shape { tensor: name.to_owned(), found: shape.to_vec(), expected });
    }
    let number = |b: &[u8]| f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]]));
    Ok(tensor.data().chunks_exact(4).map(number).collect())
}

/// The first names of a list, as a message shows them.
fn listed(names: &[&str]) -> String {
    const SHOWN: usize = 8;
    let mut text = names.iter().take(SHOWN).map(|n| format!("`{n}`")).collect::<Vec<_>>().join(", ");
    if names.len() > SHOWN {
        text.push_str(&format!(" and {} more", names.len() - SHOWN));
    }
    if names.is_empty() { "none".to_owned() } else { text }
}
