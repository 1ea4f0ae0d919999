//! The elements that each element of a scene attends to: relations to them, and their features.

use burn::tensor::{Int, Tensor, TensorData};

use super::pairs::Pairs;

/// For each element, the elements that it attends to.
#[derive(Clone, Debug)]
pub(super) struct Surroundings {
    /// Relations of each element to those that it attends to, `[own, each, width]`.
    pub(super) relations: Tensor<3>,
    /// Added to the scores of these, `[own or 1, 1, 1, each]`: closed if absent.
    pub(super) closed: Tensor<4>,
    /// Rows of these, `[own * each]`; `None` if they are the same for all elements.
    rows: Option<Tensor<1, Int>>,
}

impl Surroundings {
    /// Takes relations, `[own, each, width]`; `absent`, `[elements]`, is added to the scores of elements.
    pub(super) fn new(pairs: &Pairs, relations: Tensor<3>, absent: Tensor<1>) -> Self {
        let Pairs { own, each, others } = pairs;
        let Some(others) = others else {
            let closed = absent.narrow(0, 0, *each).reshape([1, 1, 1, *each]);
            return Self { relations, closed, rows: None };
        };
        let rows: Vec<i32> = others.iter().map(|i| *i as i32).collect();
        let rows = Tensor::<1, Int>::from_data(TensorData::new(rows, [own * each]), &absent.device());
        let closed = absent.select(0, rows.clone()).reshape([*own, 1, 1, *each]);
        Self { relations, closed, rows: Some(rows) }
    }

    /// Returns the surroundings of the first elements alone.
    pub(super) fn first(&self, own: usize) -> Self {
        let each = self.relations.dims()[1];
        let closed = match &self.rows {
            Some(_) => self.closed.clone().narrow(0, 0, own),
            None => self.closed.clone(),
        };
        Self {
            relations: self.relations.clone().narrow(0, 0, own),
            closed,
            rows: self.rows.clone().map(|rows| rows.narrow(0, 0, own * each)),
        }
    }

    /// Returns the features of the seen elements, `[own or 1, each, width]`, of those of all, `[elements,
    /// width]`.
    pub(super) fn features(&self, all: Tensor<2>) -> Tensor<3> {
        let [own, each, _] = self.relations.dims();
        let width = all.dims()[1];
        match &self.rows {
            Some(rows) => all.select(0, rows.clone()).reshape([own, each, width]),
            None => all.unsqueeze_dim::<3>(0),
        }
    }
}
