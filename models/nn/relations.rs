//! Relation vectors of pairs, laid out for matrix products.

use burn::tensor::{Tensor, TensorData};

use super::Neighbors;
use super::device::is_gpu;

/// The relation vector of every slot of [`Neighbors`], as rows and as columns: scores use the
/// columns, messages the rows.
#[derive(Clone, Debug)]
pub struct Relations {
    /// Shape [N, K, r].
    pub(super) rows: Tensor<3>,
    /// Shape [N, r, K].
    pub(super) columns: Tensor<3>,
}

impl Relations {
    /// Builds relations from the vectors of slots, [N, K, r].
    pub fn new(rows: Tensor<3>) -> Self {
        Self { columns: rows.clone().swap_dims(1, 2), rows }
    }

    /// Builds relations from the vectors of edges, [E, r], for several layers. The values equal
    /// those of [`Relations::new`] of [`Neighbors::relations`]. If no gradients are needed, the
    /// columns are stored contiguously once instead of being transposed again in every layer.
    pub fn of_edges(neighbors: &Neighbors, edges: Tensor<2>) -> Self {
        let device = edges.device();
        let relations = Self::new(neighbors.relations(edges));
        let [count, slots, width] = relations.rows.dims();
        if device.is_autodiff() || slots == 0 || is_gpu(&device) {
            return relations;
        }
        let values: Vec<f32> = relations.rows.to_data().iter::<f32>().collect();
        let mut columns = vec![0.0f32; values.len()];
        for (from, to) in values.chunks_exact(slots * width).zip(columns.chunks_exact_mut(slots * width)) {
            transpose(from, to, slots, width);
        }
        let columns = Tensor::from_data(TensorData::new(columns, [count, width, slots]), &device);
        Self { rows: relations.rows, columns }
    }
}

/// Transposes [rows, columns] to [columns, rows], tile by tile.
fn transpose(from: &[f32], to: &mut [f32], rows: usize, columns: usize) {
    const TILE: usize = 16;
    for first in (0..columns).step_by(TILE) {
        for row in (0..rows).step_by(TILE) {
            for column in first..(first + TILE).min(columns) {
                let line = &mut to[column * rows..][row..(row + TILE).min(rows)];
                for (i, value) in line.iter_mut().enumerate() {
                    *value = from[(row + i) * columns + column];
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_become_columns() {
        for (rows, columns) in [(1, 1), (3, 40), (16, 16), (35, 17)] {
            let from: Vec<f32> = (0..rows * columns).map(|i| i as f32).collect();
            let mut to = vec![-1.0; rows * columns];
            transpose(&from, &mut to, rows, columns);
            for (r, c) in (0..rows).flat_map(|r| (0..columns).map(move |c| (r, c))) {
                assert_eq!(to[c * rows + r], from[r * columns + c]);
            }
        }
    }
}
