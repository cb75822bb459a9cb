//! Names and shapes like those of the published model, and configurations that must be refused.

use std::collections::BTreeMap;

use zk0_lerobot::config::PolicyConfig;
use zk0_lerobot::layout::{expert_layout, policy_layout, state_dict_layout, TensorShapes};
use zk0_lerobot::policy_folder::LeRobotConfig;
use zk0_lerobot::StoredPolicyError;
use zk0_testkit::recordings::fixtures;

fn text(file: &str) -> String {
    std::fs::read_to_string(fixtures().join("smolvla_tiny").join(file)).unwrap()
}

fn json(file: &str) -> serde_json::Value {
    serde_json::from_str(&text(file)).unwrap()
}

/// The tiny fixture's configuration with other values.
fn policy_json(changes: &[(&str, serde_json::Value)]) -> String {
    let mut policy = json("policy_config.json");
    for (key, value) in changes {
        policy[*key] = value.clone();
    }
    policy.to_string()
}

fn parse(policy: &str) -> Result<PolicyConfig, StoredPolicyError> {
    dims(policy, &text("vlm_config.json"))
}

fn dims(policy: &str, vlm: &str) -> Result<PolicyConfig, StoredPolicyError> {
    Ok(LeRobotConfig::parse(policy, Some(vlm))?.dims)
}

/// SmolVLA as published, written as changes to the tiny fixture's file.
fn published_policy() -> String {
    policy_json(&[
        ("chunk_size", 50.into()),
        ("num_vlm_layers", 16.into()),
        ("resize_imgs_with_padding", vec![512, 512].into()),
        (
            "vlm_model_name",
            "HuggingFaceTB/SmolVLM2-500M-Video-Instruct".into(),
        ),
    ])
}

/// The published VLM's configuration, written as changes to the tiny fixture's file.
fn published_vlm() -> String {
    let mut vlm = json("vlm_config.json");
    let vision = [
        ("image_size", 512),
        ("hidden_size", 768),
        ("intermediate_size", 3072),
        ("num_hidden_layers", 12),
        ("num_attention_heads", 12),
    ];
    for (key, value) in vision {
        vlm["vision_config"][key] = value.into();
    }
    let language = [
        ("hidden_size", 960),
        ("intermediate_size", 2560),
        ("num_hidden_layers", 32),
        ("head_dim", 64),
        ("num_attention_heads", 15),
        ("num_key_value_heads", 5),
        ("vocab_size", 49280),
    ];
    for (key, value) in language {
        vlm["text_config"][key] = value.into();
    }
    vlm["scale_factor"] = 4.into();
    vlm.to_string()
}

#[test]
fn the_published_model_has_exactly_these_tensors() {
    let mut all = TensorShapes::new();
    let published = std::fs::read_to_string(fixtures().join("smolvla_full_params.json")).unwrap();
    let published: serde_json::Value = serde_json::from_str(&published).unwrap();
    for parameter in published["parameters"].as_array().unwrap() {
        let name = parameter["name"].as_str().unwrap().to_string();
        all.insert(
            name,
            serde_json::from_value(parameter["shape"].clone()).unwrap(),
        );
    }
    assert_eq!(all.len(), 500);

    let mut config = dims(&published_policy(), &published_vlm()).unwrap();
    config.camera_names.clear();
    assert_eq!((config.expert.width, config.expert.mlp_width), (720, 2048));
    assert_eq!(config.max_prefix_tokens(), 2 * 64 + 48 + 1);
    assert_eq!(state_dict_layout(&config), all);
    let elements = |shape: &Vec<usize>| shape.iter().product::<usize>();
    assert_eq!(all.values().map(elements).sum::<usize>(), 450_046_176);

    all.remove("model.vlm_with_expert.vlm.lm_head.weight")
        .unwrap();
    assert_eq!(policy_layout(&config), all);
    all.retain(|name, _| expert_layout(&config).contains_key(name));
    assert_eq!(expert_layout(&config), all);
}

#[test]
fn the_published_vlm_is_known_by_its_name() {
    let by_name = LeRobotConfig::parse(&published_policy(), None).unwrap();
    let by_file = LeRobotConfig::parse(&published_policy(), Some(&published_vlm())).unwrap();
    assert_eq!(by_name, by_file);
    // The model was built with 32 language layers. Without a smaller limit, all of them are kept.
    for limit in [-1, 0, 32, 40] {
        let mut policy: serde_json::Value = serde_json::from_str(&published_policy()).unwrap();
        policy["num_vlm_layers"] = limit.into();
        let config = LeRobotConfig::parse(&policy.to_string(), None).unwrap();
        assert_eq!(config.dims.text.layers, 32);
    }
    let unknown = LeRobotConfig::parse(&text("policy_config.json"), None).unwrap_err();
    let reported = unknown.to_string();
    assert!(
        reported.contains("`local-tiny`") && reported.contains("vlm_config.json"),
        "{reported}"
    );
}

