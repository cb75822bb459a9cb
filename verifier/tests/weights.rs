//! Expert weights are read strictly: whatever is wrong with a file, the error names the tensor and the cause.

use proptest::prelude::*;
use safetensors::tensor::TensorView;
use safetensors::Dtype;
use std::collections::BTreeMap;
use zk0_circuits::model::layout::TensorSpec;
use zk0_circuits::Digest;
use zk0_tensors::TensorError;
use zk0_verifier::{blob_digest, ExpertTensors, WeightsError};

fn expected() -> Vec<TensorSpec> {
    let spec = |name: &str, shape: &[usize]| TensorSpec {
        name: name.into(),
        shape: shape.into(),
    };
    vec![spec("b.weight", &[2, 3]), spec("a.bias", &[2])]
}

type Raw = BTreeMap<&'static str, (Dtype, Vec<usize>, Vec<u8>)>;

fn f32s(values: &[f32]) -> Vec<u8> {
    values
        .iter()
        .flat_map(|value| value.to_le_bytes())
        .collect()
}

fn good() -> Raw {
    BTreeMap::from([
        ("a.bias", (Dtype::F32, vec![2], f32s(&[0.5, -0.0]))),
        (
            "b.weight",
            (
                Dtype::F32,
                vec![2, 3],
                f32s(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.5]),
            ),
        ),
    ])
}

fn file(raw: &Raw) -> Vec<u8> {
    let views = raw.iter().map(|(name, (dtype, shape, data))| {
        (*name, TensorView::new(*dtype, shape.clone(), data).unwrap())
    });
    safetensors::serialize(views, None).unwrap()
}

fn refused(bytes: &[u8]) -> WeightsError {
    ExpertTensors::read(bytes, &expected()).unwrap_err()
}

#[test]
fn a_good_file_is_read_and_written_canonically() {
    let bytes = file(&good());
    let weights = ExpertTensors::read(&bytes, &expected()).unwrap();
    assert_eq!(
        weights.get("b.weight").unwrap(),
        [1.0, 2.0, 3.0, 4.0, 5.0, 6.5]
    );
    assert!(weights.get("a.bias").unwrap()[1].is_sign_negative());
    let names: Vec<_> = weights.iter().map(|(name, _, _)| name.to_owned()).collect();
    assert_eq!(names, ["a.bias", "b.weight"]);
    assert_eq!(weights.to_bytes(), bytes);
}

#[test]
fn the_canonical_file_is_what_it_was() {
    // This is a test vector. A change here changes the digest of every network's weights.
    let weights = ExpertTensors::read(&file(&good()), &expected()).unwrap();
    let header = r#"{"a.bias":{"dtype":"F32","shape":[2],"data_offsets":[0,8]},"b.weight":{"dtype":"F32","shape":[2,3],"data_offsets":[8,32]}}"#;
    let padded = format!("{header:<width$}", width = header.len().next_multiple_of(8));
    let mut bytes = (padded.len() as u64).to_le_bytes().to_vec();
    bytes.extend(padded.as_bytes());
    bytes.extend(f32s(&[0.5, -0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.5]));
    assert_eq!(weights.to_bytes(), bytes);
}

#[test]
fn every_truncation_says_so() {
    let bytes = file(&good());
    for end in 0..bytes.len() {
        let text = refused(&bytes[..end]).to_string();
        assert!(text.contains("truncated"), "{end}: {text}");
    }
}

#[test]
fn bytes_after_the_data_are_refused() {
    let bytes = [&file(&good())[..], &[0]].concat();
    assert!(matches!(
        refused(&bytes),
        WeightsError::Tensor(TensorError::Length(_))
    ));
}

#[test]
fn a_header_beyond_the_file_or_the_limit_is_refused() {
    let mut bytes = file(&good());
    bytes[..8].copy_from_slice(&u64::MAX.to_le_bytes());
    assert!(matches!(
        refused(&bytes),
        WeightsError::Tensor(TensorError::HeaderTooLarge {
            bytes: u64::MAX,
            ..
        })
    ));
    bytes[..8].copy_from_slice(&100_000u64.to_le_bytes());
    assert!(matches!(
        refused(&bytes),
        WeightsError::Tensor(TensorError::HeaderTruncated { .. })
    ));
}

