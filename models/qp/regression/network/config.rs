//! Configuration of the network.

use std::borrow::Cow;

use reactsim_nn::SizeError;
use reactsim_nn::perception::denoised;
use reactsim_scene::{FUTURE, Frame};
use serde::{Deserialize, Serialize};

/// Input features of agents and lines.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Attributes {
    /// Features of MTR, in metres: 30 numbers of an agent per frame, 9 of a point of a line.
    Published,
    /// Similar features scaled to about 1, without the noise of recorded positions, and lights and speed limits
    /// with lines.
    Own,
}

impl Attributes {
    /// Returns tracks as the network sees them; `now` is the last frame as recorded.
    pub(crate) fn shown(self, tracks: &[Vec<Frame>], now: usize) -> Cow<'_, [Vec<Frame>]> {
        match self {
            Self::Published => Cow::Borrowed(tracks),
            Self::Own => denoised(tracks, now),
        }
    }
}

/// Normalisation after hidden layers of perceptrons.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Norms {
    /// Batch norm, in training over the rows of a forward pass. Its running means and variances follow those.
    Batch,
    /// Layer norm.
    Layer,
}

/// Sizes and ranges, stored with the weights.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Input features.
    pub attributes: Attributes,
    /// Normalisation in perceptrons.
    pub norms: Norms,
    /// Whether the network predicts the difference from a reference motion: constant velocity for the
    /// dense prediction, constant acceleration from the present velocity to the intention point for
    /// modes.
    pub guided: bool,
    /// Whether the forecast of the AV replaces its dense prediction in the encoding.
    pub av_forecast: bool,
    /// Whether the network gets lane and conflict features of the predicted agent, and reference
    /// motions follow the paths along its lanes.
    pub outlook: bool,
    /// Frames from one predicted state to the next; a divisor of 80.
    pub step: usize,
    /// Number of agents in the input, the predicted one first.
    pub agents: usize,
    /// Largest number of lines in the input.
    pub lines: usize,
    /// Largest number of points of a line.
    pub points: usize,
    /// Distance between these points, metres.
    pub spacing: f64,
    /// Radius around the AV's position at the current frame within which lines are known, metres.
    pub radius: f64,
    /// Width of tokens in the encoder.
    pub width: usize,
    /// Hidden width of the encoder of agents' histories.
    pub agent_hidden: usize,
    /// Hidden width of the encoder of lines.
    pub line_hidden: usize,
    /// Layers of the encoder of lines before the first pooling: 1 or 3.
    pub line_layers: usize,
    /// Attention layers of the encoder.
    pub encoder_layers: usize,
    /// Heads of every attention layer.
    pub heads: usize,
    /// Number of nearest tokens that a token attends to, including itself.
    pub neighbours: usize,
    /// Hidden width of feed-forward networks, as a multiple of the layer's.
    pub widening: usize,
    /// Width of queries.
    pub decoder_width: usize,
    /// Width of queries in the attention to lines.
    pub map_width: usize,
    /// Layers of the decoder.
    pub decoder_layers: usize,
    /// Number of lines nearest to the base point that every query attends to.
    pub base_lines: usize,
    /// Number of lines nearest to a query's current trajectory that it attends to.
    pub way_lines: usize,
    /// Number of modes that remain after suppression.
    pub modes: usize,
    /// Distance in metres between end points below which the less probable mode is suppressed.
    pub apart: f64,
}

impl Config {
    /// Returns the sizes of the public code (`tools/cfgs/waymo/mtr+100_percent_data.yaml`): 66 million
    /// parameters.
    pub const fn mtr() -> Self {
        Self {
            attributes: Attributes::Published,
            norms: Norms::Batch,
            guided: false,
            av_forecast: false,
            outlook: false,
            step: 1,
            agents: 64,
            lines: 768,
            points: 20,
            spacing: 0.5,
            radius: 200.0,
            width: 256,
            agent_hidden: 256,
            line_hidden: 64,
            line_layers: 3,
            encoder_layers: 6,
            heads: 8,
            neighbours: 16,
            widening: 4,
            decoder_width: 512,
            map_width: 256,
            decoder_layers: 6,
            base_lines: 256,
            way_lines: 128,
            modes: 6,
            apart: 2.5,
        }
    }

