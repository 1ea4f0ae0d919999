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
    /// A set, or a list with a limit.
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

/// Beginnings of names that make only data of what they are called with.
const DATA: &str = "array. builtins.bytearray builtins.complex builtins.object builtins.range builtins.slice \
    builtins.xrange collections. datetime. decimal.Decimal fractions.Fraction nuplan.common. \
    pandas._libs. pathlib. shapely. torch._utils. torch.device types.SimpleNamespace uuid.UUID";

/// Packages of Python itself; its other ones begin with an underscore.
const PYTHON: &str = "abc aifc argparse array ast asynchat asyncio asyncore atexit audioop base64 bdb \
    binascii bisect builtins bz2 cProfile calendar cgi cgitb chunk cmath cmd code codecs codeop \
    collections colorsys compileall concurrent configparser contextlib contextvars copy copyreg crypt csv \
    ctypes curses dataclasses datetime dbm decimal difflib dis distutils doctest email encodings ensurepip \
    enum errno faulthandler fcntl filecmp fileinput fnmatch fractions ftplib functools gc genericpath \
    getopt getpass gettext glob graphlib grp gzip hashlib heapq hmac html http idlelib imaplib imghdr imp \
    importlib inspect io ipaddress itertools json keyword lib2to3 linecache locale logging lzma mailbox \
    mailcap marshal math mimetypes mmap modulefinder msilib msvcrt multiprocessing netrc nis nntplib nt \
    ntpath nturl2path numbers opcode operator optparse os ossaudiodev pathlib pdb pickle pickletools pipes \
    pkgutil platform plistlib poplib posix posixpath pprint profile pstats pty pwd py_compile pyclbr pydoc \
    pydoc_data pyexpat queue quopri random re readline reprlib resource rlcompleter runpy sched secrets \
    select selectors shelve shlex shutil signal site smtpd smtplib sndhdr socket socketserver spwd sqlite3 \
    sre_compile sre_constants sre_parse ssl stat statistics string stringprep struct subprocess sunau \
    symtable sys sysconfig syslog tabnanny tarfile telnetlib tempfile termios textwrap threading time \
    timeit tkinter token tokenize tomllib trace traceback tracemalloc tty turtle turtledemo types typing \
    unicodedata unittest urllib uu uuid venv warnings wave weakref webbrowser winreg winsound wsgiref \
    xdrlib xml xmlrpc zipapp zipfile zipimport zlib zoneinfo pip";

/// Returns why what a name makes is refused: nothing is called, but such a file does harm in Python. Of other
/// packages than Python's, classes are data, and functions are not.
pub(super) fn attack(name: &str) -> Option<String> {
    let root = name.split('.').next().unwrap_or_default();
    let class = name.rsplit('.').next().unwrap_or_default().trim_start_matches('_');
    let is_python = root.starts_with('_') || PYTHON.split(' ').any(|package| package == root);
    let is_class = !is_python && class.starts_with(char::is_uppercase);
    let plain = name.replacen("__builtin__.", "builtins.", 1);
    // Python's packages refer to one another: `pathlib.os.system`.
    let is_own = |rest: &str| !(is_python && rest.contains('.'));
    let is_data = is_class || DATA.split(' ').any(|data| plain.strip_prefix(data).is_some_and(is_own));
    (!is_data).then(|| {
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
            ("collections", "deque") => Self::Set,
            ("torch", storage) => Self::StorageOf(Dtype::from_name(match storage {
                "HalfStorage" => "f2",
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
