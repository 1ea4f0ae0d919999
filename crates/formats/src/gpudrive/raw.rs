//! Fields of a GPUDrive file that are read; all others are skipped.

use std::collections::BTreeMap;
use std::fmt;

use reactsim_geometry::Vec2;
use serde::{Deserialize, Deserializer};

use crate::document::values::Number;

#[derive(Deserialize)]
#[serde(expecting = "an object")]
pub(super) struct RawScenario {
    pub(super) name: Option<String>,
    pub(super) scenario_id: Option<String>,
    pub(super) objects: Vec<RawObject>,
    pub(super) roads: Vec<RawRoad>,
    /// Lights by the id of the controlled lane.
    #[serde(default)]
    pub(super) tl_states: BTreeMap<String, RawLight>,
    /// Metadata; missing in old files.
    pub(super) metadata: Option<RawMetadata>,
}

impl RawScenario {
    /// Returns the scenario's id: that of Waymo, or in old files the name of the source record.
    pub(super) fn id(&self) -> Option<String> {
        let name = || Some(self.name.as_ref()?.trim_end_matches(".json").to_owned());
        self.scenario_id.clone().or_else(name).filter(|id| !id.is_empty())
    }
}

#[derive(Deserialize)]
#[serde(expecting = "an object")]
pub(super) struct RawMetadata {
    pub(super) sdc_track_index: Option<i64>,
    #[serde(default)]
    pub(super) objects_of_interest: Vec<Name>,
    #[serde(default)]
    pub(super) tracks_to_predict: Vec<RawPrediction>,
}

#[derive(Deserialize)]
#[serde(expecting = "an object")]
pub(super) struct RawPrediction {
    pub(super) track_index: i64,
}

#[derive(Deserialize)]
#[serde(expecting = "an object")]
pub(super) struct RawObject {
    pub(super) id: Option<Name>,
    #[serde(rename = "type")]
    pub(super) kind: String,
    #[serde(deserialize_with = "number")]
    pub(super) length: f64,
    #[serde(deserialize_with = "number")]
    pub(super) width: f64,
    pub(super) height: Option<f64>,
    pub(super) position: Vec<Point>,
    pub(super) velocity: Vec<Point>,
    #[serde(deserialize_with = "numbers")]
    pub(super) heading: Vec<f64>,
    pub(super) valid: Vec<bool>,
}

#[derive(Deserialize)]
#[serde(expecting = "an object")]
pub(super) struct RawRoad {
    pub(super) id: Option<Name>,
    pub(super) map_element_id: Option<i64>,
    #[serde(rename = "type")]
    pub(super) kind: String,
    pub(super) geometry: Vec<Point>,
}

/// Observations of a light: four lists with one entry per observation.
#[derive(Deserialize)]
#[serde(expecting = "an object")]
pub(super) struct RawLight {
    pub(super) state: Vec<String>,
    pub(super) x: Vec<f64>,
    pub(super) y: Vec<f64>,
    pub(super) time_index: Vec<i64>,
}

/// A point or a vector. Old files have no z.
#[derive(Clone, Copy, Deserialize)]
#[serde(expecting = "an object")]
pub(super) struct Point {
    #[serde(deserialize_with = "number")]
    pub(super) x: f64,
    #[serde(deserialize_with = "number")]
    pub(super) y: f64,
    pub(super) z: Option<f64>,
}

/// Reads a number. Null and NaN, which are unknown velocities, are NaN; elsewhere a scenario refuses them by
/// their place.
fn number<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    Number::deserialize(deserializer).map(Number::or_nan)
}

/// Reads numbers as [`number`] does.
fn numbers<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<f64>, D::Error> {
    Ok(Vec::<Number>::deserialize(deserializer)?.into_iter().map(Number::or_nan).collect())
}

impl From<Point> for Vec2 {
    fn from(p: Point) -> Self {
        Self::new(p.x, p.y)
    }
}

/// An id: a number in files of GPUDrive and Nocturne, a text in some files edited by other programs.
#[derive(Clone, Deserialize)]
#[serde(untagged)]
pub(super) enum Name {
    Number(i64),
    Text(String),
}

impl fmt::Display for Name {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Number(n) => n.fmt(f),
            Self::Text(t) => t.fmt(f),
        }
    }
}
