//! Shapes of tokens.

use super::{InputError, SmartConfig};

/// Shapes of all tokens.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TokenShapes {
    /// Agent tokens for vehicles, pedestrians and cyclists: the corners of the class's box after 0.5 s,
    /// x and y of left front, right front, right back, left back, in m, in the frame of the preceding
    /// pose (x forward, y left).
    pub agents: [Vec<[f32; 8]>; 3],
    /// Map tokens: 11 points, x and y, in m, starting at 0, 0 along x.
    pub map: Vec<[f32; 22]>,
}

impl TokenShapes {
    /// Checks the numbers of tokens against a network with this configuration.
    ///
    /// # Errors
    /// [`InputError`] if one differs.
    pub fn check(&self, config: &SmartConfig) -> Result<(), InputError> {
        let counts = config.n_token_agent.of_classes();
        let [vehicles, pedestrians, cyclists] = [0, 1, 2].map(|c| (self.agents[c].len(), counts[c]));
        for (of, (found, expected)) in [
            ("vehicles", vehicles),
            ("pedestrians", pedestrians),
            ("cyclists", cyclists),
            ("the map", (self.map.len(), config.n_token_map)),
        ] {
            if found != expected {
                return Err(InputError(format!(
                    "the vocabulary has {found} tokens of {of}, expected {expected}: it does not belong to \
                     this network"
                )));
            }
        }
        Ok(())
    }
}