#[test]
fn a_tensor_of_more_bytes_than_the_file_is_refused() {
    let header = r#"{"a.bias":{"dtype":"F32","shape":[4611686018427387904],"data_offsets":[0,8]}}"#;
    let mut bytes = (header.len() as u64).to_le_bytes().to_vec();
    bytes.extend(header.as_bytes());
    bytes.extend([0; 8]);
    assert!(matches!(
        refused(&bytes),
        WeightsError::Tensor(TensorError::Header(_))
    ));
}

#[test]
fn missing_and_extra_tensors_are_named() {
    let mut raw = good();
    raw.remove("a.bias");
    let missing = TensorError::Missing("a.bias".into());
    assert_eq!(refused(&file(&raw)), missing.into());
    let mut raw = good();
    raw.insert("c.weight", (Dtype::F32, vec![1], f32s(&[1.0])));
    assert_eq!(refused(&file(&raw)), WeightsError::Extra("c.weight".into()));
}

/// Auditors compare the reason of a refusal, so it is the same in every process.
#[test]
fn of_several_extra_tensors_the_first_in_the_file_is_named() {
    let mut raw = good();
    for name in ["c", "d", "e", "f", "g", "h", "i", "j"] {
        raw.insert(name, (Dtype::F32, vec![1], f32s(&[1.0])));
    }
    for _ in 0..4 {
        assert_eq!(refused(&file(&raw)), WeightsError::Extra("c".into()));
    }
}

#[test]
fn wrong_types_and_shapes_are_named() {
    let mut raw = good();
    raw.insert("a.bias", (Dtype::F16, vec![4], vec![0; 8]));
    let text = refused(&file(&raw)).to_string();
    assert!(text.contains("a.bias") && text.contains("F16"), "{text}");
    let mut raw = good();
    raw.insert("b.weight", (Dtype::F32, vec![3, 2], vec![0; 24]));
    let text = refused(&file(&raw)).to_string();
    assert!(
        text.contains("b.weight") && text.contains("[3, 2]"),
        "{text}"
    );
}

#[test]
fn values_that_are_not_finite_are_named() {
    for (value, shown) in [
        (f32::NAN, "NaN"),
        (f32::INFINITY, "inf"),
        (f32::NEG_INFINITY, "-inf"),
    ] {
        let mut raw = good();
        raw.insert(
            "b.weight",
            (
                Dtype::F32,
                vec![2, 3],
                f32s(&[1.0, 2.0, value, 4.0, 5.0, 6.0]),
            ),
        );
        assert_eq!(
            refused(&file(&raw)),
            WeightsError::Tensor(TensorError::NotFinite {
                name: "b.weight".into(),
                index: 2,
                value: shown.into()
            })
        );
    }
}

#[test]
fn mapped_weights_keep_their_shapes_and_stay_finite() {
    let weights = ExpertTensors::read(&file(&good()), &expected()).unwrap();
    let doubled = weights
        .map(|_, values| values.iter().map(|value| value * 2.0).collect())
        .unwrap();
    assert_eq!(doubled.get("a.bias").unwrap()[0], 1.0);
    assert!(weights.map(|_, _| vec![1.0]).is_err());
    assert!(weights
        .map(|_, values| vec![f32::NAN; values.len()])
        .is_err());
}

#[test]
fn a_blob_is_named_by_its_sha256() {
    let empty: Digest = "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855"
        .parse()
        .unwrap();
    assert_eq!(blob_digest(b""), empty);
}

proptest! {
    #[test]
    fn no_bytes_make_it_panic(bytes in proptest::collection::vec(any::<u8>(), 0..300), length in 0u64..300) {
        let _ = ExpertTensors::read(&bytes, &expected());
        let _ = ExpertTensors::read(&[&length.to_le_bytes()[..], &bytes].concat(), &expected());
    }

    #[test]
    fn no_flipped_byte_makes_it_panic(at in any::<prop::sample::Index>(), flip in 1u8..) {
        let mut bytes = file(&good());
        let at = at.index(bytes.len());
        bytes[at] ^= flip;
        if let Ok(weights) = ExpertTensors::read(&bytes, &expected()) {
            prop_assert!(weights.iter().all(|(_, _, values)| values.iter().all(|value| value.is_finite())));
        }
    }
}
