//! The metrics of a scenario or of a set of scenarios.

use serde::{Deserialize, Serialize};

use super::config::Config;
use super::feature::{Bucket, Feature};

/// The metrics of the official message `SimAgentMetrics`, of one scenario or as means of several. `None`: the
/// configuration does not have the metric.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WosacMetrics {
    /// Weighted sum of the likelihoods.
    pub metametric: f64,
    /// Mean displacement from the log over rollouts and evaluated objects, metres.
    pub average_displacement_error: f64,
    /// Smallest mean displacement of any rollout, metres.
    pub min_average_displacement_error: f64,
    /// Likelihoods in the order of [`Feature::ALL`], in (0, 1].
    pub likelihoods: [Option<f64>; Feature::COUNT],
    /// Share of simulated objects that collide.
    pub simulated_collision_rate: f64,
    /// Share of simulated objects that leave the road.
    pub simulated_offroad_rate: f64,
    /// Share of simulated objects that violate a traffic light.
    pub simulated_traffic_light_violation_rate: Option<f64>,
}

/// Share of a rollout in the metrics of its scenario: the metric of all rollouts minus the metric of all
/// others, as if the rollout did not exist. Negative: the scenario has a better score without the rollout.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RolloutShare {
    /// Share in the metametric.
    pub metametric: f64,
    /// Shares in the likelihoods, in the order of [`Feature::ALL`]. `None`: the configuration does not have
    /// the feature.
    pub likelihoods: [Option<f64>; Feature::COUNT],
}

impl WosacMetrics {
    /// Returns the likelihood of a feature.
    pub fn likelihood(&self, feature: Feature) -> Option<f64> {
        self.likelihoods[feature as usize]
    }

    /// Returns the share of a rollout; `others` are the likelihoods without it, in the same configuration.
    pub(super) fn share(&self, config: &Config, others: &[Option<f64>; Feature::COUNT]) -> RolloutShare {
        let difference = |i: usize| Some(self.likelihoods[i]? - others[i]?);
        RolloutShare {
            metametric: self.metametric - config.metametric(others),
            likelihoods: std::array::from_fn(difference),
        }
    }

    /// Returns all metrics with the field names of the official message, in the order of its tags.
    pub fn fields(&self) -> Vec<(&'static str, Option<f64>)> {
        let likelihood = |feature: Feature| (feature.likelihood_name(), self.likelihood(feature));
        let mut fields = vec![
            ("metametric", Some(self.metametric)),
            ("average_displacement_error", Some(self.average_displacement_error)),
        ];
        fields.extend(
            Feature::ALL.into_iter().filter(|f| *f != Feature::TrafficLightViolation).map(likelihood),
        );
        fields.extend([
            ("min_average_displacement_error", Some(self.min_average_displacement_error)),
            ("simulated_collision_rate", Some(self.simulated_collision_rate)),
            ("simulated_offroad_rate", Some(self.simulated_offroad_rate)),
            likelihood(Feature::TrafficLightViolation),
            ("simulated_traffic_light_violation_rate", self.simulated_traffic_light_violation_rate),
        ]);
        fields
    }

