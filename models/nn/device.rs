//! Devices: where networks run.

use std::panic;

use burn::tensor::{Device, Tensor};
use reactsim_baseline::{Backend, BackendError};

/// Returns the first device of a backend.
// burn has announced that its ndarray backend will go; it stays here as an independent check of flex.
#[cfg_attr(feature = "ndarray", expect(deprecated, reason = "burn-ndarray is kept for comparison"))]
pub fn device_of(backend: Backend) -> Device {
    match backend {
        Backend::Flex => Device::flex(),
        #[cfg(feature = "ndarray")]
        Backend::Ndarray => Device::ndarray(),
        #[cfg(feature = "wgpu")]
        Backend::Wgpu => Device::wgpu(Default::default()),
        #[cfg(feature = "cuda")]
        Backend::Cuda => Device::cuda(0),
    }
}

/// Returns the device of the default backend.
pub fn device() -> Device {
    device_of(Backend::default())
}

const fn is_gpu_backend(backend: Backend) -> bool {
    match backend {
        Backend::Flex => false,
        #[cfg(feature = "ndarray")]
        Backend::Ndarray => false,
        #[cfg(feature = "wgpu")]
        Backend::Wgpu => true,
        #[cfg(feature = "cuda")]
        Backend::Cuda => true,
    }
}

/// Returns whether the tensors of a device without gradients are on a graphics processor, far from the host.
pub(super) fn is_gpu(device: &Device) -> bool {
    Backend::ALL.iter().any(|backend| is_gpu_backend(*backend) && device_of(*backend) == *device)
}

/// Checks that a backend computes on this machine: drivers of graphics processors may be missing.
///
/// # Errors
/// [`BackendError::Unusable`] with the message of the driver.
pub fn check_backend(backend: Backend) -> Result<(), BackendError> {
    // Drivers panic where nothing else reports that they are missing. The message goes into the error.
    let before = panic::take_hook();
    panic::set_hook(Box::new(|_| ()));
    let sum = panic::catch_unwind(|| {
        Tensor::<1>::from_data([1.0f32, 2.0], &device_of(backend)).sum().into_data().try_to_vec::<f32>()
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
    Err(BackendError::Unusable { name: backend.name(), reason })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn backends_for_processors_always_work() {
        for name in ["flex", "ndarray"] {
            if let Ok(backend) = name.parse::<Backend>() {
                assert_eq!(check_backend(backend), Ok(()));
            }
        }
    }
}
