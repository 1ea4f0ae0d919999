//! Files of weights: round trips, and every way in which they can be wrong.

use std::collections::BTreeMap;

use burn::tensor::Device;
use reactsim::models::nn::{Initializer, Perceptron, PerceptronKind, Tensors, save};
use safetensors::tensor::{Dtype, TensorView};

use super::values;

fn network(seed: u64) -> Perceptron {
    PerceptronKind::SMART.init(&[3, 4, 2], &mut Initializer::new(seed, &Device::flex()))
}

fn bytes() -> Vec<u8> {
    let metadata = [("config", r#"{"hidden_dim":4}"#), ("of", "a test")];
    save(&network(1), &metadata.iter().map(|(k, v)| ((*k).into(), (*v).into())).collect())
}

/// Returns the file with one of its tensors changed, added or left out.
fn changed(change: impl FnOnce(&mut BTreeMap<String, (Dtype, Vec<usize>, Vec<u8>)>)) -> Vec<u8> {
    let bytes = bytes();
    let file = safetensors::SafeTensors::deserialize(&bytes).unwrap();
    let mut tensors = file
        .tensors()
        .into_iter()
        .map(|(name, view)| (name, (view.dtype(), view.shape().to_vec(), view.data().to_vec())))
        .collect();
    change(&mut tensors);
    let views: Vec<_> = tensors
        .iter()
        .map(|(n, (d, s, b))| (n.clone(), TensorView::new(*d, s.clone(), b).unwrap()))
        .collect();
    safetensors::serialize(views, None).unwrap()
}

fn refusal(bytes: &[u8]) -> String {
    let error = Tensors::read(bytes).and_then(|t| t.load(network(2))).expect_err("refused");
    error.to_string()
}

#[test]
fn what_is_saved_is_loaded() {
    let bytes = bytes();
    assert_eq!(bytes, self::bytes(), "the same bytes");
    let tensors = Tensors::read(&bytes).unwrap();
    let names: Vec<&str> = tensors.shapes().map(|s| s.0).collect();
    assert_eq!(
        names,
        ["mlp.0.bias", "mlp.0.weight", "mlp.1.bias", "mlp.1.weight", "mlp.3.bias", "mlp.3.weight"]
    );
    assert_eq!(tensors.floats("mlp.0.weight").unwrap().0, [4, 3], "[out, in]");
    assert_eq!(tensors.metadata()["of"], "a test");
    let config: serde_json::Value = tensors.config().unwrap();
    assert_eq!(config["hidden_dim"], 4);

    let loaded = tensors.load(network(2)).unwrap();
    assert_eq!(save(&loaded, &BTreeMap::new()), save(&network(1), &BTreeMap::new()));
    let x = burn::tensor::Tensor::<2>::from_floats([[0.5, -1.0, 2.0]], &Device::flex());
    assert_eq!(values(loaded.forward(x.clone())), values(network(1).forward(x)));
}

#[test]
fn a_file_cut_short_is_refused() {
    let bytes = bytes();
    for length in [0, 4, 8, 40, bytes.len() / 2, bytes.len() - 1] {
        let text = refusal(&bytes[..length]);
        assert!(text.contains("cut short or not safetensors"), "{length}: {text}");
    }
    assert!(refusal(b"PK\x03\x04 this is some other kind of file").contains("not safetensors"));
}

#[test]
fn wrong_tensors_are_named() {
    let text = refusal(&changed(|t| drop(t.remove("mlp.1.bias"))));
    assert!(text.contains("`mlp.1.bias` is missing: the weights belong to another network"), "{text}");
    let text = refusal(&changed(|t| drop(t.insert("mlp.7.bias".into(), (Dtype::F32, vec![1], vec![0; 4])))));
    assert!(text.contains("`mlp.7.bias` [1] has no place"), "{text}");
    let text = refusal(&changed(|t| t.get_mut("mlp.0.weight").unwrap().1 = vec![3, 4]));
    assert!(text.contains("`mlp.0.weight` is [3, 4], expected [4, 3]"), "{text}");
    let text = refusal(&changed(|t| drop(t.insert("mlp.3.bias".into(), (Dtype::F16, vec![2], vec![0; 4])))));
    assert!(text.contains("`mlp.3.bias` holds F16, expected F32"), "{text}");
    for (value, shown) in [(f32::NAN, "NaN"), (f32::NEG_INFINITY, "-inf")] {
        let text = refusal(&changed(|t| {
            t.get_mut("mlp.3.weight").unwrap().2[20..24].copy_from_slice(&value.to_le_bytes())
        }));
        assert!(text.contains(&format!("`mlp.3.weight` holds {shown} at 5")), "{text}");
    }
}

#[test]
fn twins_must_be_alike() {
    let bytes = changed(|t| {
        let one = t["mlp.0.bias"].clone();
        t.insert("copy".into(), one);
        t.insert("other".into(), (Dtype::F32, vec![4], vec![1; 16]));
    });
    let mut tensors = Tensors::read(&bytes).unwrap();
    tensors.drop_twin("copy", "mlp.0.bias").unwrap();
    tensors.drop_twin("not there", "mlp.0.bias").unwrap();
    assert!(tensors.shapes().all(|s| s.0 != "copy"));
    let error = tensors.drop_twin("other", "mlp.0.bias").unwrap_err();
    assert!(error.to_string().contains("should be identical but differ"), "{error}");
}

#[test]
fn a_configuration_must_fit() {
    let bytes = bytes();
    let tensors = Tensors::read(&bytes).unwrap();
    assert!(tensors.config::<Vec<u8>>().is_err());
    let bytes = changed(|_| {});
    let error = Tensors::read(&bytes).unwrap().config::<serde_json::Value>().unwrap_err();
    assert!(error.to_string().contains("it is missing"), "{error}");
}
