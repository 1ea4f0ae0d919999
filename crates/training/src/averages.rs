//! Running averages among the parameters of a network, such as the statistics of batch norms.

use std::ops::Range;

use super::parameters::Layout;

/// Share of a new value in a running average, as is usual for batch norms.
const MOMENTUM: f32 = 0.1;

fn ranges(layout: &Layout) -> impl Iterator<Item = Range<usize>> {
    layout
        .parameters
        .iter()
        .filter(|parameter| parameter.is_average())
        .map(|parameter| parameter.range.clone())
}

/// Moves averages towards the values that the loss gave as their gradient, summed over `items`, and clears
/// that gradient, so that it has no influence on anything else.
pub(super) fn follow(layout: &Layout, values: &mut [f32], gradient: &mut [f32], items: f64) {
    for range in ranges(layout) {
        for (value, sum) in values[range.clone()].iter_mut().zip(&mut gradient[range]) {
            let new = (f64::from(*sum) / items) as f32;
            *value += MOMENTUM * (new - *value);
            *sum = 0.0;
        }
    }
}
