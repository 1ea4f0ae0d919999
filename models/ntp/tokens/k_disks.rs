//! k-disks: tokens drawn from recorded motions with a minimum distance (SMART, CATK).

use rand::RngExt;
use reactsim_geometry::{Vec2, wrap};
use reactsim_nn::perception::Class;
use reactsim_rollout::{Purpose, stream};
use reactsim_scene::DT;
use reactsim_scene::dynamics::Pose;
use serde::Serialize;

use super::token_set::corner_distance;
use super::{BuildError, ORIGIN, Segments, TOKEN_FRAMES, TOKEN_POSES, TokenPoses, Tokenizer};

/// Repeatedly draws a motion, makes the mean of all motions near it a token, and removes them.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct KDisks {
    /// Number of tokens per class; fewer if the motions are exhausted.
    pub tokens: usize,
    /// Mean distance of corresponding corners, metres, below which motions are merged into one token, per
    /// class in the order of [`Class::ALL`].
    pub tolerance: [f64; 3],
    /// Whether token 0 is an exact standstill.
    pub stand_still: bool,
    /// Whether every token has its mirror image in the vocabulary.
    pub symmetric: bool,
    /// Bounds beyond which motions are discarded as implausible.
    pub quality: Quality,
}

/// Bounds of accepted motions.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Quality {
    /// Largest acceleration or deceleration, m/s².
    pub acceleration: f64,
    /// Largest curvature, 1/m. Not applied to pedestrians, nor below 0.6 m/s, where curvature is
    /// meaningless.
    pub curvature: f64,
}

impl Default for KDisks {
    /// Settings of CATK's vocabulary `555_s2`, but without motions caused by recording faults, and with
    /// finer tolerances for classes with less data: at 0.05 m their motions are exhausted long before
    /// the tokens are, and the result follows logs no closer than that.
    fn default() -> Self {
        Self {
            tokens: 2048,
            tolerance: [0.05, 0.025, 0.0125],
            stand_still: true,
            symmetric: false,
            quality: Quality { acceleration: 10.0, curvature: 0.5 },
        }
    }
}

impl KDisks {
    fn check(&self) -> Result<(), BuildError> {
        let wrong =
            |name, value, expected| Err(BuildError::Setting { method: METHOD, name, value, expected });
        if self.tokens == 0 {
            return wrong("tokens", 0.0, "at least 1");
        }
        if let Some(bad) = self.tolerance.into_iter().find(|t| !(*t >= 0.0 && t.is_finite())) {
            return wrong("tolerance", bad, "a distance in metres");
        }
        Ok(())
    }
}

/// Name of the method in files and messages.
const METHOD: &str = "k-disks";
/// Speed below which curvature is not checked, m/s (as in the benchmark's metric).
const MIN_CURVATURE_SPEED: f64 = 0.6;

impl Tokenizer for KDisks {
    fn method(&self) -> &'static str {
        METHOD
    }

    fn settings(&self) -> serde_json::Value {
        serde_json::json!(self)
    }

    fn tokens(&self, class: Class, segments: &Segments) -> Result<Vec<TokenPoses>, BuildError> {
        self.check()?;
        let mut motions: Vec<TokenPoses> =
            segments.of(class).iter().filter(|m| self.is_plausible(class, m)).copied().collect();
        if self.symmetric {
            let mirrored: Vec<_> = motions.iter().map(mirror).collect();
            motions.extend(mirrored);
        }
        if motions.is_empty() {
            let needed = "at least one without recording faults".to_owned();
            let segments = segments.of(class).len();
            return Err(BuildError::NoData { class, segments, method: METHOD, needed });
        }
        let tolerance = self.tolerance[class.index()];
        let mut pool = Pool::new(class, motions, tolerance);
        let name = format!("vocabulary/k-disks/{class}");
        let mut stream = stream(segments.seed(), &name, 0, Purpose::Begin);
        let mut tokens = Vec::new();
        if self.stand_still {
            let still = [ORIGIN; TOKEN_POSES];
            pool.gather(&still);
            tokens.push(still);
        }
        while tokens.len() < self.tokens && !pool.left.is_empty() {
            let drawn = pool.motion(stream.random_range(0..pool.left.len()));
            let token = mean(&pool.gather(&drawn), &drawn);
            if !self.symmetric {
                tokens.push(token);
                continue;
            }
            let other = mirror(&drawn);
            if pool.are_near(&drawn, &other) {
                // Nearly its own mirror image: made exactly symmetric, merged with the motions near the
                // mirror image.
                pool.gather(&other);
                tokens.push(token.map(|p| Pose { position: Vec2::new(p.position.x, 0.0), heading: 0.0 }));
            } else if tokens.len() + 2 <= self.tokens {
                pool.gather(&other);
                tokens.extend([token, mirror(&token)]);
            }
            // Otherwise only one token is left, too few for a pair; a later draw may be symmetric.
        }
        Ok(tokens)
    }
}

