//! A written folder differs from its source only in the given weights.

use std::fs;

use half::bf16;
use safetensors::tensor::{Dtype, SafeTensors};
use zk0_lerobot::policy_folder::{PolicyFolder, Precision};
use zk0_lerobot::StoredPolicyError;
use zk0_tensors::{TensorError, TensorSet};

use super::folder::*;

#[test]
fn an_untouched_policy_is_written_back_bit_for_bit() {
    let published = fixture("weights.safetensors");
    for tensors in [raw(&published), mixed()] {
        let source = folder(&tensors);
        let opened = PolicyFolder::open(source.path()).unwrap();
        let all = opened.tensors().unwrap();
        let out = tempfile::tempdir().unwrap();
        for (changed, name) in [(TensorSet::new(), "none"), (all, "all")] {
            let to = out.path().join(name);
            opened.write(&to, &changed, Precision::Kept).unwrap();
            // The test compares the weights, with the language model's head among them, and every file beside them.
            let mut names: Vec<_> = fs::read_dir(source.path())
                .unwrap()
                .map(|e| e.unwrap().file_name())
                .collect();
            names.sort();
            let mut written: Vec<_> = fs::read_dir(&to)
                .unwrap()
                .map(|e| e.unwrap().file_name())
                .collect();
            written.sort();
            assert_eq!(names, written);
            for name in names {
                let both = [source.path(), to.as_path()].map(|f| fs::read(f.join(&name)).unwrap());
                assert!(both[0] == both[1], "{name:?} differs");
            }
        }
        assert!(raw(&weights_in(&out.path().join("all"))).contains_key(LM_HEAD));
    }
}

#[test]
fn only_the_given_tensors_change_in_the_type_they_had() {
    let tensors = mixed();
    let source = folder(&tensors);
    let opened = PolicyFolder::open(source.path()).unwrap();
    let mut expert = expert(&opened);
    for tensor in expert.values_mut() {
        tensor.data.iter_mut().for_each(|x| *x = *x * 1.01 + 1e-3);
    }
    let out = tempfile::tempdir().unwrap();

    let kept = out.path().join("kept");
    opened.write(&kept, &expert, Precision::Kept).unwrap();
    let found = raw(&weights_in(&kept));
    assert_eq!(found.len(), tensors.len());
    for (name, (dtype, shape, bytes)) in &tensors {
        let (found_dtype, found_shape, found_bytes) = &found[name];
        assert_eq!((dtype, shape), (found_dtype, found_shape), "{name}");
        assert_eq!(bytes != found_bytes, expert.contains_key(name), "{name}");
    }
    let rounded = bf16::from_f32(expert[NORM].data[0]).to_le_bytes();
    assert_eq!(found[NORM].2[..2], rounded);

    let single = out.path().join("single");
    opened.write(&single, &expert, Precision::Single).unwrap();
    let bytes = weights_in(&single);
    let (_, header) = SafeTensors::read_metadata(&bytes).unwrap();
    assert_eq!(header.metadata(), &Some(pytorch()));
    let found = raw(&bytes);
    for (name, (dtype, shape, bytes)) in &tensors {
        let expected = match expert.get(name) {
            Some(t) => {
                let bytes = t.data.iter().flat_map(|x| x.to_le_bytes()).collect();
                (Dtype::F32, shape.clone(), bytes)
            }
            None => (*dtype, shape.clone(), bytes.clone()),
        };
        assert!(found[name] == expected, "{name}");
    }
    // The written folder is a policy folder again, with exactly these weights.
    let again = PolicyFolder::open(&single).unwrap();
    assert_eq!(super::folder::expert(&again), expert);
    assert_eq!(weights_in(&single), {
        let twice = out.path().join("twice");
        opened.write(&twice, &expert, Precision::Single).unwrap();
        weights_in(&twice)
    });
}

#[test]
fn what_cannot_be_written_is_refused() {
    let source = folder(&mixed());
    let opened = PolicyFolder::open(source.path()).unwrap();
    let out = tempfile::tempdir().unwrap();
    let norm = opened.tensor(NORM).unwrap();
    let one = |name: &str, change: &dyn Fn(&mut zk0_tensors::TensorData)| {
        let mut tensor = norm.clone();
        change(&mut tensor);
        TensorSet::from([(name.to_string(), tensor)])
    };
    let to = out.path().join("new");
    let refused = |changed: &TensorSet| opened.write(&to, changed, Precision::Kept).unwrap_err();
    let error = refused(&one("stowaway", &|_| ()));
    assert!(
        matches!(&error, StoredPolicyError::Tensor(TensorError::Unexpected(n)) if n == "stowaway")
    );
    let error = refused(&one(NORM, &|t| t.shape = vec![53]));
    assert!(matches!(
        error,
        StoredPolicyError::Tensor(TensorError::Shape { .. })
    ));
    let error = refused(&one(NORM, &|t| t.data[3] = f32::NAN));
    assert!(matches!(
        error,
        StoredPolicyError::Tensor(TensorError::NotFinite { index: 3, .. })
    ));
    assert!(!to.exists(), "nothing is left of what was refused at once");
    // The value is finite in F32, but not in BF16.
    let error = refused(&one(NORM, &|t| t.data[0] = f32::MAX));
    assert!(error.to_string().contains("too large for BF16"), "{error}");
    assert!(!to.join("model.safetensors").exists());

    let error = opened
        .write(source.path(), &TensorSet::new(), Precision::Kept)
        .unwrap_err();
    assert!(error.to_string().contains("not empty"), "{error}");
}
