//! Sampling of tokens.

use rand::RngExt;
use reactsim_geometry::math;
use reactsim_rollout::Stream;
use serde::{Deserialize, Serialize};

/// Settings for drawing tokens from the network's distribution.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sampling {
    /// Number of likeliest tokens to draw from; 1 is greedy, 0 means all.
    pub top_k: usize,
    /// Temperature by which logits are divided; above 0.
    pub temperature: f64,
}

/// Settings for turning tokens into motion: the parameters on the cards of this family.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Driving {
    /// Whether vehicles drive tokens within the limits of the benchmark; otherwise tokens are executed
    /// exactly.
    pub projection: bool,
    /// Whether a drawn token that leads too close to other agents is replaced by a likely one that does
    /// not.
    pub keep_clear: bool,
    /// Settings for drawing tokens.
    pub sampling: Sampling,
}

/// Largest number of likeliest tokens that are kept in order while the others are passed over.
const INSERTED: usize = 32;

impl Sampling {
    /// Draws a token. One number is drawn from the stream whatever the settings. `None` if a logit is
    /// NaN or +∞.
    pub(crate) fn draw(&self, logits: &[f32], stream: &mut Stream) -> Option<usize> {
        self.draw_first(logits, stream).map(|order| order[0])
    }

    /// Returns the tokens that can be drawn: the drawn one first, then the others, likeliest first. Of
    /// equal logits, the lower index counts as likelier. `None` as for [`Self::draw`].
    pub(crate) fn draw_first(&self, logits: &[f32], stream: &mut Stream) -> Option<Vec<usize>> {
        let u: f64 = stream.random();
        // Without a branch, so that several logits are compared at once.
        let all_below_infinity = logits.iter().fold(true, |all, l| all & (*l < f32::INFINITY));
        if logits.is_empty() || !all_below_infinity {
            return None;
        }
        let k = if self.top_k == 0 { logits.len() } else { self.top_k.min(logits.len()) };
        let mut order = likeliest(logits, k);
        let best = f64::from(logits[order[0] as usize]);
        let weights: Vec<f64> = order
            .iter()
            .map(|&i| math::exp((f64::from(logits[i as usize]) - best) / self.temperature))
            .collect();
        let mut left = u * weights.iter().sum::<f64>();
        let drawn = weights.iter().position(|w| {
            left -= w;
            left < 0.0
        });
        order[..=drawn.unwrap_or(0)].rotate_right(1);
        Some(order.into_iter().map(|i| i as usize).collect())
    }

    /// Returns the probability that a token of this kind is drawn from `tokens`, of which one is drawn.
    pub(crate) fn probability(
        &self,
        logits: &[f32],
        tokens: &[usize],
        is_of_kind: impl Fn(usize) -> bool,
    ) -> f64 {
        let best = tokens.iter().map(|&token| logits[token]).fold(f32::NEG_INFINITY, f32::max);
        let (mut all, mut of_kind) = (0.0, 0.0);
        for &token in tokens {
            let weight = math::exp(f64::from(logits[token] - best) / self.temperature);
            all += weight;
            of_kind += if is_of_kind(token) { weight } else { 0.0 };
        }
        of_kind / all
    }
}

/// Returns the `k` likeliest tokens, likeliest first; of equal logits, the lower index first.
fn likeliest(logits: &[f32], k: usize) -> Vec<u32> {
    let likelier =
        |a: &u32, b: &u32| logits[*b as usize].total_cmp(&logits[*a as usize]).then_with(|| a.cmp(b));
    if k > INSERTED {
        let mut order: Vec<u32> = (0..logits.len() as u32).collect();
        if k < order.len() {
            order.select_nth_unstable_by(k - 1, likelier);
            order.truncate(k);
        }
        order.sort_unstable_by(likelier);
        return order;
    }
    let mut order: Vec<u32> = Vec::with_capacity(k + 1);
    let mut least = f32::NEG_INFINITY;
    for (token, logit) in logits.iter().enumerate() {
        if order.len() == k {
            // Most tokens end here. A later token of an equal logit counts as less likely.
            if logit.total_cmp(&least).is_le() {
                continue;
            }
            order.pop();
        }
        let token = token as u32;
        order.insert(order.partition_point(|kept| likelier(kept, &token).is_lt()), token);
        least = order.last().map_or(least, |last| logits[*last as usize]);
    }
    order
}

#[cfg(test)]
mod tests {
    use reactsim_rollout::{Purpose, stream};

    use super::*;

    fn shares(sampling: Sampling, logits: &[f32]) -> Vec<f64> {
        let mut stream = stream(0, "sampling", 0, Purpose::Plan);
        let mut counts = vec![0.0; logits.len()];
        for _ in 0..20_000 {
            counts[sampling.draw(logits, &mut stream).unwrap()] += 1.0 / 20_000.0;
        }
        counts
    }

    #[test]
    fn follows_the_distribution() {
        let logits = [2.0f32.ln(), 0.0, 5.0f32.ln(), 0.0];
        let all = shares(Sampling { top_k: 0, temperature: 1.0 }, &logits);
        for (share, expected) in all.iter().zip([2.0 / 9.0, 1.0 / 9.0, 5.0 / 9.0, 1.0 / 9.0]) {
            assert!((share - expected).abs() < 0.015, "{all:?}");
        }
        let two = shares(Sampling { top_k: 2, temperature: 1.0 }, &logits);
        assert!((two[2] - 5.0 / 7.0).abs() < 0.015 && two[1] == 0.0 && two[3] == 0.0, "{two:?}");
        let cold = shares(Sampling { top_k: 0, temperature: 0.5 }, &logits);
        assert!((cold[2] - 25.0 / 31.0).abs() < 0.015, "{cold:?}");
    }

    #[test]
    fn the_likeliest_are_those_of_a_sorted_list() {
        let logits: Vec<f32> = (0..500u32).map(|i| ((i * 7919) % 83) as f32 / 10.0 - 4.0).collect();
        let mut sorted: Vec<u32> = (0..500).collect();
        sorted.sort_by(|a, b| logits[*b as usize].total_cmp(&logits[*a as usize]));
        for k in [1, 2, 8, INSERTED, INSERTED + 1, 500] {
            assert_eq!(likeliest(&logits, k), sorted[..k], "{k}");
        }
    }

    #[test]
    fn greedy_sampling_returns_the_first_likeliest_token() {
        let mut stream = stream(0, "sampling", 0, Purpose::Plan);
        let greedy = Sampling { top_k: 1, temperature: 1.0 };
        assert_eq!(greedy.draw(&[0.0, 3.0, 3.0, 1.0], &mut stream), Some(1));
        assert_eq!(greedy.draw(&[0.0, f32::NAN], &mut stream), None);
        assert_eq!(greedy.draw(&[f32::NEG_INFINITY, 0.0], &mut stream), Some(1));
    }
}
