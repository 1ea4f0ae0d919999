//! Devices: where networks run.

use std::panic;
use std::sync::{Arc, Mutex, PoisonError};

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

/// Returns whether the tensors of a device without gradients are on a graphics processor, far from the host.
pub(super) fn is_gpu(device: &Device) -> bool {
    Backend::ALL.iter().any(|backend| backend.is_gpu() && device_of(*backend) == *device)
}

/// Checks that a backend computes on this machine: drivers of graphics processors, or the libraries that their
/// compilers need, may be missing.
///
/// # Errors
/// [`BackendError::Unusable`] with the message of the driver.
pub fn check_backend(backend: Backend) -> Result<(), BackendError> {
    // Drivers panic where nothing else reports that they are missing, and on threads of their own: the first
    // message has the reason, the later ones only that another thread has ended.
    let first = Arc::new(Mutex::new(None));
    let before = panic::take_hook();
    let messages = Arc::clone(&first);
    panic::set_hook(Box::new(move |panic| {
        let text = panic.payload_as_str().unwrap_or_default().to_owned();
        messages.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(text);
    }));
    // The cosine is not an instruction of every device: it also needs the library of mathematical functions.
    let sum = panic::catch_unwind(|| {
        let zeros = Tensor::<1>::from_data([0.0f32, 0.0], &device_of(backend));
        zeros.cos().sum().into_data().try_to_vec::<f32>()
    });
    panic::set_hook(before);
    let reason = match sum {
        Ok(Ok(sum)) if sum == [2.0] => return Ok(()),
        Ok(sum) => format!("the sum of two cosines of 0 is {sum:?}"),
        Err(_) => {
            let first = first.lock().unwrap_or_else(PoisonError::into_inner).take().unwrap_or_default();
            let line = first.lines().map(str::trim).find(|line| !line.is_empty());
            let line = line.unwrap_or("its driver gives no reason");
            // Lists of all names that were tried do not help.
            line.split(" - searched for").next().unwrap_or(line).to_owned()
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
