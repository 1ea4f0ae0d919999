//! Groups of operations as one operation with gradients, on the backend flex.
//!
//! burn computes and stores the result of every operation, and again its gradient. For the norms and
//! activations of many short rows this takes longer than the products between them. Here a group is one pass
//! forwards and one backwards. Results equal those of the operations but for rounding.

use std::sync::Arc;

use burn::backend::autodiff::NodeId;
use burn::backend::autodiff::checkpoint::base::Checkpointer;
use burn::backend::autodiff::checkpoint::strategy::NoCheckpointing;
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::ops::FloatTensorOps;
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, Flex};
use burn::tensor::{Device, Tensor, TensorData};

use super::host::{Finish, LearnedRows, Norm, learned_rows, matrix_gradients, row_gradients};
use super::turns::{cos_sin_rows, frequency_gradients};

/// The backend with gradients.
type Learning = Autodiff<Flex>;
/// A tensor without gradients.
type Plain = FloatTensor<Flex>;

/// Multiplies the rows of a matrix `[n, k]` with weights `[k, width]`, adds a bias, applies a norm (gain,
/// shift, constant added to variances) and ReLU, those that are given. `None` if a tensor is of another
/// backend or has no gradients, or if there are no rows.
pub(super) fn finish(
    x: &Tensor<2>,
    weights: Option<&Tensor<2>>,
    bias: Option<&Tensor<1>>,
    norm: Option<&(Tensor<1>, Option<Tensor<1>>, f32)>,
    relu: bool,
) -> Option<Tensor<2>> {
    let [count, k] = x.dims();
    let width = weights.map_or(k, |weights| weights.dims()[1]);
    if count * k * width == 0 {
        return None;
    }
    let (gain, shift, epsilon) = match norm {
        Some((gain, shift, epsilon)) => (Some(gain), shift.as_ref(), Some(*epsilon)),
        None => (None, None, None),
    };
    let device = x.device();
    let [bias, gain, shift] = [bias, gain, shift].map(|vector| tracked(vector, &device));
    let all = [tracked(Some(x), &device)?, tracked(weights, &device)?, bias?, gain?, shift?];
    let nodes = all.each_ref().map(|tensor| tensor.node());
    let [x, weights, bias, gain, shift] = all.map(|tensor| tensor.into_primitive().to_contiguous());
    let steps = Steps { width, weights, bias, gain, shift, epsilon, relu };
    let LearnedRows { rows, products } = learned_rows(numbers(&x), given(&steps.weights), &steps.finish());
    let out = Plain::from_data(TensorData::new(rows, [count, width]));
    let out = match FinishRows.prepare::<NoCheckpointing>(nodes).compute_bound().stateful() {
        OpsKind::Tracked(operation) => operation.finish((x, Arc::new(products), steps), out),
        OpsKind::UnTracked(operation) => operation.finish(out),
    };
    Some(Tensor::from_primitive::<Learning>(out))
}

/// Returns a tensor with its node in the graph; without numbers and gradient if it is absent. `None` if it is
/// of another backend.
fn tracked<const D: usize>(given: Option<&Tensor<D>>, device: &Device) -> Option<FloatTensor<Learning>> {
    match given {
        Some(tensor) => tensor.clone().try_into_primitive::<Learning>().ok(),
        None => Tensor::<1>::zeros([0], device).try_into_primitive::<Learning>().ok(),
    }
}

/// Returns the numbers of a contiguous tensor.
fn numbers(tensor: &Plain) -> &[f32] {
    &tensor.storage()[tensor.layout().start_offset()..][..tensor.layout().num_elements()]
}

/// Returns the numbers of a tensor, if it has any.
fn given(tensor: &Plain) -> Option<&[f32]> {
    Some(numbers(tensor)).filter(|numbers| !numbers.is_empty())
}

/// What [`finish`] does; absent tensors are empty.
#[derive(Clone, Debug)]
struct Steps {
    width: usize,
    weights: Plain,
    bias: Plain,
    gain: Plain,
    shift: Plain,
    epsilon: Option<f32>,
    relu: bool,
}

impl Steps {
    fn finish(&self) -> Finish<'_> {
        let norm = |epsilon| Norm { gain: numbers(&self.gain), shift: given(&self.shift), epsilon };
        Finish { width: self.width, bias: given(&self.bias), norm: self.epsilon.map(norm), relu: self.relu }
    }
}

