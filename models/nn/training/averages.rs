//! Running averages of networks, such as the statistics of batch norms.

use std::collections::BTreeMap;

use burn::module::{Module, Param, ParamId};
use burn::tensor::Tensor;

use super::parameters::{Layout, numbers};

/// Share of a new value in a running average, as is usual for batch norms.
const MOMENTUM: f32 = 0.1;

/// A running average. It is stored with the parameters of a network, but the optimiser does not change it: each
/// step moves it by a tenth towards the mean of what the forward passes of the batch observed, weighted by their
/// items ([`Output::averages`](super::Output::averages)).
#[derive(Module, Debug)]
pub struct Average {
    value: Param<Tensor<1>>,
}

/// Value that a forward pass observed of a running average.
#[derive(Clone, Debug)]
pub struct Observation {
    average: ParamId,
    value: Tensor<1>,
}

impl Average {
    /// Creates an average that begins with these values.
    pub fn new(value: Tensor<1>) -> Self {
        Self { value: Param::from_tensor(value) }
    }

    /// Returns the average, which has no gradient.
    pub fn val(&self) -> Tensor<1> {
        self.value.val().detach()
    }

    /// Observes a value, of the same size, that the average is to follow.
    pub fn observe(&self, value: Tensor<1>) -> Observation {
        Observation { average: self.value.id, value: value.detach() }
    }
}

/// Sums of observations by average: values multiplied by the items of their passes, and these items.
#[derive(Debug, Default)]
pub(super) struct Observed(BTreeMap<ParamId, (Vec<f32>, f64)>);

impl Observed {
    /// Sums the observations of a pass over `items`.
    pub(super) fn of(observations: Vec<Observation>, items: f64) -> Self {
        let mut all = Self::default();
        for Observation { average, value } in observations {
            let values = numbers(value).into_iter().map(|value| value * items as f32).collect();
            all.add_one(average, values, items);
        }
        all
    }

    /// Adds the observations of further passes.
    pub(super) fn add(&mut self, others: Self) {
        for (average, (values, items)) in others.0 {
            self.add_one(average, values, items);
        }
    }

    fn add_one(&mut self, average: ParamId, values: Vec<f32>, items: f64) {
        match self.0.get_mut(&average) {
            Some((sums, all)) => {
                sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += value);
                *all += items;
            }
            None => {
                self.0.insert(average, (values, items));
            }
        }
    }

    /// Returns the first sum that is not finite.
    pub(super) fn not_finite(&self) -> Option<f32> {
        self.0.values().flat_map(|(sums, _)| sums).find(|sum| !sum.is_finite()).copied()
    }

    /// Moves the averages of a network towards what was observed.
    pub(super) fn apply(&self, layout: &Layout, values: &mut [f32]) {
        for parameter in &layout.parameters {
            let Some((sums, items)) = self.0.get(&parameter.id) else { continue };
            for (value, sum) in values[parameter.range.clone()].iter_mut().zip(sums) {
                let new = (f64::from(*sum) / items) as f32;
                *value += MOMENTUM * (new - *value);
            }
        }
    }
}
