//! What is read: exact values, wherever they are.

use std::fs;

use half::f16;
use safetensors::tensor::Dtype;
use zk0_smolvla::checkpoint::Precision;
use zk0_smolvla::weights::TensorSet;
use zk0_smolvla::{Checkpoint, Policy};

use crate::folder::*;

#[test]
fn values_are_read_exactly_from_all_three_types() {
    let tensors = mixed();
    let source = folder(&tensors);
    let checkpoint = Checkpoint::open(source.path()).unwrap();
    let read = all(&checkpoint.policy().unwrap());
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
    let parameters = checkpoint.parameters(&candle_core::Device::Cpu).unwrap();
    let norm: Vec<f32> = parameters.get(NORM).unwrap().to_vec1().unwrap();
    assert_eq!(norm, read[NORM].data);

    // F32 is the same as what the network's own reader gives.
    let source = folder(&raw(&fixture("weights.safetensors")));
    let checkpoint = Checkpoint::open(source.path()).unwrap();
    let direct =
        Policy::from_safetensors(&checkpoint.config().dims, &fixture("weights.safetensors"));
    assert_eq!(checkpoint.policy().unwrap(), direct.unwrap());
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
    let checkpoint = Checkpoint::open(source.path()).unwrap();
    let policy = checkpoint.policy().unwrap();
    let direct = folder(&mixed());
    let direct = Checkpoint::open(direct.path()).unwrap().policy().unwrap();
    assert_eq!(policy, direct);

    let out = tempfile::tempdir().unwrap();
    let expert = policy.expert.tensors();
    checkpoint
        .write(out.path(), expert, Precision::Kept)
        .unwrap();
    assert!(weights_in(out.path()) == bytes);
    let embeddings = TensorSet::from([(EMBEDDINGS.into(), policy.frozen[EMBEDDINGS].clone())]);
    let out = tempfile::tempdir().unwrap();
    let error = checkpoint
        .write(out.path(), &embeddings, Precision::Kept)
        .unwrap_err();
    assert!(error.to_string().contains("another name"), "{error}");
}
