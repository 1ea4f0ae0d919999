//! Map vocabulary: curves of 5 m, the nearest of which represents a piece of a line.

use std::collections::HashMap;

use rand::RngExt;
use reactsim_geometry::{Vec2, direction, into_frame};
use reactsim_nn::learning::{Provenance, Reservoir};
use reactsim_nn::{Tensors, WeightsError, weights::Tables};
use reactsim_rollout::{Purpose, stream};
use reactsim_scene::Scenario;
use safetensors::tensor::TensorView;
use safetensors::{Dtype, SafeTensors};

use super::file::{damaged_provenance, incomplete, no_vocabulary, refused, wrong_shape, wrong_type};
use super::{CURVE_POINTS, CurvePiece, curve_pieces};

/// Curve of a token: eleven points in the frame of the first, with the first chord along x.
type Curve = [Vec2; CURVE_POINTS];

/// Curves that represent pieces of the map.
#[derive(Clone, Debug, PartialEq)]
pub struct MapVocabulary {
    curves: Vec<Curve>,
    provenance: Provenance,
}

/// Key of the metadata entry that holds the provenance, as JSON.
const PROVENANCE_KEY: &str = "reactsim.map_vocabulary";
/// Prefix of the name of the native tensor.
pub(crate) const MAP_PREFIX: &str = "map_vocabulary.";
/// Name of the native tensor, `[tokens, 11, 2]`.
const NATIVE_TENSOR: &str = "map_vocabulary.curves";
/// Names of the tensors of SMART, `[tokens, 11, 2]`, and CATK, `[tokens, 22]`.
const FOREIGN_TENSORS: [&str; 2] = ["traj_src", "map_token_traj_src"];

impl MapVocabulary {
    /// Builds a vocabulary of these curves, rounded to the 32 bits of files.
    ///
    /// # Errors
    /// [`WeightsError`] if there are none, or a coordinate is not finite.
    pub fn new(curves: &[Curve], provenance: Provenance) -> Result<Self, WeightsError> {
        if curves.is_empty() {
            return Err(refused("the map vocabulary has no curves; give scenarios with maps".to_owned()));
        }
        for (token, curve) in curves.iter().enumerate() {
            if let Some(p) = curve.iter().find(|p| !(p.x.is_finite() && p.y.is_finite())) {
                let value = [p.x, p.y];
                return Err(refused(format!(
                    "curve {token} of the map vocabulary: {value:?} (x, y) is not finite"
                )));
            }
        }
        let round = |v: f64| f64::from(v as f32);
        Ok(Self { curves: curves.iter().map(|c| c.map(|p| p.map(round))).collect(), provenance })
    }

    /// Returns its provenance.
    pub fn provenance(&self) -> &Provenance {
        &self.provenance
    }

    /// Returns the number of tokens; at least one.
    pub fn tokens(&self) -> usize {
        self.curves.len()
    }

    /// Returns the curve of a token, metres.
    pub fn curve(&self, token: usize) -> &[Vec2; CURVE_POINTS] {
        &self.curves[token]
    }

    /// Returns the token whose first, middle and last point are nearest to those of a piece, by the sum
    /// of squares; the first of equally near ones.
    pub fn nearest(&self, piece: &CurvePiece) -> usize {
        self.nearest_to(piece.samples(), piece.heading())
    }

    /// Like [`Self::nearest`], for a piece given by its start, middle and end, and the heading at its
    /// start.
    pub fn nearest_to(&self, points: [Vec2; 3], heading: f64) -> usize {
        let ahead = direction(heading);
        let local = |p: Vec2| into_frame(ahead, p - points[0]);
        let (middle, end) = (local(points[1]), local(points[2]));
        let mut best = (f64::INFINITY, 0);
        for (token, curve) in self.curves.iter().enumerate() {
            let far = curve[0].norm_squared()
                + (curve[CURVE_POINTS / 2] - middle).norm_squared()
                + (curve[CURVE_POINTS - 1] - end).norm_squared();
            if far < best.0 {
                best = (far, token);
            }
        }
        best.1
    }

