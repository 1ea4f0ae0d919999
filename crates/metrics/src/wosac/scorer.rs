//! Scoring of rollouts against the log of their scenario.

use std::borrow::Cow;

use reactsim_geometry::math;
use reactsim_scene::{
    AgentKind,
    wosac::{ScenarioRollouts, WosacLog, align},
};

use super::config::{Bins, Config, Estimator};
use super::displacement::average_displacement;
use super::edge_cells::EdgeCells;
use super::error::WosacError;
use super::feature::Feature;
use super::footprint::RoundedBox;
use super::histogram::{log_event_probability, log_probabilities};
use super::masks::Masks;
use super::objects::{Motion, Objects};
use super::result::{RolloutShare, WosacMetrics};
use super::road_edges::RoadEdges;
use super::steps::{Stage, StepFeatures, Surroundings};
use super::tally::{EVENTS, RolloutTallies, Tally, has_event};
use super::traffic_lights::TrafficLights;

/// A scenario, prepared for scoring any number of sets of rollouts.
pub struct Scorer<'a> {
    log: Cow<'a, WosacLog>,
    objects: Objects,
    surroundings: Surroundings,
    masks: Vec<Masks>,
    logged: Vec<StepFeatures>,
}

impl<'a> Scorer<'a> {
    /// Prepares a scenario: its map, and the features of the log.
    ///
    /// # Errors
    /// [`WosacError`] if the log is invalid, lacks the future or a road edge, or if an evaluated object or
    /// every sample of a feature is invalid.
    pub fn new(log: &'a WosacLog) -> Result<Self, WosacError> {
        Self::of(Cow::Borrowed(log))
    }

    /// Prepares a scenario as [`Self::new`] does, and keeps its log.
    ///
    /// # Errors
    /// Same as [`Self::new`].
    pub fn owning(log: WosacLog) -> Result<Self, WosacError> {
        Self::of(Cow::Owned(log))
    }

    fn of(log: Cow<'a, WosacLog>) -> Result<Self, WosacError> {
        log.check()?;
        let id = log.scenario_id.clone();
        let refused = |text: &str| Err(WosacError(format!("scenario `{id}`: {text}")));
        if !log.has_future() {
            return refused(
                "the log ends at the current frame (test split), expected 91 frames; score scenarios of the \
                 training or validation split",
            );
        }
        let objects = Objects::new(&log)?;
        let edges = RoadEdges::new(&log.road_edges);
        if edges.arrays.len() == 0 {
            return refused(
                "the map has no road edge, expected at least one: without it the distance to the road edge is \
                 undefined, and the official code fails too",
            );
        }
        let surroundings = Surroundings {
            boxes: objects.tracks(&log).map(RoundedBox::of).collect(),
            edges,
            lights: TrafficLights::new(&log),
        };
        let motion = objects.logged(&log);
        let mask = |object: usize| Masks::new(std::array::from_fn(|k| motion.is_valid(object, k)));
        let masks: Vec<Masks> = (0..objects.evaluated).map(mask).collect();
        let mut cells = EdgeCells::new(&surroundings.edges.arrays);
        let logged = (0..objects.evaluated)
            .map(|object| StepFeatures::of(&motion, &surroundings, &mut cells, object, &mut |_| ()))
            .collect();
        let scorer = Self { log, objects, surroundings, masks, logged };
        for feature in Feature::ALL {
            let mut steps = (0..scorer.objects.evaluated)
                .flat_map(|object| scorer.judged_steps(feature, object, &Config::CHALLENGE_2025));
            if scorer.logged[0].values(feature).is_some() && steps.next().is_none() {
                return refused(&format!(
                    "no logged step of {} can be judged, expected a valid AV that is a vehicle",
                    feature.name()
                ));
            }
        }
        Ok(scorer)
    }

    /// Returns the log.
    pub fn log(&self) -> &WosacLog {
        &self.log
    }

