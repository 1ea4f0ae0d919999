//! The names that pickles may use, and what is made of them.

/// A name that is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Global {
    /// Makes an empty array, which is filled later.
    Reconstruct,
    /// Makes an array of bytes.
    FromBuffer,
    /// Makes a number of a type and bytes.
    Scalar,
    /// The type of arrays.
    NdArray,
    /// Makes a type of numbers.
    Dtype,
    /// A dictionary of another name.
    Dict,
    /// A dictionary whose argument says what new entries hold.
    DefaultDict,
    /// A set.
    Set,
    /// A type that is only named, by a [`Global::DefaultDict`].
    Plain,
    /// How protocol 2 spells bytes.
    Encode,
}

/// What to do about a file that names anything else.
const MEND: &str = "a scenario holds numpy arrays of numbers, lists, dictionaries, texts and numbers, and names nothing else: if the file is \
                    to be trusted, save it again with these only";

impl Global {
    /// What a name means.
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
                return Err(format!(
                    "it names `{}`, which is not run nor looked up: {MEND}",
                    shown.escape_debug()
                ));
            }
        })
    }
}
