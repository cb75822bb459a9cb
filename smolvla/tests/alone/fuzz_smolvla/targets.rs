//! The readers that get random inputs, and the inputs that fuzzing starts from.

use zk0_lerobot::tokenizer::TrainedTokenizer;
use zk0_smolvla::policy::init::init_policy;
use zk0_smolvla::policy::policy_file::{self, PolicyFile};
use zk0_smolvla::{ExpertWeights, Profile};
use zk0_testkit::fuzzing::{Target, Targets};

use super::cache_and_snapshot_targets;

pub const TARGETS: Targets = Targets {
    names: &NAMES,
    target,
    slack: 24 << 20,
};

const NAMES: [&str; 6] = [
    "safetensors",
    "policy_file",
    "prefix_entry",
    "file_digests",
    "training_state",
    "training_tensors",
];

fn target(name: &str) -> Target {
    match name {
        "safetensors" => safetensors(),
        "policy_file" => policy_file(),
        "prefix_entry" => cache_and_snapshot_targets::prefix_entry(),
        "file_digests" => cache_and_snapshot_targets::file_digests(),
        "training_state" => cache_and_snapshot_targets::training_state(),
        "training_tensors" => cache_and_snapshot_targets::training_tensors(),
        other => panic!("no target {other}; there are {NAMES:?}"),
    }
}

fn safetensors() -> Target {
    let config = Profile::Micro.config();
    let seed = init_policy(&config, 1)
        .unwrap()
        .expert
        .to_safetensors()
        .unwrap();
    Target {
        seeds: vec![seed],
        run: Box::new(move |bytes| {
            ExpertWeights::from_safetensors(&config, bytes)
                .map(drop)
                .map_err(|e| e.to_string())
        }),
    }
}

/// Reads policy files. One seed hashes words, and the other has a tokenizer.
fn policy_file() -> Target {
    let config = Profile::Micro.config();
    let policy = || init_policy(&config, 3).unwrap();
    let definition = r#"{"version": "1.0", "truncation": null, "padding": null, "added_tokens": [], "normalizer": null,
        "pre_tokenizer": {"type": "Whitespace"}, "post_processor": null, "decoder": null,
        "model": {"type": "WordLevel", "vocab": {"?": 0, "cube": 1}, "unk_token": "?"}}"#;
    let trained = PolicyFile {
        policy: policy(),
        tokenizer: TrainedTokenizer::parse(definition, &config).unwrap().into(),
    };
    let seeds = [PolicyFile::hashing_words(policy()), trained].map(|file| {
        let mut bytes = Vec::new();
        file.write(&mut bytes).unwrap();
        bytes
    });
    Target {
        seeds: seeds.into(),
        run: Box::new(|bytes| {
            policy_file::read(bytes)
                .map(drop)
                .map_err(|e| e.to_string())
        }),
    }
}
