//! Folders that must be refused, with the file and what is wrong with it.

use std::fs;
use std::path::Path;

use half::bf16;
use safetensors::tensor::Dtype;
use zk0_lerobot::policy_folder::PolicyFolder;

use super::folder::*;

/// Opens a folder after a change to it, and returns the error.
fn refusal(change: impl Fn(&Path)) -> String {
    let source = folder(&raw(&fixture("weights.safetensors")));
    change(source.path());
    PolicyFolder::open(source.path()).unwrap_err().to_string()
}

#[test]
fn faults_are_named_with_their_file() {
    let weights = |change: &dyn Fn(&mut RawFile)| {
        let mut tensors = raw(&fixture("weights.safetensors"));
        change(&mut tensors);
        refusal(|folder| {
            fs::write(
                folder.join("model.safetensors"),
                file_of(&tensors, pytorch()),
            )
            .unwrap()
        })
    };
    let cases = [
        (weights(&|t| drop(t.remove(NORM))), NORM),
        (
            weights(&|t| {
                let norm = t[NORM].clone();
                t.insert("stowaway".into(), norm);
            }),
            "stowaway",
        ),
        (
            weights(&|t| t.get_mut(NORM).unwrap().1 = vec![1, 54]),
            "[1, 54]",
        ),
        (
            weights(&|t| {
                let norm = t.get_mut(NORM).unwrap();
                norm.0 = Dtype::I32;
            }),
            "I32",
        ),
        (
            weights(&|t| t.get_mut(LM_HEAD).unwrap().1.reverse()),
            LM_HEAD,
        ),
        (
            refusal(|f| fs::remove_file(f.join("model.safetensors")).unwrap()),
            "model.safetensors",
        ),
        (
            refusal(|f| fs::remove_file(f.join("config.json")).unwrap()),
            "config.json",
        ),
        (
            refusal(|f| fs::remove_file(f.join("vlm_config.json")).unwrap()),
            "vlm_config.json",
        ),
        (
            refusal(|f| fs::write(f.join("config.json"), "{").unwrap()),
            "config.json",
        ),
        (
            refusal(|f| {
                let file = fs::File::create(f.join("config.json")).unwrap();
                file.set_len((16 << 20) + 1).unwrap();
            }),
            "is larger than 16777216 bytes",
        ),
        (
            refusal(|f| fs::write(f.join("vlm_config.json"), [0xff; 8]).unwrap()),
            "vlm_config.json",
        ),
        (
            refusal(|f| fs::write(f.join("policy_preprocessor.json"), "{").unwrap()),
            "policy_preprocessor.json",
        ),
        (
            refusal(|f| fs::write(f.join("policy_postprocessor.json"), "{}").unwrap()),
            "missing field `steps`",
        ),
    ];
    for (reported, expected) in cases {
        assert!(reported.contains(expected), "{reported}: lacks {expected}");
        let named = ["model.safetensors", "config.json", "processor.json"]
            .iter()
            .any(|file| reported.contains(file));
        assert!(named, "{reported}: names no file");
    }
    let error = PolicyFolder::open("no such folder").unwrap_err();
    assert!(error
        .to_string()
        .contains("no such folder: is not a folder"));
}

#[test]
fn a_weights_file_cut_anywhere_or_with_a_lying_header_is_refused() {
    let whole = fixture("weights.safetensors");
    let header = u64::from_le_bytes(whole[..8].try_into().unwrap()) as usize;
    let with = |bytes: &[u8]| {
        refusal(|folder| fs::write(folder.join("model.safetensors"), bytes).unwrap())
    };
    for length in [0, 7, 8, 100, 8 + header, whole.len() / 2, whole.len() - 1] {
        let reported = with(&whole[..length]);
        assert!(reported.contains("truncated"), "{length}: {reported}");
    }
    let longer = [whole.as_slice(), &[0]].concat();
    assert!(with(&longer).contains("followed by other bytes"));
    for claimed in [u64::MAX, 1 << 60, whole.len() as u64 - 7, 99_000_000] {
        let mut lying = whole.clone();
        lying[..8].copy_from_slice(&claimed.to_le_bytes());
        assert!(with(&lying).contains(&format!("has {claimed} bytes")));
    }
}

#[test]
fn numbers_that_are_not_finite_are_named() {
    let mut tensors = mixed();
    tensors.get_mut(NORM).unwrap().2[4..6].copy_from_slice(&bf16::NAN.to_le_bytes());
    let source = folder(&tensors);
    let opened = PolicyFolder::open(source.path()).unwrap();
    let reported = opened.tensors().unwrap_err().to_string();
    assert!(
        reported.contains(NORM) && reported.contains("element 2"),
        "{reported}"
    );
}
