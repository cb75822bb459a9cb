//! A policy folder as weights, in memory and on a device.

use std::fs;

use zk0_lerobot::policy_folder::PolicyFolder;
use zk0_smolvla::Policy;

use crate::reference::{fixtures, parameters_of};

const NORM: &str = "model.vlm_with_expert.lm_expert.norm.weight";

#[test]
fn a_folder_gives_the_weights_that_its_file_holds() {
    let (tiny, folder) = (
        fixtures().join("smolvla_tiny"),
        tempfile::tempdir().unwrap(),
    );
    for (from, to) in [
        ("policy_config.json", "config.json"),
        ("vlm_config.json", "vlm_config.json"),
        ("weights.safetensors", "model.safetensors"),
    ] {
        fs::copy(tiny.join(from), folder.path().join(to)).unwrap();
    }
    let opened = PolicyFolder::open(folder.path()).unwrap();
    let policy = Policy::from_folder(&opened).unwrap();
    let bytes = fs::read(tiny.join("weights.safetensors")).unwrap();
    let direct = Policy::from_safetensors(&opened.config().dims, &bytes).unwrap();
    assert_eq!(policy, direct);

    let parameters = parameters_of(&opened);
    let norm: Vec<f32> = parameters.get(NORM).unwrap().to_vec1().unwrap();
    assert_eq!(norm, policy.expert.tensors()[NORM].data);
}