    /// Reads a vocabulary: native files, and those of SMART and CATK.
    ///
    /// # Errors
    /// [`WeightsError`] naming tensor and value.
    pub fn read(bytes: &[u8]) -> Result<Self, WeightsError> {
        let file = SafeTensors::deserialize(bytes).map_err(incomplete)?;
        let (_, header) = SafeTensors::read_metadata(bytes).map_err(incomplete)?;
        let names = file.names();
        let Some(name) =
            [NATIVE_TENSOR, FOREIGN_TENSORS[0], FOREIGN_TENSORS[1]].into_iter().find(|n| names.contains(n))
        else {
            let mut found: Vec<_> = names.iter().map(|n| format!("`{n}`")).collect();
            found.sort_unstable();
            found.truncate(8);
            return Err(no_vocabulary(&format!("`{NATIVE_TENSOR}`"), &found.join(", ")));
        };
        let tensor = file.tensor(name).map_err(incomplete)?;
        if tensor.dtype() != Dtype::F32 {
            return Err(wrong_type(name, tensor.dtype()));
        }
        let shape = tensor.shape();
        let number = |b: &[u8]| f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]]));
        let values: Vec<f64> = tensor.data().chunks_exact(4).map(number).collect();
        let made = header.metadata().as_ref().and_then(|m| m.get(PROVENANCE_KEY));
        Self::new(&curves(name, shape, &values)?, provenance(made)?)
    }

    /// Reads a vocabulary from a file that also holds other tensors: the tensor of [`Self::tables`], and
    /// the provenance in the metadata, without which it counts as foreign.
    ///
    /// # Errors
    /// [`WeightsError`], as [`Self::read`].
    pub fn from_tables(tensors: &Tensors<'_>) -> Result<Self, WeightsError> {
        let found: Vec<&str> = tensors.shapes().map(|(name, _)| name).collect();
        if found != [NATIVE_TENSOR] {
            return Err(no_vocabulary(&format!("`{NATIVE_TENSOR}`"), &found.join(", ")));
        }
        let (shape, values) = tensors.floats(NATIVE_TENSOR)?;
        let values: Vec<f64> = values.into_iter().map(f64::from).collect();
        Self::new(
            &curves(NATIVE_TENSOR, shape, &values)?,
            provenance(tensors.metadata().get(PROVENANCE_KEY))?,
        )
    }

    /// Returns the curves as a tensor `[tokens, 11, 2]` by name, and the metadata entry with their
    /// provenance. Both are stored with the weights of a network trained with them.
    ///
    /// # Errors
    /// [`WeightsError`] if the provenance cannot be written as text.
    pub fn tables(&self) -> Result<(Tables, (String, String)), WeightsError> {
        let made = serde_json::to_string(&self.provenance).map_err(damaged_provenance)?;
        let values = self.curves.iter().flatten().flat_map(|p| [p.x as f32, p.y as f32]).collect();
        let table = (vec![self.curves.len(), CURVE_POINTS, 2], values);
        Ok((Tables::from([(NATIVE_TENSOR.to_owned(), table)]), (PROVENANCE_KEY.to_owned(), made)))
    }

    /// Returns the bytes of a file that [`Self::read`] reads back as the same vocabulary.
    ///
    /// # Errors
    /// [`WeightsError`] if the vocabulary is too large for such a file.
    pub fn write(&self) -> Result<Vec<u8>, WeightsError> {
        let made = serde_json::to_string(&self.provenance).map_err(damaged_provenance)?;
        let values = self.curves.iter().flatten().flat_map(|p| [p.x, p.y]);
        let data: Vec<u8> = values.flat_map(|v| (v as f32).to_le_bytes()).collect();
        let view = TensorView::new(Dtype::F32, vec![self.curves.len(), CURVE_POINTS, 2], &data)
            .map_err(incomplete)?;
        let metadata = HashMap::from([(PROVENANCE_KEY.to_owned(), made)]);
        safetensors::serialize([(NATIVE_TENSOR, view)], Some(metadata)).map_err(incomplete)
    }
}