impl KDisks {
    fn is_plausible(&self, class: Class, motion: &TokenPoses) -> bool {
        // Window of SMART: no agent is faster.
        let front = class.contour(motion[TOKEN_FRAMES])[0];
        if !(-10.0..=50.0).contains(&front.x) || front.y.abs() > 10.0 {
            return false;
        }
        let Quality { acceleration, curvature } = self.quality;
        let steps: Vec<(f64, f64)> = motion
            .windows(2)
            .map(|w| ((w[1].position - w[0].position).norm(), wrap(w[1].heading - w[0].heading).abs()))
            .collect();
        let accelerates = steps.windows(2).any(|w| (w[1].0 - w[0].0).abs() > acceleration * DT * DT);
        let turns = steps.iter().any(|s| s.0 > MIN_CURVATURE_SPEED * DT && s.1 > curvature * s.0);
        !accelerates && (class == Class::Pedestrian || !turns)
    }
}

/// Motions that are not merged into a token yet.
struct Pool {
    class: Class,
    motions: Vec<TokenPoses>,
    contours: Vec<[Vec2; 4]>,
    /// End points and indices of the remaining motions.
    left: Vec<(Vec2, u32)>,
    tolerance: f64,
}

impl Pool {
    fn new(class: Class, motions: Vec<TokenPoses>, tolerance: f64) -> Self {
        let contours = motions.iter().map(|m| class.contour(m[TOKEN_FRAMES])).collect();
        let left = motions.iter().zip(0..).map(|(m, i)| (m[TOKEN_FRAMES].position, i)).collect();
        Self { class, motions, contours, left, tolerance }
    }

    /// Returns one of the remaining motions.
    fn motion(&self, at: usize) -> TokenPoses {
        self.motions[self.left[at].1 as usize]
    }

    /// Removes and returns the motions near `about`.
    fn gather(&mut self, about: &TokenPoses) -> Vec<TokenPoses> {
        let mut left = std::mem::take(&mut self.left);
        let end = about[TOKEN_FRAMES];
        let contour = self.class.contour(end);
        let mut near = Vec::new();
        // The distance of the centres is at most that of the corners, except for rounding.
        let reach = self.tolerance + 1e-9;
        left.retain(|&(at, i)| {
            let far = (at - end.position).norm_squared() > reach * reach;
            if far || corner_distance(&self.contours[i as usize], &contour) / 4.0 > self.tolerance {
                return true;
            }
            near.push(self.motions[i as usize]);
            false
        });
        self.left = left;
        near
    }

    fn are_near(&self, a: &TokenPoses, b: &TokenPoses) -> bool {
        let contour = |m: &TokenPoses| self.class.contour(m[TOKEN_FRAMES]);
        corner_distance(&contour(a), &contour(b)) / 4.0 <= self.tolerance
    }
}

/// Returns the mirror image of a motion.
pub(super) fn mirror(poses: &TokenPoses) -> TokenPoses {
    poses.map(|p| Pose { position: Vec2::new(p.position.x, -p.position.y), heading: -p.heading })
}

/// Returns the mean of motions. Headings are averaged relative to those of `about`, so that wrapping
/// does not matter.
pub(super) fn mean(motions: &[TokenPoses], about: &TokenPoses) -> TokenPoses {
    let n = motions.len().max(1) as f64;
    let mut mean = [ORIGIN; TOKEN_POSES];
    for (i, pose) in mean.iter_mut().enumerate() {
        let mut sum = (Vec2::zeros(), 0.0);
        for motion in motions {
            sum.0 += motion[i].position;
            sum.1 += wrap(motion[i].heading - about[i].heading);
        }
        *pose = Pose { position: sum.0 / n, heading: wrap(about[i].heading + sum.1 / n) };
    }
    mean
}
