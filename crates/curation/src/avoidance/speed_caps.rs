//! Speed limits of an agent where its path bends.

use reactsim_geometry::wrap;
use reactsim_scene::AgentKind;

use super::own_path::OwnPath;
use super::profile::Profile;
use super::responder::Responder;

/// Spacing of the sampled positions of a path, metres.
const SAMPLE_SPACING: f64 = 0.5;
/// Length over which the curvature is measured, metres: recorded headings are noisy.
const CURVATURE_WINDOW: f64 = 5.0;
/// Distance up to which the logged speed applies around a position, metres.
const LOG_SPEED_REACH: f64 = 1.0;
/// Factor on the logged speed that a response may reach anywhere.
const LOG_SPEED_FACTOR: f64 = 1.1;
/// Speed excess that is tolerated, m/s.
const SPEED_TOLERANCE: f64 = 0.05;
/// Share of the allowed speed from which steps are capped as well once a response is too fast.
const NEAR_CAP_SHARE: f64 = 0.9;
/// Distance behind a position whose caps apply to it too, metres: a slower response is farther back.
const CAP_REACH_BACK: f64 = 2.0;

/// Largest speed by arc length.
pub(super) struct SpeedCaps {
    caps: Vec<f64>,
}

impl SpeedCaps {
    /// Computes the caps up to the arc length `furthest`, metres, for the largest lateral acceleration
    /// `lateral`, m/s². Pedestrians have none.
    pub(super) fn new(
        responder: &Responder,
        kind: AgentKind,
        path: &OwnPath,
        furthest: f64,
        lateral: f64,
    ) -> Self {
        if kind == AgentKind::Pedestrian {
            return Self { caps: Vec::new() };
        }
        let last = (furthest / SAMPLE_SPACING).ceil() as usize + 1;
        let reach = (0.5 * CURVATURE_WINDOW / SAMPLE_SPACING) as usize;
        let headings = path.headings(SAMPLE_SPACING, last + reach);
        let mut caps: Vec<f64> = (0..=last)
            .map(|i| {
                let (from, to) = (i.saturating_sub(reach), i + reach);
                let bend = wrap(headings[to] - headings[from]).abs() / ((to - from) as f64 * SAMPLE_SPACING);
                (lateral / bend).sqrt()
            })
            .collect();
        let logged = responder.logged.windows(2).zip(responder.speeds.windows(2));
        for (s, v) in logged {
            let from = ((s[0] - LOG_SPEED_REACH).max(0.0) / SAMPLE_SPACING).floor() as usize;
            let to = (((s[1] + LOG_SPEED_REACH) / SAMPLE_SPACING).ceil() as usize).min(last);
            let driven = LOG_SPEED_FACTOR * v[0].max(v[1]);
            for cap in &mut caps[from.min(to)..=to] {
                *cap = cap.max(driven);
            }
        }
        Self { caps }
    }

    /// Returns the largest speed allowed anywhere between two arc lengths, m/s.
    fn between(&self, from: f64, to: f64) -> f64 {
        let first = (from.max(0.0) / SAMPLE_SPACING) as usize;
        let last = (to.max(0.0) / SAMPLE_SPACING).ceil() as usize;
        self.caps.iter().take(last + 1).skip(first).copied().fold(f64::INFINITY, f64::min)
    }

    /// Returns whether a profile is nowhere too fast.
    pub(super) fn allows(&self, profile: &Profile) -> bool {
        let all = profile.s.iter().zip(&profile.v).skip(1);
        all.into_iter().all(|(&s, &v)| v <= self.between(s, s) + SPEED_TOLERANCE)
    }

    /// Tightens the speed bounds of the steps at which a profile is too fast, or nearly.
    pub(super) fn tighten(&self, profile: &Profile, speeds: &mut [f64]) {
        for (bound, (&s, &v)) in speeds.iter_mut().zip(profile.s.iter().zip(&profile.v)).skip(1) {
            let cap = self.between(s - CAP_REACH_BACK, s);
            if v > NEAR_CAP_SHARE * cap {
                *bound = bound.min(cap);
            }
        }
    }
}
