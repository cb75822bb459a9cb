//! Profiles, and the dimensions that an evaluation takes from a policy.

use zk0_lerobot::policy_folder::LeRobotConfig;
use zk0_smolvla::measure::fixed_point::dims;
use zk0_smolvla::{PolicyConfig, Profile};

use crate::reference::fixtures;

#[test]
fn the_full_profile_is_the_published_model() {
    let file = fixtures().join("smolvla_tiny/policy_config.json");
    let text = std::fs::read_to_string(file).unwrap();
    let mut policy: serde_json::Value = serde_json::from_str(&text).unwrap();
    policy["chunk_size"] = 50.into();
    policy["num_vlm_layers"] = 16.into();
    policy["resize_imgs_with_padding"] = vec![512, 512].into();
    policy["vlm_model_name"] = "HuggingFaceTB/SmolVLM2-500M-Video-Instruct".into();
    let mut published = LeRobotConfig::parse(&policy.to_string(), None)
        .unwrap()
        .dims;
    published.camera_names.clear();
    assert_eq!(Profile::Full.config(), published);
}

#[test]
fn profiles_are_valid_and_named() {
    for profile in Profile::ALL {
        profile.config().validate().unwrap();
        assert_eq!(Profile::from_name(profile.name()).unwrap(), profile);
    }
    assert!(Profile::from_name("huge")
        .unwrap_err()
        .to_string()
        .contains("`huge`"));
    let micro = Profile::Micro.config();
    assert_eq!(
        (
            micro.tokens_per_camera(),
            micro.max_prefix_tokens(),
            micro.chunk_elements()
        ),
        (4, 13, 48)
    );
}

/// Networks name a policy by the digest of a file that holds this.
#[test]
fn a_profiles_dimensions_are_written_as_they_always_were() {
    let written = serde_json::to_value(Profile::Micro.config()).unwrap();
    let keys: Vec<&String> = written.as_object().unwrap().keys().collect();
    assert_eq!(keys.len(), 13, "{keys:?}");
}

#[test]
fn what_the_evaluation_has_as_a_constant_must_be_the_policys() {
    type Change = fn(&mut PolicyConfig);
    let changes: [(Change, &str); 2] = [
        (|c| c.rms_norm_eps = 1e-6, "rms_norm_eps"),
        (|c| c.min_period = 0.005, "time periods"),
    ];
    for (change, named) in changes {
        let mut config = Profile::Micro.config();
        change(&mut config);
        let error = dims(&config).unwrap_err().to_string();
        assert!(error.contains(named), "{error}");
    }
}
