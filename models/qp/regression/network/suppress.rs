//! Non-maximum suppression of modes.

/// Returns the modes that remain, most probable first: the most probable one whose end is at least
/// `apart` metres from the ends of all chosen before, until there are `most`. Where no such mode is
/// left, the most probable suppressed ones follow. Of equally probable modes the first is taken.
pub fn suppress(ends: &[[f64; 2]], probabilities: &[f64], apart: f64, most: usize) -> Vec<usize> {
    let mut order: Vec<usize> = (0..ends.len().min(probabilities.len())).collect();
    order.sort_by(|&a, &b| probabilities[b].total_cmp(&probabilities[a]).then(a.cmp(&b)));
    let near = |a: usize, b: usize| {
        let (x, y) = (ends[a][0] - ends[b][0], ends[a][1] - ends[b][1]);
        x * x + y * y < apart * apart
    };
    let mut kept: Vec<usize> = Vec::with_capacity(most);
    for &mode in &order {
        if kept.len() < most && !kept.iter().any(|&k| near(k, mode)) {
            kept.push(mode);
        }
    }
    for &mode in &order {
        if kept.len() < most && !kept.contains(&mode) {
            kept.push(mode);
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    const ENDS: [[f64; 2]; 4] = [[0.0, 0.0], [2.4, 0.0], [4.8, 0.0], [30.0, 1.0]];

    #[test]
    fn near_modes_are_suppressed() {
        assert_eq!(suppress(&ENDS, &[0.4, 0.3, 0.2, 0.1], 2.5, 3), [0, 2, 3]);
        assert_eq!(suppress(&ENDS, &[0.3, 0.4, 0.2, 0.1], 2.5, 2), [1, 3]);
    }

    #[test]
    fn suppressed_modes_fill_the_rest() {
        assert_eq!(suppress(&ENDS, &[0.3, 0.4, 0.2, 0.1], 2.5, 4), [1, 3, 0, 2]);
        assert_eq!(suppress(&ENDS, &[0.25; 4], 100.0, 6), [0, 1, 2, 3]);
    }

    #[test]
    fn none_of_none_and_exactly_apart_is_apart() {
        assert!(suppress(&[], &[], 2.5, 6).is_empty());
        assert_eq!(suppress(&[[0.0, 0.0], [2.5, 0.0]], &[0.5, 0.5], 2.5, 1), [0]);
        assert_eq!(suppress(&[[0.0, 0.0], [2.5, 0.0]], &[0.5, 0.5], 2.5, 2), [0, 1]);
    }
}
