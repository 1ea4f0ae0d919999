//! How far tokens lead past what was recorded.

use reactsim::scene::Scenario;

use super::{Class, PreparedTrack, TOKEN_FRAMES, TOKEN_STEPS, Vocabulary, motion_between};

/// Distances of tokenised from recorded poses: per step the mean distance of the corners of the class's matching box, metres.
#[derive(Clone, Debug, Default)]
pub struct MatchingErrors {
    classes: [Vec<f32>; 3],
}

/// The errors of one class in short, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ErrorSummary {
    /// Tokens that were matched.
    pub count: usize,
    /// Mean.
    pub mean: f64,
    /// Median.
    pub p50: f64,
    /// 99 % are at most this.
    pub p99: f64,
    /// Largest.
    pub max: f64,
}

impl MatchingErrors {
    /// Adds the errors of all simulated agents of a scenario, over the whole log.
    pub fn add(&mut self, vocabulary: &Vocabulary, scenario: &Scenario) {
        for (i, agent) in scenario.start.agents.iter().enumerate() {
            if let Some(class) = Class::of(agent.kind) {
                self.add_track(vocabulary, class, &PreparedTrack::new(&scenario.logged(i)));
            }
        }
    }

    /// Adds the errors of one track.
    pub fn add_track(&mut self, vocabulary: &Vocabulary, class: Class, track: &PreparedTrack) {
        let found = track.nearest_tokens(vocabulary, class);
        for step in (0..TOKEN_STEPS).filter(|&s| found.valid[s]) {
            let Some(recorded) = track.pose((step + 1) * TOKEN_FRAMES) else { continue };
            let miss = motion_between(recorded, found.poses[step]);
            let corners = class.contour(super::ORIGIN).into_iter().zip(class.contour(miss));
            let mean = corners.map(|(a, b)| (a - b).norm()).sum::<f64>() / 4.0;
            self.classes[class.index()].push(mean as f32);
        }
    }

    /// The errors of a class in short; `None` where there were none of it.
    pub fn of(&self, class: Class) -> Option<ErrorSummary> {
        let mut errors = self.classes[class.index()].clone();
        errors.sort_by(f32::total_cmp);
        let last = errors.len().checked_sub(1)?;
        let at = |share: f64| f64::from(errors[(share * last as f64).round() as usize]);
        let mean = errors.iter().map(|e| f64::from(*e)).sum::<f64>() / errors.len() as f64;
        Some(ErrorSummary { count: errors.len(), mean, p50: at(0.5), p99: at(0.99), max: at(1.0) })
    }
}