    /// Returns the ids of the evaluated objects, in the order of all results.
    pub fn evaluated(&self) -> Vec<i32> {
        self.objects.tracks(&self.log).take(self.objects.evaluated).map(|track| track.id).collect()
    }

    /// Returns the features of the log by evaluated object. Values at invalid frames have no meaning.
    pub fn logged_features(&self) -> &[StepFeatures] {
        &self.logged
    }

    /// Computes the features of every rollout by evaluated object.
    ///
    /// # Errors
    /// [`WosacError`] if the rollouts do not belong to the scenario or have invalid values.
    pub fn features(&self, rollouts: &ScenarioRollouts) -> Result<Vec<Vec<StepFeatures>>, WosacError> {
        let aligned = align(rollouts, &self.log)?;
        let mut cells = EdgeCells::new(&self.surroundings.edges.arrays);
        let mut of_rollout = |motion: &Motion| {
            (0..motion.evaluated)
                .map(|i| StepFeatures::of(motion, &self.surroundings, &mut cells, i, &mut |_| ()))
                .collect()
        };
        Ok(aligned.iter().map(|rollout| of_rollout(&self.objects.simulated(&self.log, rollout))).collect())
    }

    /// Scores rollouts by several configurations, which share all that is the same. The number of rollouts is
    /// free; the challenge requires 32.
    ///
    /// # Errors
    /// [`WosacError`] if the rollouts do not belong to the scenario or have invalid values.
    pub fn score(
        &self,
        rollouts: &ScenarioRollouts,
        configs: &[Config],
    ) -> Result<Vec<WosacMetrics>, WosacError> {
        self.score_observed(rollouts, configs, &mut |_| ())
    }

    /// Scores rollouts as [`Self::score`] does and reports every stage of the computation when it ends.
    ///
    /// # Errors
    /// Same as [`Self::score`].
    pub fn score_observed(
        &self,
        rollouts: &ScenarioRollouts,
        configs: &[Config],
        observer: &mut dyn FnMut(Stage),
    ) -> Result<Vec<WosacMetrics>, WosacError> {
        let tallies = self.tally(rollouts, configs, observer)?;
        let metrics = configs.iter().map(|config| self.metrics(&tallies, config)).collect();
        observer(Stage::Likelihoods);
        Ok(metrics)
    }

    /// Scores rollouts as [`Self::score`] does, and returns with the metrics of each configuration the share
    /// of every rollout. Features are computed once: counts of the other rollouts are those of all minus
    /// those of the rollout. A single rollout has no share, because there is no score without rollouts.
    ///
    /// # Errors
    /// Same as [`Self::score`].
    pub fn score_with_shares(
        &self,
        rollouts: &ScenarioRollouts,
        configs: &[Config],
    ) -> Result<Vec<(WosacMetrics, Vec<RolloutShare>)>, WosacError> {
        let tallies = self.tally(rollouts, configs, &mut |_| ())?;
        let without = |own: &Tally| (tallies.all.rollouts > 1).then(|| tallies.all.without(own));
        let rest: Vec<Tally> = tallies.own.iter().filter_map(without).collect();
        let scored = |config: &Config| {
            let metrics = self.metrics(&tallies, config);
            let share = |rest: &Tally| metrics.share(config, &self.likelihoods(rest, config));
            (metrics, rest.iter().map(share).collect())
        };
        Ok(configs.iter().map(scored).collect())
    }

