//! The trained parameters of a network as one list of numbers.

use std::ops::Range;

use burn::module::{Module, ModuleMapper, ModuleVisitor, Param};
use burn::tensor::{Gradients, Tensor, TensorData};

/// Where the trained parameters of a network lie in a list of all of their numbers, in the order in which the network names them.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Layout {
    pub(super) parameters: Vec<Parameter>,
    pub(super) len: usize,
}

/// A trained tensor.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Parameter {
    /// The names of the modules from the network down to it, with points between.
    pub(super) path: String,
    /// What the module is that it belongs to, as burn says it, such as `Struct:Linear`.
    pub(super) owner: String,
    pub(super) shape: Vec<usize>,
    pub(super) range: Range<usize>,
}

impl Parameter {
    /// Whether weight decay is for it: for matrices, but for those of embeddings, whose rows stand for themselves.
    pub(super) fn decays(&self) -> bool {
        self.shape.len() >= 2 && self.owner != "Struct:Embedding"
    }
}

/// The layout of a network and the values of its parameters.
pub(super) fn read<M: Module>(model: &M) -> (Layout, Vec<f32>) {
    let mut reader = Reader {
        path: Path::default(),
        layout: Layout { parameters: Vec::new(), len: 0 },
        values: Vec::new(),
    };
    model.visit(&mut reader);
    (reader.layout, reader.values)
}

/// The network with these values. Its parameters are leaves of their own: what runs on it shares no graph with what runs on another copy,
/// which burn would guard by one lock.
pub(super) fn write<M: Module>(model: M, values: &[f32]) -> M {
    model.map(&mut Writer { values, at: 0 })
}

/// Adds the gradients of a network's parameters to a list of zeros of the layout's length.
pub(super) fn gradients<M: Module>(model: &M, mut gradients: Gradients, len: usize) -> Vec<f32> {
    let mut collector = Collector { gradients: &mut gradients, list: Vec::with_capacity(len) };
    model.visit(&mut collector);
    collector.list
}

/// Where a visitor is in a network.
#[derive(Default)]
struct Path {
    names: Vec<String>,
    owners: Vec<String>,
}

struct Reader {
    path: Path,
    layout: Layout,
    values: Vec<f32>,
}

impl ModuleVisitor for Reader {
    fn enter_module(&mut self, name: &str, container_type: &str) {
        self.path.names.push(name.to_owned());
        self.path.owners.push(container_type.to_owned());
    }

    fn exit_module(&mut self, _name: &str, _container_type: &str) {
        self.path.names.pop();
        self.path.owners.pop();
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
        self.layout.parameters.push(Parameter {
            path: self.path.names.join("."),
            owner: self.path.owners.last().cloned().unwrap_or_default(),
            shape,
            range: start..self.layout.len,
        });
    }
}

/// The numbers of a tensor, row by row.
fn numbers<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
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
