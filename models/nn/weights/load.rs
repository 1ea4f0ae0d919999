//! Loads tensors into a network.

use std::collections::BTreeMap;

use burn::module::{Module, ModuleMapper, ModuleVisitor, Param};
use burn::tensor::{Tensor, TensorData};

use super::names::{ParameterPath, transpose};
use super::tensors::more;
use super::{Tensors, WeightsError};

impl Tensors<'_> {
    /// Returns the network with its weights replaced by these. The file must contain every tensor
    /// of the network in its shape, and no others.
    ///
    /// # Errors
    /// [`WeightsError`] naming the first tensor, by name, that is missing, has no path or does not
    /// fit.
    pub fn load<M: Module>(&self, network: M) -> Result<M, WeightsError> {
        let mut expected_shapes = ExpectedShapes::default();
        network.visit(&mut expected_shapes);
        let found: BTreeMap<&str, &[usize]> = self.shapes().collect();

        let mut missing =
            expected_shapes.shapes.iter().filter(|(name, _)| !found.contains_key(name.as_str()));
        if let Some((name, _)) = missing.next() {
            return Err(self.missing(name, missing.count()));
        }
        let mut extra = found.iter().filter(|(name, _)| !expected_shapes.shapes.contains_key(**name));
        if let Some((name, shape)) = extra.next() {
            let more = more(extra.count());
            return Err(WeightsError::Refused(format!(
                "tensor `{name}` {shape:?} has no place in the network{more}: the weights belong to another \
                 network or configuration"
            )));
        }
        let mut values = BTreeMap::new();
        for (name, expected) in expected_shapes.shapes {
            let (found, floats) = self.floats(&name)?;
            if found != expected {
                return Err(WeightsError::Refused(format!(
                    "tensor `{name}` is {found:?}, expected {expected:?}: the configuration is not that of \
                     these weights"
                )));
            }
            values.insert(name, floats);
        }
        Ok(network.map(&mut WeightsLoader { path: ParameterPath::default(), values }))
    }
}

/// Names and shapes of a network's tensors, as in files.
#[derive(Default)]
struct ExpectedShapes {
    path: ParameterPath,
    shapes: BTreeMap<String, Vec<usize>>,
}

impl ModuleVisitor for ExpectedShapes {
    fn enter_module(&mut self, name: &str, container: &str) {
        self.path.enter(name, container);
    }

    fn exit_module(&mut self, _: &str, _: &str) {
        self.path.exit();
    }

    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        let shape = self.path.stored_shape(param.lazy_shape().as_slice().to_vec());
        self.shapes.insert(self.path.name(), shape);
    }
}

/// Replaces the weights of a network with values that have been checked.
struct WeightsLoader {
    path: ParameterPath,
    values: BTreeMap<String, Vec<f32>>,
}

impl ModuleMapper for WeightsLoader {
    fn enter_module(&mut self, name: &str, container: &str) {
        self.path.enter(name, container);
    }

    fn exit_module(&mut self, _: &str, _: &str) {
        self.path.exit();
    }

    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        let Some(values) = self.values.remove(&self.path.name()) else {
            return param;
        };
        let is_transposed = self.path.is_transposed();
        param.map(|old| {
            let shape = old.dims();
            let values = if is_transposed { transpose(&values, shape[1], shape[0]) } else { values };
            let new = Tensor::from_data(TensorData::new(values, shape), &old.device());
            // A trainable network stays trainable.
            new.set_require_grad(old.is_require_grad())
        })
    }
}
