//! Configuration of the network.

use reactsim_nn::SizeError;
use reactsim_scene::FUTURE;
use serde::{Deserialize, Serialize};

/// Sizes, stored with the weights.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VbdConfig {
    /// Width of features.
    pub width: usize,
    /// Hidden width of the perceptrons that read agents, points, anchors and states.
    pub hidden: usize,
    /// Heads of every attention.
    pub heads: usize,
    /// Frequencies per number of a relation.
    pub frequencies: usize,
    /// Layers of the scene encoder.
    pub encoder_layers: usize,
    /// Pairs of blocks of the predictor, and of the denoiser.
    pub pairs: usize,
    /// Number of actions of a plan.
    pub actions: usize,
    /// Number of steps of 0.1 s for which an action is held.
    pub hold: usize,
    /// Number of noise levels.
    pub noise_levels: usize,
    /// Number of elements that an element sees, itself included: those that come nearest to it within 3 s, if
    /// all keep their velocities.
    pub near_elements: usize,
    /// Number of agents whose plans an agent sees while they are denoised, itself included, chosen likewise.
    pub near_agents: usize,
    /// Share of training scenes in which the AV's actions are given without noise while those of others are
    /// denoised. If there are any, in-painting gives them so too; otherwise with the noise of the level.
    pub av_given: f64,
    /// Whether relations tell how two elements move towards each other too; in the public code, how they lie.
    pub relates_motion: bool,
    /// Whether map lines and lights attend to what they see in the encoder, as agents do. They do in the
    /// public code; most of the encoder's work is theirs.
    pub map_attends: bool,
    /// Whether actions see later ones of an AV whose plan is given, too. In the public code they see those of
    /// all others up to their own time.
    pub foresight: bool,
    /// Whether the AV is described by its latest acceleration and yaw rate too. Those of others are left out:
    /// agents that read their own would go on as they did. The public code reads none.
    pub reads_av_motion: bool,
    /// Whether blocks of the predictor and the denoiser add what they attend to to their queries, and queries
    /// of the denoiser contain the encoding of their agent. The public code does neither.
    pub residual: bool,
    /// Whether the denoiser reads noisy actions beside the states that they lead to. In the public code it
    /// reads states alone.
    pub reads_actions: bool,
    /// Whether the encoder attends to present elements alone. The public code attends to all of them, and
    /// from absent ones to all alike.
    pub masked: bool,
    /// Whether a coordinate of exactly 0 says that something is absent, as in the public code; otherwise
    /// types alone do.
    pub zeros_are_absent: bool,
}

impl Default for VbdConfig {
    /// Returns a configuration for training on two processor cores.
    fn default() -> Self {
        Self {
            width: 64,
            hidden: 64,
            heads: 4,
            frequencies: 24,
            encoder_layers: 2,
            pairs: 2,
            actions: 10,
            hold: 5,
            noise_levels: 50,
            near_elements: 32,
            near_agents: 12,
            av_given: 0.5,
            relates_motion: true,
            map_attends: false,
            foresight: true,
            reads_av_motion: true,
            residual: true,
            reads_actions: true,
            masked: true,
            zeros_are_absent: false,
        }
    }
}

impl VbdConfig {
    /// Returns the published sizes: 11.8 million parameters.
    pub const fn published() -> Self {
        Self {
            width: 256,
            hidden: 128,
            heads: 8,
            frequencies: 64,
            encoder_layers: 6,
            pairs: 2,
            actions: 40,
            hold: 2,
            noise_levels: 50,
            // All of them: the public code has no limits.
            near_elements: 4096,
            near_agents: 4096,
            av_given: 0.0,
            relates_motion: false,
            map_attends: true,
            foresight: false,
            reads_av_motion: false,
            residual: false,
            reads_actions: false,
            masked: false,
            zeros_are_absent: true,
        }
    }

    /// Checks the sizes.
    ///
    /// # Errors
    /// [`SizeError`], which names the field.
    pub fn check(&self) -> Result<(), SizeError> {
        let refuse = |field, value: usize, expected| Err(SizeError { field, value: value as f64, expected });
        let sizes = [
            ("width", self.width),
            ("hidden", self.hidden),
            ("heads", self.heads),
            ("frequencies", self.frequencies),
            ("encoder_layers", self.encoder_layers),
            ("pairs", self.pairs),
            ("noise_levels", self.noise_levels),
            ("near_elements", self.near_elements),
            ("near_agents", self.near_agents),
        ];
        for (field, value) in sizes {
            if !(1..=4096).contains(&value) {
                return refuse(field, value, "1 to 4096");
            }
        }
        if !self.width.is_multiple_of(self.heads) {
            return refuse("width", self.width, "a multiple of the number of heads");
        }
        if self.hold == 0 || self.actions == 0 || self.actions > FUTURE / self.hold {
            return refuse("actions", self.actions, "1 to 80 divided by `hold`");
        }
        if self.noise_levels < 2 {
            return refuse("noise_levels", self.noise_levels, "2 or more");
        }
        if !(0.0..=1.0).contains(&self.av_given) {
            return Err(SizeError { field: "av_given", value: self.av_given, expected: "0 to 1" });
        }
        Ok(())
    }

    /// Returns the number of predicted states of an agent.
    pub const fn states(&self) -> usize {
        self.actions * self.hold
    }
}