/// Decodes the curves of a tensor.
fn curves(name: &str, shape: &[usize], values: &[f64]) -> Result<Vec<Curve>, WeightsError> {
    let fits = match shape {
        [_, points, 2] => *points == CURVE_POINTS,
        [_, values] => *values == 2 * CURVE_POINTS,
        _ => false,
    };
    if !fits {
        return Err(wrong_shape(name, shape, "[tokens, 11, 2] or [tokens, 22]"));
    }
    let curve = |v: &[f64]| std::array::from_fn(|i| Vec2::new(v[2 * i], v[2 * i + 1]));
    Ok(values.chunks_exact(2 * CURVE_POINTS).map(curve).collect())
}

/// Parses the provenance of a file.
fn provenance(made: Option<&String>) -> Result<Provenance, WeightsError> {
    match made {
        Some(made) => serde_json::from_str(made).map_err(damaged_provenance),
        None => Ok(Provenance { method: "foreign".to_owned(), ..Provenance::default() }),
    }
}

/// Builder of a map vocabulary by k-disks on the curves of pieces: it repeatedly draws one, makes the
/// mean of all near it a token, and removes them.
#[derive(Debug)]
pub struct MapVocabularyBuilder {
    sample: Reservoir<Curve>,
    seed: u64,
    scenarios: u64,
    digest: blake3::Hasher,
}

/// Resolution of coordinates at which curves count as the same, metres.
const CURVE_RESOLUTION: f64 = 1.0 / 128.0;

impl MapVocabularyBuilder {
    /// Builds an empty sample that keeps at most `most` curves.
    pub fn new(most: usize, seed: u64) -> Self {
        Self {
            sample: Reservoir::new(most, seed, "vocabulary/map"),
            seed,
            scenarios: 0,
            digest: blake3::Hasher::new(),
        }
    }

    /// Adds the pieces of a scenario's map.
    pub fn add(&mut self, scenario: &Scenario) {
        self.scenarios += 1;
        self.digest.update(scenario.digest().as_bytes());
        for piece in curve_pieces(&scenario.start) {
            let curve = piece.curve();
            let values = curve.into_iter().flat_map(|p| [p.x, p.y]);
            self.sample.add(curve, values, CURVE_RESOLUTION);
        }
    }

    /// Builds a vocabulary of at most `tokens` curves. Two pieces are near if the mean distance of their
    /// middle and end points is at most `tolerance` metres.
    ///
    /// # Errors
    /// [`WeightsError`] if no scenario had a map.
    pub fn build(&self, tokens: usize, tolerance: f64) -> Result<MapVocabulary, WeightsError> {
        // NaN and negative tolerances would remove nothing.
        let tolerance = tolerance.max(0.0);
        let mut left = self.sample.kept.clone();
        let mut stream = stream(self.seed, "vocabulary/map/k-disks", 0, Purpose::Begin);
        let mut curves = Vec::new();
        while curves.len() < tokens && !left.is_empty() {
            let drawn = left[stream.random_range(0..left.len())];
            let mut near: (Curve, f64) = ([Vec2::zeros(); CURVE_POINTS], 0.0);
            let apart = |c: &Curve, i: usize| (c[i] - drawn[i]).norm();
            left.retain(|curve| {
                let far = 0.5 * (apart(curve, CURVE_POINTS / 2) + apart(curve, CURVE_POINTS - 1)) > tolerance;
                if !far {
                    near.0.iter_mut().zip(curve).for_each(|(sum, p)| *sum += p);
                    near.1 += 1.0;
                }
                far
            });
            curves.push(near.0.map(|sum| sum / near.1));
        }
        let provenance = Provenance {
            method: "k-disks".to_owned(),
            settings: serde_json::json!({ "tokens": tokens, "tolerance": tolerance }),
            seed: self.seed,
            scenarios: self.scenarios,
            data: if self.scenarios == 0 {
                String::new()
            } else {
                self.digest.finalize().to_hex().to_string()
            },
        };
        MapVocabulary::new(&curves, provenance)
    }
}