    /// Returns the aggregates of a leaderboard with the field names of the official message
    /// `SimAgentsBucketedMetrics`, in the order of its tags: among others the weighted means of the
    /// likelihoods of each [`Bucket`]. `config` is the configuration of these metrics.
    pub fn buckets(&self, config: &Config) -> [(&'static str, Option<f64>); 8] {
        let mean = |bucket: Bucket| {
            let (mut sum, mut weights) = (0.0, 0.0);
            for feature in Feature::ALL.into_iter().filter(|feature| feature.bucket() == bucket) {
                if let Some(likelihood) = self.likelihood(feature) {
                    let weight = f64::from(config.weights[feature as usize]);
                    sum += weight * likelihood;
                    weights += weight;
                }
            }
            sum / weights
        };
        [
            ("realism_meta_metric", Some(self.metametric)),
            ("kinematic_metrics", Some(mean(Bucket::Kinematic))),
            ("interactive_metrics", Some(mean(Bucket::Interactive))),
            ("map_based_metrics", Some(mean(Bucket::MapBased))),
            ("min_ade", Some(self.min_average_displacement_error)),
            ("simulated_collision_rate", Some(self.simulated_collision_rate)),
            ("simulated_offroad_rate", Some(self.simulated_offroad_rate)),
            ("simulated_traffic_light_violation_rate", self.simulated_traffic_light_violation_rate),
        ]
    }
}

/// The unweighted mean over scenarios, of every metric. Sums are formed in the order of the scenarios.
#[derive(Clone, Copy, Debug, Default)]
pub struct MeanMetrics {
    sum: WosacMetrics,
    scenarios: u64,
}

impl MeanMetrics {
    /// Adds a scenario. All scenarios must be of one configuration.
    pub fn add(&mut self, metrics: &WosacMetrics) {
        self.sum = match self.scenarios {
            0 => *metrics,
            _ => self.sum.zip(metrics, |sum, value| sum + value),
        };
        self.scenarios += 1;
    }

    /// Returns the number of scenarios.
    pub fn scenarios(&self) -> u64 {
        self.scenarios
    }

    /// Returns the mean; `None` without scenarios.
    pub fn mean(&self) -> Option<WosacMetrics> {
        let scenarios = self.scenarios as f64;
        (self.scenarios > 0).then(|| self.sum.zip(&self.sum, |sum, _| sum / scenarios))
    }
}

impl WosacMetrics {
    /// Combines two results metric by metric; a metric that one of them lacks is absent.
    fn zip(&self, other: &Self, f: impl Fn(f64, f64) -> f64) -> Self {
        let both = |a: Option<f64>, b: Option<f64>| Some(f(a?, b?));
        Self {
            metametric: f(self.metametric, other.metametric),
            average_displacement_error: f(self.average_displacement_error, other.average_displacement_error),
            min_average_displacement_error: f(
                self.min_average_displacement_error,
                other.min_average_displacement_error,
            ),
            likelihoods: std::array::from_fn(|i| both(self.likelihoods[i], other.likelihoods[i])),
            simulated_collision_rate: f(self.simulated_collision_rate, other.simulated_collision_rate),
            simulated_offroad_rate: f(self.simulated_offroad_rate, other.simulated_offroad_rate),
            simulated_traffic_light_violation_rate: both(
                self.simulated_traffic_light_violation_rate,
                other.simulated_traffic_light_violation_rate,
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_are_unweighted_and_absent_metrics_stay_absent() {
        let mut mean = MeanMetrics::default();
        assert_eq!(mean.mean(), None);
        for (metametric, lights) in [(0.25, Some(1.0)), (0.75, Some(0.5))] {
            let mut likelihoods = [Some(0.5); Feature::COUNT];
            likelihoods[0] = None;
            likelihoods[9] = lights;
            mean.add(&WosacMetrics { metametric, likelihoods, ..WosacMetrics::default() });
        }
        let found = mean.mean().unwrap();
        assert_eq!((found.metametric, mean.scenarios()), (0.5, 2));
        assert_eq!(found.likelihood(Feature::LinearSpeed), None);
        assert_eq!(found.likelihood(Feature::TrafficLightViolation), Some(0.75));
        assert_eq!(found.simulated_traffic_light_violation_rate, None);
    }

    #[test]
    fn buckets_are_weighted_means() {
        let mut likelihoods = [Some(1.0); Feature::COUNT];
        likelihoods[Feature::DistanceToRoadEdge as usize] = Some(0.0);
        likelihoods[Feature::TrafficLightViolation as usize] = None;
        let metrics = WosacMetrics { likelihoods, ..WosacMetrics::default() };
        let buckets = metrics.buckets(&Config::CHALLENGE_2024);
        let [_, (_, kinematic), _, (_, map_based), ..] = buckets;
        assert!((map_based.unwrap() - 0.25 / 0.35).abs() < 1e-7);
        assert_eq!(kinematic, Some(1.0));
    }
}
