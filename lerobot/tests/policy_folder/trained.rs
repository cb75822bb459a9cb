//! A copy with what was trained: it has the statistics of the recording that it was trained on, wherever its source keeps its own.

use std::collections::HashMap;
use std::fs;
use std::path::Path;

use safetensors::tensor::Dtype;
use serde_json::Value;
use zk0_lerobot::dataset::{Normalizer, Stats};
use zk0_lerobot::policy_folder::{PolicyFolder, Precision};
use zk0_tensors::TensorSet;

use super::folder::*;

/// Statistics that need many decimal digits. BF16 would lose the last ones.
fn recording() -> Stats {
    let mean = (0..6).map(|d| 1.0 / (3.0 + d as f32)).collect();
    let std = (0..6).map(|d| 1e-4 * (7.0 + d as f32)).collect();
    Stats {
        state: Normalizer::new(mean, std).unwrap(),
        action: Normalizer::new(vec![-98.765_43; 6], vec![12.345_678; 6]).unwrap(),
    }
}

/// Changes the weights as if they were trained for a step, and returns them with the folder that is written with them.
fn write(source: &Path, precision: Precision) -> (TensorSet, tempfile::TempDir) {
    let opened = PolicyFolder::open(source).unwrap();
    let mut expert = expert(&opened);
    for tensor in expert.values_mut() {
        tensor.data.iter_mut().for_each(|x| *x = *x * 1.01 + 1e-3);
    }
    let out = tempfile::tempdir().unwrap();
    opened
        .write_trained(out.path(), &expert, &recording(), precision)
        .unwrap();
    (expert, out)
}

fn read(folder: &Path, name: &str) -> Vec<u8> {
    fs::read(folder.join(name)).unwrap()
}

fn stats_of(folder: &Path) -> Option<Stats> {
    PolicyFolder::open(folder).unwrap().stats().unwrap()
}

fn f32s(raw: &Raw) -> Vec<f32> {
    let numbers = raw.2.chunks_exact(4);
    numbers
        .map(|b| f32::from_le_bytes(b.try_into().unwrap()))
        .collect()
}

#[test]
fn processors_get_the_recordings_statistics() {
    let source = folder(&raw(&fixture("weights.safetensors")));
    // LeRobot leaves statistics of every feature, and more kinds than mean and standard deviation.
    let mut state = raw(&read(source.path(), "pre.safetensors"));
    state.extend(stats(&[
        ("observation.state.min", &[-1.0; 6]),
        ("action.q99", &[9.0; 6]),
        ("observation.images.top.mean", &[0.5; 3]),
    ]));
    let count = (Dtype::I64, vec![1], 245i64.to_le_bytes().to_vec());
    state.insert("observation.images.top.count".into(), count);
    let bytes = file_of(&state, HashMap::new());
    fs::write(source.path().join("pre.safetensors"), bytes).unwrap();

    let (expert, out) = write(source.path(), Precision::Kept);
    assert_eq!(stats_of(out.path()), Some(recording()));
    assert_ne!(stats_of(source.path()), Some(recording()));
    let again = PolicyFolder::open(out.path()).unwrap();
    assert_eq!(super::folder::expert(&again), expert);

    for name in ["pre.safetensors", "post.safetensors"] {
        let written = raw(&read(out.path(), name));
        let is = |name: &str, values: &[f32]| {
            assert_eq!(f32s(&written[name]), values, "{name}");
            assert_eq!(written[name].0, Dtype::F32);
        };
        is("observation.state.mean", recording().state.mean());
        is("observation.state.std", recording().state.std());
        is("action.mean", recording().action.mean());
        is("action.std", recording().action.std());
        // The statistics of images stay. The other statistics of states and actions are gone, because they were of another
        // recording.
        let others = |(name, _): &(&String, &Raw)| name.starts_with("observation.images");
        let kept: Vec<_> = written.iter().filter(others).collect();
        let had = raw(&read(source.path(), name));
        assert_eq!(kept, had.iter().filter(others).collect::<Vec<_>>());
        assert_eq!(written.len(), 4 + kept.len(), "{name}");
    }
    for entry in fs::read_dir(source.path()).unwrap() {
        let name = entry.unwrap().file_name().into_string().unwrap();
        let same = read(source.path(), &name) == read(out.path(), &name);
        let differs = ["model.safetensors", "pre.safetensors", "post.safetensors"];
        assert_eq!(same, !differs.contains(&&name[..]), "{name}");
    }
}

#[test]
fn a_processor_that_has_seen_no_recording_gets_a_state() {
    let source = folder(&mixed());
    let pipelines = [
        ("policy_preprocessor.json", "pre.safetensors"),
        ("policy_postprocessor.json", "post.safetensors"),
    ];
    for (file, state) in pipelines {
        let path = source.path().join(file);
        let json = fs::read_to_string(&path).unwrap();
        let without = json.replace(&format!(", \"state_file\": \"{state}\""), "");
        assert_ne!(json, without);
        fs::write(&path, without).unwrap();
        fs::remove_file(source.path().join(state)).unwrap();
    }
    assert_eq!(stats_of(source.path()), None);
    let (_, out) = write(source.path(), Precision::Kept);
    assert_eq!(stats_of(out.path()), Some(recording()));
    let parsed = |folder: &Path, file: &str| -> Value {
        serde_json::from_slice(&read(folder, file)).unwrap()
    };
    for (file, state) in [
        (
            "policy_preprocessor.json",
            "policy_preprocessor_step_1_normalizer_processor.safetensors",
        ),
        (
            "policy_postprocessor.json",
            "policy_postprocessor_step_1_unnormalizer_processor.safetensors",
        ),
    ] {
        let mut expected = parsed(source.path(), file);
        expected["steps"][1]["state_file"] = state.into();
        assert_eq!(parsed(out.path(), file), expected);
        assert!(out.path().join(state).is_file());
    }
}

