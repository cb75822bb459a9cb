//! Weights files: what is written can be read, and every fault is refused with the tensor's name.

use proptest::prelude::*;
use safetensors::tensor::{serialize, Dtype, SafeTensors, TensorView};
use sha2::{Digest, Sha256};
use zk0_lerobot::config::PolicyConfig;
use zk0_lerobot::StoredPolicyError;
use zk0_smolvla::policy::init::init_policy;
use zk0_smolvla::policy::profile::Profile;
use zk0_smolvla::policy::weights::{ExpertWeights, Policy};
use zk0_smolvla::PolicyError;
use zk0_tensors::TensorError;

const NORM: &str = "model.vlm_with_expert.lm_expert.norm.weight";

fn micro() -> PolicyConfig {
    Profile::Micro.config()
}

fn expert() -> ExpertWeights {
    init_policy(&micro(), 1).unwrap().expert
}

/// Returns the expert's file after `change` has altered its list of (name, type, shape, bytes).
fn file_with(change: impl Fn(&mut Vec<(String, Dtype, Vec<usize>, Vec<u8>)>)) -> Vec<u8> {
    let bytes = expert().to_safetensors().unwrap();
    let file = SafeTensors::deserialize(&bytes).unwrap();
    let mut tensors: Vec<_> = file
        .iter()
        .map(|(n, v)| {
            (
                n.to_string(),
                v.dtype(),
                v.shape().to_vec(),
                v.data().to_vec(),
            )
        })
        .collect();
    change(&mut tensors);
    let views = tensors
        .iter()
        .map(|(n, d, s, b)| (n, TensorView::new(*d, s.clone(), b).unwrap()));
    serialize(views, None).unwrap()
}

fn refusal(bytes: &[u8]) -> StoredPolicyError {
    stored(ExpertWeights::from_safetensors(&micro(), bytes).unwrap_err())
}

/// Returns what is wrong with the stored tensors.
fn stored(error: PolicyError) -> StoredPolicyError {
    match error {
        PolicyError::Stored(error) => error,
        other => panic!("{other}"),
    }
}

#[test]
fn what_is_written_is_read_and_writing_is_deterministic() {
    let weights = expert();
    let bytes = weights.to_safetensors().unwrap();
    let read = ExpertWeights::from_safetensors(&micro(), &bytes).unwrap();
    assert_eq!(read, weights);
    assert_eq!(read.to_safetensors().unwrap(), bytes);

    let policy = init_policy(&micro(), 1).unwrap();
    let read = Policy::from_safetensors(&micro(), &policy.to_safetensors().unwrap()).unwrap();
    assert_eq!(read, policy);
}

/// A network's genesis is made from a seed: these bytes must be the same on every machine and in every version.
#[test]
fn a_seed_fixes_every_bit() {
    let bytes = init_policy(&micro(), 1).unwrap().to_safetensors().unwrap();
    let digest: String = Sha256::digest(&bytes)
        .iter()
        .map(|b| format!("{b:02x}"))
        .collect();
    assert_eq!(
        digest,
        "3b79be294799f80b5a8403629ac0223476fe6577815970a992f8458dc70bcee4"
    );
    assert_ne!(init_policy(&micro(), 2).unwrap().expert, expert());
}

#[test]
fn a_file_cut_anywhere_is_refused() {
    let bytes = expert().to_safetensors().unwrap();
    for length in [0, 7, 8, 100, bytes.len() / 2, bytes.len() - 1] {
        let error = refusal(&bytes[..length]);
        assert!(error.to_string().contains("truncated"), "{length}: {error}");
    }
    let longer = [bytes.as_slice(), &[0]].concat();
    assert!(matches!(
        refusal(&longer),
        StoredPolicyError::Tensor(TensorError::Length(_))
    ));
}

