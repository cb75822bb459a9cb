//! A LoRA adapter that LeRobot 0.6.1 and PEFT wrote, with its base. `smolvla/tests/policy/processors.rs` compares its loss with LeRobot's.

use std::fs;
use std::path::Path;

use serde_json::{json, Value};
use zk0_lerobot::policy_folder::{PolicyFolder, Precision};
use zk0_tensors::TensorSet;
use zk0_testkit::own_process::{alone, is_alone};
use zk0_testkit::recordings::fixtures;

use super::folder::*;

const CONFIG: &str = "adapter_config.json";
const STATE_PROJ: &str = "model.state_proj.weight";

/// The adapter's folder, which names the folder `base`.
fn adapter(base: &Path) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for file in fs::read_dir(fixtures().join("policy_processors/lora_adapter")).unwrap() {
        let file = file.unwrap();
        fs::copy(file.path(), folder.path().join(file.file_name())).unwrap();
    }
    set(
        folder.path(),
        "base_model_name_or_path",
        base.to_str().unwrap().into(),
    );
    folder
}

fn set(folder: &Path, key: &str, value: Value) {
    let path = folder.join(CONFIG);
    let mut json: Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
    json[key] = value;
    fs::write(path, json.to_string()).unwrap();
}

fn base() -> tempfile::TempDir {
    folder(&raw(&fixture("weights.safetensors")))
}

#[test]
fn the_matrices_of_the_base_get_those_of_the_adapter_added() {
    let base = base();
    let folder = adapter(base.path());
    let merged = PolicyFolder::open(folder.path())
        .unwrap()
        .tensors()
        .unwrap();
    let plain = PolicyFolder::open(base.path()).unwrap().tensors().unwrap();
    let changed: Vec<_> = merged
        .iter()
        .filter(|(name, t)| plain[*name] != **t)
        .collect();
    // Queries and values of four layers, and five projections.
    assert_eq!(changed.len(), 13);

    let file = raw(&fs::read(folder.path().join("adapter_model.safetensors")).unwrap());
    let numbers = |side: &str| -> Vec<f32> {
        let (_, _, bytes) = &file[&format!("base_model.model.model.state_proj.{side}.weight")];
        let four = bytes.chunks_exact(4);
        four.map(|b| f32::from_le_bytes(b.try_into().unwrap()))
            .collect()
    };
    let (a, b) = (numbers("lora_A"), numbers("lora_B"));
    // `lora_alpha` is 8, and the rank is 2.
    let expected = plain[STATE_PROJ].data[33] + 4.0 * (b[2] * a[1] + b[3] * a[33]);
    assert!((merged[STATE_PROJ].data[33] - expected).abs() < 1e-5);
}

#[test]
fn sums_that_are_not_finite_are_named() {
    let base = base();
    let folder = adapter(base.path());
    let path = folder.path().join("adapter_model.safetensors");
    let mut file = raw(&fs::read(&path).unwrap());
    for (name, (_, _, bytes)) in &mut file {
        if name.contains("state_proj") {
            *bytes = 1e30f32.to_le_bytes().repeat(bytes.len() / 4);
        }
    }
    fs::write(&path, file_of(&file, pytorch())).unwrap();
    let reported = PolicyFolder::open(folder.path())
        .unwrap()
        .tensor(STATE_PROJ)
        .unwrap_err()
        .to_string();
    assert!(reported.contains(STATE_PROJ), "{reported}");
}

#[test]
fn what_is_written_is_a_whole_policy() {
    let base = base();
    let folder = adapter(base.path());
    let opened = PolicyFolder::open(folder.path()).unwrap();
    let out = tempfile::tempdir().unwrap();
    opened
        .write(out.path(), &TensorSet::new(), Precision::Kept)
        .unwrap();
    let written = PolicyFolder::open(out.path()).unwrap();
    assert_eq!(written.tensors().unwrap(), opened.tensors().unwrap());
    assert_eq!(written.config(), opened.config());
    for file in [CONFIG, "adapter_model.safetensors"] {
        assert!(!out.path().join(file).exists(), "{file}");
    }
    let config = fs::read_to_string(out.path().join("config.json")).unwrap();
    assert!(config.contains("\"use_peft\": false"), "{config}");

    // What training changes replaces the sum.
    let zero = TensorSet::from([(NORM.to_owned(), opened.tensor(NORM).unwrap())]);
    let mut state = opened.tensor(STATE_PROJ).unwrap();
    state.data.fill(0.5);
    let changed = TensorSet::from([(STATE_PROJ.to_owned(), state.clone())]);
    let out = tempfile::tempdir().unwrap();
    let changed = changed.into_iter().chain(zero).collect();
    opened.write(out.path(), &changed, Precision::Kept).unwrap();
    let written = PolicyFolder::open(out.path()).unwrap();
    assert_eq!(written.tensor(STATE_PROJ).unwrap(), state);
}

