//! Backends: what computes networks.

use std::fmt;
use std::str::FromStr;

/// A tensor backend that this program contains (Cargo features `ndarray`, `wgpu`, `cuda`; flex always).
///
/// An operation on flex or ndarray gives the same bits whatever else runs: both are built without threads
/// of their own, and the program distributes scenarios among threads. Published numbers come from flex.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Backend {
    /// burn's own backend for processors.
    #[default]
    Flex,
    /// Processors, through the crate ndarray.
    #[cfg(feature = "ndarray")]
    Ndarray,
    /// Graphics processors, through Vulkan, Metal, DirectX or WebGPU.
    #[cfg(feature = "wgpu")]
    Wgpu,
    /// NVIDIA graphics processors.
    #[cfg(feature = "cuda")]
    Cuda,
}

/// Reason why a backend cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum BackendError {
    /// The program does not contain it.
    #[error("backend `{name}`: this program contains {known}{}", build_hint(name))]
    Unknown {
        /// Requested name.
        name: String,
        /// Names of the backends that the program contains.
        known: String,
    },
    /// It does not work on this machine.
    #[error("backend `{name}` does not work on this machine: {reason}{}", usage_hint(name))]
    Unusable {
        /// Name of the backend.
        name: &'static str,
        /// Message of its driver.
        reason: String,
    },
}

fn build_hint(name: &str) -> String {
    match name {
        "ndarray" | "wgpu" | "cuda" => format!("; build it with `--features {name}`"),
        _ => String::new(),
    }
}

/// Returns what a backend needs at run time.
fn usage_hint(name: &str) -> &'static str {
    match name {
        "cuda" => {
            "; it needs an NVIDIA card with its driver (`nvidia-smi` lists both) and the CUDA toolkit, whose \
             folder CUDA_PATH names if it is not /usr/local/cuda; without `--backend` processors compute"
        }
        "wgpu" => {
            "; it needs a graphics driver with Vulkan, Metal or DirectX 12 (`vulkaninfo --summary` lists those \
             of Vulkan); without `--backend` processors compute"
        }
        _ => "",
    }
}

impl Backend {
    /// The backends that this program contains; the first one is the default.
    pub const ALL: &'static [Self] = &[
        Self::Flex,
        #[cfg(feature = "ndarray")]
        Self::Ndarray,
        #[cfg(feature = "wgpu")]
        Self::Wgpu,
        #[cfg(feature = "cuda")]
        Self::Cuda,
    ];

    /// Returns whether it computes on a graphics processor.
    pub const fn is_gpu(self) -> bool {
        match self {
            Self::Flex => false,
            #[cfg(feature = "ndarray")]
            Self::Ndarray => false,
            #[cfg(feature = "wgpu")]
            Self::Wgpu => true,
            #[cfg(feature = "cuda")]
            Self::Cuda => true,
        }
    }

    /// Returns the name used on the command line and in provenance.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Flex => "flex",
            #[cfg(feature = "ndarray")]
            Self::Ndarray => "ndarray",
            #[cfg(feature = "wgpu")]
            Self::Wgpu => "wgpu",
            #[cfg(feature = "cuda")]
            Self::Cuda => "cuda",
        }
    }
}

impl fmt::Display for Backend {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Backend {
    type Err = BackendError;

    fn from_str(name: &str) -> Result<Self, Self::Err> {
        let known = || Self::ALL.iter().map(|b| b.name()).collect::<Vec<_>>().join(", ");
        let found = Self::ALL.iter().copied().find(|b| b.name() == name);
        found.ok_or_else(|| BackendError::Unknown { name: name.to_owned(), known: known() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_contained_backend_is_found_by_name() {
        for backend in Backend::ALL {
            assert_eq!(backend.name().parse(), Ok(*backend));
        }
        let text = "tpu".parse::<Backend>().unwrap_err().to_string();
        assert!(text.starts_with("backend `tpu`: this program contains flex"), "{text}");
    }
}
