//! Driver styles: factors of headway, desired speed and acceleration, drawn for each driver.

use rand::RngExt;
use reactsim_geometry::math;
use reactsim_rollout::Stream;
use serde::Deserialize;

/// Distributions of driver styles. Headway and acceleration are log-normal about the values of the class, the
/// desired speed is normal about the speed limit.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Styles {
    /// Standard deviation of the logarithm of the headway.
    headway: f64,
    /// Standard deviation of the factor of the desired speed.
    speed: f64,
    /// Standard deviation of the logarithm of the acceleration.
    acceleration: f64,
    /// Largest distance from the median, standard deviations.
    cutoff: f64,
}

/// Factors by which a driver differs from the parameters of its class.
#[derive(Clone, Copy, Debug)]
pub(super) struct Variation {
    /// Factor of the headway.
    pub(super) headway: f64,
    /// Factor of the desired speed.
    pub(super) speed: f64,
    /// Factor of the acceleration.
    pub(super) acceleration: f64,
}

impl Default for Variation {
    /// No difference.
    fn default() -> Self {
        Self { headway: 1.0, speed: 1.0, acceleration: 1.0 }
    }
}

/// Number of the ChaCha stream, under the key of the driver's stream, from which styles are drawn. Routes are
/// drawn from number 0, so that drivers have the same routes with and without styles.
const STYLE_STREAM: u64 = 1;

impl Styles {
    /// Draws the style of a driver with this random stream, which it does not advance.
    pub(super) fn draw(&self, driver: &Stream) -> Variation {
        let mut stream = driver.clone();
        stream.set_stream(STYLE_STREAM);
        let mut normal = || {
            let (u, v) = (1.0 - stream.random::<f64>(), stream.random::<f64>());
            math::standard_normal(u, v).clamp(-self.cutoff, self.cutoff)
        };
        Variation {
            headway: math::exp(self.headway * normal()),
            speed: 1.0 + self.speed * normal(),
            acceleration: math::exp(self.acceleration * normal()),
        }
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use reactsim_baseline::Card;

    use super::*;
    use crate::{ENTRY, STYLES};

    #[test]
    fn styles_have_the_stated_distributions() {
        let styles: Styles =
            STYLES.setup().unwrap().parameters.values()["styles"].clone().try_into().unwrap();
        let drawn: Vec<Variation> = (0..4000).map(|n| styles.draw(&Stream::seed_from_u64(n))).collect();
        let factors: [fn(&Variation) -> f64; 3] = [|v| v.headway, |v| v.speed, |v| v.acceleration];
        let expected = [[0.61, 1.0, 1.64], [0.84, 1.0, 1.16], [0.66, 1.0, 1.51]];
        for (of, expected) in factors.into_iter().zip(expected) {
            let mut values: Vec<f64> = drawn.iter().map(of).collect();
            values.sort_by(f64::total_cmp);
            for (share, expected) in [0.05, 0.5, 0.95].into_iter().zip(expected) {
                let value = values[(share * values.len() as f64) as usize];
                assert!((value - expected).abs() < 0.03, "{value}, expected {expected}");
            }
        }
        let fastest = drawn.iter().map(|v| v.speed).fold(0.0, f64::max);
        assert!(fastest <= 1.0 + 2.5 * 0.1 + 1e-12, "{fastest}");
    }

    #[test]
    fn other_parameters_are_those_of_idm() {
        let table = |card: &str| Card::read("idm", card).unwrap().parameters;
        let (mut idm, mut styles) = (table(ENTRY.card), table(STYLES.card));
        assert!(styles.remove("styles").is_some());
        for table in [&mut idm, &mut styles] {
            for class in ["vehicle", "cyclist"] {
                let class = table[class].as_table_mut().unwrap();
                assert!(class.remove("headway_spread").is_some() && class.remove("speed_spread").is_some());
            }
        }
        assert_eq!(idm, styles);
    }
}
