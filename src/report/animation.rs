//! Scenes and rollouts from above, as an animated GIF: for papers, talks and READMEs.
//!
//! Panels stand side by side and show the same moment of one scenario. They are drawn as [`birdseye`](super::birdseye) draws stills, and a
//! bar below each tells the time, with ticks where events are. Time runs as it does in the world; the last moment is held for a second,
//! then it begins again.
//!
//! Files stay small: one palette of few colours serves all moments, nothing is dithered, and of each moment only the rectangle that
//! changed is written, in it only the pixels that did. The same input gives the same bytes.

mod camera;
mod difference;
mod letters;
mod palette;
mod picture;

use std::collections::BTreeMap;

use gif::{DisposalMethod, Encoder, Repeat};
use resvg::usvg;

use self::camera::Camera;
use self::difference::change;
use self::palette::{Colour, Palette};
use self::picture::Stage;
use super::birdseye::{Mark, View, moving::Moving};
use crate::scene::{CURRENT, FUTURE, Frame, Scenario};

/// Colours of an animation, beside the transparent one. Few make long runs of equal pixels.
const COLOURS: usize = 95;
/// How long the last moment is held, hundredths of a second.
const HELD: u16 = 100;
/// The palette is made from every so manieth moment, the last one, and those at which a light changes.
const SAMPLED: usize = 8;

/// What one panel shows.
#[derive(Clone, Debug, Default)]
pub struct Panel<'a> {
    /// What stands above it: Latin letters, digits and a few signs can be shown, all small.
    pub title: String,
    /// Realised tracks: per agent (order of the scenario) 91 frames. Without them the log is shown.
    pub rollout: Option<&'a [Vec<Frame>]>,
    /// Events of the rollout. They appear at their step and stay.
    pub marks: Vec<Mark>,
}

/// An animation of one scenario.
#[derive(Clone, Debug)]
pub struct Animation<'a> {
    /// The scenario.
    pub scenario: &'a Scenario,
    /// What is shown side by side, four to a row; without any, the log.
    pub panels: Vec<Panel<'a>>,
    /// Half of the side of a panel, metres, at least 5; `None`: as much as the AV's whole way needs, or 40 m where the camera follows it.
    pub radius: Option<f64>,
    /// Side of a panel, pixels, 100 to 1200.
    pub size: u32,
    /// Steps from one moment to the next, at least 1. The last step is always there.
    pub every: usize,
    /// Whether the AV stays in the middle. Otherwise the camera stands still, which makes far smaller files.
    pub follow: bool,
}

/// Why there is no animation.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum AnimationError {
    /// More pixels than the format can hold.
    #[error(
        "an animation of {width} x {height} pixels is too large: a side has at most 65535; take smaller or fewer panels"
    )]
    TooLarge {
        /// Pixels from left to right.
        width: usize,
        /// Pixels from top to bottom.
        height: usize,
    },
    /// A moment that the renderer refuses.
    #[error("step {step} of `{scenario}` could not be drawn")]
    Draw {
        /// The scenario.
        scenario: String,
        /// The moment.
        step: usize,
        /// What the renderer says.
        source: usvg::Error,
    },
    /// The encoder failed.
    #[error("the animation of `{scenario}` could not be encoded")]
    Encode {
        /// The scenario.
        scenario: String,
        /// What the encoder says.
        source: gif::EncodingError,
    },
}

impl<'a> Animation<'a> {
    /// An animation of some panels: every step, 480 pixels, a camera that stands still.
    pub fn new(scenario: &'a Scenario, panels: Vec<Panel<'a>>) -> Self {
        Self { scenario, panels, radius: None, size: 480, every: 1, follow: false }
    }

    /// The steps that are shown, 0 to 80.
    fn steps(&self) -> Vec<usize> {
        let mut steps: Vec<usize> = (0..FUTURE).step_by(self.every.max(1)).collect();
        steps.push(FUTURE);
        steps
    }

    /// The animation as the bytes of a GIF.
    ///
    /// # Errors
    /// [`AnimationError`]: too many pixels, or a scene that the renderer refuses.
    pub fn encode(&self) -> Result<Vec<u8>, AnimationError> {
        let log = [Panel { title: self.scenario.id.clone(), ..Panel::default() }];
        let panels = if self.panels.is_empty() { &log[..] } else { &self.panels };
        let size = self.size.clamp(100, 1200);
        let mut views: Vec<View<'_>> = panels
            .iter()
            .map(|p| View {
                rollout: p.rollout,
                marks: p.marks.clone(),
                size: f64::from(size),
                ..View::default()
            })
            .collect();
        let camera = Camera::new(self, &views, f64::from(size));
        views.iter_mut().for_each(|v| v.radius = camera.radius);
        let moving = views.iter().map(|view| Moving::new(self.scenario, view)).collect();
        let mut stage = Stage::new(panels, moving, camera, size as usize);
        let (width, height) = (stage.width(), stage.height());
        let (Ok(wide), Ok(high)) = (u16::try_from(width), u16::try_from(height)) else {
            return Err(AnimationError::TooLarge { width, height });
        };

        let steps = self.steps();
        let mut moment = |step: usize| {
            let drawn = stage.moment(step);
            drawn.map_err(|source| AnimationError::Draw { scenario: self.scenario.id.clone(), step, source })
        };
        let mut counts: BTreeMap<Colour, u64> = BTreeMap::new();
        for (i, &step) in steps.iter().enumerate() {
            if i % SAMPLED == 0
                || i + 1 == steps.len()
                || self.lights_change(i.checked_sub(1).map(|k| steps[k]), step)
            {
                moment(step)?.pixels.iter().for_each(|c| *counts.entry(*c).or_default() += 1);
            }
        }
        let mut palette = Palette::new(&counts, COLOURS);

        let failed = |source| AnimationError::Encode { scenario: self.scenario.id.clone(), source };
        let mut encoder = Encoder::new(Vec::new(), wide, high, &palette.table()).map_err(failed)?;
        encoder.set_repeat(Repeat::Infinite).map_err(failed)?;
        let mut before: Option<Vec<u8>> = None;
        for (i, &step) in steps.iter().enumerate() {
            let after = palette.indices(&moment(step)?.pixels);
            let part = change(before.as_deref(), &after, width);
            let frame = gif::Frame {
                // Hundredths of a second: a step has ten.
                delay: steps.get(i + 1).map_or(HELD, |next| 10 * (next - step) as u16),
                dispose: DisposalMethod::Keep,
                transparent: Some(palette::TRANSPARENT),
                left: part.left as u16,
                top: part.top as u16,
                width: part.width as u16,
                height: part.height as u16,
                buffer: part.pixels.into(),
                ..gif::Frame::default()
            };
            encoder.write_frame(&frame).map_err(failed)?;
            before = Some(after);
        }
        encoder.into_inner().map_err(failed)
    }

    /// Whether a light shows something else at a step than at an earlier one.
    fn lights_change(&self, before: Option<usize>, step: usize) -> bool {
        let Some(before) = before else { return false };
        (0..self.scenario.start.lights.len()).any(|i| {
            let states = self.scenario.light_states(i);
            states.get(CURRENT + before) != states.get(CURRENT + step)
        })
    }
}

#[cfg(test)]
mod tests;
