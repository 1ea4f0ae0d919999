//! Files of values of public code, against which tests compare ours.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::fs;
use std::path::PathBuf;

use burn::tensor::Tensor;
use reactsim_nn::Tensors;
use reactsim_test_support::shared;
use safetensors::SafeTensors;
use safetensors::tensor::Dtype;

/// A folder of values.
pub struct Golden(PathBuf);

/// A file of tensors.
pub struct GoldenFile(Vec<u8>);

impl Golden {
    /// Opens a folder of the shared data; `None`, with a message, if it is missing.
    #[track_caller]
    pub fn open(name: &str) -> Option<Self> {
        shared(name).map(Self)
    }

    /// Reads a file, named without its extension.
    pub fn file(&self, name: &str) -> GoldenFile {
        GoldenFile(fs::read(self.0.join(format!("{name}.safetensors"))).unwrap())
    }
}

impl GoldenFile {
    /// Returns all tensors, as those of a network.
    pub fn tensors(&self) -> Tensors<'_> {
        Tensors::read(&self.0).unwrap()
    }

    fn data(&self, name: &str, dtypes: &[Dtype]) -> Vec<u8> {
        let file = SafeTensors::deserialize(&self.0).unwrap();
        let tensor = file.tensor(name).unwrap_or_else(|_| panic!("no {name}"));
        assert!(dtypes.contains(&tensor.dtype()), "{name} is of type {:?}", tensor.dtype());
        tensor.data().to_vec()
    }

    /// Returns the numbers of a tensor.
    pub fn floats(&self, name: &str) -> Vec<f32> {
        self.data(name, &[Dtype::F32]).as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect()
    }

    /// Returns the indices of a tensor.
    pub fn integers(&self, name: &str) -> Vec<usize> {
        let integer = |b: &[u8; 4]| usize::try_from(i32::from_le_bytes(*b)).unwrap();
        self.data(name, &[Dtype::I32]).as_chunks::<4>().0.iter().map(integer).collect()
    }

    /// Returns the flags of a tensor.
    pub fn flags(&self, name: &str) -> Vec<bool> {
        self.data(name, &[Dtype::BOOL, Dtype::U8]).iter().map(|b| *b == 1).collect()
    }
}

/// Returns the numbers of a tensor, last axis first.
pub fn values<const D: usize>(tensor: &Tensor<D>) -> Vec<f32> {
    tensor.clone().into_data().iter::<f32>().collect()
}

/// Asserts that numbers are at most `tolerance` apart.
pub fn assert_close<T: Copy + Into<f64>>(found: &[T], wanted: &[f32], tolerance: f64, what: &str) {
    assert_eq!(found.len(), wanted.len(), "{what}");
    for (k, (found, wanted)) in found.iter().zip(wanted).enumerate() {
        let (found, wanted): (f64, f64) = ((*found).into(), f64::from(*wanted));
        // Not a number is not close.
        assert!((found - wanted).abs() <= tolerance, "{what}, number {k}: {found} instead of {wanted}");
    }
}
