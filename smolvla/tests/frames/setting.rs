//! A policy, a recording and its frames, for tests of samples.

use std::fs;
use std::path::{Path, PathBuf};

use zk0_lerobot::dataset::Dataset;
use zk0_smolvla::frames::prefix_cache::{FileDigests, FrameRef, KeySpace};
use zk0_smolvla::frames::sample::PreparedSample;
use zk0_smolvla::policy::frozen::FrozenPlace;
use zk0_smolvla::policy::init::init_policy;
use zk0_smolvla::policy::profile::Profile;
use zk0_smolvla::policy::tokenizer::WordHash;
use zk0_smolvla::policy::weights::Policy;

use crate::reference::fixtures;

/// A size with room for everything.
pub const PLENTY: u64 = 1 << 30;

pub fn policy() -> Policy {
    init_policy(&Profile::Micro.config(), 1).unwrap()
}

pub fn recording() -> PathBuf {
    fixtures().join("datasets/so100_sorting")
}

/// Returns the first frames of a recording with their keys.
pub fn frames(policy: &Policy, dataset: &Dataset, count: usize) -> Vec<FrameRef> {
    let tokenizer = WordHash::new(&policy.config);
    let indices: Vec<usize> = (0..count).collect();
    let keys = KeySpace::new::<PreparedSample>(policy, &FrozenPlace::default()).keys(
        &policy.config,
        &tokenizer,
        dataset,
        &indices,
        &mut FileDigests::default(),
    );
    let keys = keys.unwrap().into_iter().zip(indices);
    keys.map(|(key, index)| FrameRef {
        dataset: 0,
        index,
        key,
        transformed: false,
    })
    .collect()
}

/// Copies a folder.
pub fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let entry = entry.unwrap();
        let target = to.join(entry.file_name());
        match entry.file_type().unwrap().is_dir() {
            true => copy(&entry.path(), &target),
            false => fs::copy(entry.path(), target).map(drop).unwrap(),
        }
    }
}
