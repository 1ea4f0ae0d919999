//! Matching errors between tokens and recorded motion.

use reactsim_nn::perception::Class;
use reactsim_scene::Scenario;

use super::{PreparedTrack, TOKEN_FRAMES, Vocabulary, motion_between};

/// Distances between tokenized and recorded poses: mean corner distance of the class's matching box at
/// each step, metres.
#[derive(Clone, Debug, Default)]
pub struct MatchingErrors {
    classes: [Vec<f32>; 3],
}

/// Summary of the errors of one class, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ErrorSummary {
    /// Mean.
    pub mean: f64,
    /// Median.
    pub p50: f64,
    /// 99th percentile.
    pub p99: f64,
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
        for step in (0..found.valid.len()).filter(|&s| found.valid[s]) {
            let Some(recorded) = track.pose((step + 1) * TOKEN_FRAMES) else { continue };
            let miss = motion_between(recorded, found.poses[step]);
            let corners = class.contour(super::ORIGIN).into_iter().zip(class.contour(miss));
            let mean = corners.map(|(a, b)| (a - b).norm()).sum::<f64>() / 4.0;
            self.classes[class.index()].push(mean as f32);
        }
    }

    /// Returns the summary for a class; `None` if there are no errors of it.
    pub fn of(&self, class: Class) -> Option<ErrorSummary> {
        let mut errors = self.classes[class.index()].clone();
        errors.sort_by(f32::total_cmp);
        let last = errors.len().checked_sub(1)?;
        let at = |share: f64| f64::from(errors[(share * last as f64).round() as usize]);
        let mean = errors.iter().map(|e| f64::from(*e)).sum::<f64>() / errors.len() as f64;
        Some(ErrorSummary { mean, p50: at(0.5), p99: at(0.99) })
    }
}