/// In LeRobot 0.3, there are no processors.
#[test]
fn without_processors_statistics_are_among_the_weights() {
    let bare = folder(&mixed());
    for (pipeline, state) in [
        ("policy_preprocessor.json", "pre.safetensors"),
        ("policy_postprocessor.json", "post.safetensors"),
    ] {
        fs::remove_file(bare.path().join(pipeline)).unwrap();
        fs::remove_file(bare.path().join(state)).unwrap();
    }
    let buffers = [
        "normalize_inputs.buffer_observation_state",
        "normalize_targets.buffer_action",
        "unnormalize_outputs.buffer_action",
    ];
    let names = buffers.map(|name| ["mean", "std"].map(|what| format!("{name}.{what}")));
    let names = names.as_flattened();
    let put = |tensors: &RawFile| {
        let path = bare.path().join("model.safetensors");
        fs::write(path, file_of(tensors, pytorch())).unwrap();
    };
    let mut in_f32 = mixed();
    let ones = names.iter().map(|name| (&name[..], &[1.0f32; 6][..]));
    in_f32.extend(stats(&ones.collect::<Vec<_>>()));
    let mut in_bf16 = in_f32.clone();
    for name in names {
        let one = half::bf16::ONE.to_le_bytes();
        let raw = (Dtype::BF16, vec![6], one.repeat(6));
        in_bf16.insert(name.clone(), raw);
    }
    for tensors in [mixed(), in_f32, in_bf16] {
        put(&tensors);
        for precision in [Precision::Kept, Precision::Single] {
            let (expert, out) = write(bare.path(), precision);
            assert_eq!(stats_of(out.path()), Some(recording()));
            let written = raw(&weights_in(out.path()));
            let action = &written["normalize_targets.buffer_action.std"];
            assert_eq!(f32s(action), recording().action.std());
            for (name, before) in &tensors {
                let same = *before == written[name];
                let new = expert.contains_key(name) || names.contains(name);
                assert_eq!(same, !new, "{name}");
            }
            let more = names.iter().filter(|name| !tensors.contains_key(*name));
            assert_eq!(written.len(), tensors.len() + more.count());
        }
    }
}

#[test]
fn what_is_not_normalised_has_no_statistics_to_replace() {
    let source = folder(&mixed());
    let config = source.path().join("config.json");
    let json = fs::read_to_string(&config).unwrap();
    let actions_alone = json.replace(r#""STATE": "MEAN_STD""#, r#""STATE": "IDENTITY""#);
    assert_ne!(json, actions_alone);
    fs::write(&config, actions_alone).unwrap();
    let (_, out) = write(source.path(), Precision::Kept);
    let found = stats_of(out.path()).unwrap();
    assert_eq!(found.state, Normalizer::identity(6).unwrap());
    assert_eq!(found.action, recording().action);
    // In training, LeRobot normalises actions with the first pipeline.
    let pre = raw(&read(out.path(), "pre.safetensors"));
    assert_eq!(f32s(&pre["action.mean"]), recording().action.mean());
    assert_eq!(f32s(&pre["observation.state.std"]), [0.5; 6]);

    fs::write(&config, json.replace("MEAN_STD", "IDENTITY")).unwrap();
    let (_, out) = write(source.path(), Precision::Kept);
    for name in ["pre.safetensors", "post.safetensors"] {
        assert_eq!(read(source.path(), name), read(out.path(), name));
    }
}

#[test]
fn a_folder_that_cannot_take_statistics_is_refused_before_anything_is_written() {
    let source = folder(&mixed());
    let out = tempfile::tempdir().unwrap();
    let refused_with = |stats: &Stats| {
        let opened = PolicyFolder::open(source.path()).unwrap();
        let to = out.path().join("new");
        let error = opened.write_trained(&to, &TensorSet::new(), stats, Precision::Kept);
        let reported = error.unwrap_err().to_string();
        assert_eq!(opened.check_takes(stats).unwrap_err().to_string(), reported);
        assert!(!to.exists());
        reported
    };
    let refused = || refused_with(&recording());
    let mut wide = recording();
    wide.action = Normalizer::identity(7).unwrap();
    let reported = refused_with(&wide);
    assert!(reported.contains("`action` have 7"), "{reported}");

    let path = source.path().join("policy_preprocessor.json");
    let json = fs::read_to_string(&path).unwrap();
    for (replaced, by, expected) in [
        ("pre.safetensors", "../pre.safetensors", "same folder"),
        (
            "pre.safetensors",
            "model.safetensors",
            "the policy's weights",
        ),
        ("pre.safetensors", "config.json", "config.json"),
        ("pre.safetensors", "none.safetensors", "none.safetensors"),
    ] {
        fs::write(&path, json.replacen(replaced, by, 1)).unwrap();
        let reported = refused();
        assert!(reported.contains(expected), "{reported}");
    }
    fs::write(&path, &json).unwrap();
    let config = source.path().join("config.json");
    let json = fs::read_to_string(&config).unwrap();
    fs::write(&config, json.replace("MEAN_STD", "MIN_MAX")).unwrap();
    let reported = refused();
    assert!(
        reported.contains("config.json") && reported.contains("MIN_MAX"),
        "{reported}"
    );
}
