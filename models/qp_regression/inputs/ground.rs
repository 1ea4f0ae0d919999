//! What is known of a map: lines that are shown, and lanes that lead on.

use reactsim::geometry::Vec2;
use reactsim::scene::Start;

use super::Lines;
use crate::models::learning::LearningMap;
use crate::models::ntp::reactive::known_map::KnownMap;
use crate::models::ntp::reactive::places::Places;
use crate::models::qp_regression::network::Config;

/// A map that can still be mirrored and stretched.
#[derive(Clone, Debug)]
pub(crate) struct Survey {
    lines: Lines,
    /// Where an outlook is shown.
    known: Option<KnownMap>,
}

/// What the network is told of a map: made once per episode.
#[derive(Clone, Debug)]
pub struct Ground {
    /// The lines that are shown.
    pub(super) lines: Lines,
    /// Lanes and stops, where an outlook is shown.
    pub(super) places: Option<Places>,
}

impl Survey {
    /// The map of a scenario, within reach of where the AV is at the current frame.
    pub(crate) fn of(start: &Start, config: &Config) -> Self {
        let known = config.outlook.then(|| KnownMap::of(start, config.radius));
        Self { lines: Lines::of(start, config), known }
    }

    /// Ready to be looked at.
    pub(crate) fn ground(self) -> Ground {
        Ground { lines: self.lines, places: self.known.as_ref().map(Places::unlinked) }
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
