//! Knowledge about the deviation of an AV.

use reactsim_scene::{Certificate, DeviatedTrack, Deviation, Difficulty};

/// The properties of a deviated AV apart from its trajectory; empty for other AVs.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DeviationLabels {
    /// Dominant source of the deviation.
    pub category: Option<Deviation>,
    /// Responses with which every affected agent can avoid it.
    pub certificate: Option<Certificate>,
}

impl DeviationLabels {
    /// Returns the properties of a deviated trajectory. A certificate without efforts is dropped: files of
    /// that age do not record which responses answer the AV and which answer other responses, so reactions
    /// cannot be evaluated.
    pub fn of(deviated: &DeviatedTrack) -> Self {
        let certificate = deviated.certificate.clone().filter(|c| c.difficulty().is_some());
        Self { category: deviated.category, certificate }
    }

    /// Returns the difficulty of avoiding the AV, if known.
    pub fn difficulty(&self) -> Option<Difficulty> {
        self.certificate.as_ref()?.difficulty()
    }
}
