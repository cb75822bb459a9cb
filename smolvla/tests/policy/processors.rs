//! Policy folders with other processors, against the losses that LeRobot 0.6.1 finds: `tests/fixtures/policy_processors`.

use std::fs;
use std::path::PathBuf;

use serde_json::Value;
use zk0_lerobot::dataset::Dataset;
use zk0_lerobot::policy_folder::{PolicyFolder, IMAGES};
use zk0_lerobot::tokenizer::TrainedTokenizer;
use zk0_lerobot::StoredTensors;
use zk0_smolvla::frames::cameras::camera_slots;
use zk0_smolvla::frames::sample::{PreparedSample, Preparer};
use zk0_smolvla::measure::evaluate::{evaluate, FlowDraw};
use zk0_smolvla::{Policy, PolicyConfig, Profile};

use crate::reference::fixtures;

fn made() -> PathBuf {
    fixtures().join("policy_processors")
}

fn facts() -> Value {
    serde_json::from_slice(&fs::read(made().join("facts.json")).unwrap()).unwrap()
}

fn recording() -> Dataset {
    let name = facts()["recording"].as_str().unwrap().to_owned();
    Dataset::open(fixtures().join("datasets").join(name)).unwrap()
}

/// A folder of LeRobot's, with the tiny policy's weights.
fn case(name: &str) -> (tempfile::TempDir, PolicyFolder) {
    let folder = tempfile::tempdir().unwrap();
    let put = |from: PathBuf, name: &str| {
        fs::copy(from, folder.path().join(name)).unwrap();
    };
    for file in fs::read_dir(made().join(name)).unwrap() {
        let file = file.unwrap();
        put(file.path(), file.file_name().to_str().unwrap());
    }
    let tiny = fixtures().join("smolvla_tiny");
    put(tiny.join("vlm_config.json"), "vlm_config.json");
    let weights = match folder.path().join("adapter_config.json") {
        // The adapter is in the folder, and its base is another one.
        adapter if adapter.exists() => {
            let config = fs::read_to_string(&adapter).unwrap();
            let base = folder.path().join("base");
            fs::create_dir(&base).unwrap();
            let config = config.replace("zk0/base", base.to_str().unwrap());
            fs::write(&adapter, config).unwrap();
            "base/model.safetensors"
        }
        _ => "model.safetensors",
    };
    put(tiny.join("weights.safetensors"), weights);
    let opened = PolicyFolder::open(folder.path()).unwrap();
    (folder, opened)
}

/// The draws that LeRobot's losses were measured with.
fn draws() -> Vec<FlowDraw> {
    let file = StoredTensors::open(made().join("draws.safetensors")).unwrap();
    let (noise, time) = (file.read("noise").unwrap(), file.read("time").unwrap());
    let each = noise.data.len() / time.data.len();
    let noise = noise.data.chunks(each).map(<[f32]>::to_vec);
    let pairs = time.data.into_iter().zip(noise);
    pairs
        .map(|(time, noise)| FlowDraw { time, noise })
        .collect()
}

fn loss(name: &str) -> f64 {
    let (_folder, opened) = case(name);
    let policy = Policy::from_folder(&opened).unwrap();
    let hub = made().join("hub");
    let tokenizer = opened.tokenizer_file(Some(&hub)).unwrap().unwrap();
    let tokenizer = TrainedTokenizer::read(tokenizer, &policy.config).unwrap();
    let mut dataset = recording();
    dataset
        .normalise_with(opened.inference().unwrap().stats.unwrap())
        .unwrap();
    let preparer = Preparer::new(&policy, &tokenizer).unwrap();
    let frames: Vec<usize> = serde_json::from_value(facts()["frames"].clone()).unwrap();
    let samples: Vec<PreparedSample> = preparer
        .prepare_frames(&dataset, frames.into_iter(), |_, _| ())
        .unwrap();
    let draws = draws();
    let pairs: Vec<_> = samples.iter().zip(&draws).collect();
    evaluate(&policy.config, &policy.expert, &pairs)
        .unwrap()
        .loss()
}

#[test]
fn the_loss_is_that_of_lerobot_whatever_the_steps_ask_for() {
    for name in [
        "map_in_order",
        "map_crossed",
        "map_that_swaps",
        "map_of_one",
        "order_of_the_policy",
        "fewer_cameras",
        "other_norm_map",
        "lora_adapter",
    ] {
        let expected = facts()["losses"][name].as_f64().unwrap();
        let found = loss(name);
        assert!(
            (found / expected - 1.0).abs() < 1e-5,
            "{name}: {found}, LeRobot finds {expected}"
        );
    }
}

#[test]
fn cameras_are_refused_where_lerobot_refuses_them() {
    let dataset = recording();
    let found: Vec<&str> = dataset.cameras().iter().map(|c| &c.name[..]).collect();
    for (case, cameras) in [
        ("strangers", &["camera1", "camera2"][..]),
        ("one_stranger", &["top", "side"]),
        ("policy_has_more", &["top", "wrist", "side"]),
    ] {
        let config = PolicyConfig {
            cameras: cameras.len(),
            camera_names: cameras
                .iter()
                .map(|name| format!("{IMAGES}{name}"))
                .collect(),
            ..Profile::Tiny.config()
        };
        let refused = facts()["refused"][case].is_string();
        assert_eq!(camera_slots(&config, 0, &found).is_err(), refused, "{case}");
    }
}