#[derive(Debug)]
struct FinishRows;

impl Backward<Flex, 5> for FinishRows {
    /// The matrix, its products with the weights if they are needed, and the steps.
    type State = (Plain, Arc<Vec<f32>>, Steps);

    fn backward(self, ops: Ops<Self::State, 5>, grads: &mut Gradients, _: &mut Checkpointer) {
        let of_output = grads.consume::<Flex>(&ops.node).to_contiguous();
        let (x, products, steps) = ops.state;
        let finish = steps.finish();
        // Without a norm or ReLU the gradients do not depend on the products.
        let rows = match (given(&steps.weights), products.is_empty()) {
            (Some(_), true) => numbers(&of_output),
            (Some(_), false) => &products,
            (None, _) => numbers(&x),
        };
        let found = row_gradients(&finish, rows, numbers(&of_output));
        let [of_x, of_weights, of_vectors @ ..] = ops.parents.map(|parent| parent.map(|parent| parent.id));
        let mut register = |parent: NodeId, numbers: Vec<f32>, shape: &[usize]| {
            grads.register::<Flex>(parent, Plain::from_data(TensorData::new(numbers, shape)));
        };
        for (parent, gradient) in of_vectors.into_iter().zip([found.bias, found.gain, found.shift]) {
            if let Some(parent) = parent {
                register(parent, gradient, &[steps.width]);
            }
        }
        let count = found.rows.len() / steps.width;
        match (given(&steps.weights), of_x) {
            (Some(weights), Some(parent)) => {
                let gradient = matrix_gradients(&found.rows, weights, steps.width);
                register(parent, gradient, &[count, weights.len() / steps.width]);
            }
            (None, Some(parent)) => return register(parent, found.rows, &[count, steps.width]),
            (_, None) => {}
        }
        if let Some(parent) = of_weights {
            let of_rows = Plain::from_data(TensorData::new(found.rows, [count, steps.width]));
            let gradient = Flex::float_matmul(Flex::float_transpose(x), of_rows);
            grads.register::<Flex>(parent, gradient);
        }
    }
}

/// Returns a row of cos(2πfu) for all frequencies f, then sin(2πfu), then u, for every number u of a column
/// `[n, 1]`. Frequencies `[1, f]` have gradients, numbers do not. `None` if a tensor is of another backend or
/// has no gradients.
pub(super) fn cos_sin(column: &Tensor<2>, frequencies: &Tensor<2>) -> Option<Tensor<2>> {
    let column = column.clone().try_into_primitive::<Learning>().ok()?.into_primitive().to_contiguous();
    let frequencies = frequencies.clone().try_into_primitive::<Learning>().ok()?;
    let node = frequencies.node();
    let frequencies = frequencies.into_primitive().to_contiguous();
    let (column, frequencies) = (numbers(&column), numbers(&frequencies));
    let values = cos_sin_rows(column.iter().copied(), frequencies);
    let (n, count) = (column.len(), frequencies.len());
    let out = Plain::from_data(TensorData::new(values, [n, 2 * count + 1]));
    let out = match CosSin.prepare::<NoCheckpointing>([node]).compute_bound().stateful() {
        OpsKind::Tracked(operation) => operation.finish((out.clone(), count), out),
        OpsKind::UnTracked(operation) => operation.finish(out),
    };
    Some(Tensor::from_primitive::<Learning>(out))
}

#[derive(Debug)]
struct CosSin;

impl Backward<Flex, 1> for CosSin {
    /// The output, and the number of frequencies.
    type State = (Plain, usize);

    fn backward(self, ops: Ops<Self::State, 1>, grads: &mut Gradients, _: &mut Checkpointer) {
        let of_output = grads.consume::<Flex>(&ops.node).to_contiguous();
        let (rows, count) = ops.state;
        let [parent] = ops.parents;
        if let Some(parent) = parent {
            let found = frequency_gradients(numbers(&rows), numbers(&of_output), count);
            grads.register::<Flex>(parent.id, Plain::from_data(TensorData::new(found, [1, count])));
        }
    }
}

#[cfg(test)]
mod tests {
    use std::f32::consts::TAU;

    use burn::tensor::Distribution;

    use super::*;
    use crate::{device, rows};

