//! LeRobot's folders with the binary: `zk0 train` starts from such a folder and leaves one. The commands respect what a policy states
//! about its normalisation.

use crate::harness::{self, logged, printed};
use serde_json::{json, Value};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use tempfile::TempDir;
use zk0_lerobot::dataset::{Dataset, Stats};
use zk0_lerobot::policy_folder::{Inference, PolicyFolder};
use zk0_smolvla::policy::policy_file;
use zk0_smolvla::Policy;

const PICKPLACE: &str = "so100_pickplace";
const SORTING: &str = "so100_sorting";

fn fixtures() -> PathBuf {
    harness::root().join("tests/fixtures")
}

fn recording(name: &str) -> PathBuf {
    fixtures().join("datasets").join(name)
}

/// A safetensors file of rows of six numbers.
fn tensors(rows: &[(&str, [f32; 6])]) -> Vec<u8> {
    let (mut header, mut data) = (serde_json::Map::new(), Vec::new());
    for (name, values) in rows {
        let start = data.len();
        data.extend(values.iter().flat_map(|x| x.to_le_bytes()));
        let about = json!({"dtype": "F32", "shape": [6], "data_offsets": [start, data.len()]});
        header.insert(name.to_string(), about);
    }
    let header = serde_json::to_vec(&header).unwrap();
    let mut file = (header.len() as u64).to_le_bytes().to_vec();
    file.extend(header);
    file.extend(data);
    file
}

/// LeRobot's tiny policy as LeRobot 0.4 leaves one. It was trained on another recording.
fn folder(to: &Path) {
    fs::create_dir_all(to).unwrap();
    for (from, name) in [
        ("policy_config.json", "config.json"),
        ("vlm_config.json", "vlm_config.json"),
        ("weights.safetensors", "model.safetensors"),
    ] {
        fs::copy(fixtures().join("smolvla_tiny").join(from), to.join(name)).unwrap();
    }
    harness::name_cameras(&to.join("config.json"));
    let write = |name: &str, content: &[u8]| fs::write(to.join(name), content).unwrap();
    let tokenizer = json!({
        "version": "1.0", "truncation": null, "padding": null, "added_tokens": [],
        "normalizer": null, "post_processor": null, "decoder": null,
        "pre_tokenizer": {"type": "ByteLevel", "add_prefix_space": false, "trim_offsets": true, "use_regex": true},
        "model": {
            "type": "BPE", "dropout": null, "unk_token": null, "continuing_subword_prefix": null,
            "end_of_word_suffix": null, "fuse_unk": false, "byte_fallback": false,
            "vocab": {"g": 0, "o": 1, "go": 2, "Ċ": 3}, "merges": ["g o"]
        }
    });
    write("tokenizer.json", tokenizer.to_string().as_bytes());
    write("train_config.json", b"{\"steps\": 20000}\n");
    for (pipeline, processor) in [
        ("policy_preprocessor", "normalizer_processor"),
        ("policy_postprocessor", "unnormalizer_processor"),
    ] {
        let state = format!("{pipeline}_step_0_{processor}.safetensors");
        let step =
            json!({"registry_name": processor, "config": {"eps": 1e-8}, "state_file": state});
        let steps = json!({"name": pipeline, "steps": [step]});
        write(&format!("{pipeline}.json"), steps.to_string().as_bytes());
        let other = tensors(&[
            ("observation.state.mean", [10.0; 6]),
            ("observation.state.std", [20.0; 6]),
            ("action.mean", [-10.0; 6]),
            ("action.std", [40.0; 6]),
        ]);
        write(&state, &other);
    }
}

/// The folder in which a test works.
struct Folder(TempDir);

impl Folder {
    fn new() -> Self {
        let place = Self(tempfile::tempdir().unwrap());
        folder(&place.at("source"));
        place
    }

