//! How fast an agent may go where its path bends.

use super::driver::Driver;
use super::own_path::OwnPath;
use super::profile::Profile;
use crate::geometry::wrap;
use crate::scene::AgentKind;

/// Distance of the places of a path that are looked at, metres.
const SPACING: f64 = 0.5;
/// The curvature is that between two places so far apart, metres: recorded headings tremble.
const WINDOW: f64 = 5.0;
/// How far around a place the speed of the log counts as driven there, metres.
const AROUND: f64 = 1.0;
/// Share of the speed of the log that a response may take anywhere.
const OF_LOG: f64 = 1.1;
/// How much faster than allowed is not noticed, m/s.
const TOLERANCE: f64 = 0.05;
/// Where a response is too fast, the steps that are nearly so are bounded too: from this share of the allowed speed on.
const NEARLY: f64 = 0.9;
/// A slower response is further back: a bound is the least within so many metres behind.
const BACK: f64 = 2.0;

/// The largest speed by arc length.
pub(super) struct Pace {
    caps: Vec<f64>,
}

impl Pace {
    /// Up to the arc length `furthest`, metres. `lateral`: the largest lateral acceleration, m/s². Pedestrians turn as they like.
    pub(super) fn new(driver: &Driver, kind: AgentKind, path: &OwnPath, furthest: f64, lateral: f64) -> Self {
        if kind == AgentKind::Pedestrian {
            return Self { caps: Vec::new() };
        }
        let last = (furthest / SPACING).ceil() as usize + 1;
        let reach = (0.5 * WINDOW / SPACING) as usize;
        let headings = path.headings(SPACING, last + reach);
        let mut caps: Vec<f64> = (0..=last)
            .map(|i| {
                let (from, to) = (i.saturating_sub(reach), i + reach);
                let bend = wrap(headings[to] - headings[from]).abs() / ((to - from) as f64 * SPACING);
                (lateral / bend).sqrt()
            })
            .collect();
        let logged = driver.logged.windows(2).zip(driver.speeds.windows(2));
        for (s, v) in logged {
            let from = ((s[0] - AROUND).max(0.0) / SPACING).floor() as usize;
            let to = (((s[1] + AROUND) / SPACING).ceil() as usize).min(last);
            let driven = OF_LOG * v[0].max(v[1]);
            for cap in &mut caps[from.min(to)..=to] {
                *cap = cap.max(driven);
            }
        }
        Self { caps }
    }

    /// The largest speed anywhere between two arc lengths, m/s.
    fn between(&self, from: f64, to: f64) -> f64 {
        let first = (from.max(0.0) / SPACING) as usize;
        let last = (to.max(0.0) / SPACING).ceil() as usize;
        self.caps.iter().take(last + 1).skip(first).copied().fold(f64::INFINITY, f64::min)
    }

    /// Whether a profile is nowhere too fast.
    pub(super) fn keeps(&self, profile: &Profile) -> bool {
        let all = profile.s.iter().zip(&profile.v).skip(1);
        all.into_iter().all(|(&s, &v)| v <= self.between(s, s) + TOLERANCE)
    }

    /// Tightens bounds of the speeds at the steps, so that a profile which is too fast somewhere is so no longer.
    pub(super) fn tighten(&self, profile: &Profile, speeds: &mut [f64]) {
        for (bound, (&s, &v)) in speeds.iter_mut().zip(profile.s.iter().zip(&profile.v)).skip(1) {
            let cap = self.between(s - BACK, s);
            if v > NEARLY * cap {
                *bound = bound.min(cap);
            }
        }
    }
}
