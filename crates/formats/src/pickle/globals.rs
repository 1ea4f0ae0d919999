//! Names that pickles may refer to, with their meaning here.

/// Known name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Global {
    /// Creates an empty array, which is filled later.
    Reconstruct,
    /// Creates an array from bytes.
    FromBuffer,
    /// Creates a number from a type and bytes.
    Scalar,
    /// The type of arrays.
    NdArray,
    /// Creates a number type.
    Dtype,
    /// A subclass of dictionary.
    Dict,
    /// A dictionary with a default value for new entries.
    DefaultDict,
    /// A set.
    Set,
    /// A type that occurs only as the argument of [`Global::DefaultDict`].
    Plain,
    /// Encodes a text as bytes; protocol 2 represents bytes this way.
    Encode,
}

/// Advice for files that refer to other names.
const ADVICE: &str = "a scenario contains only numpy arrays of numbers, lists, dictionaries, texts and \
                      numbers: if you trust the file, save it again with these types only";

impl Global {
    /// Looks up a name.
    pub(super) fn find(module: &str, name: &str) -> Result<Self, String> {
        // NumPy 2 moved its `core` to `_core`.
        let part = module.strip_prefix("numpy.core.").or_else(|| module.strip_prefix("numpy._core."));
        match (part, name) {
            (Some("multiarray"), "_reconstruct") => return Ok(Self::Reconstruct),
            (Some("multiarray"), "scalar") => return Ok(Self::Scalar),
            (Some("numeric"), "_frombuffer") => return Ok(Self::FromBuffer),
            _ => {}
        }
        Ok(match (module, name) {
            ("numpy", "ndarray") => Self::NdArray,
            ("numpy", "dtype") => Self::Dtype,
            ("collections", "OrderedDict")
            | ("metadrive.scenario.scenario_description", "ScenarioDescription") => Self::Dict,
            ("collections", "defaultdict") => Self::DefaultDict,
            ("builtins" | "__builtin__", "set" | "frozenset") => Self::Set,
            ("builtins" | "__builtin__", "int" | "float" | "bool" | "str" | "list" | "dict" | "tuple") => {
                Self::Plain
            }
            ("_codecs", "encode") => Self::Encode,
            _ => {
                let shown = format!("{module}.{name}");
                let shown: String = shown.chars().take(80).collect();
                return Err(format!("it names `{}`, which is not run: {ADVICE}", shown.escape_debug()));
            }
        })
    }
}