    fn at(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn zk0(&self, command: &str, datasets: &[PathBuf], more: &[&str]) -> (bool, String, String) {
        let mut zk0 = harness::zk0(&[command]);
        zk0.args(more);
        zk0.arg("--cache")
            .arg(self.at("cache"))
            .current_dir(self.0.path());
        for dataset in datasets {
            zk0.arg("--dataset").arg(dataset);
        }
        let output = zk0.output().unwrap();
        (output.status.success(), printed(&output), logged(&output))
    }

    fn train(&self, datasets: &[&str], more: &[&str]) -> Result<String, String> {
        let datasets: Vec<_> = datasets.iter().map(|name| recording(name)).collect();
        let options = ["--steps", "3", "--batch-size", "4", "--lr", "1e-3"];
        match self.zk0("train", &datasets, &[&options[..], more].concat()) {
            (true, reported, _) => Ok(reported),
            (false, _, reported) => Err(reported),
        }
    }

    /// The rows of `zk0 eval`.
    fn eval(&self, dataset: &Path, more: &[&str]) -> Vec<Value> {
        let options = [&["--json", "--frames", "12"], more].concat();
        let (fine, reported, error) = self.zk0("eval", &[dataset.to_owned()], &options);
        assert!(fine, "{error}");
        serde_json::from_str(&reported).unwrap()
    }
}

fn stats(name: &str) -> Stats {
    Dataset::open(recording(name)).unwrap().stats().clone()
}

/// All files of a folder.
fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap());
    entries
        .map(|entry| {
            let name = entry.file_name().into_string().unwrap();
            (name, fs::read(entry.path()).unwrap())
        })
        .collect()
}

/// Returns what a policy makes of a recording, without the names.
fn measured(row: &Value) -> Value {
    let mut row = row.clone();
    for name in ["policy", "dataset", "statistics"] {
        row.as_object_mut().unwrap().remove(name).unwrap();
    }
    row
}

#[test]
fn a_run_leaves_a_folder_for_lerobot() {
    let place = Folder::new();
    let source = files(&place.at("source"));
    let options = ["--policy", "source", "--out", "run", "--train-state-proj"];
    let reported = place.train(&[PICKPLACE], &options).unwrap();
    assert!(reported.contains("run/lerobot"), "{reported}");

    let written = PolicyFolder::open(place.at("run/lerobot")).unwrap();
    let policy = Policy::from_folder(&written).unwrap();
    let model = policy_file::load(&place.at("run/model.safetensors")).unwrap();
    assert!(policy == model.policy);
    let before = PolicyFolder::open(place.at("source")).unwrap();
    let before = Policy::from_folder(&before).unwrap();
    assert!(policy.expert != before.expert);
    let changed = policy
        .frozen
        .iter()
        .filter(|(n, t)| before.frozen[*n] != **t);
    let changed: Vec<_> = changed.map(|(name, _)| &name[..]).collect();
    assert_eq!(
        changed,
        ["model.state_proj.bias", "model.state_proj.weight"],
        "what was trained besides the expert"
    );
    assert_eq!(written.stats().unwrap(), Some(stats(PICKPLACE)));
    let used = policy_file::inference(&place.at("run/model.safetensors")).unwrap();
    assert_eq!(used, written.inference().unwrap());
    let report = fs::read(place.at("run/run.json")).unwrap();
    let report: Value = serde_json::from_slice(&report).unwrap();
    let reported: Inference = serde_json::from_value(report["inference"].clone()).unwrap();
    assert_eq!(reported, used);
    assert_eq!(report["ended"]["lerobot"], "run/lerobot");

    let left = files(&place.at("run/lerobot"));
    assert!(left.keys().eq(source.keys()));
    for (name, content) in &source {
        let same = name.ends_with(".json");
        assert_eq!(&left[name] == content, same, "{name}");
    }
    assert_eq!(files(&place.at("source")), source);

    // Both are the same policy, so their measurements are equal.
    let paths = [
        "--policy",
        "run/lerobot",
        "--policy",
        "run/model.safetensors",
    ];
    let rows = place.eval(&recording(SORTING), &paths);
    assert_eq!(measured(&rows[0]), measured(&rows[1]));
}

