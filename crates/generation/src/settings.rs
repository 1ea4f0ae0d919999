//! Settings of the generator.

use reactsim_scene::{Length, named_enum};

use super::maps::{self, MAP_TYPES, MapType};
use super::traffic::Manner;

named_enum! {
    name, from_name;

    /// Intended use of generated scenarios. Each preset has its own seed space: its name is part of the key
    /// of every random stream and of every scenario id, so that presets never share a scenario.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum Preset {
        /// Benchmark scenarios: the AV drives and has others around it; all map types are equally frequent.
        Bench = "bench",
        /// Training scenarios: map types and traffic are about as frequent as in recordings.
        Train = "train",
        /// Training scenarios as the sensors of a vehicle record them, with the speed limits, accelerations
        /// and junctions of recordings.
        Sensed = "sensed",
    }
}

impl Preset {
    /// How drivers drive.
    pub(super) const fn manner(self) -> Manner {
        match self {
            Self::Bench | Self::Train => Manner::CALM,
            Self::Sensed => Manner::BRISK,
        }
    }
}

/// Settings that, together with its number, determine a generated scenario. Ids contain only preset, seed
/// and number, so sets with other maps, densities or lengths should use other seeds.
#[derive(Clone, Debug, PartialEq)]
pub struct GenerationSettings {
    /// Preset, which also selects the seed space.
    pub preset: Preset,
    /// Random seed.
    pub seed: u64,
    /// Ids of the map types to draw from; empty for all of [`MAP_TYPES`], weighted as the preset weights
    /// them.
    pub maps: Vec<String>,
    /// Traffic volume as a multiple of the usual one; `None` draws it per scenario, from nearly empty to
    /// congested.
    pub density: Option<f64>,
    /// Number of frames that are recorded.
    pub length: Length,
}

impl GenerationSettings {
    /// Returns the id of the scenario with this number. It keys the random streams of the scenario, so that
    /// presets never share one.
    pub fn id(&self, number: u64) -> String {
        format!("{}-{}-{number:06}", self.preset.name(), self.seed)
    }

    /// Returns the map types to draw from.
    pub fn map_types(&self) -> Vec<&'static MapType> {
        if self.maps.is_empty() {
            return MAP_TYPES.iter().collect();
        }
        maps::all().filter(|m| self.maps.iter().any(|name| name == m.id)).collect()
    }
}

impl Default for GenerationSettings {
    fn default() -> Self {
        Self { preset: Preset::Bench, seed: 0, maps: Vec::new(), density: None, length: Length::BENCHMARK }
    }
}