/// On the Hub, the file leaves out values that are transformers' defaults.
#[test]
fn a_vlm_file_may_leave_out_transformers_defaults() {
    let mut vlm: serde_json::Value = serde_json::from_str(&published_vlm()).unwrap();
    for key in [
        "intermediate_size",
        "num_hidden_layers",
        "num_channels",
        "layer_norm_eps",
        "hidden_act",
    ] {
        vlm["vision_config"].as_object_mut().unwrap().remove(key);
    }
    for key in ["hidden_act", "attention_bias", "mlp_bias"] {
        vlm["text_config"].as_object_mut().unwrap().remove(key);
    }
    assert_eq!(
        dims(&published_policy(), &vlm.to_string()).unwrap(),
        dims(&published_policy(), &published_vlm()).unwrap()
    );
}

#[test]
fn the_expert_mlp_width_can_be_given() {
    let config = parse(&policy_json(&[("expert_intermediate_size", 32.into())])).unwrap();
    assert_eq!(config.expert.mlp_width, 32);
}

/// LeRobot writes the features of empty cameras into the file when it builds a policy, not before.
#[test]
fn cameras_are_in_the_files_order_and_empty_ones_count_once() {
    let visual = |name: &str| (name.to_string(), r#"{"type":"VISUAL","shape":[3,8,8]}"#);
    let features = |names: &[&str]| {
        let state = r#""observation.state":{"type":"STATE","shape":[6]}"#.to_string();
        let cameras = names.iter().map(|name| {
            let (name, feature) = visual(name);
            format!(r#""observation.images.{name}":{feature}"#)
        });
        format!(
            "{{{}}}",
            std::iter::once(state)
                .chain(cameras)
                .collect::<Vec<_>>()
                .join(",")
        )
    };
    let with = |names: &[&str]| {
        // The features are inserted as text, because a JSON value would sort their names.
        let policy = policy_json(&[
            ("empty_cameras", 2.into()),
            ("input_features", "HERE".into()),
        ]);
        parse(&policy.replace("\"HERE\"", &features(names))).unwrap()
    };
    let expected = ["wrist", "top", "empty_camera_0", "empty_camera_1"]
        .map(|name| format!("observation.images.{name}"));
    for names in [
        &["wrist", "top"][..],
        &["wrist", "top", "empty_camera_0"],
        &["wrist", "top", "empty_camera_0", "empty_camera_1"],
    ] {
        let config = with(names);
        assert_eq!(config.camera_names, expected);
        assert_eq!(config.cameras, 4);
    }
}

#[test]
fn layer_kinds_follow_lerobots_rule() {
    use zk0_lerobot::config::LayerKind::{Cross, Joint};
    let kinds = |changes: &[(&str, serde_json::Value)]| {
        let config = parse(&policy_json(changes)).unwrap();
        (0..4).map(|i| config.layer_kind(i)).collect::<Vec<_>>()
    };
    let every = |n: i64| kinds(&[("self_attn_every_n_layers", n.into())]);
    assert_eq!(every(2), [Joint, Cross, Joint, Cross]);
    assert_eq!(every(3), [Joint, Cross, Cross, Joint]);
    assert_eq!(every(0), [Cross; 4]);
    assert_eq!(every(-1), [Cross; 4]);
    assert_eq!(kinds(&[("attention_mode", "self_attn".into())]), [Joint; 4]);
}

/// Policy files with the published epsilon do not name it, so these files and their digests are the same as without that field.
#[test]
fn the_norms_epsilon_is_the_vlms() {
    let parsed =
        |vlm: &serde_json::Value| dims(&text("policy_config.json"), &vlm.to_string()).unwrap();
    let back = |config: &PolicyConfig| -> (String, PolicyConfig) {
        let text = serde_json::to_string(config).unwrap();
        let config = serde_json::from_str(&text).unwrap();
        (text, config)
    };
    let mut vlm = json("vlm_config.json");
    let usual = parsed(&vlm);
    assert_eq!(usual.rms_norm_eps, 1e-5);
    let (text, read) = back(&usual);
    assert!(!text.contains("rms_norm_eps"), "{text}");
    assert_eq!(read, usual);

    vlm["text_config"]["rms_norm_eps"] = 3e-2.into();
    let other = parsed(&vlm);
    assert_eq!(other.rms_norm_eps, 3e-2);
    assert_eq!(back(&other).1, other);

    vlm["text_config"]
        .as_object_mut()
        .unwrap()
        .remove("rms_norm_eps");
    assert_eq!(parsed(&vlm).rms_norm_eps, 1e-6, "LlamaConfig's default");
}

#[test]
fn euler_steps_and_lerobots_defaults() {
    let config = LeRobotConfig::parse(
        &policy_json(&[("num_steps", 7.into())]),
        Some(&text("vlm_config.json")),
    )
    .unwrap();
    assert_eq!(config.num_steps, 7);

    // A file of LeRobot 0.3.3 has fewer keys, and the shortest possible file has very few.
    let mut policy = json("policy_config.json");
    let keys: Vec<String> = policy.as_object().unwrap().keys().cloned().collect();
    let needed = [
        "type",
        "input_features",
        "output_features",
        "chunk_size",
        "resize_imgs_with_padding",
        "num_vlm_layers",
        "vlm_model_name",
    ];
    for key in keys.iter().filter(|key| !needed.contains(&key.as_str())) {
        policy.as_object_mut().unwrap().remove(key);
    }
    let vlm = text("vlm_config.json");
    let short = LeRobotConfig::parse(&policy.to_string(), Some(&vlm)).unwrap();
    let whole = LeRobotConfig::parse(&text("policy_config.json"), Some(&vlm)).unwrap();
    assert_eq!(short, whole);
}

#[test]
fn unsupported_or_impossible_configurations_are_refused_by_name() {
    let policy_cases = BTreeMap::from([
        ("add_image_special_tokens", true.into()),
        ("adapt_to_pi_aloha", true.into()),
        ("use_delta_joint_actions_aloha", true.into()),
        ("max_state_dim", 5.into()),
        ("num_expert_layers", 2.into()),
        ("resize_imgs_with_padding", vec![32, 32].into()),
        ("type", "pi0".into()),
        ("chunk_size", 0.into()),
        ("num_steps", 0.into()),
        ("max_action_dim", 5.into()),
        ("min_period", 5.0.into()),
        ("prefix_length", 1_000_000.into()),
        ("empty_cameras", 1_000_000_000.into()),
        ("input_features", serde_json::json!({})),
        (
            "normalization_mapping",
            serde_json::json!({"VISUAL": "MEAN_STD"}),
        ),
    ]);
    for (key, value) in policy_cases {
        let error = parse(&policy_json(&[(key, value)])).unwrap_err();
        assert!(
            matches!(error, StoredPolicyError::Config(_)),
            "{key}: {error}"
        );
    }
    let special = parse(&policy_json(&[("add_image_special_tokens", true.into())])).unwrap_err();
    let special = special.to_string();
    assert!(
        special.contains("`add_image_special_tokens` is not implemented"),
        "{special}"
    );
    for (part, key, value) in [
        ("text_config", "num_attention_heads", 0.into()),
        ("text_config", "num_key_value_heads", 4.into()),
        ("text_config", "head_dim", 7.into()),
        ("text_config", "hidden_size", usize::MAX.into()),
        ("text_config", "attention_bias", true.into()),
        ("text_config", "rms_norm_eps", 0.0.into()),
        ("text_config", "rms_norm_eps", (-1e-5).into()),
        ("vision_config", "patch_size", 0.into()),
        ("vision_config", "patch_size", 65.into()),
        ("vision_config", "patch_size", 20.into()),
        ("vision_config", "num_channels", 1.into()),
        ("vision_config", "layer_norm_eps", 1e-5.into()),
        ("text_config", "mlp_bias", true.into()),
        ("text_config", "hidden_act", "gelu".into()),
        ("vision_config", "hidden_act", serde_json::json!("relu")),
    ] {
        let mut vlm = json("vlm_config.json");
        vlm[part][key] = value;
        let error = dims(&text("policy_config.json"), &vlm.to_string()).unwrap_err();
        assert!(
            matches!(error, StoredPolicyError::Config(_)),
            "{key}: {error}"
        );
    }
    for change in [
        (|c| c.text.layers = 257) as fn(&mut PolicyConfig),
        |c| c.cameras = 1 << 17,
        |c| (c.text.width, c.text.mlp_width) = (1 << 17, 1 << 17),
        |c| c.camera_names = vec!["one of two".into()],
        |c| c.self_attn_every = usize::MAX,
        |c| c.vision.width += 1,
        |c| c.expert.width += 1,
        |c| {
            c.camera_names.clear();
            c.rename_map = BTreeMap::from([("a".into(), "b".into())]);
        },
    ] {
        let mut config = parse(&text("policy_config.json")).unwrap();
        change(&mut config);
        assert!(matches!(
            config.validate(),
            Err(StoredPolicyError::Config(_))
        ));
    }
    let twice = text("policy_config.json").replace("images.camera2", "images.camera1");
    assert!(parse(&twice).unwrap_err().to_string().contains("twice"));
    assert!(dims("{", "{}").is_err());
}