    /// Scores rollouts as [`Self::score`] does, and divides the share of every rollout among its evaluated
    /// objects: the metric of all minus the metric without the values of one object in one rollout. Those of
    /// the other objects in the rollout stay as they are, next to the object. By rollout and object; without
    /// entries if there is one rollout.
    ///
    /// # Errors
    /// Same as [`Self::score`].
    pub fn score_with_object_shares(
        &self,
        rollouts: &ScenarioRollouts,
        config: &Config,
    ) -> Result<(WosacMetrics, Vec<Vec<RolloutShare>>), WosacError> {
        let tallies = self.tally(rollouts, std::slice::from_ref(config), &mut |_| ())?;
        let metrics = self.metrics(&tallies, config);
        if tallies.all.rollouts < 2 {
            return Ok((metrics, Vec::new()));
        }
        let objects = 0..self.objects.evaluated;
        let judged = Feature::ALL.map(|feature| {
            objects.clone().map(|object| self.judged_steps(feature, object, config).count()).sum::<usize>()
        });
        let shares = |own: &Tally| {
            let rest = tallies.all.without(own);
            let share = |object: usize| {
                let others = Feature::ALL.map(|feature| {
                    let of = (object, judged[feature as usize]);
                    let factor = self.factor((&tallies.all, &rest), config, feature, of)?;
                    Some(metrics.likelihood(feature)? * factor)
                });
                metrics.share(config, &others)
            };
            objects.clone().map(share).collect()
        };
        Ok((metrics, tallies.own.iter().map(shares).collect()))
    }

    /// Counts the features of every rollout.
    pub(super) fn tally(
        &self,
        rollouts: &ScenarioRollouts,
        configs: &[Config],
        observer: &mut dyn FnMut(Stage),
    ) -> Result<RolloutTallies, WosacError> {
        let aligned = align(rollouts, &self.log)?;
        observer(Stage::Alignment);
        let (logged, mut cells) =
            (self.objects.logged(&self.log), EdgeCells::new(&self.surroundings.edges.arrays));
        let none = Tally::new(configs, self.objects.evaluated);
        let mut tallies = RolloutTallies { own: Vec::new(), all: none.clone(), displacements: Vec::new() };
        for rollout in &aligned {
            let motion = self.objects.simulated(&self.log, rollout);
            let mut displacements = Vec::with_capacity(motion.evaluated);
            let mut own = Tally { rollouts: 1, ..none.clone() };
            for object in 0..motion.evaluated {
                let features = StepFeatures::of(&motion, &self.surroundings, &mut cells, object, observer);
                own.add(object, &features, &self.masks[object]);
                displacements.push(average_displacement(&logged, &motion, object));
                observer(Stage::Likelihoods);
            }
            tallies.all.include(&own);
            tallies.own.push(own);
            tallies.displacements.push(displacements);
        }
        Ok(tallies)
    }

    fn metrics(&self, tallies: &RolloutTallies, config: &Config) -> WosacMetrics {
        let pairs = (tallies.all.rollouts * self.objects.evaluated) as f64;
        let [collision, offroad, light] = EVENTS.map(|event| event_counts(&tallies.all, event));
        let rate = |counts: &[u32]| counts.iter().map(|&count| f64::from(count)).sum::<f64>() / pairs;
        let means: Vec<f64> = tallies.displacements.iter().map(|of_rollout| mean(of_rollout)).collect();
        let likelihoods = self.likelihoods(&tallies.all, config);
        WosacMetrics {
            metametric: config.metametric(&likelihoods),
            average_displacement_error: mean(&means),
            min_average_displacement_error: means.iter().copied().fold(f64::INFINITY, f64::min),
            likelihoods,
            simulated_collision_rate: rate(collision),
            simulated_offroad_rate: rate(offroad),
            simulated_traffic_light_violation_rate: config.has_traffic_lights().then(|| rate(light)),
        }
    }

    /// Returns the likelihoods in the order of [`Feature::ALL`]; `None` for features that the configuration
    /// does not have.
    fn likelihoods(&self, tally: &Tally, config: &Config) -> [Option<f64>; Feature::COUNT] {
        Feature::ALL.map(|feature| match config.estimators[feature as usize] {
            Estimator::Histogram(bins) => self.step_likelihood(tally, config, feature, bins),
            Estimator::Bernoulli => config.has(feature).then(|| self.event_likelihood(tally, feature)),
        })
    }

