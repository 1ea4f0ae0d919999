//! Names that pickles may refer to, with their meaning here.

use super::array::Dtype;

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
    /// Creates a tensor of PyTorch, a part of a storage.
    Tensor,
    /// Creates a storage from bytes that PyTorch wrote.
    Storage,
    /// The type of storages of such numbers.
    StorageOf(Dtype),
    /// Creates an object of a class.
    NewObject,
}

/// Modules whose functions are called by files that attack who opens them.
const ATTACKS: &[&str] = &[
    "__builtin__",
    "builtins",
    "code",
    "commands",
    "ctypes",
    "functools",
    "importlib",
    "multiprocessing",
    "nt",
    "operator",
    "os",
    "pickle",
    "posix",
    "pty",
    "requests",
    "runpy",
    "shutil",
    "socket",
    "subprocess",
    "sys",
    "urllib",
    "webbrowser",
];

/// Returns why a call of a name is refused: nothing is called, but such a file does harm in Python.
pub(super) fn attack(name: &str) -> Option<String> {
    let root = name.split('.').next().unwrap_or_default();
    ATTACKS.contains(&root).then(|| {
        let shown: String = name.chars().take(80).collect();
        let shown = shown.escape_debug();
        format!(
            "it tries to run code: it calls `{shown}`, which is not run; do not open the file with Python"
        )
    })
}

/// Advice for files that refer to other names.
const ADVICE: &str = "a scenario contains only numpy arrays of numbers, lists, dictionaries, texts and \
                      numbers: if you trust the file, save it again with these types only";

impl Global {
    /// Looks up a name that occurs beside those of [`Self::find`] in files of objects and tensors.
    pub(super) fn of_objects(module: &str, name: &str) -> Option<Self> {
        Some(match (module, name) {
            ("torch._utils", "_rebuild_tensor_v2") => Self::Tensor,
            ("torch.storage", "_load_from_bytes") => Self::Storage,
            ("copyreg" | "copy_reg", "_reconstructor") => Self::NewObject,
            ("torch", storage) => Self::StorageOf(Dtype::from_name(match storage {
                "FloatStorage" => "f4",
                "DoubleStorage" => "f8",
                "LongStorage" => "i8",
                "IntStorage" => "i4",
                "ShortStorage" => "i2",
                "CharStorage" => "i1",
                "ByteStorage" => "u1",
                "BoolStorage" => "b1",
                _ => return None,
            })?),
            _ => return None,
        })
    }

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
