//! The reader gives exact values, wherever they are stored.

use std::fs;

use half::f16;
use safetensors::tensor::Dtype;
use zk0_lerobot::layout::policy_layout;
use zk0_lerobot::policy_folder::{PolicyFolder, Precision};
use zk0_tensors::{TensorFile, TensorSet, HEADER_LIMIT};

use super::folder::*;

#[test]
fn values_are_read_exactly_from_all_three_types() {
    let tensors = mixed();
    let source = folder(&tensors);
    let opened = PolicyFolder::open(source.path()).unwrap();
    let read = opened.tensors().unwrap();
    assert!(!read.contains_key(LM_HEAD));
    for (name, tensor) in &read {
        let (dtype, shape, bytes) = &tensors[name];
        assert_eq!(&tensor.shape, shape, "{name}");
        let expected: Vec<f32> = match dtype {
            // BF16 is the upper half of F32.
            Dtype::BF16 => bytes
                .chunks_exact(2)
                .map(|b| f32::from_le_bytes([0, 0, b[0], b[1]]))
                .collect(),
            Dtype::F16 => bytes
                .chunks_exact(2)
                .map(|b| f16::from_le_bytes([b[0], b[1]]).to_f32())
                .collect(),
            _ => bytes
                .chunks_exact(4)
                .map(|b| f32::from_le_bytes(b.try_into().unwrap()))
                .collect(),
        };
        assert_eq!(tensor.data, expected, "{name}");
    }

    // F32 values are the same as those from the reader of bytes in memory.
    let source = folder(&raw(&fixture("weights.safetensors")));
    let opened = PolicyFolder::open(source.path()).unwrap();
    let layout = policy_layout(&opened.config().dims);
    let bytes = fixture("weights.safetensors");
    let file = TensorFile::open(&bytes[..], HEADER_LIMIT).unwrap();
    let direct = file.read_exactly(&layout, &[LM_HEAD]).unwrap();
    assert_eq!(opened.tensors().unwrap(), direct);
}

/// PyTorch stores tied weights once; the metadata leads from the other name to it.
#[test]
fn tied_embeddings_are_found_under_the_other_name() {
    let mut tensors = mixed();
    let embeddings = tensors.remove(EMBEDDINGS).unwrap();
    tensors.insert(LM_HEAD.into(), embeddings);
    let source = folder(&tensors);
    let mut metadata = pytorch();
    metadata.insert(EMBEDDINGS.into(), LM_HEAD.into());
    let bytes = file_of(&tensors, metadata);
    fs::write(source.path().join("model.safetensors"), &bytes).unwrap();
    let opened = PolicyFolder::open(source.path()).unwrap();
    let tensors = opened.tensors().unwrap();
    let direct = folder(&mixed());
    let direct = PolicyFolder::open(direct.path()).unwrap();
    assert_eq!(tensors, direct.tensors().unwrap());

    let out = tempfile::tempdir().unwrap();
    let expert = expert(&opened);
    opened.write(out.path(), &expert, Precision::Kept).unwrap();
    assert!(weights_in(out.path()) == bytes);
    let embeddings = TensorSet::from([(EMBEDDINGS.into(), tensors[EMBEDDINGS].clone())]);
    let out = tempfile::tempdir().unwrap();
    let error = opened
        .write(out.path(), &embeddings, Precision::Kept)
        .unwrap_err();
    assert!(error.to_string().contains("another name"), "{error}");
}
