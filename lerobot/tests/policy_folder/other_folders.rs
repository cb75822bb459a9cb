//! Folders and files that are given for a policy, and are something else.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use zk0_lerobot::policy_folder::PolicyFolder;
use zk0_lerobot::tokenizer::TrainedTokenizer;
use zk0_testkit::recordings::{fixtures, Copy, DATA, INFO, STATS, TOP};

use super::folder::*;

fn refusal(folder: &Path) -> String {
    PolicyFolder::open(folder).unwrap_err().to_string()
}

#[test]
fn a_checkpoint_of_a_run_names_the_folder_of_its_policy() {
    let run = tempfile::tempdir().unwrap();
    let policy = run.path().join("checkpoints/last/pretrained_model");
    fs::create_dir_all(policy.parent().unwrap()).unwrap();
    fs::rename(folder(&mixed()).keep(), &policy).unwrap();
    PolicyFolder::open(&policy).unwrap();
    for place in [
        run.path().to_path_buf(),
        run.path().join("checkpoints/last"),
    ] {
        let reported = refusal(&place);
        assert!(
            reported.contains(&format!("name {}", policy.display())),
            "{reported}"
        );
    }
}

#[test]
fn an_adapter_without_its_base_is_called_one() {
    let reported = refusal(&fixtures().join("policy_processors/lora_adapter"));
    assert!(
        reported.contains("a LoRA adapter of the policy `zk0/base`"),
        "{reported}"
    );
    assert!(reported.contains("`hf download zk0/base`"), "{reported}");
}

#[test]
fn weights_of_a_compiled_module_are_named_by_their_prefix() {
    for prefixed in ["_orig_mod.model.", "model._orig_mod."] {
        let tensors: BTreeMap<_, _> = mixed()
            .into_iter()
            .map(|(name, tensor)| (name.replacen("model.", prefixed, 1), tensor))
            .collect();
        let reported = refusal(folder(&tensors).path());
        assert!(
            reported.contains("`_orig_mod.` is in their names"),
            "{reported}"
        );
        assert!(reported.contains("random weights"), "{reported}");
    }
}

#[test]
fn a_pointer_of_git_lfs_is_called_one_whatever_it_stands_for() {
    let pointer = fs::read(fixtures().join("git_lfs/pointer")).unwrap();
    let source = folder(&mixed());
    let tokenizer = source.path().join("tokenizer.json");
    fs::write(&tokenizer, &pointer).unwrap();
    let dims = PolicyFolder::open(source.path())
        .unwrap()
        .config()
        .dims
        .clone();
    let mut all = vec![match TrainedTokenizer::read(&tokenizer, &dims) {
        Ok(_) => panic!("was read"),
        Err(error) => error.to_string(),
    }];
    for file in [
        "config.json",
        "model.safetensors",
        "policy_preprocessor.json",
        "post.safetensors",
    ] {
        let source = folder(&mixed());
        fs::write(source.path().join(file), &pointer).unwrap();
        let opened = PolicyFolder::open(source.path()).and_then(|folder| folder.inference());
        all.push(opened.unwrap_err().to_string());
    }
    let tables = [
        "meta/tasks.parquet",
        "meta/episodes/chunk-000/file-000.parquet",
        DATA,
    ];
    for file in [INFO, STATS, TOP].into_iter().chain(tables) {
        let recording = Copy::default();
        recording.edit(file, |_| pointer.clone());
        let reported = recording.error().to_string();
        assert!(reported.contains(file), "{reported}");
        all.push(reported);
    }
    for reported in all {
        assert!(reported.contains("is a Git LFS pointer"), "{reported}");
        assert!(reported.contains("`git lfs pull`"), "{reported}");
        assert!(!reported.contains("damaged"), "{reported}");
    }
}
