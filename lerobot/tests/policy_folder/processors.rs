//! The steps of the processors, in folders that LeRobot 0.6.1 wrote: `tests/fixtures/policy_processors`.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::{json, Value};
use zk0_lerobot::dataset::Dataset;
use zk0_lerobot::policy_folder::{Normalisation, PolicyFolder, Precision};
use zk0_lerobot::tokenizer::{Tokenizer, TrainedTokenizer};
use zk0_tensors::TensorSet;
use zk0_testkit::recordings::fixtures;

use super::folder::fixture;

const PREPROCESSOR: &str = "policy_preprocessor.json";
const POSTPROCESSOR: &str = "policy_postprocessor.json";

fn made() -> PathBuf {
    fixtures().join("policy_processors")
}

/// A folder of LeRobot's, with the tiny policy's weights.
fn case(name: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for file in fs::read_dir(made().join(name)).unwrap() {
        let file = file.unwrap();
        fs::copy(file.path(), folder.path().join(file.file_name())).unwrap();
    }
    for (from, to) in [
        ("vlm_config.json", "vlm_config.json"),
        ("weights.safetensors", "model.safetensors"),
    ] {
        fs::write(folder.path().join(to), fixture(from)).unwrap();
    }
    folder
}

fn open(folder: &tempfile::TempDir) -> PolicyFolder {
    PolicyFolder::open(folder.path()).unwrap()
}

/// What is stated of a folder whose pipeline was changed.
fn refusal(pipeline: &str, change: impl FnOnce(&mut Vec<Value>)) -> String {
    let folder = case("map_in_order");
    edit(folder.path(), pipeline, change);
    let opened = PolicyFolder::open(folder.path()).and_then(|folder| folder.inference());
    opened.unwrap_err().to_string()
}

fn edit(folder: &Path, pipeline: &str, change: impl FnOnce(&mut Vec<Value>)) {
    let path = folder.join(pipeline);
    let mut json: Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
    change(json["steps"].as_array_mut().unwrap());
    fs::write(&path, json.to_string()).unwrap();
}

fn step<'a>(steps: &'a mut [Value], name: &str) -> &'a mut Value {
    let mut steps = steps.iter_mut();
    steps.find(|step| step["registry_name"] == name).unwrap()
}

fn image(name: &str) -> String {
    format!("observation.images.{name}")
}

#[test]
fn maps_of_cameras_are_read_beside_the_policys_own_order() {
    let two = ["camera1", "camera2"];
    for (name, cameras, map) in [
        (
            "map_in_order",
            two,
            &[("top", "camera1"), ("wrist", "camera2")][..],
        ),
        (
            "map_crossed",
            two,
            &[("wrist", "camera1"), ("top", "camera2")],
        ),
        (
            "map_that_swaps",
            ["top", "wrist"],
            &[("top", "wrist"), ("wrist", "top")],
        ),
        ("map_of_one", two, &[("wrist", "camera2")]),
        ("order_of_the_policy", ["wrist", "top"], &[]),
    ] {
        let dims = &open(&case(name)).config().dims.clone();
        assert_eq!(dims.camera_names, cameras.map(image), "{name}");
        let map = map.iter().map(|(old, new)| (image(old), image(new)));
        assert_eq!(dims.rename_map, map.collect(), "{name}");
    }
}

#[test]
fn a_second_map_renames_what_the_first_one_gave() {
    let folder = case("map_in_order");
    edit(folder.path(), PREPROCESSOR, |steps| {
        let map = json!({image("camera1"): image("camera3"), image("side"): image("camera1")});
        let second = json!({"registry_name": "rename_observations_processor", "config": {"rename_map": map}});
        steps.insert(1, second);
    });
    let found = open(&folder).config().dims.rename_map.clone();
    let expected = [
        ("camera1", "camera3"),
        ("side", "camera1"),
        ("top", "camera3"),
        ("wrist", "camera2"),
    ];
    assert_eq!(
        found,
        expected.map(|(old, new)| (image(old), image(new))).into()
    );
}

#[test]
fn a_map_of_something_else_than_cameras_is_refused() {
    for (old, new) in [
        ("observation.state", "observation.joints"),
        ("top", "observation.images.camera1"),
        ("observation.images.top", "camera1"),
    ] {
        let reported = refusal(PREPROCESSOR, |steps| {
            let rename = step(steps, "rename_observations_processor");
            rename["config"]["rename_map"] = json!({old: new});
        });
        assert!(reported.contains(PREPROCESSOR), "{reported}");
        assert!(
            reported.contains(&format!("`{old}` to `{new}`")),
            "{reported}"
        );
    }
}