#[test]
fn a_run_that_goes_on_leaves_the_same_folder() {
    let place = Folder::new();
    let go = |more: &[&str]| {
        let options = [&["--policy", "source", "--out", "run"], more].concat();
        place.train(&[PICKPLACE], &options)
    };
    go(&[]).unwrap();
    let left = files(&place.at("run/lerobot"));
    // The run is killed while it writes the new folder, or while it replaces the old folder, or not at all.
    let junk = |name: &str| {
        fs::create_dir_all(place.at(name)).unwrap();
        fs::write(place.at(name).join("model.safetensors"), b"half").unwrap();
    };
    let kills: [&dyn Fn(); 3] = [
        &|| {
            fs::remove_dir_all(place.at("run/lerobot")).unwrap();
            junk("run/lerobot.unfinished");
        },
        &|| {
            fs::rename(place.at("run/lerobot"), place.at("run/lerobot.replaced")).unwrap();
            junk("run/lerobot.unfinished");
        },
        &|| (),
    ];
    for kill in kills {
        kill();
        go(&["--resume"]).unwrap();
        assert_eq!(files(&place.at("run/lerobot")), left);
        assert!(!place.at("run/lerobot.unfinished").exists());
        assert!(!place.at("run/lerobot.replaced").exists());
    }
    // Another run may not replace this folder.
    fs::remove_dir_all(place.at("run/snapshots")).unwrap();
    let reported = go(&[]).unwrap_err();
    assert!(
        reported.contains("run/lerobot exists already"),
        "{reported}"
    );
    for policy in ["run/lerobot", "source"] {
        let out = policy.strip_suffix("/lerobot").unwrap_or(policy);
        let options = ["--policy", policy, "--out", out, "--resume"];
        let reported = place.train(&[PICKPLACE], &options).unwrap_err();
        assert!(reported.contains("would replace the policy"), "{reported}");
    }
    assert_eq!(files(&place.at("run/lerobot")), left);
}

/// With `--lerobot-f32`, the trained weights are not rounded. Otherwise they have the type of the source.
#[test]
fn what_was_trained_keeps_its_type_unless_told_otherwise() {
    let place = Folder::new();
    let path = place.at("source/model.safetensors");
    let bytes = fs::read(&path).unwrap();
    // This is the same file with the expert's norm in BF16.
    let norm = "model.vlm_with_expert.lm_expert.norm.weight";
    let length = u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
    let mut header: BTreeMap<String, Value> =
        serde_json::from_slice(&bytes[8..8 + length]).unwrap();
    header.remove("__metadata__");
    let mut data = Vec::new();
    for (name, about) in &mut header {
        let at = |i: usize| 8 + length + about["data_offsets"][i].as_u64().unwrap() as usize;
        let mut raw = bytes[at(0)..at(1)].to_vec();
        if name == norm {
            raw = raw.chunks(4).flat_map(|x| [x[2], x[3]]).collect();
            about["dtype"] = "BF16".into();
        }
        about["data_offsets"] = json!([data.len(), data.len() + raw.len()]);
        data.extend(raw);
    }
    let header = serde_json::to_vec(&header).unwrap();
    let file = [&(header.len() as u64).to_le_bytes()[..], &header, &data].concat();
    fs::write(&path, file).unwrap();

    for (out, more, dtype) in [
        ("kept", &[][..], "BF16"),
        ("f32", &["--lerobot-f32"], "F32"),
    ] {
        let options = [&["--policy", "source", "--out", out], more].concat();
        place.train(&[PICKPLACE], &options).unwrap();
        let written = PolicyFolder::open(place.at(out).join("lerobot")).unwrap();
        let info = written.weights().info(norm).unwrap();
        assert_eq!(info.dtype.to_string(), dtype);
        let model = policy_file::load(&place.at(out).join("model.safetensors")).unwrap();
        let same = Policy::from_folder(&written).unwrap() == model.policy;
        assert_eq!(same, dtype == "F32");
    }
}

