//! Scoring of rollouts against the log of their scenario.

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
use super::result::WosacMetrics;
use super::road_edges::RoadEdges;
use super::steps::{Stage, StepFeatures, Surroundings};
use super::tally::{EVENTS, Tally, has_event};
use super::traffic_lights::TrafficLights;

/// A scenario, prepared for scoring any number of sets of rollouts.
pub struct Scorer<'a> {
    log: &'a WosacLog,
    objects: Objects<'a>,
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
        log.check()?;
        if !log.has_future() {
            return Err(WosacError::NoFuture { scenario: log.scenario_id.clone() });
        }
        let objects = Objects::new(log)?;
        let edges = RoadEdges::new(&log.road_edges);
        if edges.arrays.len() == 0 {
            return Err(WosacError::NoRoadEdge { scenario: log.scenario_id.clone() });
        }
        let surroundings = Surroundings {
            boxes: objects.tracks.iter().map(|track| RoundedBox::of(track)).collect(),
            edges,
            lights: TrafficLights::new(log),
        };
        let motion = objects.logged();
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
                return Err(WosacError::NothingToJudge { scenario: log.scenario_id.clone(), feature });
            }
        }
        Ok(scorer)
    }

    /// Returns the ids of the evaluated objects, in the order of all results.
    pub fn evaluated(&self) -> Vec<i32> {
        self.objects.tracks[..self.objects.evaluated].iter().map(|track| track.id).collect()
    }

    /// Returns the features of the log by evaluated object. Values at invalid frames have no meaning.
    pub fn logged_features(&self) -> &[StepFeatures] {
        &self.logged
    }

    /// Computes the features of every rollout by evaluated object.
    ///
    /// # Errors
    /// [`WosacError::Invalid`] if the rollouts do not belong to the scenario or have invalid values.
    pub fn features(&self, rollouts: &ScenarioRollouts) -> Result<Vec<Vec<StepFeatures>>, WosacError> {
        let aligned = align(rollouts, self.log)?;
        let mut cells = EdgeCells::new(&self.surroundings.edges.arrays);
        let mut of_rollout = |motion: &Motion| {
            (0..motion.evaluated)
                .map(|i| StepFeatures::of(motion, &self.surroundings, &mut cells, i, &mut |_| ()))
                .collect()
        };
        Ok(aligned.iter().map(|rollout| of_rollout(&self.objects.simulated(rollout))).collect())
    }

    /// Scores rollouts by several configurations, which share all that is the same. The number of rollouts is
    /// free; the challenge requires 32.
    ///
    /// # Errors
    /// [`WosacError::Invalid`] if the rollouts do not belong to the scenario or have invalid values.
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
        let tally = self.tally(rollouts, configs, observer)?;
        let metrics = configs.iter().map(|config| self.metrics(&tally, config)).collect();
        observer(Stage::Likelihoods);
        Ok(metrics)
    }

    /// Counts the features of all rollouts.
    pub(super) fn tally(
        &self,
        rollouts: &ScenarioRollouts,
        configs: &[Config],
        observer: &mut dyn FnMut(Stage),
    ) -> Result<Tally, WosacError> {
        let aligned = align(rollouts, self.log)?;
        observer(Stage::Alignment);
        let (logged, mut cells) = (self.objects.logged(), EdgeCells::new(&self.surroundings.edges.arrays));
        let mut tally = Tally::new(configs, self.objects.evaluated);
        for rollout in &aligned {
            let motion = self.objects.simulated(rollout);
            let mut displacements = Vec::with_capacity(motion.evaluated);
            for object in 0..motion.evaluated {
                let features = StepFeatures::of(&motion, &self.surroundings, &mut cells, object, observer);
                tally.add(object, &features, &self.masks[object]);
                displacements.push(average_displacement(&logged, &motion, object));
                observer(Stage::Likelihoods);
            }
            tally.displacements.push(displacements);
        }
        Ok(tally)
    }

    fn metrics(&self, tally: &Tally, config: &Config) -> WosacMetrics {
        let rollouts = tally.displacements.len();
        let pairs = (rollouts * self.objects.evaluated) as f64;
        let [collision, offroad, light] = EVENTS.map(|event| self.event_counts(tally, event));
        let rate = |counts: &[u32]| counts.iter().map(|&count| f64::from(count)).sum::<f64>() / pairs;
        let mut likelihoods = [None; Feature::COUNT];
        for (feature, estimator) in Feature::ALL.into_iter().zip(config.estimators) {
            likelihoods[feature as usize] = match estimator {
                Estimator::Histogram(bins) => self.step_likelihood(tally, config, feature, bins),
                Estimator::Bernoulli => match feature {
                    Feature::TrafficLightViolation if !config.has_traffic_lights() => None,
                    _ => Some(self.event_likelihood(tally, feature, rollouts)),
                },
            };
        }
        let weighted =
            |(likelihood, weight): (&Option<f64>, f32)| f64::from(weight) * likelihood.unwrap_or(0.0);
        let means = tally.displacements.iter().map(|of_rollout| mean(of_rollout));
        let means: Vec<f64> = means.collect();
        WosacMetrics {
            metametric: likelihoods.iter().zip(config.weights).map(weighted).sum(),
            average_displacement_error: mean(&means),
            min_average_displacement_error: means.iter().copied().fold(f64::INFINITY, f64::min),
            likelihoods,
            simulated_collision_rate: rate(collision),
            simulated_offroad_rate: rate(offroad),
            simulated_traffic_light_violation_rate: config.has_traffic_lights().then(|| rate(light)),
        }
    }

    fn event_counts<'b>(&self, tally: &'b Tally, event: Feature) -> &'b [u32] {
        let index = EVENTS.iter().position(|&known| known == event).unwrap_or(0);
        &tally.events[index]
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
    /// the same weight. Objects other than vehicles never violate a traffic light, but they count.
    fn event_likelihood(&self, tally: &Tally, event: Feature, rollouts: usize) -> f64 {
        let counts = self.event_counts(tally, event);
        let of_object = |object: usize| {
            let is_judged = event != Feature::TrafficLightViolation || self.is_vehicle(object);
            let count = if is_judged { counts[object] } else { 0 };
            match is_judged && has_event(&self.logged[object], event, &self.masks[object]) {
                true => log_event_probability(count, rollouts),
                false => log_event_probability(rollouts as u32 - count, rollouts),
            }
        };
        let sum: f64 = (0..self.objects.evaluated).map(of_object).sum();
        math::exp(sum / self.objects.evaluated as f64)
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
        self.objects.tracks[object].kind == AgentKind::Vehicle
    }
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}