    /// Returns the number of predicted states of an agent.
    pub const fn states(&self) -> usize {
        FUTURE / self.step
    }

    /// Returns the number of tokens of an agent's surroundings: agents, then lines.
    pub const fn tokens(&self) -> usize {
        self.agents + self.lines
    }

    /// Returns whether a network with these sizes holds one with the others: at least as many layers of the
    /// decoder, and no difference but in sizes that no weights depend on.
    pub(crate) fn holds(&self, other: &Self) -> bool {
        let same = Self {
            agents: other.agents,
            lines: other.lines,
            radius: other.radius,
            neighbours: other.neighbours,
            base_lines: other.base_lines,
            way_lines: other.way_lines,
            modes: other.modes,
            apart: other.apart,
            decoder_layers: other.decoder_layers,
            ..*self
        };
        self.decoder_layers >= other.decoder_layers && same == *other
    }

    /// Returns the times from now to each predicted state, seconds.
    pub(crate) fn times(&self) -> impl Iterator<Item = f64> + Clone + use<> {
        let step = self.step as f64 * reactsim_scene::DT;
        (1..=self.states()).map(move |k| k as f64 * step)
    }

    /// Checks the sizes.
    ///
    /// # Errors
    /// [`SizeError`], which names the field.
    pub fn check(&self) -> Result<(), SizeError> {
        let sizes = [
            ("agents", self.agents),
            ("lines", self.lines),
            ("points", self.points),
            ("width", self.width),
            ("agent_hidden", self.agent_hidden),
            ("line_hidden", self.line_hidden),
            ("encoder_layers", self.encoder_layers),
            ("heads", self.heads),
            ("neighbours", self.neighbours),
            ("widening", self.widening),
            ("decoder_width", self.decoder_width),
            ("map_width", self.map_width),
            ("decoder_layers", self.decoder_layers),
            ("base_lines", self.base_lines),
            ("way_lines", self.way_lines),
            ("modes", self.modes),
        ];
        let refuse = |field, value, expected| Err(SizeError { field, value, expected });
        for (field, value) in sizes {
            if !(1..=4096).contains(&value) {
                return refuse(field, value as f64, "1 to 4096");
            }
        }
        for (field, value) in
            [("width", self.width), ("decoder_width", self.decoder_width), ("map_width", self.map_width)]
        {
            if !value.is_multiple_of(4) || !value.is_multiple_of(self.heads) {
                return refuse(field, value as f64, "a multiple of 4 and of the number of heads");
            }
        }
        if self.line_layers != 1 && self.line_layers != 3 {
            return refuse("line_layers", self.line_layers as f64, "1 or 3");
        }
        if self.step == 0 || !FUTURE.is_multiple_of(self.step) {
            return refuse("step", self.step as f64, "a divisor of 80");
        }
        let lengths = [("spacing", self.spacing), ("radius", self.radius), ("apart", self.apart)];
        for (field, value) in lengths {
            if !(value > 0.0 && value < 1e4) {
                return refuse(field, value, "metres, above 0 and below 10000");
            }
        }
        Ok(())
    }
}

impl Default for Config {
    /// Returns a configuration for training on two processor cores: half a million parameters.
    fn default() -> Self {
        Self {
            attributes: Attributes::Own,
            norms: Norms::Layer,
            guided: true,
            av_forecast: true,
            outlook: true,
            step: 5,
            agents: 12,
            lines: 24,
            points: 10,
            spacing: 2.0,
            radius: 120.0,
            width: 64,
            agent_hidden: 48,
            line_hidden: 32,
            line_layers: 1,
            encoder_layers: 2,
            heads: 4,
            neighbours: 16,
            widening: 2,
            decoder_width: 64,
            map_width: 64,
            decoder_layers: 1,
            base_lines: 16,
            way_lines: 12,
            modes: 6,
            apart: 2.5,
        }
    }
}