#[test]
fn a_policy_is_evaluated_under_the_statistics_it_was_trained_with() {
    let place = Folder::new();
    let options = ["--policy", "source", "--out", "run"];
    place.train(&[PICKPLACE], &options).unwrap();
    // This is the same recording, but with the statistics that the policy was trained with.
    let copy = place.at("copy");
    harness::copy(&recording(SORTING), &copy);
    let of = |folder: &Path| -> Value {
        serde_json::from_slice(&fs::read(folder.join("meta/stats.json")).unwrap()).unwrap()
    };
    let mut all = of(&recording(SORTING));
    for feature in ["observation.state", "action"] {
        all[feature] = of(&recording(PICKPLACE))[feature].clone();
    }
    fs::write(copy.join("meta/stats.json"), all.to_string()).unwrap();

    for policy in ["run/model.safetensors", "run/lerobot"] {
        let eval = |dataset: &Path, more: &[&str]| {
            let rows = place.eval(dataset, &[&["--policy", policy], more].concat());
            rows[0].clone()
        };
        let ours = eval(&recording(SORTING), &[]);
        assert_eq!(ours["statistics"], "policy");
        let recordings = ["--statistics", "recording"];
        let same = eval(&copy, &recordings);
        assert_eq!(same["statistics"], "recording");
        assert_eq!(measured(&ours), measured(&same), "{policy}");
        let other = eval(&recording(SORTING), &recordings);
        assert_ne!(measured(&ours), measured(&other), "{policy}");
    }
    // The checkpoint has its own statistics. A policy without any uses those of the recording.
    let rows = place.eval(
        &recording(SORTING),
        &["--policy", "source", "--profile", "micro"],
    );
    let whose: Vec<_> = rows.iter().map(|row| &row["statistics"]).collect();
    assert_eq!(whose, ["policy", "recording"]);
    let (fine, table, _) = place.zk0(
        "eval",
        &[recording(SORTING)],
        &["--frames", "2", "--policy", "source", "--profile", "micro"],
    );
    assert!(fine);
    for whose in ["policy's", "recording's"] {
        let line = format!("normalised with the {whose} statistics");
        assert!(table.contains(&line), "{table}");
    }
}

#[test]
fn actions_are_sampled_in_as_many_steps_as_the_policy_says() {
    let place = Folder::new();
    let path = place.at("source/config.json");
    let config = fs::read_to_string(&path).unwrap();
    let eval = |policy: &str| place.eval(&recording(SORTING), &["--policy", policy])[0].clone();
    let ten = eval("source");
    assert_eq!(ten["num_steps"], 10);
    let three = config.replace("\"num_steps\": 10", "\"num_steps\": 3");
    assert_ne!(config, three);
    fs::write(&path, three).unwrap();
    let three = eval("source");
    assert_eq!(three["num_steps"], 3);
    assert_eq!(three["loss"], ten["loss"]);
    assert_ne!(three["action_error"], ten["action_error"]);
    place
        .train(&[SORTING], &["--policy", "source", "--out", "run"])
        .unwrap();
    assert_eq!(eval("run/model.safetensors")["num_steps"], 3);
}

#[test]
fn other_normalisations_are_kept_to_or_refused() {
    let place = Folder::new();
    let path = place.at("source/config.json");
    let config = fs::read_to_string(&path).unwrap();
    for (feature, mode) in [("STATE", "MIN_MAX"), ("ACTION", "QUANTILES")] {
        let was = format!("\"{feature}\": \"MEAN_STD\"");
        let other = config.replace(&was, &format!("\"{feature}\": \"{mode}\""));
        assert_ne!(config, other);
        fs::write(&path, other).unwrap();
        let reported = place.train(&[PICKPLACE], &["--policy", "source", "--out", "run"]);
        let (_, _, evaluated) = place.zk0("eval", &[recording(SORTING)], &["--policy", "source"]);
        for reported in [reported.unwrap_err(), evaluated] {
            assert!(reported.contains(mode), "{reported}");
            assert!(reported.contains("config.json"), "{reported}");
        }
    }
    fs::write(&path, config.replace("MEAN_STD", "IDENTITY")).unwrap();
    let go = |out: &str, more: &[&str]| {
        let options = [&["--out", out], more].concat();
        place.train(&[PICKPLACE], &options).unwrap();
        policy_file::inference(&place.at(out).join("model.safetensors")).unwrap()
    };
    let used = go("run", &["--policy", "source"]);
    let kept = used.stats.clone().unwrap();
    assert_eq!(
        (kept.state.mean(), kept.state.std()),
        (&[0.0; 6][..], &[1.0; 6][..])
    );
    assert_eq!(kept.action, kept.state);
    let written = PolicyFolder::open(place.at("run/lerobot")).unwrap();
    assert_eq!(written.inference().unwrap(), used);
    // A run that goes on from the file does not normalise either.
    assert_eq!(go("again", &["--policy", "run/model.safetensors"]), used);
    assert!(
        !place.at("again/lerobot").exists(),
        "no folder to start from"
    );
}

