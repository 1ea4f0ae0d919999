//! Intention points: positions that agents may reach within eight seconds, one per motion query.

use reactsim_geometry::Vec2;
use serde_json::json;

use super::Provenance;
use crate::perception::Class;
use crate::{
    Tensors, WeightsError,
    weights::{Tables, save_tables},
};

/// Prefix of the tensor names.
pub const PREFIX: &str = "intention_points.";
/// Metadata key of the provenance of the points, as JSON.
const PROVENANCE_KEY: &str = "reactsim.intentions";

/// Points per class, metres, in the current frame of the agent; every class has the same number.
#[derive(Clone, Debug, PartialEq)]
pub struct Intentions {
    points: [Vec<Vec2>; 3],
    provenance: Provenance,
}

impl Intentions {
    /// Creates a set from the points of the classes in the order of [`Class::ALL`] and their
    /// provenance.
    ///
    /// # Errors
    /// [`WeightsError`] if classes differ in number or have no points.
    pub fn new(points: [Vec<Vec2>; 3], provenance: Provenance) -> Result<Self, WeightsError> {
        let found = [points[0].len(), points[1].len(), points[2].len()];
        if found[0] != found[1] || found[0] != found[2] {
            return Err(WeightsError::Refused(format!(
                "found {found:?} intention points of vehicles, pedestrians and cyclists, expected equal \
                 numbers"
            )));
        }
        if !(1..=4096).contains(&found[0]) {
            let name = format!("{PREFIX}{}", Class::Vehicle);
            return Err(wrong_shape(&name, &[found[0], 2]));
        }
        Ok(Self { points, provenance })
    }

    /// Returns sixteen points per class that need no data: straight on at usual speeds, turns,
    /// standstill.
    pub fn fan() -> Self {
        let class = |straight: &[f64], aside: &[(f64, f64)]| {
            let pairs = aside.iter().flat_map(|&(x, y)| [Vec2::new(x, y), Vec2::new(x, -y)]);
            straight.iter().map(|&x| Vec2::new(x, 0.0)).chain(pairs).collect::<Vec<_>>()
        };
        let vehicle = class(
            &[0.0, 10.0, 25.0, 42.0, 62.0, 85.0, 115.0, 160.0],
            &[(14.0, 14.0), (28.0, 34.0), (50.0, 9.0), (-2.0, 10.0)],
        );
        let pedestrian = class(
            &[0.0, 4.0, 8.0, 11.0, 15.0, 24.0],
            &[(9.0, 3.5), (6.0, 8.0), (0.0, 6.0), (-6.0, 5.0), (2.0, 2.5)],
        );
        let cyclist = class(
            &[0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 65.0, 85.0],
            &[(12.0, 12.0), (30.0, 6.0), (24.0, 24.0), (45.0, 10.0)],
        );
        let provenance = Provenance { method: "fan".to_owned(), ..Provenance::default() };
        Self { points: [vehicle, pedestrian, cyclist], provenance }
    }

    /// Returns the points of a class.
    pub fn of(&self, class: Class) -> &[Vec2] {
        &self.points[class.index()]
    }

    /// Returns the number of points per class.
    pub fn count(&self) -> usize {
        self.points[0].len()
    }

    /// Returns the provenance of the points.
    pub fn provenance(&self) -> &Provenance {
        &self.provenance
    }

    /// Returns the index of the point of a class that is nearest to `p`; of equally near ones the
    /// first.
    pub fn nearest(&self, class: Class, p: Vec2) -> usize {
        nearest(self.of(class), p)
    }

    /// Reads a file.
    ///
    /// # Errors
    /// [`WeightsError`], which names the tensor.
    pub fn read(bytes: &[u8]) -> Result<Self, WeightsError> {
        Self::from_tables(&Tensors::read(bytes)?)
    }

