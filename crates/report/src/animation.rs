//! Scenes and rollouts from above, as an animated GIF: for papers, talks and READMEs.
//!
//! Panels are side by side and show the same step of one scenario. They are drawn like the stills of
//! [`birdseye`](super::birdseye); a bar below each shows the time, with ticks at events. The animation
//! runs in real time, holds the last step for a second and repeats.
//!
//! Files stay small: all steps share one palette of few colours, nothing is dithered, and pixels that a step
//! leaves unchanged are transparent. The same input gives the same bytes.

mod camera;
mod picture;

use std::collections::{BTreeMap, HashMap};

use color_quant::NeuQuant;
use gif::{Encoder, Repeat};
use reactsim_scene::{Frame, Scenario};
use resvg::usvg;

use self::camera::Camera;
use self::picture::Stage;
use super::birdseye::{Mark, Scene, View};

/// Number of colours of an animation. Few colours give long runs of equal pixels, which compress well.
const COLOURS: usize = 127;
/// Palette index that leaves a pixel unchanged.
const TRANSPARENT: u8 = COLOURS as u8;
/// Display time of the last step, hundredths of a second.
const LAST_DELAY: u16 = 100;
/// Stride, in shown steps, of the samples for the palette. The last step, and steps at which a light
/// changes, are sampled too.
const PALETTE_STRIDE: usize = 8;

/// Content of one panel.
#[derive(Clone, Debug, Default)]
pub struct Panel<'a> {
    /// Title. Other than Latin letters are shown as `?`.
    pub title: String,
    /// Realised tracks: the frames of each agent, in the order of the scenario; the log without them.
    pub rollout: Option<&'a [Vec<Frame>]>,
    /// Events of the rollout. They are shown from their step on.
    pub marks: Vec<Mark>,
}

/// An animation of one scenario.
#[derive(Clone, Debug)]
pub struct Animation<'a> {
    /// The scenario.
    pub scenario: &'a Scenario,
    /// Panels side by side, four per row; if empty, the log.
    pub panels: Vec<Panel<'a>>,
    /// Half of the side of a panel, metres, at least 5. `None`: enough for the AV's whole path, or 40 m
    /// if the camera follows it.
    pub radius: Option<f64>,
    /// Side of a panel, pixels, 100 to 1200.
    pub size: u32,
    /// Stride between shown steps, at least 1. The last one is always shown.
    pub every: usize,
    /// Last shown step; larger ones than that of the scenario mean its last.
    pub until: usize,
    /// Whether the camera follows the AV. A fixed camera gives far smaller files.
    pub follow: bool,
}

/// A drawn step.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture {
    /// Width, pixels.
    pub width: usize,
    /// Height, pixels.
    pub height: usize,
    /// Red, green and blue of each pixel, row by row from the top.
    pub rgb: Vec<u8>,
}

/// Error of an animation.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum AnimationError {
    /// More pixels than the format can hold.
    #[error(
        "an animation of {width} x {height} pixels is too large: a side has at most 65535; \
         take smaller or fewer panels"
    )]
    TooLarge {
        /// Width, pixels.
        width: usize,
        /// Height, pixels.
        height: usize,
    },
    /// The renderer failed.
    #[error("step {step} of `{scenario}` could not be drawn")]
    Draw {
        /// The scenario.
        scenario: String,
        /// The step.
        step: usize,
        /// Error of the renderer.
        source: usvg::Error,
    },
    /// The encoder failed.
    #[error("the animation of `{scenario}` could not be encoded")]
    Encode {
        /// The scenario.
        scenario: String,
        /// Error of the encoder.
        source: gif::EncodingError,
    },
}

impl<'a> Animation<'a> {
    /// Creates an animation of these panels: every step, 480 pixels, a fixed camera.
    pub fn new(scenario: &'a Scenario, panels: Vec<Panel<'a>>) -> Self {
        let until = scenario.length().future;
        Self { scenario, panels, radius: None, size: 480, every: 1, until, follow: false }
    }

    /// Returns the shown steps, 0 to `until` or the last.
    fn steps(&self) -> Vec<usize> {
        let last = self.until.min(self.scenario.length().future);
        let mut steps: Vec<usize> = (0..last).step_by(self.every.max(1)).collect();
        steps.push(last);
        steps
    }

    /// Encodes the animation as a GIF.
    ///
    /// # Errors
    /// [`AnimationError`] for too many pixels, or if the renderer or the encoder fails.
    pub fn encode(&self) -> Result<Vec<u8>, AnimationError> {
        self.on_stage(|stage| self.encode_stage(stage))
    }