#[test]
fn missing_and_unexpected_tensors_are_named() {
    let missing = file_with(|tensors| tensors.retain(|t| t.0 != NORM));
    assert!(
        matches!(refusal(&missing), StoredPolicyError::Tensor(TensorError::Missing(name)) if name == NORM)
    );

    let renamed =
        file_with(|tensors| tensors.push(("stowaway".into(), Dtype::F32, vec![1], vec![0; 4])));
    assert!(
        matches!(refusal(&renamed), StoredPolicyError::Tensor(TensorError::Unexpected(name)) if name == "stowaway")
    );

    // A whole policy is not an update: its frozen half does not belong there.
    let whole = init_policy(&micro(), 1).unwrap().to_safetensors().unwrap();
    assert!(matches!(
        refusal(&whole),
        StoredPolicyError::Tensor(TensorError::Unexpected(_))
    ));
}

#[test]
fn shapes_and_types_are_checked() {
    let long = file_with(|tensors| {
        let norm = tensors.iter_mut().find(|t| t.0 == NORM).unwrap();
        (norm.2, norm.3) = (vec![13], vec![0; 52]);
    });
    assert!(
        matches!(refusal(&long), StoredPolicyError::Tensor(TensorError::Shape { name, found, .. }) if name == NORM && found == [13])
    );

    let transposed = file_with(|tensors| tensors.iter_mut().for_each(|t| t.2.reverse()));
    assert!(matches!(
        refusal(&transposed),
        StoredPolicyError::Tensor(TensorError::Shape { .. })
    ));

    let half = file_with(|tensors| {
        let norm = tensors.iter_mut().find(|t| t.0 == NORM).unwrap();
        (norm.1, norm.3) = (Dtype::F16, vec![0; 24]);
    });
    assert!(
        matches!(refusal(&half), StoredPolicyError::Tensor(TensorError::Dtype { name, found, .. }) if name == NORM && found == "F16")
    );

    let other_profile = ExpertWeights::from_safetensors(
        &Profile::Tiny.config(),
        &expert().to_safetensors().unwrap(),
    );
    assert!(other_profile.is_err());
}

#[test]
fn values_that_are_not_finite_are_named() {
    for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let bytes = file_with(|tensors| {
            let norm = tensors.iter_mut().find(|t| t.0 == NORM).unwrap();
            norm.3[8..12].copy_from_slice(&value.to_le_bytes());
        });
        assert!(
            matches!(refusal(&bytes), StoredPolicyError::Tensor(TensorError::NotFinite { name, index: 2, .. }) if name == NORM)
        );

        let mut tensors = expert().into_tensors();
        tensors.get_mut(NORM).unwrap().data[2] = value;
        let error = stored(ExpertWeights::from_tensors(&micro(), tensors).unwrap_err());
        assert!(
            matches!(
                error,
                StoredPolicyError::Tensor(TensorError::NotFinite { index: 2, .. })
            ),
            "{error}"
        );
    }
}

#[test]
fn tensors_made_elsewhere_are_checked_too() {
    let change = |change: fn(&mut zk0_tensors::TensorSet)| {
        let mut tensors = expert().into_tensors();
        change(&mut tensors);
        stored(ExpertWeights::from_tensors(&micro(), tensors).unwrap_err())
    };
    assert!(matches!(
        change(|t| drop(t.remove(NORM))),
        StoredPolicyError::Tensor(TensorError::Missing(_))
    ));
    assert!(matches!(
        change(|t| t.get_mut(NORM).unwrap().data.truncate(11)),
        StoredPolicyError::Tensor(TensorError::Shape { .. })
    ));
    let extra = change(|t| drop(t.insert("stowaway".into(), t[NORM].clone())));
    assert!(matches!(
        extra,
        StoredPolicyError::Tensor(TensorError::Unexpected(_))
    ));
}

proptest! {
    #[test]
    fn damaged_files_never_panic(at in 0usize..4000, byte: u8) {
        let mut bytes = expert().to_safetensors().unwrap();
        bytes[at] = byte;
        let _ = ExpertWeights::from_safetensors(&micro(), &bytes);
    }
}