#[test]
fn the_modes_of_the_steps_count_and_not_those_of_the_configuration() {
    let folder = case("other_norm_map");
    let opened = open(&folder);
    assert_eq!(opened.config().state_normalisation, "MEAN_STD");
    let inference = opened.inference().unwrap();
    assert_eq!(inference.state, Normalisation::Identity);
    assert_eq!(inference.action, Normalisation::MeanStd);
    let found = inference.stats.unwrap();
    assert_eq!(found.state.std(), [1.0; 6]);
    let recorded = Dataset::open(fixtures().join("datasets/so100_pickplace")).unwrap();
    assert_eq!(found.action, recorded.stats().action);

    // A step that does not list the state leaves it as it is, and so does a pipeline without the step.
    let changes: [fn(&mut Value); 3] = [
        |config| config["features"] = json!({}),
        |config| config["normalize_observation_keys"] = json!(["observation.other"]),
        |config| config["norm_map"] = json!({"ACTION": "MEAN_STD"}),
    ];
    for change in changes {
        let folder = case("map_in_order");
        assert_eq!(
            open(&folder).inference().unwrap().state,
            Normalisation::MeanStd
        );
        edit(folder.path(), PREPROCESSOR, |steps| {
            change(&mut step(steps, "normalizer_processor")["config"]);
        });
        assert_eq!(
            open(&folder).inference().unwrap().state,
            Normalisation::Identity
        );
    }
}

#[test]
fn pipelines_that_disagree_about_actions_are_refused() {
    let identity = |steps: &mut Vec<Value>| {
        step(steps, "unnormalizer_processor")["config"]["norm_map"]["ACTION"] = "IDENTITY".into();
    };
    for reported in [
        refusal(POSTPROCESSOR, identity),
        refusal(POSTPROCESSOR, |steps| drop(steps.remove(0))),
    ] {
        assert!(
            reported.contains("normalises `action` by `MEAN_STD`"),
            "{reported}"
        );
        assert!(
            reported.contains("brings it back by `IDENTITY`"),
            "{reported}"
        );
    }
}

#[test]
fn actions_relative_to_the_state_are_refused_where_they_are_enabled() {
    let folder = case("relative_actions");
    let reported = PolicyFolder::open(folder.path()).unwrap_err().to_string();
    assert!(
        reported.contains("`relative_actions_processor` is enabled"),
        "{reported}"
    );
    let off = |name: &'static str| {
        move |steps: &mut Vec<Value>| {
            step(steps, name)["config"]["enabled"] = false.into();
        }
    };
    edit(
        folder.path(),
        PREPROCESSOR,
        off("relative_actions_processor"),
    );
    let reported = PolicyFolder::open(folder.path()).unwrap_err().to_string();
    assert!(
        reported.contains("`absolute_actions_processor` is enabled"),
        "{reported}"
    );
    edit(
        folder.path(),
        POSTPROCESSOR,
        off("absolute_actions_processor"),
    );
    open(&folder);
}

#[test]
fn what_a_step_asks_for_and_zk0_cannot_do_is_refused_by_name() {
    let set = |name: &'static str, key: &'static str, value: Value| {
        refusal(PREPROCESSOR, move |steps| {
            step(steps, name)["config"][key] = value;
        })
    };
    let normalizer = "normalizer_processor";
    let tokenizer = "tokenizer_processor";
    for (reported, expected) in [
        (
            refusal(PREPROCESSOR, |steps| {
                steps.insert(
                    1,
                    json!({"registry_name": "image_crop_resize_processor", "config": {}}),
                )
            }),
            "step `image_crop_resize_processor` is not known",
        ),
        (
            refusal(PREPROCESSOR, |steps| {
                steps.push(json!({"class": "lab.steps.Blur", "config": {}}))
            }),
            "step `lab.steps.Blur` is not known",
        ),
        (
            refusal(PREPROCESSOR, |steps| steps.push(json!({"config": {}}))),
            "a step without `registry_name`",
        ),
        (
            refusal(PREPROCESSOR, |steps| steps.push(steps[5].clone())),
            "has the step `normalizer_processor` twice",
        ),
        (
            refusal(PREPROCESSOR, |steps| steps.swap(2, 3)),
            "no `smolvla_new_line_processor` before it",
        ),
        (
            set(tokenizer, "task_key", "subtask".into()),
            "reads `subtask`",
        ),
        (set(tokenizer, "truncation", false.into()), "does not cut"),
        (set(tokenizer, "language", "en".into()), "`language`"),
        (
            set(tokenizer, "max_length", 0.into()),
            "max_language_tokens",
        ),
        (set(normalizer, "eps", 1e-6.into()), "`eps` 0.000001"),
        (
            set(normalizer, "norm_map", json!({"VISUAL": "MEAN_STD"})),
            "normalises images by `MEAN_STD`",
        ),
        (
            set(normalizer, "norm_map", json!({"STATE": "QUANTILES"})),
            "normalised by `QUANTILES`",
        ),
        (
            set("device_processor", "float_dtype", "bfloat16".into()),
            "`bfloat16`",
        ),
    ] {
        assert!(reported.contains(expected), "{reported}: lacks {expected}");
        assert!(reported.contains(PREPROCESSOR), "{reported}");
    }
}