    /// Draws one step, 0 is the current frame; larger ones than the last step mean the last.
    ///
    /// # Errors
    /// [`AnimationError`] for too many pixels, or if the renderer fails.
    pub fn picture(&self, step: usize) -> Result<Picture, AnimationError> {
        self.on_stage(|stage| {
            let pixels = self.draw(stage, step.min(self.scenario.length().future))?;
            let rgb = pixels.into_iter().flat_map(|[red, green, blue, _]| [red, green, blue]).collect();
            Ok(Picture { width: stage.width(), height: stage.height(), rgb })
        })
    }

    /// Creates the stage with all panels for `work`.
    fn on_stage<T>(
        &self,
        work: impl FnOnce(&Stage<'_>) -> Result<T, AnimationError>,
    ) -> Result<T, AnimationError> {
        let log = [Panel { title: self.scenario.id.clone(), ..Panel::default() }];
        let panels = if self.panels.is_empty() { &log[..] } else { &self.panels };
        let size = self.size.clamp(100, 1200);
        let view = |p: &Panel<'a>| View { rollout: p.rollout, marks: p.marks.clone(), ..View::default() };
        let views: Vec<View<'_>> = panels.iter().map(view).collect();
        let scenes: Vec<Scene<'_>> = views.iter().map(|view| Scene::new(self.scenario, view)).collect();
        let camera = Camera::new(self, &scenes, f64::from(size));
        work(&Stage { panels, scenes, camera, size: size as usize })
    }

    /// Draws a step: pixels in row-major order (red, green, blue, alpha).
    fn draw(&self, stage: &Stage<'_>, step: usize) -> Result<Vec<[u8; 4]>, AnimationError> {
        let failed = |source| AnimationError::Draw { scenario: self.scenario.id.clone(), step, source };
        stage.draw(step).map_err(failed)
    }

    fn encode_stage(&self, stage: &Stage<'_>) -> Result<Vec<u8>, AnimationError> {
        let (width, height) = (stage.width(), stage.height());
        let (Ok(wide), Ok(high)) = (u16::try_from(width), u16::try_from(height)) else {
            return Err(AnimationError::TooLarge { width, height });
        };
        let steps = self.steps();
        let draw = |step: usize| self.draw(stage, step);
        let mut counts: BTreeMap<[u8; 4], u64> = BTreeMap::new();
        for (i, &step) in steps.iter().enumerate() {
            if i % PALETTE_STRIDE == 0
                || i + 1 == steps.len()
                || self.lights_change(i.checked_sub(1).map(|k| steps[k]), step)
            {
                draw(step)?.into_iter().for_each(|c| *counts.entry(c).or_default() += 1);
            }
        }
        // A colour weighs the square root of its pixels, so that small bright areas keep theirs.
        let sample = |(colour, count): (&[u8; 4], &u64)| colour.repeat(count.isqrt() as usize);
        let quantiser = NeuQuant::new(1, COLOURS, &counts.iter().flat_map(sample).collect::<Vec<u8>>());
        let mut known: HashMap<[u8; 4], u8> = HashMap::new();

        let failed = |source| AnimationError::Encode { scenario: self.scenario.id.clone(), source };
        let table = [quantiser.color_map_rgb(), vec![0; 3]].concat();
        let mut encoder = Encoder::new(Vec::new(), wide, high, &table).map_err(failed)?;
        encoder.set_repeat(Repeat::Infinite).map_err(failed)?;
        let mut before: Vec<[u8; 4]> = Vec::new();
        for (i, &step) in steps.iter().enumerate() {
            let after = draw(step)?;
            let mut index = |k: usize, pixel: &[u8; 4]| {
                if before.get(k) == Some(pixel) {
                    return TRANSPARENT;
                }
                *known.entry(*pixel).or_insert_with(|| quantiser.index_of(pixel) as u8)
            };
            let frame = gif::Frame {
                // Hundredths of a second: a step has ten.
                delay: steps.get(i + 1).map_or(LAST_DELAY, |next| 10 * (next - step) as u16),
                transparent: Some(TRANSPARENT),
                width: wide,
                height: high,
                buffer: after.iter().enumerate().map(|(k, pixel)| index(k, pixel)).collect(),
                ..gif::Frame::default()
            };
            encoder.write_frame(&frame).map_err(failed)?;
            before = after;
        }
        encoder.into_inner().map_err(failed)
    }

    /// Returns whether a light changes between an earlier step and this one.
    fn lights_change(&self, before: Option<usize>, step: usize) -> bool {
        let Some(before) = before else { return false };
        (0..self.scenario.start.lights.len()).any(|i| {
            let (states, now) = (self.scenario.light_states(i), self.scenario.start.current());
            states.get(now + before) != states.get(now + step)
        })
    }
}

#[cfg(test)]
mod tests;
