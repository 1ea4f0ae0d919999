//! k-disks: tokens drawn from recorded motions, none near another (SMART, CATK).

use rand::RngExt;
use reactsim::dynamics::Pose;
use reactsim::geometry::{Vec2, wrap};
use reactsim::rollout::{Purpose, stream};
use reactsim::scene::DT;
use serde::Serialize;

use super::token_set::corner_distance;
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
    /// As CATK's vocabulary `555_s2`, but without motions that are faults of the recording, and finer for those of whom less is recorded: at
    /// 0.05 m their motions come to an end long before the tokens do, and what is left follows a log no nearer than that.
    fn default() -> Self {
        Self {
            tokens: 2048,
            distance: CornerDistance::Mean,
            tolerance: [0.05, 0.025, 0.0125],
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
        let mut motions: Vec<TokenPoses> =
            segments.of(class).iter().filter(|m| self.takes(class, m)).copied().collect();
        if self.symmetric {
            let mirrored: Vec<_> = motions.iter().map(mirror).collect();
            motions.extend(mirrored);
        }
        if motions.is_empty() {
            let needed = "at least one that no fault of the recording made".to_owned();
            let segments = segments.of(class).len();
            return Err(BuildError::NoData { class, segments, method: METHOD, needed });
        }
        let tolerance = self.tolerance[class.index()];
        let mut pool = Pool::new(class, motions, self.distance, tolerance);
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
                // Nearly its own mirror image: made exactly so, with those that are near on the other side.
                pool.gather(&other);
                tokens.push(token.map(|p| Pose { position: Vec2::new(p.position.x, 0.0), heading: 0.0 }));
            } else if tokens.len() + 2 <= self.tokens {
                pool.gather(&other);
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
}

/// The motions that were not taken yet.
struct Pool {
    class: Class,
    motions: Vec<TokenPoses>,
    contours: Vec<[Vec2; 4]>,
    /// Where they end, and their indices.
    left: Vec<(Vec2, u32)>,
    distance: CornerDistance,
    tolerance: f64,
}

impl Pool {
    fn new(class: Class, motions: Vec<TokenPoses>, distance: CornerDistance, tolerance: f64) -> Self {
        let contours = motions.iter().map(|m| class.contour(m[TOKEN_FRAMES])).collect();
        let left = motions.iter().zip(0..).map(|(m, i)| (m[TOKEN_FRAMES].position, i)).collect();
        Self { class, motions, contours, left, distance, tolerance }
    }

    /// One of those that are left.
    fn motion(&self, at: usize) -> TokenPoses {
        self.motions[self.left[at].1 as usize]
    }

    /// Takes away the motions near one, and gives them.
    fn gather(&mut self, about: &TokenPoses) -> Vec<TokenPoses> {
        let mut left = std::mem::take(&mut self.left);
        let end = about[TOKEN_FRAMES];
        let contour = self.class.contour(end);
        let mut near = Vec::new();
        // The distance of the centres is at most that of the corners, by either measure; rounding aside.
        let reach = self.tolerance + 1e-9;
        left.retain(|&(at, i)| {
            let far = (at - end.position).norm_squared() > reach * reach;
            if far || self.between(&self.contours[i as usize], &contour) > self.tolerance {
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
        self.between(&contour(a), &contour(b)) <= self.tolerance
    }

    fn between(&self, a: &[Vec2; 4], b: &[Vec2; 4]) -> f64 {
        match self.distance {
            CornerDistance::Mean => corner_distance(a, b) / 4.0,
            CornerDistance::RootMeanSquare => {
                (a.iter().zip(b).map(|(a, b)| (a - b).norm_squared()).sum::<f64>() / 4.0).sqrt()
            }
        }
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