#[test]
fn instructions_are_as_long_as_the_step_says() {
    let folder = case("map_in_order");
    assert_eq!(open(&folder).config().dims.max_language_tokens, 48);
    edit(folder.path(), PREPROCESSOR, |steps| {
        step(steps, "tokenizer_processor")["config"]["max_length"] = 5.into();
    });
    assert_eq!(open(&folder).config().dims.max_language_tokens, 5);
}

#[test]
fn the_tokenizer_that_the_step_names_comes_from_the_hubs_cache() {
    let folder = case("map_in_order");
    let opened = open(&folder);
    let cache = made().join("hub");
    let file = opened.tokenizer_file(Some(&cache)).unwrap().unwrap();
    let tokenizer = TrainedTokenizer::read(file, &opened.config().dims).unwrap();
    let facts: Value =
        serde_json::from_slice(&fs::read(made().join("facts.json")).unwrap()).unwrap();
    let expected: Vec<u32> = serde_json::from_value(facts["tokens"].clone()).unwrap();
    let recorded = Dataset::open(fixtures().join("datasets/so100_pickplace")).unwrap();
    assert_eq!(tokenizer.tokens(&recorded.tasks()[0]).unwrap(), expected);

    let empty = tempfile::tempdir().unwrap();
    for cache in [None, Some(empty.path())] {
        let reported = opened.tokenizer_file(cache).unwrap_err().to_string();
        assert!(
            reported.contains("`hf download zk0/tiny tokenizer.json`"),
            "{reported}"
        );
        assert!(reported.contains(PREPROCESSOR), "{reported}");
    }
    // LeRobot 0.3 took the name from the configuration.
    for pipeline in [PREPROCESSOR, POSTPROCESSOR] {
        fs::remove_file(folder.path().join(pipeline)).unwrap();
    }
    let reported = open(&folder).tokenizer_file(None).unwrap_err().to_string();
    assert!(
        reported.contains("config.json names the tokenizer"),
        "{reported}"
    );
    // The folder's own file comes first, and a name may be that of a folder.
    let own = folder.path().join("tokenizer.json");
    fs::write(&own, "{}").unwrap();
    assert_eq!(
        open(&folder).tokenizer_file(Some(&cache)).unwrap(),
        Some(own)
    );
    let local = case("map_in_order");
    edit(local.path(), PREPROCESSOR, |steps| {
        let name = folder.path().to_str().unwrap();
        step(steps, "tokenizer_processor")["config"]["tokenizer_name"] = name.into();
    });
    let found = open(&local).tokenizer_file(None).unwrap();
    assert_eq!(found, Some(folder.path().join("tokenizer.json")));
}

#[test]
fn a_policy_whose_statistics_are_named_by_recording_is_not_handed_on_without() {
    let folder = case("statistics_by_recording");
    let opened = open(&folder);
    assert_eq!(opened.stats().unwrap(), None);
    let reported = opened.check_has_statistics().unwrap_err().to_string();
    assert!(reported.contains("`so100.buffer.action`"), "{reported}");
    let recorded = Dataset::open(fixtures().join("datasets/so100_pickplace")).unwrap();
    let out = tempfile::tempdir().unwrap();
    opened
        .write_trained(
            out.path(),
            &TensorSet::new(),
            recorded.stats(),
            Precision::Kept,
        )
        .unwrap();
    let written = PolicyFolder::open(out.path()).unwrap();
    written.check_has_statistics().unwrap();
    assert_eq!(written.stats().unwrap().as_ref(), Some(recorded.stats()));
    open(&case("map_in_order")).check_has_statistics().unwrap();
}