    /// Reads the points stored with weights. Points without provenance count as foreign.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn from_tables(tensors: &Tensors<'_>) -> Result<Self, WeightsError> {
        let provenance = Provenance::of(tensors, PROVENANCE_KEY)?.unwrap_or_else(Provenance::foreign);
        let mut points: [Vec<Vec2>; 3] = Default::default();
        for class in Class::ALL {
            let name = format!("{PREFIX}{class}");
            let (shape, values) = tensors.floats(&name)?;
            if shape.len() != 2 || shape[1] != 2 || !(1..=4096).contains(&shape[0]) {
                return Err(wrong_shape(&name, shape));
            }
            let point = |p: &[f32; 2]| Vec2::new(f64::from(p[0]), f64::from(p[1]));
            points[class.index()] = values.as_chunks::<2>().0.iter().map(point).collect();
        }
        Self::new(points, provenance)
    }

    /// Returns the points as tensors `[points, 2]` by name, and the metadata entry of their provenance.
    ///
    /// # Errors
    /// [`WeightsError`] if the provenance cannot be written as text.
    pub fn tables(&self) -> Result<(Tables, (String, String)), WeightsError> {
        let table = |class: Class| {
            let values = self.of(class).iter().flat_map(|p| [p.x as f32, p.y as f32]).collect();
            (format!("{PREFIX}{class}"), (vec![self.count(), 2], values))
        };
        Ok((Class::ALL.into_iter().map(table).collect(), self.provenance.entry(PROVENANCE_KEY)?))
    }

    /// Describes the points and how they were made, for the provenance of a training.
    pub fn describe(&self) -> serde_json::Value {
        let points: Vec<[f64; 2]> = self.points.iter().flatten().map(|p| [p.x, p.y]).collect();
        json!({ "made": self.provenance, "points": points })
    }

    /// Returns the bytes of a file.
    ///
    /// # Errors
    /// [`WeightsError`] if the provenance cannot be written as text.
    pub fn write(&self) -> Result<Vec<u8>, WeightsError> {
        let (tables, entry) = self.tables()?;
        Ok(save_tables(&tables, &[entry].into()))
    }
}

/// Returns the index of the point that is nearest to `p`; of equally near ones the first.
pub(super) fn nearest(points: &[Vec2], p: Vec2) -> usize {
    let far = points.iter().map(|point| (point - p).norm_squared()).enumerate();
    far.min_by(|a, b| a.1.total_cmp(&b.1)).map_or(0, |(index, _)| index)
}

fn wrong_shape(tensor: &str, found: &[usize]) -> WeightsError {
    WeightsError::Refused(format!(
        "tensor `{tensor}` has the shape {found:?}, expected [points, 2] with 1 to 4096 points"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_read_back() {
        let fan = Intentions::fan();
        assert_eq!(fan.count(), 16);
        assert_eq!(Intentions::read(&fan.write().unwrap()).unwrap(), fan);
    }

    #[test]
    fn invalid_points_are_refused_by_name() {
        let bytes = Intentions::fan().write().unwrap();
        assert!(Intentions::read(&bytes[..40]).is_err());
        let uneven =
            Intentions::new([vec![Vec2::zeros(); 3], vec![Vec2::zeros(); 2], vec![]], Provenance::default());
        assert!(uneven.unwrap_err().to_string().contains("[3, 2, 0]"));
        let none = Intentions::new(Default::default(), Provenance::default());
        assert!(none.unwrap_err().to_string().contains("1 to 4096"));
        let tables = Tables::from([("intention_points.vehicle".to_owned(), (vec![2, 3], vec![0.0; 6]))]);
        let text = Intentions::read(&save_tables(&tables, &Default::default())).unwrap_err().to_string();
        assert!(text.contains("`intention_points.vehicle`") && text.contains("[2, 3]"), "{text}");
    }

    #[test]
    fn the_nearest_point_is_found() {
        let fan = Intentions::fan();
        assert_eq!(fan.nearest(Class::Vehicle, Vec2::new(41.0, 1.0)), 3);
        assert_eq!(fan.nearest(Class::Pedestrian, Vec2::zeros()), 0);
    }
}
