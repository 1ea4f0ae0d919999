//! Names of parameters in files.

/// Names in PyTorch's state dicts for fields that are named differently here: container, field,
/// name in the file.
const STORED_NAMES: &[(&str, &str, &str)] = &[
    ("Struct:LayerNorm", "gamma", "weight"),
    ("Struct:LayerNorm", "beta", "bias"),
    ("Struct:FourierEmbedding", "freqs", "freqs.weight"),
    ("Struct:FourierEmbedding", "merge_norm", "to_out.0"),
    ("Struct:FourierEmbedding", "merge", "to_out.2"),
    ("Struct:NormedMlp", "first", "0"),
    ("Struct:NormedMlp", "first_norm", "1"),
    ("Struct:NormedMlp", "second", "3"),
    ("Struct:NormedMlp", "second_norm", "4"),
    ("Struct:NormedMlp", "third", "6"),
    ("Struct:NormedMlp", "third_norm", "7"),
    ("Struct:MotionDecoder", "dense", ""),
    ("Struct:Average", "value", ""),
    ("Struct:DiffusionPlanner", "encoder", "encoder.encoder"),
    ("Struct:DiffusionPlanner", "transformer", "decoder.decoder.dit"),
    ("Struct:RouteEncoder", "mixer", "Mixer"),
    ("Struct:TransformerBlock", "modulation", "adaLN_modulation.1"),
    ("Struct:FinalLayer", "modulation", "adaLN_modulation.1"),
    ("Struct:FinalProjection", "first_norm", "0"),
    ("Struct:FinalProjection", "wide", "1"),
    ("Struct:FinalProjection", "second_norm", "3"),
    ("Struct:FinalProjection", "narrow", "4"),
];

/// Path to the current parameter in a walk over a module.
#[derive(Debug, Default)]
pub(super) struct ParameterPath {
    parts: Vec<String>,
    /// Whether the innermost part is the weight of a linear layer, which files hold as [out, in].
    linear: Vec<bool>,
}

impl ParameterPath {
    pub(super) fn enter(&mut self, name: &str, container: &str) {
        let stored = STORED_NAMES.iter().find(|(c, field, _)| (*c, *field) == (container, name));
        // Names do not include the variant of an enum: the tensors identify it.
        let name_there = if container.starts_with("Enum:") { "" } else { stored.map_or(name, |s| s.2) };
        self.parts.push(name_there.to_owned());
        self.linear.push(container == "Struct:Linear" && name == "weight");
    }

    pub(super) fn exit(&mut self) {
        self.parts.pop();
        self.linear.pop();
    }

    /// Returns the name in the file.
    pub(super) fn name(&self) -> String {
        let parts: Vec<&str> = self.parts.iter().map(String::as_str).filter(|p| !p.is_empty()).collect();
        parts.join(".")
    }

    /// Converts a shape from this program to its shape in the file.
    pub(super) fn stored_shape(&self, mut shape: Vec<usize>) -> Vec<usize> {
        if self.is_transposed() {
            shape.reverse();
        }
        shape
    }

    /// Returns whether the file holds the transpose of the current parameter.
    pub(super) fn is_transposed(&self) -> bool {
        self.linear.last() == Some(&true)
    }
}

/// Transposes [rows, columns] to [columns, rows].
pub(super) fn transpose(values: &[f32], rows: usize, columns: usize) -> Vec<f32> {
    (0..columns).flat_map(|c| (0..rows).map(move |r| values[r * columns + c])).collect()
}