#[test]
fn several_recordings_share_one_normaliser() {
    let place = Folder::new();
    let options = ["--policy", "source", "--out", "run"];
    place.train(&[PICKPLACE, SORTING], &options).unwrap();
    let open = |name: &str| Dataset::open(recording(name)).unwrap();
    let (a, b) = (open(PICKPLACE), open(SORTING));
    let pooled = Stats::pooled(&[(a.stats(), a.len()), (b.stats(), b.len())]);
    let written = PolicyFolder::open(place.at("run/lerobot")).unwrap();
    assert_eq!(written.stats().unwrap(), pooled);
    let used = policy_file::inference(&place.at("run/model.safetensors")).unwrap();
    assert_eq!(used.stats, pooled);
}

#[test]
fn cameras_of_other_names_are_refused_without_a_map_and_taken_with_one() {
    let place = Folder::new();
    let path = place.at("source/config.json");
    let config = fs::read_to_string(&path).unwrap();
    let others = config.replace("images.top", "images.camera1");
    let others = others.replace("images.wrist", "images.camera2");
    assert_ne!(config, others);
    fs::write(&path, others).unwrap();
    let train = || place.train(&[PICKPLACE], &["--policy", "source", "--out", "run"]);
    let reported = train().unwrap_err();
    assert!(reported.contains("--rename_map"), "{reported}");
    assert!(
        reported.contains("observation.images.camera1"),
        "{reported}"
    );
    let (fine, _, evaluated) = place.zk0("eval", &[recording(PICKPLACE)], &["--policy", "source"]);
    let named = "so100_pickplace: sample: the policy's cameras are observation.images.camera1, ";
    assert!(!fine && evaluated.contains(named), "{evaluated}");

    let path = place.at("source/policy_preprocessor.json");
    let mut pipeline: Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
    let map = json!({
        "observation.images.wrist": "observation.images.camera1",
        "observation.images.top": "observation.images.camera2",
    });
    let step =
        json!({"registry_name": "rename_observations_processor", "config": {"rename_map": map}});
    pipeline["steps"].as_array_mut().unwrap().insert(0, step);
    fs::write(&path, pipeline.to_string()).unwrap();
    train().unwrap();
    // The policy file keeps the map, and with it a network that is founded on it.
    let model = policy_file::load(&place.at("run/model.safetensors")).unwrap();
    assert_eq!(json!(model.policy.config.rename_map), map);
}

#[test]
fn a_tokenizer_that_the_folder_names_comes_from_the_hubs_cache() {
    let place = Folder::new();
    fs::remove_file(place.at("source/tokenizer.json")).unwrap();
    let path = place.at("source/config.json");
    let config = fs::read_to_string(&path).unwrap();
    fs::write(&path, config.replace("local-tiny", "zk0/tiny")).unwrap();
    let train = |hub: &Path| {
        let mut zk0 = harness::zk0(&["train", "--steps", "1", "--batch-size", "2"]);
        zk0.args(["--policy", "source", "--out", "run", "--dataset"])
            .arg(recording(PICKPLACE))
            .arg("--cache")
            .arg(place.at("cache"))
            .env("HF_HUB_CACHE", hub)
            .current_dir(place.0.path());
        let output = zk0.output().unwrap();
        (output.status.success(), logged(&output))
    };
    let (fine, reported) = train(&place.at("none"));
    assert!(!fine, "{reported}");
    assert!(
        reported.contains("`hf download zk0/tiny tokenizer.json`"),
        "{reported}"
    );
    let hub = fixtures().join("policy_processors/hub");
    let (fine, reported) = train(&hub);
    assert!(fine, "{reported}");
    let snapshot = "models--zk0--tiny/snapshots/0123456789abcdef0123456789abcdef01234567";
    let named = fs::read_to_string(hub.join(snapshot).join("tokenizer.json")).unwrap();
    let model = policy_file::load(&place.at("run/model.safetensors")).unwrap();
    assert_eq!(model.tokenizer.definition(), Some(&named[..]));
}
