//! Haste: faster tokens made likelier, so that likely tokens alone are not slower than recorded traffic.

use reactsim_scene::DT;
use serde::{Deserialize, Serialize};

use super::tokens::TOKEN_FRAMES;

/// How much likelier tokens become that lead a vehicle farther than its present speed.
///
/// The likeliest tokens are slower than the average: of two equally good moments to set off or to regain
/// speed, the likeliest is always the later one. Bounds keep parked cars parked: beyond `most` a token gains
/// nothing more, and vehicles at `free_speed` or above gain nothing at all.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Haste {
    /// Added to the logit of a token per metre that it leads farther than the present speed, 1/m; at
    /// standstill.
    pub weight: f64,
    /// Distance gained over the present speed beyond which nothing is added, metres.
    pub most: f64,
    /// Speed at which nothing is added any more, m/s; the weight falls linearly up to it.
    pub free_speed: f64,
}

impl Haste {
    /// Returns what is added to the logit of a token that leads `ahead` metres for a vehicle at `speed` m/s.
    /// Slower tokens become less likely.
    pub(crate) fn bonus(self, ahead: f64, speed: f64) -> f64 {
        let slowness = (1.0 - speed / self.free_speed).clamp(0.0, 1.0);
        self.weight * slowness * (ahead - TOKEN_FRAMES as f64 * DT * speed).min(self.most)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HASTE: Haste = Haste { weight: 3.0, most: 0.4, free_speed: 12.0 };

    #[test]
    fn tokens_that_gain_distance_are_raised_up_to_a_bound() {
        // At 6 m/s, half the weight; its speed alone leads 3 m ahead.
        assert!(HASTE.bonus(3.0, 6.0).abs() < 1e-12);
        assert!((HASTE.bonus(3.2, 6.0) - 0.3).abs() < 1e-12);
        assert!((HASTE.bonus(3.4, 6.0) - 0.6).abs() < 1e-12);
        assert!((HASTE.bonus(5.0, 6.0) - 0.6).abs() < 1e-12);
        assert!((HASTE.bonus(2.0, 6.0) + 1.5).abs() < 1e-12);
    }

    #[test]
    fn fast_vehicles_are_in_no_haste() {
        assert_eq!(HASTE.bonus(9.0, 12.0), 0.0);
        assert_eq!(HASTE.bonus(9.0, 20.0), 0.0);
        // A vehicle that rolls back counts as one that stands.
        assert!((HASTE.bonus(0.4, -1.0) - 3.0 * 0.4).abs() < 1e-12);
    }
}
