//! Tensors into a network.

use std::collections::BTreeMap;

use burn::module::{Module, ModuleMapper, ModuleVisitor, Param};
use burn::tensor::{Tensor, TensorData};

use super::names::{Place, turn};
use super::{Tensors, WeightsError};

impl Tensors<'_> {
    /// The network with these weights in place of its own. Every tensor of the network must be there, in its shape, and nothing else.
    ///
    /// # Errors
    /// [`WeightsError`] that names the first tensor, by name, that is missing, has no place, or is not what the network wants.
    pub fn load<M: Module>(&self, network: M) -> Result<M, WeightsError> {
        let mut wanted = Wanted::default();
        network.visit(&mut wanted);
        let found: BTreeMap<&str, &[usize]> = self.shapes().collect();

        let mut missing = wanted.shapes.iter().filter(|(name, _)| !found.contains_key(name.as_str()));
        if let Some((name, expected)) = missing.next() {
            let (name, expected) = (name.clone(), expected.clone());
            return Err(WeightsError::Missing { name, expected, others: missing.count() });
        }
        let mut extra = found.iter().filter(|(name, _)| !wanted.shapes.contains_key(**name));
        if let Some((name, shape)) = extra.next() {
            let (name, found) = ((*name).to_owned(), shape.to_vec());
            return Err(WeightsError::Extra { name, found, others: extra.count() });
        }
        let mut values = BTreeMap::new();
        for (name, expected) in wanted.shapes {
            let (found, floats) = self.floats(&name)?;
            if found != expected {
                return Err(WeightsError::Shape { name, expected, found: found.to_vec() });
            }
            values.insert(name, floats);
        }
        Ok(network.map(&mut Placing { place: Place::default(), values }))
    }
}

/// Names and shapes, as in files, of what a network has.
#[derive(Default)]
struct Wanted {
    place: Place,
    shapes: BTreeMap<String, Vec<usize>>,
}

impl ModuleVisitor for Wanted {
    fn enter_module(&mut self, name: &str, container: &str) {
        self.place.enter(name, container);
    }

    fn exit_module(&mut self, _: &str, _: &str) {
        self.place.exit();
    }

    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        let shape = self.place.stored_shape(param.lazy_shape().as_slice().to_vec());
        self.shapes.insert(self.place.name(), shape);
    }
}

/// Puts values where they belong; they have been checked.
struct Placing {
    place: Place,
    values: BTreeMap<String, Vec<f32>>,
}

impl ModuleMapper for Placing {
    fn enter_module(&mut self, name: &str, container: &str) {
        self.place.enter(name, container);
    }

    fn exit_module(&mut self, _: &str, _: &str) {
        self.place.exit();
    }

    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        let Some(values) = self.values.remove(&self.place.name()) else {
            return param;
        };
        let turned = self.place.turned();
        param.map(|old| {
            let shape = old.dims();
            let values = if turned { turn(&values, shape[1], shape[0]) } else { values };
            let new = Tensor::from_data(TensorData::new(values, shape), &old.device());
            // A network that is to be trained goes on being one.
            new.set_require_grad(old.is_require_grad())
        })
    }
}
