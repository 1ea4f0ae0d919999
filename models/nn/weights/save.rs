//! Writes a network to bytes.

use std::collections::BTreeMap;

use burn::module::{Module, ModuleVisitor, Param};
use burn::tensor::Tensor;
use serde::Serialize;

use super::names::{ParameterPath, transpose};
use super::{CONFIG, WeightsError};

/// Returns the weights of a network as a safetensors file with these metadata;
/// [`CONFIG`] should be among them to identify the network. The same weights and
/// metadata give the same bytes.
pub fn save<M: Module>(network: &M, metadata: &BTreeMap<String, String>) -> Vec<u8> {
    collected(network, Tables::new(), metadata)
}

/// Tensors by name: shape, and values row by row.
pub type Tables = BTreeMap<String, (Vec<usize>, Vec<f32>)>;

/// Returns a network that a program reads by its configuration: weights, what is `stored` with them (tensors,
/// whose names must differ from those of weights, each with a metadata entry), and metadata, to which the
/// configuration is added as [`CONFIG`].
///
/// # Errors
/// [`WeightsError::Config`] if the configuration cannot be written as text.
pub fn save_with<M: Module>(
    network: &M,
    config: &impl Serialize,
    stored: impl IntoIterator<Item = (Tables, (String, String))>,
    metadata: &BTreeMap<String, String>,
) -> Result<Vec<u8>, WeightsError> {
    let config = serde_json::to_string(config).map_err(|e| WeightsError::Config(e.to_string()))?;
    let mut metadata = metadata.clone();
    metadata.insert(CONFIG.to_owned(), config);
    let mut tables = Tables::new();
    for (more, entry) in stored {
        tables.extend(more);
        metadata.extend([entry]);
    }
    Ok(collected(network, tables, &metadata))
}

fn collected<M: Module>(network: &M, tables: Tables, metadata: &BTreeMap<String, String>) -> Vec<u8> {
    let mut weights = TensorCollector { tensors: tables, ..TensorCollector::default() };
    network.visit(&mut weights);
    save_tables(&weights.tensors, metadata)
}

/// Returns tensors alone as a safetensors file.
pub fn save_tables(tables: &Tables, metadata: &BTreeMap<String, String>) -> Vec<u8> {
    // Not written by the crate, which orders metadata as in a hash map.
    let mut header = serde_json::Map::new();
    if !metadata.is_empty() {
        header.insert("__metadata__".into(), serde_json::json!(metadata));
    }
    let mut data = Vec::new();
    for (name, (shape, values)) in tables {
        let start = data.len();
        data.extend(values.iter().flat_map(|v| v.to_le_bytes()));
        let entry = serde_json::json!({"dtype": "F32", "shape": shape, "data_offsets": [start, data.len()]});
        header.insert(name.clone(), entry);
    }
    let mut header = serde_json::Value::Object(header).to_string().into_bytes();
    header.resize(header.len().next_multiple_of(8), b' ');
    let mut file = (header.len() as u64).to_le_bytes().to_vec();
    file.extend(header);
    file.extend(data);
    file
}

#[derive(Default)]
struct TensorCollector {
    path: ParameterPath,
    tensors: Tables,
}

impl ModuleVisitor for TensorCollector {
    fn enter_module(&mut self, name: &str, container: &str) {
        self.path.enter(name, container);
    }

    fn exit_module(&mut self, _: &str, _: &str) {
        self.path.exit();
    }

    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        let tensor = param.val();
        let shape = tensor.dims();
        let values: Vec<f32> = tensor.into_data().iter::<f32>().collect();
        let values = if self.path.is_transposed() { transpose(&values, shape[0], shape[1]) } else { values };
        self.tensors.insert(self.path.name(), (self.path.stored_shape(shape.to_vec()), values));
    }
}
