//! Names and shapes against the published model's, and configurations that must be refused.

mod reference;

use std::collections::BTreeMap;

use reference::text;
use zk0_smolvla::layout::{expert_layout, policy_layout, Layout};
use zk0_smolvla::{PolicyConfig, PolicyError, Profile};

/// SmolVLA as published, written as changes to the tiny fixture's files.
fn published() -> PolicyConfig {
    let mut policy: serde_json::Value = serde_json::from_str(&text("policy_config.json")).unwrap();
    let mut vlm: serde_json::Value = serde_json::from_str(&text("vlm_config.json")).unwrap();
    for (key, value) in [("chunk_size", 50), ("num_vlm_layers", 16)] {
        policy[key] = value.into();
    }
    policy["resize_imgs_with_padding"] = vec![512, 512].into();
    let vision = [
        ("image_size", 512),
        ("hidden_size", 768),
        ("intermediate_size", 3072),
    ];
    for (key, value) in vision
        .into_iter()
        .chain([("num_hidden_layers", 12), ("num_attention_heads", 12)])
    {
        vlm["vision_config"][key] = value.into();
    }
    let language = [
        ("hidden_size", 960),
        ("intermediate_size", 2560),
        ("num_hidden_layers", 32),
        ("head_dim", 64),
    ];
    let heads = [
        ("num_attention_heads", 15),
        ("num_key_value_heads", 5),
        ("vocab_size", 49280),
    ];
    for (key, value) in language.into_iter().chain(heads) {
        vlm["text_config"][key] = value.into();
    }
    vlm["scale_factor"] = 4.into();
    PolicyConfig::from_lerobot(&policy.to_string(), &vlm.to_string()).unwrap()
}

#[test]
fn the_published_model_has_exactly_these_tensors() {
    let json: serde_json::Value =
        serde_json::from_str(&text("../smolvla_full_params.json")).unwrap();
    let (mut all, mut trainable) = (Layout::new(), Layout::new());
    for parameter in json["parameters"].as_array().unwrap() {
        let name = parameter["name"].as_str().unwrap().to_string();
        let shape: Vec<usize> = serde_json::from_value(parameter["shape"].clone()).unwrap();
        if parameter["trainable"].as_bool().unwrap() {
            trainable.insert(name.clone(), shape.clone());
        }
        all.insert(name, shape);
    }
    assert_eq!(all.len(), 500);
    all.remove("model.vlm_with_expert.vlm.lm_head.weight")
        .unwrap();
    // LeRobot trains the state projection by default; here it is frozen with the rest of the prefix.
    trainable.retain(|name, _| !name.starts_with("model.state_proj."));

    let config = published();
    assert_eq!((config.expert.width, config.expert.mlp_width), (720, 2048));
    assert_eq!(config.max_prefix_tokens(), 2 * 64 + 48 + 1);
    assert_eq!(policy_layout(&config), all);
    assert_eq!(expert_layout(&config), trainable);
    assert_eq!(Profile::Full.config(), config);
}

#[test]
fn profiles_are_valid_and_named() {
    for profile in [Profile::Tiny, Profile::Micro, Profile::Full] {
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

#[test]
fn the_expert_mlp_width_can_be_given() {
    let mut policy: serde_json::Value = serde_json::from_str(&text("policy_config.json")).unwrap();
    policy["expert_intermediate_size"] = 32.into();
    let config = PolicyConfig::from_lerobot(&policy.to_string(), &text("vlm_config.json")).unwrap();
    assert_eq!(config.expert.mlp_width, 32);
}

#[test]
fn unsupported_or_impossible_configurations_are_refused_by_name() {
    let policy_cases = BTreeMap::from([
        ("attention_mode", serde_json::json!("self_attn")),
        ("add_image_special_tokens", true.into()),
        ("prefix_length", 100.into()),
        ("num_expert_layers", 2.into()),
        ("resize_imgs_with_padding", vec![32, 32].into()),
        ("type", "pi0".into()),
        ("self_attn_every_n_layers", 0.into()),
        ("chunk_size", 0.into()),
        ("max_action_dim", 5.into()),
        ("min_period", 5.0.into()),
        ("input_features", serde_json::json!({})),
    ]);
    for (key, value) in policy_cases {
        let mut policy: serde_json::Value =
            serde_json::from_str(&text("policy_config.json")).unwrap();
        policy[key] = value;
        let error =
            PolicyConfig::from_lerobot(&policy.to_string(), &text("vlm_config.json")).unwrap_err();
        assert!(matches!(error, PolicyError::Config(_)), "{key}: {error}");
    }
    for (part, key, value) in [
        ("text_config", "num_attention_heads", 0),
        ("text_config", "num_key_value_heads", 4),
        ("text_config", "head_dim", 7),
        ("text_config", "hidden_size", usize::MAX),
        ("vision_config", "patch_size", 0),
        ("vision_config", "patch_size", 15),
        ("vision_config", "num_channels", 1),
    ] {
        let mut vlm: serde_json::Value = serde_json::from_str(&text("vlm_config.json")).unwrap();
        vlm[part][key] = value.into();
        let error =
            PolicyConfig::from_lerobot(&text("policy_config.json"), &vlm.to_string()).unwrap_err();
        assert!(matches!(error, PolicyError::Config(_)), "{key}: {error}");
    }
    for change in [
        (|c| c.text.layers = 257) as fn(&mut PolicyConfig),
        |c| c.cameras = 1 << 17,
        |c| (c.text.width, c.text.mlp_width) = (1 << 17, 1 << 17),
    ] {
        let mut config = Profile::Micro.config();
        change(&mut config);
        assert!(matches!(config.validate(), Err(PolicyError::Config(_))));
    }
    assert!(PolicyConfig::from_lerobot("{", "{}").is_err());
}
