//! Map features: lines in the input, and lanes that lead on.

use reactsim_geometry::Vec2;
use reactsim_nn::learning::LearningMap;
use reactsim_nn::perception::{KnownMap, Places};
use reactsim_scene::Start;

use super::Lines;
use crate::regression::network::Config;

/// Map features that can still be mirrored and stretched.
#[derive(Clone, Debug)]
pub(crate) struct Survey {
    lines: Lines,
    /// Lane graph, if the configuration has an outlook.
    known: Option<KnownMap>,
}

/// Map features of the network, the same for a whole episode.
#[derive(Clone, Debug)]
pub(crate) struct MapFeatures {
    /// Lines of the map.
    pub(super) lines: Lines,
    /// Lanes and stop lines, if the configuration has an outlook.
    pub(super) places: Option<Places>,
}

impl Survey {
    /// Extracts the map of a scenario within the radius around the AV's position at the current frame.
    pub(crate) fn of(start: &Start, config: &Config) -> Self {
        let known = config.outlook.then(|| KnownMap::of(start, config.radius));
        Self { lines: Lines::of(start, config), known }
    }

    /// Converts to map features.
    pub(crate) fn features(self) -> MapFeatures {
        MapFeatures { lines: self.lines, places: self.known.as_ref().map(Places::of) }
    }
}

impl LearningMap for Survey {
    fn mirror(&mut self, flip: fn(Vec2) -> Vec2) {
        self.lines.mirror(flip);
        if let Some(known) = &mut self.known {
            known.mirror(flip);
        }
    }

    fn stretch(&mut self, factor: f64) {
        self.lines.stretch(factor);
        if let Some(known) = &mut self.known {
            known.stretch(factor);
        }
    }
}
