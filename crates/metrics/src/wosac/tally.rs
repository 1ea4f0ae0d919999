//! Counts over rollouts of a scenario: histograms and events.

use reactsim_scene::FUTURE;

use super::config::{Bins, Config, Estimator};
use super::feature::Feature;
use super::histogram::Edges;
use super::masks::Masks;
use super::steps::StepFeatures;

/// The features that are events, in the order of the counts of events.
pub(super) const EVENTS: [Feature; 3] =
    [Feature::CollisionIndication, Feature::OffroadIndication, Feature::TrafficLightViolation];

/// Counts over rollouts of one scenario, for all configurations at once.
#[derive(Clone)]
pub(super) struct Tally {
    pub(super) rollouts: usize,
    /// The different histograms of the configurations.
    pub(super) histograms: Vec<Histograms>,
    /// Number of rollouts in which an event occurs at a valid step, by event and object.
    pub(super) events: [Vec<u32>; EVENTS.len()],
}

/// The counts of a set of rollouts.
pub(super) struct RolloutTallies {
    /// Counts of each rollout.
    pub(super) own: Vec<Tally>,
    /// Counts of all rollouts.
    pub(super) all: Tally,
    /// Mean displacement by rollout and object, metres.
    pub(super) displacements: Vec<Vec<f64>>,
}

/// The histograms of all evaluated objects for one feature and range.
#[derive(Clone)]
pub(super) struct Histograms {
    pub(super) feature: Feature,
    pub(super) bins: Bins,
    pub(super) edges: Edges,
    /// Counts by object and bin, one object after another.
    counts: Vec<u32>,
}

impl Histograms {
    fn add(&mut self, object: usize, values: &[f32; FUTURE]) {
        let bins = self.edges.bins();
        let counts = &mut self.counts[object * bins..(object + 1) * bins];
        for &value in values {
            counts[self.edges.bin(value)] += 1;
        }
    }

    pub(super) fn counts(&self, object: usize) -> &[u32] {
        let bins = self.edges.bins();
        &self.counts[object * bins..(object + 1) * bins]
    }
}

impl Tally {
    /// Returns the counts of no rollout.
    pub(super) fn new(configs: &[Config], objects: usize) -> Self {
        let mut histograms: Vec<Histograms> = Vec::new();
        for config in configs {
            for (feature, estimator) in Feature::ALL.into_iter().zip(config.estimators) {
                let Estimator::Histogram(bins) = estimator else { continue };
                if !histograms.iter().any(|h| h.feature == feature && h.bins == bins) {
                    let counts = vec![0; objects * bins.count];
                    histograms.push(Histograms { feature, bins, edges: Edges::new(bins), counts });
                }
            }
        }
        Self { rollouts: 0, histograms, events: std::array::from_fn(|_| vec![0; objects]) }
    }

    /// Counts the features of an object in one rollout. All steps enter the histograms; events count at the
    /// steps that are valid in the log.
    pub(super) fn add(&mut self, object: usize, features: &StepFeatures, masks: &Masks) {
        for histograms in &mut self.histograms {
            if let Some(values) = features.values(histograms.feature) {
                histograms.add(object, values);
            }
        }
        for (event, counts) in EVENTS.into_iter().zip(&mut self.events) {
            counts[object] += u32::from(has_event(features, event, masks));
        }
    }

    /// Adds the counts of other rollouts, by the same configurations.
    pub(super) fn include(&mut self, others: &Self) {
        self.rollouts += others.rollouts;
        self.combine(others, |count, other| *count += other);
    }

    /// Returns the counts without those of rollouts that are included.
    pub(super) fn without(&self, others: &Self) -> Self {
        let mut rest = self.clone();
        rest.rollouts -= others.rollouts;
        rest.combine(others, |count, other| *count -= other);
        rest
    }

    fn combine(&mut self, others: &Self, change: impl Fn(&mut u32, u32)) {
        let histograms = self.histograms.iter_mut().map(|histograms| &mut histograms.counts);
        let others_histograms = others.histograms.iter().map(|histograms| &histograms.counts);
        let counts = histograms.chain(&mut self.events).zip(others_histograms.chain(&others.events));
        for (counts, others) in counts {
            counts.iter_mut().zip(others).for_each(|(count, other)| change(count, *other));
        }
    }

    /// Returns the histograms of a feature with this range.
    pub(super) fn histograms(&self, feature: Feature, bins: Bins) -> Option<&Histograms> {
        self.histograms.iter().find(|h| h.feature == feature && h.bins == bins)
    }
}

/// Returns whether an event occurs at a step that is valid in the log.
pub(super) fn has_event(features: &StepFeatures, event: Feature, masks: &Masks) -> bool {
    (0..FUTURE).any(|k| masks.states[k] && features.has_event(event, k))
}