    /// Returns the likelihood of the logged values of a feature under the histograms of the rollouts. All
    /// judged steps of all objects have the same weight.
    fn step_likelihood(&self, tally: &Tally, config: &Config, feature: Feature, bins: Bins) -> Option<f64> {
        let histograms = tally.histograms(feature, bins)?;
        let (mut sum, mut count) = (0.0, 0u32);
        for (object, logged) in self.logged.iter().enumerate() {
            let values = logged.values(feature)?;
            let probabilities = log_probabilities(histograms.counts(object));
            for k in self.judged_steps(feature, object, config) {
                sum += probabilities[histograms.edges.bin(values[k])];
                count += 1;
            }
        }
        Some(math::exp(sum / f64::from(count)))
    }

    /// Returns the likelihood of the logged events under the frequencies in the rollouts. All objects have
    /// the same weight.
    fn event_likelihood(&self, tally: &Tally, event: Feature) -> f64 {
        let sum: f64 = (0..self.objects.evaluated).map(|object| self.event_term(tally, event, object)).sum();
        math::exp(sum / self.objects.evaluated as f64)
    }

    /// Returns the logarithm of the likelihood of the logged event of an object. Objects other than vehicles
    /// never violate a traffic light, but they count.
    fn event_term(&self, tally: &Tally, event: Feature, object: usize) -> f64 {
        let (counts, rollouts) = (event_counts(tally, event), tally.rollouts);
        let is_judged = event != Feature::TrafficLightViolation || self.is_vehicle(object);
        let count = if is_judged { counts[object] } else { 0 };
        match is_judged && has_event(&self.logged[object], event, &self.masks[object]) {
            true => log_event_probability(count, rollouts),
            false => log_event_probability(rollouts as u32 - count, rollouts),
        }
    }

    /// Returns the sum of the logarithms of the likelihoods of the logged values of an object.
    fn step_term(
        &self,
        tally: &Tally,
        config: &Config,
        (feature, bins): (Feature, Bins),
        object: usize,
    ) -> Option<f64> {
        let histograms = tally.histograms(feature, bins)?;
        let values = self.logged[object].values(feature)?;
        let probabilities = log_probabilities(histograms.counts(object));
        let terms = self.judged_steps(feature, object, config).map(|k| values[k]);
        Some(terms.map(|value| probabilities[histograms.edges.bin(value)]).sum())
    }

    /// Returns by which factor the likelihood of a feature changes if the counts of an object become those of
    /// another tally. `judged` is the number of steps of all objects at which the feature is judged.
    fn factor(
        &self,
        (all, rest): (&Tally, &Tally),
        config: &Config,
        feature: Feature,
        (object, judged): (usize, usize),
    ) -> Option<f64> {
        let change = match config.estimators[feature as usize] {
            Estimator::Histogram(bins) => {
                let term = |tally| self.step_term(tally, config, (feature, bins), object);
                (term(rest)? - term(all)?) / judged as f64
            }
            Estimator::Bernoulli => {
                let term = |tally| self.event_term(tally, feature, object);
                (term(rest) - term(all)) / self.objects.evaluated as f64
            }
        };
        Some(math::exp(change))
    }

    /// Returns the steps (counted from 0) at which the logged values of a feature are judged.
    fn judged_steps(
        &self,
        feature: Feature,
        object: usize,
        config: &Config,
    ) -> impl Iterator<Item = usize> + use<'_> {
        let masks = &self.masks[object];
        let mask = match feature {
            Feature::LinearSpeed | Feature::AngularSpeed => &masks.speeds,
            Feature::LinearAcceleration | Feature::AngularAcceleration => &masks.accelerations,
            _ => &masks.states,
        };
        let is_left_out = feature == Feature::TimeToCollision
            && config.limits_ttc_to_vehicles()
            && !self.is_vehicle(object);
        (0..mask.len()).filter(move |&k| mask[k] && !is_left_out)
    }

    fn is_vehicle(&self, object: usize) -> bool {
        self.objects.track(&self.log, object).kind == AgentKind::Vehicle
    }
}

/// Returns the number of rollouts with an event, by object.
fn event_counts(tally: &Tally, event: Feature) -> &[u32] {
    let index = EVENTS.iter().position(|&known| known == event).unwrap_or(0);
    &tally.events[index]
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}
