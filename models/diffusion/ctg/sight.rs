//! Limits of the network's input.

use reactsim_nn::SizeError;
use reactsim_scene::CURRENT;
use serde::{Deserialize, Serialize};

/// Number of layers of the map in an image: drivable area, centre lines, crosswalks.
pub(super) const MAP_LAYERS: usize = 3;

/// Limits of the network's input; stored with the weights.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sight {
    /// Pixels along an edge of an image; a multiple of 16.
    pub pixels: usize,
    /// Edge of a pixel, metres.
    pub pixel: f64,
    /// Number of frames of the history, spread over one second.
    pub frames: usize,
    /// Half of the edge of the square around the AV's position at the current frame in which the map is
    /// known, metres.
    pub radius: f64,
}

impl Default for Sight {
    /// Returns sizes for two processor cores.
    fn default() -> Self {
        Self { pixels: 64, pixel: 1.0, frames: 5, radius: 100.0 }
    }
}

impl Sight {
    /// Checks the sizes.
    ///
    /// # Errors
    /// [`SizeError`], which names the field.
    pub(super) fn check(&self) -> Result<(), SizeError> {
        let refuse = |field, value, expected| Err(SizeError { field, value, expected });
        if !(16..=512).contains(&self.pixels) || !self.pixels.is_multiple_of(16) {
            return refuse("pixels", self.pixels as f64, "a multiple of 16, up to 512");
        }
        if !(1..=11).contains(&self.frames) {
            return refuse("frames", self.frames as f64, "1 to 11");
        }
        if !(0.05..=10.0).contains(&self.pixel) {
            return refuse("pixel", self.pixel, "metres, from 0.05 to 10");
        }
        if !(1.0..=500.0).contains(&self.radius) {
            return refuse("radius", self.radius, "metres, from 1 to 500");
        }
        Ok(())
    }

    /// Returns the number of channels of an image.
    pub(crate) const fn channels(&self) -> usize {
        self.frames + MAP_LAYERS
    }

    /// Returns how many frames ago each frame of the history is, the latest first: they are spread over the
    /// whole history.
    pub(super) fn history(&self) -> impl Iterator<Item = usize> + use<> {
        let last = self.frames.saturating_sub(1).max(1);
        (0..self.frames).map(move |k| (k * CURRENT + last / 2) / last)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn histories_end_at_both_ends() {
        let of = |frames| Sight { frames, ..Sight::default() }.history().collect::<Vec<_>>();
        assert_eq!(of(1), [0]);
        assert_eq!(of(2), [0, 10]);
        assert_eq!(of(5), [0, 3, 5, 8, 10]);
        assert_eq!(of(11), (0..=10).collect::<Vec<_>>());
    }
}
