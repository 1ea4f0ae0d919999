//! k-disks: tokens drawn from recorded motions, none near another (SMART, CATK).

use rand::RngExt;
use reactsim::dynamics::Pose;
use reactsim::geometry::{Vec2, wrap};
use reactsim::rollout::{Purpose, stream};
use reactsim::scene::DT;
use serde::Serialize;

use super::{BuildError, Class, ORIGIN, Segments, TOKEN_FRAMES, TOKEN_POSES, TokenPoses, Tokenizer};

/// Draws a motion, makes the mean of all near it a token, takes them away, and goes on.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct KDisks {
    /// Tokens per class, fewer where the motions come to an end.
    pub tokens: usize,
    /// How contours are compared.
    pub distance: CornerDistance,
    /// Motions nearer than this are one token, metres; per class in the order of [`Class::ALL`].
    pub tolerance: [f64; 3],
    /// Whether token 0 stands exactly still.
    pub stand_still: bool,
    /// Whether every token comes with its mirror image.
    pub symmetric: bool,
    /// Motions that no road user makes are left out.
    pub quality: Option<Quality>,
}

/// The distance of two contours.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum CornerDistance {
    /// Mean distance of corresponding corners (CATK).
    Mean,
    /// Root mean square of these distances (SMART).
    RootMeanSquare,
}

/// Bounds of motions that are taken.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Quality {
    /// Largest change of speed, m/s².
    pub acceleration: f64,
    /// Largest curvature, 1/m; not asked of pedestrians, nor below 0.6 m/s, where it means nothing.
    pub curvature: f64,
}

impl Default for KDisks {
    /// As CATK's vocabulary `555_s2`, but without motions that are faults of the recording.
    fn default() -> Self {
        Self {
            tokens: 2048,
            distance: CornerDistance::Mean,
            tolerance: [0.05; 3],
            stand_still: true,
            symmetric: false,
            quality: Some(Quality { acceleration: 10.0, curvature: 0.5 }),
        }
    }
}

impl KDisks {
    /// As SMART's script.
    pub fn smart() -> Self {
        Self {
            distance: CornerDistance::RootMeanSquare,
            tolerance: [0.05, 0.004, 0.004],
            stand_still: false,
            quality: None,
            ..Self::default()
        }
    }

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

const METHOD: &str = "k-disks";
/// Below this speed curvature is not asked for, m/s (as in the benchmark's metric).
const CURVATURE_FROM: f64 = 0.6;

impl Tokenizer for KDisks {
    fn method(&self) -> &'static str {
        METHOD
    }

    fn settings(&self) -> Result<serde_json::Value, serde_json::Error> {
        serde_json::to_value(self)
    }

    fn tokens(&self, class: Class, segments: &Segments) -> Result<Vec<TokenPoses>, BuildError> {
        self.check()?;
        let mut left: Vec<Candidate> = segments
            .of(class)
            .iter()
            .filter(|m| self.takes(class, m))
            .map(|m| Candidate::new(class, m))
            .collect();
        if self.symmetric {
            let mirrored: Vec<_> = left.iter().map(|c| Candidate::new(class, &mirror(&c.poses))).collect();
            left.extend(mirrored);
        }
        if left.is_empty() {
            let needed = "at least one that no fault of the recording made".to_owned();
            return Err(BuildError::NoData {
                class,
                segments: segments.of(class).len(),
                method: METHOD,
                needed,
            });
        }
        let tolerance = self.tolerance[class.index()];
        let name = format!("vocabulary/k-disks/{class}");
        let mut stream = stream(segments.seed(), &name, 0, Purpose::Begin);
        let mut tokens = Vec::new();
        if self.stand_still {
            let still = [ORIGIN; TOKEN_POSES];
            self.gather(&mut left, &Candidate::new(class, &still), tolerance);
            tokens.push(still);
        }
        while tokens.len() < self.tokens && !left.is_empty() {
            let drawn = left[stream.random_range(0..left.len())].clone();
            let near = self.gather(&mut left, &drawn, tolerance);
            let token = mean(&near, &drawn.poses);
            if !self.symmetric {
                tokens.push(token);
                continue;
            }
            let other = Candidate::new(class, &mirror(&drawn.poses));
            if self.between(&drawn.contour, &other.contour) <= tolerance {
                // Nearly its own mirror image: made exactly so, with those that are near on the other side.
                self.gather(&mut left, &other, tolerance);
                tokens.push(token.map(|p| Pose { position: Vec2::new(p.position.x, 0.0), heading: 0.0 }));
            } else if tokens.len() + 2 <= self.tokens {
                self.gather(&mut left, &other, tolerance);
                tokens.extend([token, mirror(&token)]);
            }
            // Otherwise one place is left, which a pair does not fit into: the next draw may.
        }
        Ok(tokens)
    }
}

impl KDisks {
    /// Whether a motion can be one of a class.
    fn takes(&self, class: Class, motion: &TokenPoses) -> bool {
        // SMART's window: nobody is faster.
        let front = class.contour(motion[TOKEN_FRAMES])[0];
        if !(-10.0..=50.0).contains(&front.x) || front.y.abs() > 10.0 {
            return false;
        }
        let Some(quality) = self.quality else { return true };
        let steps: Vec<(f64, f64)> = motion
            .windows(2)
            .map(|w| ((w[1].position - w[0].position).norm(), wrap(w[1].heading - w[0].heading).abs()))
            .collect();
        let accelerates = steps.windows(2).any(|w| (w[1].0 - w[0].0).abs() > quality.acceleration * DT * DT);
        let turns = steps.iter().any(|s| s.0 > CURVATURE_FROM * DT && s.1 > quality.curvature * s.0);
        !accelerates && (class == Class::Pedestrian || !turns)
    }

    /// Takes away the motions near one, and gives them.
    fn gather(&self, left: &mut Vec<Candidate>, about: &Candidate, tolerance: f64) -> Vec<TokenPoses> {
        let mut near = Vec::new();
        left.retain(|candidate| {
            // The distance of the centres is at most that of the corners, by either measure.
            let far = (candidate.end - about.end).norm_squared() > (tolerance + 1e-9) * (tolerance + 1e-9);
            if far || self.between(&candidate.contour, &about.contour) > tolerance {
                return true;
            }
            near.push(candidate.poses);
            false
        });
        near
    }

    fn between(&self, a: &[Vec2; 4], b: &[Vec2; 4]) -> f64 {
        match self.distance {
            CornerDistance::Mean => super::token_set::corner_distance(a, b) / 4.0,
            CornerDistance::RootMeanSquare => {
                (a.iter().zip(b).map(|(a, b)| (a - b).norm_squared()).sum::<f64>() / 4.0).sqrt()
            }
        }
    }
}

/// A motion that may become a token.
#[derive(Clone, Debug)]
struct Candidate {
    end: Vec2,
    contour: [Vec2; 4],
    poses: TokenPoses,
}

impl Candidate {
    fn new(class: Class, poses: &TokenPoses) -> Self {
        let end = poses[TOKEN_FRAMES];
        Self { end: end.position, contour: class.contour(end), poses: *poses }
    }
}

/// The same to the other side.
pub(super) fn mirror(poses: &TokenPoses) -> TokenPoses {
    poses.map(|p| Pose { position: Vec2::new(p.position.x, -p.position.y), heading: -p.heading })
}

/// The mean of motions; headings are averaged about those of one of them, so that half a turn is no matter.
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
