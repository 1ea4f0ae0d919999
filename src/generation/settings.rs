//! What is generated.

use super::maps::{MAP_TYPES, MapType};

/// A use of generated scenarios. Each has its own space of seeds: the preset's name is part of the name of every random stream, and of
/// every scenario's id, so that no scenario of one can be a scenario of another.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Preset {
    /// Scenes in which the AV drives and has others around it, every map type alike: what the benchmark is made of.
    Bench,
    /// What networks train on: map types and traffic as often as in recordings.
    Train,
}

impl Preset {
    /// All presets.
    pub const ALL: [Self; 2] = [Self::Bench, Self::Train];

    /// The name, as on the command line and in ids.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Bench => "bench",
            Self::Train => "train",
        }
    }

    /// The preset with this name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|p| p.name() == name)
    }
}

/// What decides a generated scenario, besides its number. Ids hold preset, seed and number: sets of other maps or densities should have
/// other seeds.
#[derive(Clone, Debug, PartialEq)]
pub struct GenerationSettings {
    /// The use, and with it the space of seeds.
    pub preset: Preset,
    /// The seed.
    pub seed: u64,
    /// Ids of the map types to draw from; empty for all, as the preset weighs them.
    pub maps: Vec<String>,
    /// Traffic volume as a multiple of what is usual; `None` draws one per scenario, from empty to congested.
    pub density: Option<f64>,
}

impl GenerationSettings {
    /// Id of the scenario of a number. The random streams of the scenario are keyed by it, so that presets never share one.
    pub fn id(&self, number: u64) -> String {
        format!("{}-{}-{number:06}", self.preset.name(), self.seed)
    }

    /// The map types to draw from.
    pub fn map_types(&self) -> Vec<&'static MapType> {
        let allowed = |m: &&MapType| self.maps.is_empty() || self.maps.iter().any(|name| name == m.id);
        MAP_TYPES.iter().filter(allowed).collect()
    }
}

impl Default for GenerationSettings {
    fn default() -> Self {
        Self { preset: Preset::Bench, seed: 0, maps: Vec::new(), density: None }
    }
}
