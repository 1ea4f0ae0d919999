//! Backends: where networks run.

use std::fmt;
use std::panic;
use std::str::FromStr;

use burn::tensor::{Device, Tensor};

#[cfg(not(any(feature = "cuda", feature = "wgpu", feature = "flex", feature = "ndarray")))]
compile_error!("networks need a backend: build with one of the features flex, ndarray, cuda, wgpu");

/// A tensor backend that this program contains (Cargo features `flex`, `ndarray`, `wgpu`, `cuda`).
///
/// An operation on flex or ndarray gives the same bits whatever else runs: both are built without threads
/// of their own, and the program distributes scenarios among threads. Published numbers come from flex.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Backend {
    /// burn's own backend for processors.
    #[cfg(feature = "flex")]
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
    #[error("backend `{name}` does not work on this machine: {reason}")]
    Unusable {
        /// Name of the backend.
        name: &'static str,
        /// Message of its driver.
        reason: String,
    },
}

fn build_hint(name: &str) -> String {
    match name {
        "flex" | "ndarray" | "wgpu" | "cuda" => format!("; build it with `--features {name}`"),
        _ => String::new(),
    }
}

impl Backend {
    /// The backends that this program contains; the first one is the default.
    pub const ALL: &'static [Self] = &[
        #[cfg(feature = "flex")]
        Self::Flex,
        #[cfg(feature = "ndarray")]
        Self::Ndarray,
        #[cfg(feature = "wgpu")]
        Self::Wgpu,
        #[cfg(feature = "cuda")]
        Self::Cuda,
    ];

    /// Returns the name used on the command line and in provenance.
    pub const fn name(self) -> &'static str {
        match self {
            #[cfg(feature = "flex")]
            Self::Flex => "flex",
            #[cfg(feature = "ndarray")]
            Self::Ndarray => "ndarray",
            #[cfg(feature = "wgpu")]
            Self::Wgpu => "wgpu",
            #[cfg(feature = "cuda")]
            Self::Cuda => "cuda",
        }
    }

    /// Returns its first device.
    // burn has announced that its ndarray backend will go; it stays here as an independent check of flex.
    #[cfg_attr(feature = "ndarray", expect(deprecated, reason = "burn-ndarray is kept for comparison"))]
    pub fn device(self) -> Device {
        match self {
            #[cfg(feature = "flex")]
            Self::Flex => Device::flex(),
            #[cfg(feature = "ndarray")]
            Self::Ndarray => Device::ndarray(),
            #[cfg(feature = "wgpu")]
            Self::Wgpu => Device::wgpu(Default::default()),
            #[cfg(feature = "cuda")]
            Self::Cuda => Device::cuda(0),
        }
    }

    const fn is_gpu(self) -> bool {
        match self {
            #[cfg(feature = "flex")]
            Self::Flex => false,
            #[cfg(feature = "ndarray")]
            Self::Ndarray => false,
            #[cfg(feature = "wgpu")]
            Self::Wgpu => true,
            #[cfg(feature = "cuda")]
            Self::Cuda => true,
        }
    }

    /// Checks that the backend computes on this machine: drivers of graphics processors may be missing.
    ///
    /// # Errors
    /// [`BackendError::Unusable`] with the message of the driver.
    pub fn check(self) -> Result<(), BackendError> {
        // Drivers panic where nothing else reports that they are missing. The message goes into the error.
        let before = panic::take_hook();
        panic::set_hook(Box::new(|_| ()));
        let sum = panic::catch_unwind(|| {
            Tensor::<1>::from_data([1.0f32, 2.0], &self.device()).sum().into_data().try_to_vec::<f32>()
        });
        panic::set_hook(before);
        let reason = match sum {
            Ok(Ok(sum)) if sum == [3.0] => return Ok(()),
            Ok(sum) => format!("1 + 2 is {sum:?}"),
            Err(cause) => {
                let text = cause.downcast_ref::<String>().map(String::as_str);
                let text = text.or_else(|| cause.downcast_ref::<&str>().copied());
                text.unwrap_or("its driver gives no reason").lines().next().unwrap_or_default().to_owned()
            }
        };
        Err(BackendError::Unusable { name: self.name(), reason })
    }
}

impl Default for Backend {
    fn default() -> Self {
        Self::ALL[0]
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

/// Returns the device of the default backend.
pub fn device() -> Device {
    Backend::default().device()
}

/// Returns whether the tensors of a device without gradients are on a graphics processor, far from the host.
pub(super) fn is_gpu(device: &Device) -> bool {
    Backend::ALL.iter().any(|backend| backend.is_gpu() && backend.device() == *device)
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

    #[test]
    fn backends_for_processors_always_work() {
        for name in ["flex", "ndarray"] {
            if let Ok(backend) = name.parse::<Backend>() {
                assert_eq!(backend.check(), Ok(()));
            }
        }
    }
}