    const ROWS: usize = 150;
    const WIDTH: usize = 24;

    fn values<const D: usize>(x: Tensor<D>) -> Vec<f32> {
        x.into_data().iter::<f32>().collect()
    }

    fn drawn<const D: usize>(shape: [usize; D], device: &Device) -> Tensor<D> {
        Tensor::random(shape, Distribution::Normal(0.3, 1.0), device)
    }

    fn assert_near(found: &[f32], expected: &[f32], what: &str) {
        assert_eq!(found.len(), expected.len(), "{what}");
        for (found, expected) in found.iter().zip(expected) {
            assert!((found - expected).abs() < 2e-4 * (1.0 + expected.abs()), "{what}: {found} {expected}");
        }
    }

    #[test]
    fn rows_and_their_gradients_are_those_of_single_operations() {
        let device = device().autodiff();
        let x = drawn([ROWS, WIDTH], &device);
        let [bias, gain, shift] = [(); 3].map(|()| drawn([WIDTH], &device));
        let (matrix, weights) = (drawn([WIDTH, WIDTH], &device), drawn([ROWS, WIDTH], &device));
        for case in 0..32 {
            let on = |bit: usize| case >> bit & 1 == 1;
            // Leaves of each way of its own.
            let run = |is_fused: bool| {
                let [x, matrix] = [&x, &matrix].map(|t| t.clone().detach().require_grad());
                let [bias, gain, shift] = [&bias, &gain, &shift].map(|v| v.clone().detach().require_grad());
                let given = on(0).then(|| bias.clone());
                let norm = on(1).then(|| (gain.clone(), on(2).then(|| shift.clone()), 1e-5));
                let out = if is_fused {
                    let matrix = on(4).then_some(&matrix);
                    finish(&x, matrix, given.as_ref(), norm.as_ref(), on(3)).expect("flex with gradients")
                } else {
                    let product = if on(4) { x.clone().matmul(matrix.clone()) } else { x.clone() };
                    rows::finish(product, given, norm, on(3))
                };
                let gradients = (out.clone() * weights.clone()).sum().backward();
                let of_vectors = [bias, gain, shift].map(|v| v.grad(&gradients).map(values));
                let of_matrix = matrix.grad(&gradients).map(values);
                (values(out), [x.grad(&gradients).map(values), of_matrix], of_vectors)
            };
            let ((out, of_matrices, of_vectors), (expected, expected_of_matrices, expected_of_vectors)) =
                (run(true), run(false));
            assert_near(&out, &expected, &format!("case {case}: values"));
            let found = of_matrices.into_iter().chain(of_vectors);
            for (found, expected) in found.zip(expected_of_matrices.into_iter().chain(expected_of_vectors)) {
                let what = format!("case {case}: gradient");
                assert_eq!(found.is_some(), expected.is_some(), "{what}");
                assert_near(&found.unwrap_or_default(), &expected.unwrap_or_default(), &what);
            }
        }
    }

    #[test]
    fn cosines_sines_and_their_gradients_are_those_of_single_operations() {
        let device = device().autodiff();
        let (column, frequencies) = (drawn([ROWS, 1], &device), drawn([1, WIDTH], &device));
        let weights = drawn([ROWS, 2 * WIDTH + 1], &device);
        let run = |is_fused: bool| {
            let f = frequencies.clone().detach().require_grad();
            let out = if is_fused {
                cos_sin(&column, &f).expect("flex with gradients")
            } else {
                let angle = column.clone().expand([ROWS, WIDTH]) * f.clone() * TAU;
                Tensor::cat(vec![angle.clone().cos(), angle.sin(), column.clone()], 1)
            };
            let gradients = (out.clone() * weights.clone()).sum().backward();
            (values(out), values(f.grad(&gradients).unwrap()))
        };
        let ((out, gradient), (expected, expected_gradient)) = (run(true), run(false));
        assert_near(&out, &expected, "values");
        assert_near(&gradient, &expected_gradient, "gradients");
    }

    #[test]
    fn other_backends_are_left_to_single_operations() {
        let plain = drawn([2, 3], &device());
        assert!(finish(&plain, None, None, None, true).is_none());
        assert!(cos_sin(&drawn([2, 1], &device()), &drawn([1, 3], &device())).is_none());
    }
}
