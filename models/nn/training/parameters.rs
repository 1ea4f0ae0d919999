//! The trained parameters of a network as one flat list of numbers.

use std::ops::Range;

use burn::module::{Module, ModuleMapper, ModuleVisitor, Param, ParamId};
use burn::tensor::{Gradients, Tensor, TensorData};

/// Layout of the trained parameters of a network in a flat list, in the order in which burn visits them.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Layout {
    pub(super) parameters: Vec<Parameter>,
    pub(super) len: usize,
}

/// A trained tensor.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Parameter {
    /// Names of the modules from the network down to the tensor, joined by dots.
    pub(super) path: String,
    pub(super) id: ParamId,
    pub(super) owner: Owner,
    pub(super) shape: Vec<usize>,
    pub(super) range: Range<usize>,
}

/// Type of the module that a tensor belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Owner {
    Linear,
    Embedding,
    Average,
    Other,
}

impl Owner {
    /// Converts burn's name of the type.
    fn of(container: &str) -> Self {
        match container {
            "Struct:Linear" => Self::Linear,
            "Struct:Embedding" => Self::Embedding,
            "Struct:Average" => Self::Average,
            _ => Self::Other,
        }
    }
}

/// Treatment of a tensor by the training.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Group {
    /// Optimised with weight decay: matrices other than embeddings, whose rows are independent vectors.
    Decayed,
    /// Optimised without weight decay.
    Undecayed,
    /// Follows what forward passes observe ([`Average`](super::Average)).
    Average,
}

impl Parameter {
    pub(super) fn group(&self) -> Group {
        match self.owner {
            Owner::Average => Group::Average,
            Owner::Linear | Owner::Other if self.shape.len() >= 2 => Group::Decayed,
            _ => Group::Undecayed,
        }
    }
}

/// Returns the layout of a network and the values of its parameters.
pub(super) fn read<M: Module>(model: &M) -> (Layout, Vec<f32>) {
    let mut reader = Reader {
        names: Vec::new(),
        owners: Vec::new(),
        layout: Layout { parameters: Vec::new(), len: 0 },
        values: Vec::new(),
    };
    model.visit(&mut reader);
    (reader.layout, reader.values)
}

/// Returns the paths of the trained parameters of a network, in order: names of modules, joined by dots.
pub fn parameter_paths<M: Module>(model: &M) -> Vec<String> {
    read(model).0.parameters.into_iter().map(|parameter| parameter.path).collect()
}

/// Returns the network with these values. Its parameters are new leaves, so that it shares no graph
/// with other copies, which burn would guard by one lock.
pub(super) fn write<M: Module>(model: M, values: &[f32]) -> M {
    model.map(&mut Writer { values, at: 0 })
}

/// Returns the gradients of a network's parameters as a flat list in the layout's order; unused
/// parameters have zeros.
pub(super) fn gradients<M: Module>(model: &M, mut gradients: Gradients, len: usize) -> Vec<f32> {
    let mut collector = Collector { gradients: &mut gradients, list: Vec::with_capacity(len) };
    model.visit(&mut collector);
    collector.list
}

struct Reader {
    /// Names of the modules from the network down to the current one.
    names: Vec<String>,
    /// Types of the modules that these belong to.
    owners: Vec<Owner>,
    layout: Layout,
    values: Vec<f32>,
}

impl ModuleVisitor for Reader {
    fn enter_module(&mut self, name: &str, container_type: &str) {
        self.names.push(name.to_owned());
        self.owners.push(Owner::of(container_type));
    }

    fn exit_module(&mut self, _name: &str, _container_type: &str) {
        self.names.pop();
        self.owners.pop();
    }

    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        let tensor = param.val();
        if !tensor.is_require_grad() {
            return;
        }
        let shape = tensor.dims().to_vec();
        self.values.extend(numbers(tensor));
        let start = self.layout.len;
        self.layout.len = self.values.len();
        let owner = self.owners.last().copied().unwrap_or(Owner::Other);
        // An average is a tensor to the outside.
        let inner = usize::from(owner == Owner::Average);
        self.layout.parameters.push(Parameter {
            path: self.names[..self.names.len() - inner].join("."),
            id: param.id,
            owner,
            shape,
            range: start..self.layout.len,
        });
    }
}

/// Returns the numbers of a tensor in row-major order.
pub(super) fn numbers<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
    tensor.into_data_as::<f32>().iter::<f32>().collect()
}

struct Writer<'a> {
    values: &'a [f32],
    at: usize,
}

impl ModuleMapper for Writer<'_> {
    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        if !param.val().is_require_grad() {
            return param;
        }
        param.map(|tensor| {
            let shape = tensor.shape();
            let end = self.at + shape.num_elements();
            let data = TensorData::new(self.values[self.at..end].to_vec(), shape);
            self.at = end;
            Tensor::from_data(data, &tensor.device()).require_grad()
        })
    }
}

struct Collector<'a> {
    gradients: &'a mut Gradients,
    list: Vec<f32>,
}

impl ModuleVisitor for Collector<'_> {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        let tensor = param.val();
        if !tensor.is_require_grad() {
            return;
        }
        match tensor.grad_remove(self.gradients) {
            Some(gradient) => self.list.extend(numbers(gradient)),
            // A parameter that was not used.
            None => self.list.resize(self.list.len() + tensor.shape().num_elements(), 0.0),
        }
    }
}
