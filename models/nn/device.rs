//! Device of the networks: the one file that selects a backend.

use burn::tensor::Device;

/// Returns the name of the backend of [`device`], as recorded in provenance.
pub const fn backend() -> &'static str {
    if cfg!(feature = "cuda") {
        "cuda"
    } else if cfg!(feature = "wgpu") {
        "wgpu"
    } else if cfg!(feature = "flex") {
        "flex"
    } else {
        "ndarray"
    }
}

/// Returns the device of every network: the first of CUDA, wgpu, flex and ndarray that the program
/// was built with.
///
/// flex and ndarray are built without threads of their own. An operation gives the same bits
/// whatever else runs; the program distributes scenarios among threads.
pub fn device() -> Device {
    #[cfg(feature = "cuda")]
    return Device::cuda(0);
    #[cfg(all(feature = "wgpu", not(feature = "cuda")))]
    return Device::wgpu(Default::default());
    #[cfg(all(feature = "flex", not(any(feature = "cuda", feature = "wgpu"))))]
    return Device::flex();
    #[cfg(all(feature = "ndarray", not(any(feature = "cuda", feature = "wgpu", feature = "flex"))))]
    return Device::ndarray();
    #[cfg(not(any(feature = "cuda", feature = "wgpu", feature = "flex", feature = "ndarray")))]
    compile_error!("networks need a backend: build with one of the features flex, ndarray, cuda, wgpu");
}
