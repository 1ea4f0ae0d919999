//! Rolling matching: a recorded track as tokens, each starting where the previous one ended (SMART,
//! CATK).

use rand::RngExt;
use reactsim_geometry::{Vec2, math, wrap};
use reactsim_nn::perception::Class;
use reactsim_rollout::Stream;
use reactsim_scene::dynamics::Pose;
use reactsim_scene::{AgentState, CURRENT, DT, FRAMES, Frame};

use super::{ORIGIN, TOKEN_FRAMES, Vocabulary, motion_between, moved};

/// Number of tokens of a track of 91 frames, which networks are trained with: token k leads from frame 5k to
/// frame 5k + 5, and token 1 ends at the current frame.
pub const TOKEN_STEPS: usize = (FRAMES - 1) / TOKEN_FRAMES;
/// Heading difference between two frames above which the later heading counts as flipped or wrong,
/// radians (CATK).
const FLIP_ANGLE: f64 = 1.5;

/// A track as tokens. Values of invalid steps are finite but have no meaning for a network.
#[derive(Clone, Debug, PartialEq)]
pub struct TokenTrack {
    /// Token that leads to each step.
    pub tokens: Vec<usize>,
    /// Pose at the end of each token, scenario frame; the origin if the step is invalid.
    pub poses: Vec<Pose>,
    /// Whether both end frames of each step are present.
    pub valid: Vec<bool>,
}

/// Random choice among near tokens, so that later steps show how to return to the log.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum TokenNoise {
    /// One of the `k` nearest, with equal probability (SMART).
    Uniform {
        /// Number of tokens; at least 1.
        k: usize,
    },
    /// One of the `k` nearest, in proportion to exp(-mean corner distance / temperature) (CATK).
    Weighted {
        /// Number of tokens; at least 1.
        k: usize,
        /// Temperature, metres.
        temperature: f64,
    },
}

/// A track prepared for matching: the pose at every frame, `None` if unknown.
#[derive(Clone, Debug, PartialEq)]
pub struct PreparedTrack {
    poses: Vec<Option<Pose>>,
}

impl PreparedTrack {
    /// Prepares a track of frames from 0 on, 91 or more (missing ones are absent): corrects flipped headings,
    /// and extrapolates backwards from its first frame to the start of a token.
    ///
    /// States that are not finite are absent. A missing velocity is taken from the next frame, or is
    /// zero. Gaps remain: fill them with [`fill_gaps`] if necessary.
    pub fn new(track: &[Frame]) -> Self {
        let mut poses: Vec<Option<Pose>> = (0..track.len().max(FRAMES))
            .map(|f| track.get(f).copied().flatten().as_ref().and_then(pose_of))
            .collect();
        without_flips(&mut poses);
        if let Some(first) = poses.iter().position(Option::is_some) {
            extrapolate_backwards(&mut poses, first, track[first].as_ref());
        }
        Self { poses }
    }

    /// Returns the pose at a frame.
    pub fn pose(&self, frame: usize) -> Option<Pose> {
        self.poses.get(frame).copied().flatten()
    }

    /// Returns the nearest token at each step.
    pub fn nearest_tokens(&self, vocabulary: &Vocabulary, class: Class) -> TokenTrack {
        self.tokens(vocabulary, class, |_, motion| vocabulary.nearest(class, motion))
    }

    /// Returns the tokens of the track, with noise from the second step on. One number is drawn per
    /// valid step.
    pub fn noisy_tokens(
        &self,
        vocabulary: &Vocabulary,
        class: Class,
        noise: TokenNoise,
        stream: &mut Stream,
    ) -> TokenTrack {
        self.tokens(vocabulary, class, |step, motion| match step {
            0 => vocabulary.nearest(class, motion),
            _ => noise.choose(vocabulary, class, motion, stream),
        })
    }

