//! The statistics of states and actions, in the two places where LeRobot keeps them.

use std::collections::HashMap;
use std::fs;

use zk0_lerobot::policy_folder::{PolicyFolder, Precision};

use super::folder::*;

#[test]
fn statistics_come_from_the_processors() {
    let source = folder(&mixed());
    let read = || PolicyFolder::open(source.path()).unwrap().stats();
    let found = read().unwrap().unwrap();
    assert_eq!(found.state.mean(), [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
    assert_eq!(found.action.mean(), [-1.0; 6]);
    assert_eq!(found.action.std(), [2.0; 6]);

    let path = source.path().join("policy_preprocessor.json");
    let json = fs::read_to_string(&path).unwrap();
    fs::write(&path, json.replace("pre.safetensors", "../pre.safetensors")).unwrap();
    let reported = read().unwrap_err().to_string();
    assert!(reported.contains("same folder"), "{reported}");
    let without = json.replace(", \"state_file\": \"pre.safetensors\"", "");
    fs::write(&path, without).unwrap();
    assert!(read().unwrap().is_none());
    fs::write(&path, &json).unwrap();

    let wrong = stats(&[
        ("observation.state.mean", &[0.0; 5]),
        ("observation.state.std", &[1.0; 5]),
    ]);
    let bytes = file_of(&wrong, HashMap::new());
    fs::write(source.path().join("pre.safetensors"), bytes).unwrap();
    let reported = read().unwrap_err().to_string();
    assert!(
        reported.contains("pre.safetensors") && reported.contains("[5]"),
        "{reported}"
    );

    let config = source.path().join("config.json");
    let json = fs::read_to_string(&config).unwrap();
    fs::write(&config, json.replace("MEAN_STD", "MIN_MAX")).unwrap();
    assert!(read().unwrap_err().to_string().contains("MIN_MAX"));
    fs::write(&config, json.replace("MEAN_STD", "IDENTITY")).unwrap();
    assert_eq!(read().unwrap().unwrap().state.std(), [1.0; 6]);
}

/// LeRobot 0.3 kept statistics in the state dict, and had no processors.
#[test]
fn statistics_among_the_weights_are_read_and_kept() {
    let mut tensors = mixed();
    tensors.extend(stats(&[
        ("normalize_inputs.buffer_observation_state.mean", &[3.0; 6]),
        ("normalize_inputs.buffer_observation_state.std", &[4.0; 6]),
        ("normalize_targets.buffer_action.mean", &[5.0; 6]),
        ("normalize_targets.buffer_action.std", &[6.0; 6]),
        ("unnormalize_outputs.buffer_action.mean", &[5.0; 6]),
        ("unnormalize_outputs.buffer_action.std", &[6.0; 6]),
    ]));
    let source = folder(&tensors);
    for file in ["policy_preprocessor.json", "policy_postprocessor.json"] {
        fs::remove_file(source.path().join(file)).unwrap();
    }
    let opened = PolicyFolder::open(source.path()).unwrap();
    let found = opened.stats().unwrap().unwrap();
    assert_eq!(
        (found.state.mean(), found.action.std()),
        (&[3.0; 6][..], &[6.0; 6][..])
    );
    let out = tempfile::tempdir().unwrap();
    let changed = opened.tensors().unwrap();
    opened.write(out.path(), &changed, Precision::Kept).unwrap();
    assert!(raw(&weights_in(out.path())) == tensors);
}
