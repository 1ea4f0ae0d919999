//! Rows of tensors that the scenes of a batch share.

use std::sync::Arc;

use burn::tensor::Tensor;

/// The rows of one scene in tensors that hold the rows of several scenes, such as its earlier steps as every
/// layer attends to them. All tensors have the same rows. Cloning is cheap.
#[derive(Clone, Debug)]
pub struct SharedRows {
    /// Tensors `[rows of all scenes, width]`, one per layer.
    layers: Arc<Vec<Tensor<2>>>,
    first: usize,
}

impl SharedRows {
    /// Divides the rows of these tensors, one per layer, among scenes with these numbers of rows, in order.
    pub fn divide(layers: Vec<Tensor<2>>, counts: impl IntoIterator<Item = usize>) -> Vec<Self> {
        let (layers, mut first) = (Arc::new(layers), 0);
        let part = |count| {
            let part = Self { layers: layers.clone(), first };
            first += count;
            part
        };
        counts.into_iter().map(part).collect()
    }
}

/// Collects the rows of several scenes for one forward pass. Tensors that scenes share are taken once, and
/// whole, so that the number of operations does not grow with the number of scenes.
#[derive(Debug, Default)]
pub struct RowCollector {
    /// The tensors that hold rows of the scenes, each with the row at which it begins in the joined ones.
    tables: Vec<(Arc<Vec<Tensor<2>>>, usize)>,
    rows: usize,
}

impl RowCollector {
    /// Adds the rows of a scene. Returns the number of the first of them in the joined tensors; the others
    /// follow it.
    pub fn add(&mut self, part: &SharedRows) -> usize {
        // Scenes that share tensors are usually added one after the other.
        let known = self.tables.iter().rev().find(|(layers, _)| Arc::ptr_eq(layers, &part.layers));
        let begin = known.map_or(self.rows, |(_, begin)| *begin);
        if known.is_none() {
            self.rows += part.layers.first().map_or(0, |layer| layer.dims()[0]);
            self.tables.push((part.layers.clone(), begin));
        }
        begin + part.first
    }

    /// Returns the number of rows of the joined tensors.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Returns the joined tensors, one per layer; `None` if nothing was added.
    pub fn joined(&self) -> Option<Vec<Tensor<2>>> {
        let (first, _) = self.tables.first()?;
        if self.tables.len() == 1 {
            return Some(first.as_ref().clone());
        }
        let layer =
            |i: usize| Tensor::cat(self.tables.iter().map(|(layers, _)| layers[i].clone()).collect(), 0);
        Some((0..first.len()).map(layer).collect())
    }
}

#[cfg(test)]
mod tests {
    use burn::tensor::TensorData;

    use super::*;
    use crate::device;

    /// Returns two layers of rows with one number each, of which those of the second layer are negative.
    fn layers(values: &[f32]) -> Vec<Tensor<2>> {
        let layer = |sign: f32| {
            let values: Vec<f32> = values.iter().map(|v| v * sign).collect();
            let count = values.len();
            Tensor::from_data(TensorData::new(values, [count, 1]), &device())
        };
        vec![layer(1.0), layer(-1.0)]
    }

    #[test]
    fn shared_tensors_are_joined_once() {
        let older = SharedRows::divide(layers(&[1.0, 2.0, 3.0]), [1, 2]);
        let newer = SharedRows::divide(layers(&[4.0, 5.0, 6.0]), [1, 2]);
        let mut all = RowCollector::default();
        assert!(all.joined().is_none());
        // The second scene alone, then the first one.
        let firsts = [&older[1], &newer[1], &older[0], &newer[0]].map(|part| all.add(part));
        assert_eq!((firsts, all.rows()), ([1, 4, 0, 3], 6));
        let joined = all.joined().unwrap();
        let values = |layer: &Tensor<2>| layer.clone().into_data().iter::<f32>().collect::<Vec<_>>();
        assert_eq!(values(&joined[0]), [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        assert_eq!(values(&joined[1]), [-1.0, -2.0, -3.0, -4.0, -5.0, -6.0]);
    }
}
