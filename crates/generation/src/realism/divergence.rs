//! Divergence of two distributions.

use std::f64::consts::LN_2;

use reactsim_geometry::math;

/// Returns the Jensen-Shannon divergence of two histograms with the same bins, to base 2: 0 for identical
/// shares, 1 if no bin occurs in both (Lin, "Divergence measures based on the Shannon entropy", 1991). This
/// is the divergence itself, not its square root. `None` if a histogram is empty.
pub fn divergence(a: &[u64], b: &[u64]) -> Option<f64> {
    let (na, nb) = (a.iter().sum::<u64>() as f64, b.iter().sum::<u64>() as f64);
    if na == 0.0 || nb == 0.0 {
        return None;
    }
    let part = |p: f64, m: f64| if p > 0.0 { 0.5 * p * math::ln(p / m) / LN_2 } else { 0.0 };
    let each = a.iter().zip(b).map(|(&x, &y)| {
        let (p, q) = (x as f64 / na, y as f64 / nb);
        let m = 0.5 * (p + q);
        part(p, m) + part(q, m)
    });
    Some(each.sum::<f64>().clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn is_0_for_equal_shares_and_1_for_disjoint_ones() {
        assert_eq!(divergence(&[1, 2, 3], &[2, 4, 6]), Some(0.0));
        assert_eq!(divergence(&[1, 1, 0, 0], &[0, 0, 5, 1]), Some(1.0));
        assert_eq!(divergence(&[0, 0], &[1, 0]), None);
    }

    #[test]
    fn is_symmetric_and_known() {
        let (a, b) = ([1, 0], [1, 1]);
        assert_eq!(divergence(&a, &b), divergence(&b, &a));
        // Half of 1·log2(4/3), and half of (1/2)·log2(2/3) + (1/2)·log2(2).
        let expected = 0.5 * (4.0_f64 / 3.0).log2() + 0.25 * ((2.0_f64 / 3.0).log2() + 1.0);
        assert!((divergence(&a, &b).unwrap() - expected).abs() < 1e-12);
    }
}
