//! Numbers of tensors in host memory.

use burn::backend::Flex;
use burn::backend::tensor::FloatTensor;
use burn::tensor::{Tensor, TensorData};

use super::slice;

/// The numbers of a tensor, row by row. Those of the backend flex are read where they are: most tensors that
/// are read here are shared, weights always, and would be copied otherwise.
pub(crate) enum Numbers {
    Flex(FloatTensor<Flex>),
    Copied(TensorData),
}

impl Numbers {
    /// Gives access to the numbers of a tensor.
    pub(crate) fn of<const D: usize>(tensor: Tensor<D>) -> Self {
        match tensor.clone().try_into_primitive::<Flex>() {
            Ok(own) if own.as_slice::<f32>().is_some() => Self::Flex(own),
            Ok(own) => Self::Flex(own.to_contiguous()),
            Err(_) => Self::Copied(tensor.into_data()),
        }
    }

    /// Returns the numbers of a tensor to change them: its own if nothing else refers to them, else a copy.
    pub(crate) fn own<const D: usize>(tensor: Tensor<D>) -> TensorData {
        let shape = tensor.dims();
        let Ok(own) = tensor.clone().try_into_primitive::<Flex>() else { return tensor.into_data() };
        drop(tensor);
        match own.as_slice::<f32>() {
            Some(numbers) if !own.is_unique() => TensorData::new(numbers.to_vec(), shape),
            _ => own.into_data(),
        }
    }

    pub(crate) fn slice(&self) -> &[f32] {
        match self {
            // Networks are loaded and computed in this type.
            Self::Flex(tensor) => tensor.as_slice().expect("32-bit floating-point numbers"),
            Self::Copied(data) => slice(data),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device;

    #[test]
    fn the_numbers_of_views_are_those_of_their_copies() {
        let values: Vec<f32> = (0..24u8).map(f32::from).collect();
        let x = Tensor::<2>::from_data(TensorData::new(values, [6, 4]), &device());
        let views = [
            x.clone(),
            x.clone().narrow(0, 2, 3),
            x.clone().narrow(0, 0, 2),
            x.clone().narrow(1, 1, 2),
            x.transpose(),
        ];
        for view in views {
            let copied: Vec<f32> = view.clone().into_data().iter::<f32>().collect();
            assert_eq!(Numbers::of(view).slice(), copied);
        }
    }
}
