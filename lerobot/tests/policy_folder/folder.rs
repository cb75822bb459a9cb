//! Policy folders as LeRobot leaves them, made from the fixture.

use std::collections::{BTreeMap, HashMap};
use std::fs;
use std::path::Path;

use half::{bf16, f16};
use safetensors::tensor::{serialize, Dtype, SafeTensors, TensorView};
use zk0_lerobot::layout::expert_layout;
use zk0_lerobot::policy_folder::PolicyFolder;
use zk0_tensors::TensorSet;
use zk0_testkit::recordings::fixtures;

pub const LM_HEAD: &str = "model.vlm_with_expert.vlm.lm_head.weight";
pub const NORM: &str = "model.vlm_with_expert.lm_expert.norm.weight";
pub const EMBEDDINGS: &str = "model.vlm_with_expert.vlm.model.text_model.embed_tokens.weight";

/// A tensor of a file: type, shape, bytes.
pub type Raw = (Dtype, Vec<usize>, Vec<u8>);
pub type RawFile = BTreeMap<String, Raw>;

pub fn fixture(file: &str) -> Vec<u8> {
    fs::read(fixtures().join("smolvla_tiny").join(file)).unwrap()
}

pub fn raw(bytes: &[u8]) -> RawFile {
    let file = SafeTensors::deserialize(bytes).unwrap();
    file.iter()
        .map(|(name, view)| {
            let raw = (view.dtype(), view.shape().to_vec(), view.data().to_vec());
            (name.to_string(), raw)
        })
        .collect()
}

pub fn file_of(tensors: &RawFile, metadata: HashMap<String, String>) -> Vec<u8> {
    let views = tensors
        .iter()
        .map(|(n, (d, s, b))| (n, TensorView::new(*d, s.clone(), b).unwrap()));
    serialize(views, Some(metadata)).unwrap()
}

pub fn pytorch() -> HashMap<String, String> {
    HashMap::from([("format".into(), "pt".into())])
}

pub fn stats(names: &[(&str, &[f32])]) -> RawFile {
    names
        .iter()
        .map(|(name, values)| {
            let bytes = values.iter().flat_map(|x| x.to_le_bytes()).collect();
            (name.to_string(), (Dtype::F32, vec![values.len()], bytes))
        })
        .collect()
}

/// The fixture's weights with the vision-language model in BF16, as published, and the action projections in F16.
pub fn mixed() -> RawFile {
    let mut tensors = raw(&fixture("weights.safetensors"));
    for (name, (dtype, _, bytes)) in &mut tensors {
        let numbers = bytes
            .chunks_exact(4)
            .map(|b| f32::from_le_bytes(b.try_into().unwrap()));
        if name.contains(".vlm.") || name == NORM {
            let rounded = numbers
                .flat_map(|x| bf16::from_f32(x).to_le_bytes())
                .collect();
            (*dtype, *bytes) = (Dtype::BF16, rounded);
        } else if name.contains("action_in_proj") {
            let rounded = numbers
                .flat_map(|x| f16::from_f32(x).to_le_bytes())
                .collect();
            (*dtype, *bytes) = (Dtype::F16, rounded);
        }
    }
    tensors
}

/// A folder as LeRobot 0.4 leaves it, with the other files that such a folder may hold.
pub fn folder(tensors: &RawFile) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, bytes: &[u8]| fs::write(folder.path().join(name), bytes).unwrap();
    write("config.json", &fixture("policy_config.json"));
    write("vlm_config.json", &fixture("vlm_config.json"));
    write("model.safetensors", &file_of(tensors, pytorch()));
    write("train_config.json", b"{\"steps\": 20000}\n");
    write("README.md", b"---\nlicense: apache-2.0\n---\n");
    let pipeline = |kind: &str, state: &str| {
        format!(
            r#"{{"name": "x", "steps": [{{"registry_name": "device_processor", "config": {{}}}},
            {{"registry_name": "{kind}", "config": {{"eps": 1e-08}}, "state_file": "{state}"}}]}}"#
        )
    };
    write(
        "policy_preprocessor.json",
        pipeline("normalizer_processor", "pre.safetensors").as_bytes(),
    );
    write(
        "policy_postprocessor.json",
        pipeline("unnormalizer_processor", "post.safetensors").as_bytes(),
    );
    let state = stats(&[
        ("observation.state.mean", &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]),
        ("observation.state.std", &[0.5; 6]),
        ("action.mean", &[9.0; 6]),
        ("action.std", &[9.0; 6]),
    ]);
    write("pre.safetensors", &file_of(&state, HashMap::new()));
    let action = stats(&[("action.mean", &[-1.0; 6]), ("action.std", &[2.0; 6])]);
    write("post.safetensors", &file_of(&action, HashMap::new()));
    folder
}

pub fn weights_in(folder: &Path) -> Vec<u8> {
    fs::read(folder.join("model.safetensors")).unwrap()
}

/// The tensors of a policy that training changes.
pub fn expert(folder: &PolicyFolder) -> TensorSet {
    let layout = expert_layout(&folder.config().dims);
    let mut tensors = folder.tensors().unwrap();
    tensors.retain(|name, _| layout.contains_key(name));
    tensors
}
