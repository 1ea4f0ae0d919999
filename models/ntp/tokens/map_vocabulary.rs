//! Map vocabulary: curves of 5 m, the nearest of which represents a piece of a line.

use rand::RngExt;
use reactsim_geometry::{Vec2, direction, into_frame};
use reactsim_nn::learning::{Provenance, Reservoir, ScenarioDigest};
use reactsim_nn::weights::{Tables, save_tables};
use reactsim_nn::{Tensors, WeightsError};
use reactsim_rollout::{Purpose, stream};
use reactsim_scene::Scenario;

use super::file::{no_vocabulary, wrong_shape};
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
/// Names of the native tensor and that of SMART, `[tokens, 11, 2]`, and of that of CATK, `[tokens, 22]`.
const TENSORS: [&str; 3] = ["map_vocabulary.curves", "traj_src", "map_token_traj_src"];

impl MapVocabulary {
    /// Builds a vocabulary of these curves, rounded to the 32 bits of files.
    ///
    /// # Errors
    /// [`WeightsError`] if there are none, or a coordinate is not finite.
    pub fn new(curves: &[Curve], provenance: Provenance) -> Result<Self, WeightsError> {
        if curves.is_empty() {
            return Err(WeightsError::Refused(
                "the map vocabulary has no curves; give scenarios with maps".to_owned(),
            ));
        }
        for (token, curve) in curves.iter().enumerate() {
            if let Some(p) = curve.iter().find(|p| !(p.x.is_finite() && p.y.is_finite())) {
                let value = [p.x, p.y];
                return Err(WeightsError::Refused(format!(
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
        Self::from_tables(&Tensors::read(bytes)?)
    }

    /// Reads a vocabulary from a file that also holds other tensors: the tensor of [`Self::tables`], and
    /// the provenance in the metadata, without which it counts as foreign.
    ///
    /// # Errors
    /// [`WeightsError`], as [`Self::read`].
    pub fn from_tables(file: &Tensors<'_>) -> Result<Self, WeightsError> {
        let found: Vec<&str> = file.shapes().map(|(name, _)| name).collect();
        let Some(name) = TENSORS.into_iter().find(|name| found.contains(name)) else {
            return Err(no_vocabulary(&TENSORS[..1], &found));
        };
        let (shape, values) = file.floats(name)?;
        let values: Vec<f64> = values.into_iter().map(f64::from).collect();
        let provenance = Provenance::of(file, PROVENANCE_KEY)?.unwrap_or_else(Provenance::foreign);
        Self::new(&curves(name, shape, &values)?, provenance)
    }

    /// Returns the curves as a tensor `[tokens, 11, 2]` by name, and the metadata entry with their
    /// provenance. Both are stored with the weights of a network trained with them.
    ///
    /// # Errors
    /// [`WeightsError`] if the provenance cannot be written as text.
    pub fn tables(&self) -> Result<(Tables, (String, String)), WeightsError> {
        let values = self.curves.iter().flatten().flat_map(|p| [p.x as f32, p.y as f32]).collect();
        let table = (vec![self.curves.len(), CURVE_POINTS, 2], values);
        Ok((Tables::from([(TENSORS[0].to_owned(), table)]), self.provenance.entry(PROVENANCE_KEY)?))
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

/// Builder of a map vocabulary by k-disks on the curves of pieces: it repeatedly draws one, makes the
/// mean of all near it a token, and removes them.
#[derive(Debug)]
pub struct MapVocabularyBuilder {
    sample: Reservoir<Curve>,
    seed: u64,
    scenarios: ScenarioDigest,
}

/// Resolution of coordinates at which curves count as the same, metres.
const CURVE_RESOLUTION: f64 = 1.0 / 128.0;

impl MapVocabularyBuilder {
    /// Builds an empty sample that keeps at most `most` curves.
    pub fn new(most: usize, seed: u64) -> Self {
        Self {
            sample: Reservoir::new(most, seed, "vocabulary/map"),
            seed,
            scenarios: ScenarioDigest::default(),
        }
    }

    /// Adds the pieces of a scenario's map.
    pub fn add(&mut self, scenario: &Scenario) {
        self.scenarios.add(scenario);
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
        let settings = serde_json::json!({ "tokens": tokens, "tolerance": tolerance });
        MapVocabulary::new(&curves, self.scenarios.provenance("k-disks", settings, self.seed))
    }
}