#[test]
fn adapters_of_other_kinds_are_refused_by_name() {
    let base = base();
    for (key, value) in [
        ("peft_type", json!("IA3")),
        ("r", json!(0)),
        ("r", json!(4097)),
        ("bias", json!("all")),
        ("use_dora", json!(true)),
        ("use_bdlora", json!({"nblocks": 2})),
        ("use_qalora", json!(true)),
        ("lora_bias", json!(true)),
        ("fan_in_fan_out", json!(true)),
        ("rank_pattern", json!({"state_proj": 4})),
        ("alpha_pattern", json!({"state_proj": 4})),
        ("modules_to_save", json!(["state_proj"])),
        ("target_parameters", json!(["state_proj.weight"])),
        ("trainable_token_indices", json!([7])),
        ("layer_replication", json!([[0, 4], [2, 4]])),
        ("alora_invocation_tokens", json!([7])),
    ] {
        let folder = adapter(base.path());
        set(folder.path(), key, value);
        let reported = PolicyFolder::open(folder.path()).unwrap_err().to_string();
        assert!(reported.contains(&format!("`{key}` is")), "{reported}");
        assert!(reported.contains(CONFIG), "{reported}");
    }
    // A rank that is not the file's.
    let folder = adapter(base.path());
    set(folder.path(), "r", 3.into());
    let reported = PolicyFolder::open(folder.path())
        .unwrap()
        .tensors()
        .unwrap_err();
    assert!(
        reported.to_string().contains("adapter_model.safetensors"),
        "{reported}"
    );
    // A matrix that the policy does not have.
    let path = folder.path().join("adapter_model.safetensors");
    let mut file = raw(&fs::read(&path).unwrap());
    let strange = file.pop_first().unwrap().1;
    for (name, module) in [
        ("base_model.model.model.hands.lora_A.weight", "model.hands"),
        ("model.hands.weight", "model.hands"),
        // This one is no matrix.
        (
            "base_model.model.model.vlm_with_expert.lm_expert.norm.lora_A.weight",
            "lm_expert.norm",
        ),
    ] {
        let mut file = file.clone();
        file.insert(name.into(), strange.clone());
        fs::write(&path, file_of(&file, pytorch())).unwrap();
        let reported = PolicyFolder::open(folder.path()).unwrap_err().to_string();
        assert!(reported.contains(module), "{reported}");
    }
}

#[test]
fn a_folder_with_weights_of_its_own_takes_nothing_from_its_adapter() {
    let base = base();
    let folder = adapter(base.path());
    for file in ["model.safetensors", "vlm_config.json"] {
        fs::copy(base.path().join(file), folder.path().join(file)).unwrap();
    }
    let own = PolicyFolder::open(folder.path()).unwrap();
    let plain = PolicyFolder::open(base.path()).unwrap();
    assert_eq!(own.tensors().unwrap(), plain.tensors().unwrap());
}

#[test]
fn a_base_without_a_name_is_not_looked_for_where_the_command_runs() {
    let base = base();
    if !is_alone() {
        let name = "policy_folder::adapter::a_base_without_a_name_is_not_looked_for_where_the_command_runs";
        let here = format!("--chdir={}", base.path().display());
        alone(name, &["env", &here]);
        return;
    }
    let reported = PolicyFolder::open(adapter(Path::new("")).path()).unwrap_err();
    assert!(
        reported.to_string().contains("adapter of the policy ``"),
        "{reported}"
    );
}
