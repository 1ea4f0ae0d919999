//! Configurations of the challenge by year: ranges of the histograms, weights, and rules that changed.

use super::feature::Feature;

/// Distribution with which the rollouts of an object are compared with its log.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Estimator {
    /// Histogram of the values of all steps.
    Histogram(Bins),
    /// Probability of an event in a rollout.
    Bernoulli,
}

/// Range of a histogram and its number of equal bins. Values outside count in the outer bins.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bins {
    /// Lower limit, in the unit of the feature.
    pub min: f32,
    /// Upper limit, in the unit of the feature.
    pub max: f32,
    /// Number of bins.
    pub count: usize,
}

/// Version of the official code.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum CodeVersion {
    /// Code of the 2024 challenge: the time to collision of objects of all types is judged, traffic lights
    /// are not.
    Challenge2024,
    /// Code of the 2025 challenge, which is the present one.
    Challenge2025,
}

/// A configuration: code, estimators and weights.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    /// Name in tables and files.
    pub id: &'static str,
    /// Description for people.
    pub title: &'static str,
    /// Version of the code.
    pub code: CodeVersion,
    /// Estimators in the order of [`Feature::ALL`].
    pub estimators: [Estimator; Feature::COUNT],
    /// Weights in the metametric, in the order of [`Feature::ALL`].
    pub weights: [f32; Feature::COUNT],
}

impl Config {
    /// Configuration of the 2025 challenge.
    pub const CHALLENGE_2025: Self = Self {
        id: "2025",
        title: "Sim Agents 2025",
        code: CodeVersion::Challenge2025,
        estimators: ESTIMATORS_2024,
        weights: [0.05, 0.05, 0.05, 0.05, 0.1, 0.25, 0.1, 0.05, 0.25, 0.05],
    };
    /// Configuration of 2024 with the present code.
    pub const CONFIG_2024: Self = Self {
        id: "2024",
        title: "2024 weights, present code",
        weights: WEIGHTS_2024,
        ..Self::CHALLENGE_2025
    };
    /// Configuration of 2023 with the present code.
    pub const CONFIG_2023: Self = Self {
        id: "2023",
        title: "2023 histograms and weights, present code",
        estimators: ESTIMATORS_2023,
        weights: [0.09, 0.09, 0.09, 0.09, 0.09, 0.18, 0.09, 0.09, 0.18, 0.0],
        ..Self::CHALLENGE_2025
    };
    /// Configuration of 2024 with the code of 2024, which made the leaderboard of that year.
    pub const CHALLENGE_2024: Self = Self {
        id: "2024_challenge_code",
        title: "Sim Agents 2024",
        code: CodeVersion::Challenge2024,
        ..Self::CONFIG_2024
    };
    /// All configurations; the first is the default.
    pub const ALL: [Self; 4] =
        [Self::CHALLENGE_2025, Self::CONFIG_2024, Self::CONFIG_2023, Self::CHALLENGE_2024];

    /// Returns the configuration with this id.
    pub fn find(id: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|config| config.id == id)
    }

    /// Returns the metametric of likelihoods, which are in the order of [`Feature::ALL`]: their weighted sum.
    pub fn metametric(&self, likelihoods: &[Option<f64>; Feature::COUNT]) -> f64 {
        let weighted =
            |(likelihood, weight): (&Option<f64>, f32)| f64::from(weight) * likelihood.unwrap_or(0.0);
        likelihoods.iter().zip(self.weights).map(weighted).sum()
    }

    /// Returns whether the configuration has a feature.
    pub fn has(&self, feature: Feature) -> bool {
        feature != Feature::TrafficLightViolation || self.has_traffic_lights()
    }

    /// Returns whether traffic-light violations are judged.
    pub const fn has_traffic_lights(&self) -> bool {
        matches!(self.code, CodeVersion::Challenge2025)
    }

    /// Returns whether the time to collision is judged for vehicles only.
    pub const fn limits_ttc_to_vehicles(&self) -> bool {
        matches!(self.code, CodeVersion::Challenge2025)
    }
}

const WEIGHTS_2024: [f32; Feature::COUNT] = [0.05, 0.05, 0.05, 0.05, 0.1, 0.25, 0.1, 0.1, 0.25, 0.0];

const fn histogram(min: f32, max: f32, count: usize) -> Estimator {
    Estimator::Histogram(Bins { min, max, count })
}

#[expect(clippy::approx_constant, reason = "the challenge's bound is 3.14, not pi")]
const ESTIMATORS_2024: [Estimator; Feature::COUNT] = [
    histogram(0.0, 25.0, 10),
    histogram(-12.0, 12.0, 11),
    histogram(-0.628, 0.628, 11),
    histogram(-3.14, 3.14, 11),
    histogram(-5.0, 40.0, 10),
    Estimator::Bernoulli,
    histogram(0.0, 5.0, 10),
    histogram(-20.0, 40.0, 10),
    Estimator::Bernoulli,
    Estimator::Bernoulli,
];

const ESTIMATORS_2023: [Estimator; Feature::COUNT] = [
    histogram(0.0, 35.0, 10),
    histogram(-15.0, 15.0, 10),
    histogram(-31.5, 31.5, 10),
    histogram(-31.5, 31.5, 10),
    histogram(-5.0, 40.0, 10),
    Estimator::Bernoulli,
    histogram(0.0, 5.0, 10),
    histogram(-20.0, 40.0, 10),
    Estimator::Bernoulli,
    Estimator::Bernoulli,
];