    fn tokens(
        &self,
        vocabulary: &Vocabulary,
        class: Class,
        mut choose: impl FnMut(usize, Pose) -> usize,
    ) -> TokenTrack {
        let steps = (self.poses.len() - 1) / TOKEN_FRAMES;
        let mut found =
            TokenTrack { tokens: vec![0; steps], poses: vec![ORIGIN; steps], valid: vec![false; steps] };
        let mut from = self.poses[0].unwrap_or(ORIGIN);
        for step in 0..steps {
            let (start, end) = (self.poses[step * TOKEN_FRAMES], self.poses[(step + 1) * TOKEN_FRAMES]);
            let Some((_, to)) = start.zip(end) else {
                // Restart the tokens at the frame itself.
                from = end.unwrap_or(ORIGIN);
                continue;
            };
            let token = choose(step, motion_between(from, to));
            from = moved(from, vocabulary.end(class, token));
            (found.tokens[step], found.poses[step], found.valid[step]) = (token, from, true);
        }
        found
    }
}

/// Returns the token nearest to an executed motion, and its summed corner distance in metres. Poses of
/// such agents remain the true ones, so errors do not accumulate.
pub fn token_of_motion(vocabulary: &Vocabulary, class: Class, from: Pose, to: Pose) -> (usize, f64) {
    vocabulary.nearest_with_distance(class, motion_between(from, to))
}

/// Fills missing frames between the first and the last one of a track by linear interpolation of
/// position, velocity and (unwrapped) heading.
pub fn fill_gaps(track: &mut [Frame]) {
    let Some(mut before) = track.iter().position(Option::is_some) else { return };
    for frame in before + 1..track.len() {
        let (Some(a), Some(b)) = (track[before], track[frame]) else { continue };
        for (gap, missing) in track.iter_mut().enumerate().take(frame).skip(before + 1) {
            let u = (gap - before) as f64 / (frame - before) as f64;
            let mix = |a: f64, b: f64| a + (b - a) * u;
            *missing = Some(AgentState {
                x: mix(a.x, b.x),
                y: mix(a.y, b.y),
                heading: a.heading + wrap(b.heading - a.heading) * u,
                vx: mix(a.vx, b.vx),
                vy: mix(a.vy, b.vy),
            });
        }
        before = frame;
    }
}

fn pose_of(state: &AgentState) -> Option<Pose> {
    state.is_finite().then(|| Pose { position: state.position(), heading: wrap(state.heading) })
}

/// Replaces the heading of a frame by the previous one if the two differ by more than [`FLIP_ANGLE`].
fn without_flips(poses: &mut [Option<Pose>]) {
    for i in 1..poses.len() {
        if let (Some(before), Some(here)) = (poses[i - 1], poses[i].as_mut())
            && wrap(here.heading - before.heading).abs() > FLIP_ANGLE
        {
            here.heading = before.heading;
        }
    }
}

/// Extrapolates backwards, at the velocity of the first frame, to the start of a token. An agent that
/// first appears at the current frame gets one whole token as its past.
fn extrapolate_backwards(poses: &mut [Option<Pose>], first: usize, state: Option<&AgentState>) {
    let Some(at) = poses[first] else { return };
    let next = || poses.get(first + 1).copied().flatten().map(|next| (next.position - at.position) / DT);
    let velocity = state.and_then(AgentState::velocity).or_else(next).unwrap_or_else(Vec2::zeros);
    let frames = if first == CURRENT { TOKEN_FRAMES } else { first % TOKEN_FRAMES };
    for back in 1..=frames {
        poses[first - back] = Some(Pose { position: at.position - velocity * (DT * back as f64), ..at });
    }
}

impl TokenNoise {
    /// Chooses one of the tokens near a motion; 0 if there are none.
    fn choose(self, vocabulary: &Vocabulary, class: Class, motion: Pose, stream: &mut Stream) -> usize {
        let (Self::Uniform { k } | Self::Weighted { k, .. }) = self;
        let near = vocabulary.nearest_k(class, motion, k.max(1));
        let least = near.first().map_or(0.0, |t| t.1);
        let weight = |t: &(usize, f64)| match self {
            Self::Uniform { .. } => 1.0,
            Self::Weighted { temperature, .. } => math::exp((least - t.1) / (4.0 * temperature)),
        };
        let mut left = stream.random::<f64>() * near.iter().map(weight).sum::<f64>();
        for token in &near {
            left -= weight(token);
            if left < 0.0 {
                return token.0;
            }
        }
        near.first().map_or(0, |t| t.0)
    }
}
