//! Reads the LeRobot reference values, and compares with them.

use std::collections::BTreeMap;
use std::path::PathBuf;

use candle_core::{Device, Tensor};
use safetensors::tensor::{Dtype, SafeTensors};
use serde::Deserialize;
use zk0_lerobot::config::PolicyConfig;
use zk0_lerobot::layout::policy_layout;
use zk0_lerobot::policy_folder::{LeRobotConfig, PolicyFolder};
use zk0_smolvla::policy::model::PolicyParameters;
use zk0_smolvla::policy::weights::Policy;

/// The repository's fixtures.
pub fn fixtures() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../tests/fixtures")
}

/// The reference's folder: `ZK0_PARITY_DIR` (from the repository's root, where it is relative), or the committed one.
pub fn folder() -> PathBuf {
    let root = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("..");
    std::env::var_os("ZK0_PARITY_DIR")
        .map_or_else(|| fixtures().join("smolvla_tiny"), |dir| root.join(dir))
}

/// The largest resident size that this process ever had, in GiB.
pub fn peak_gib() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find(|l| l.starts_with("VmHWM:")).unwrap();
    let kib: f64 = line.split_whitespace().nth(1).unwrap().parse().unwrap();
    kib / (1 << 20) as f64
}

/// Every parameter of the published model.
pub fn published_parameters() -> serde_json::Value {
    let text = std::fs::read_to_string(fixtures().join("smolvla_full_params.json")).unwrap();
    serde_json::from_str(&text).unwrap()
}

pub fn text(file: &str) -> String {
    let path = folder().join(file);
    std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

pub fn bytes(file: &str) -> Vec<u8> {
    let path = folder().join(file);
    std::fs::read(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// Whether the folder is the committed one, whose dimensions and cases are known.
pub fn is_committed() -> bool {
    std::env::var_os("ZK0_PARITY_DIR").is_none()
}

/// Whether the folder is one of the repository's.
pub fn is_of_repository() -> bool {
    let real = |path: PathBuf| path.canonicalize().unwrap();
    real(folder()).starts_with(real(fixtures()))
}

/// Whether the folder is the repository's second one.
pub fn is_odd() -> bool {
    is_of_repository() && folder().ends_with("smolvla_odd")
}

pub fn json(file: &str) -> serde_json::Value {
    serde_json::from_str(&text(file)).unwrap_or_else(|e| panic!("{file}: {e}"))
}

pub fn lerobot() -> LeRobotConfig {
    LeRobotConfig::parse(&text("policy_config.json"), Some(&text("vlm_config.json"))).unwrap()
}

/// What a policy's configuration states of its training. What it leaves out has LeRobot's default.
#[derive(Clone, Debug, Deserialize, PartialEq)]
#[serde(default)]
pub struct TrainingPreset {
    pub freeze_vision_encoder: bool,
    pub train_expert_only: bool,
    pub train_state_proj: bool,
    pub optimizer_lr: f64,
    pub optimizer_betas: (f64, f64),
    pub optimizer_eps: f64,
    pub optimizer_weight_decay: f64,
    pub optimizer_grad_clip_norm: f64,
    pub scheduler_warmup_steps: usize,
    pub scheduler_decay_steps: usize,
    pub scheduler_decay_lr: f64,
}

impl Default for TrainingPreset {
    fn default() -> Self {
        Self {
            freeze_vision_encoder: true,
            train_expert_only: true,
            train_state_proj: true,
            optimizer_lr: 1e-4,
            optimizer_betas: (0.9, 0.95),
            optimizer_eps: 1e-8,
            optimizer_weight_decay: 1e-10,
            optimizer_grad_clip_norm: 10.0,
            scheduler_warmup_steps: 1000,
            scheduler_decay_steps: 30_000,
            scheduler_decay_lr: 2.5e-6,
        }
    }
}

pub fn training_preset() -> TrainingPreset {
    serde_json::from_value(json("policy_config.json")).unwrap()
}

/// All weights of a policy folder. One tensor at a time passes through memory: this takes the policy's size and no more.
pub fn parameters_of(folder: &PolicyFolder) -> PolicyParameters {
    let read = |name: String| {
        let tensor = folder.tensor(&name).unwrap();
        let tensor = Tensor::from_vec(tensor.data, tensor.shape, &Device::Cpu).unwrap();
        (name, tensor)
    };
    let names = policy_layout(&folder.config().dims).into_keys();
    PolicyParameters::from_tensors(names.map(read).collect())
}

pub fn config() -> PolicyConfig {
    lerobot().dims
}

pub fn policy() -> Policy {
    Policy::from_safetensors(&config(), &bytes("weights.safetensors")).unwrap()
}

/// All tensors of one file as numbers.
pub struct Values(BTreeMap<String, (Vec<usize>, Vec<f64>)>);

impl Values {
    pub fn read(file: &str) -> Self {
        let raw = bytes(file);
        let tensors = SafeTensors::deserialize(&raw).unwrap();
        let numbers = |name: &str| {
            let view = tensors.tensor(name).unwrap();
            let data = view.data();
            let wide = |n: usize| data.chunks_exact(n);
            let values = match view.dtype() {
                Dtype::F32 => wide(4)
                    .map(|b| f64::from(f32::from_le_bytes(b.try_into().unwrap())))
                    .collect(),
                Dtype::F64 => wide(8)
                    .map(|b| f64::from_le_bytes(b.try_into().unwrap()))
                    .collect(),
                Dtype::I64 => wide(8)
                    .map(|b| i64::from_le_bytes(b.try_into().unwrap()) as f64)
                    .collect(),
                Dtype::I32 => wide(4)
                    .map(|b| f64::from(i32::from_le_bytes(b.try_into().unwrap())))
                    .collect(),
                Dtype::BOOL | Dtype::U8 => data.iter().map(|b| f64::from(*b)).collect(),
                other => panic!("{name}: {other:?}"),
            };
            (view.shape().to_vec(), values)
        };
        Self(
            tensors
                .names()
                .into_iter()
                .map(|name| (name.to_string(), numbers(name)))
                .collect(),
        )
    }

    pub fn names(&self) -> impl Iterator<Item = &String> {
        self.0.keys()
    }

    pub fn contains(&self, name: &str) -> bool {
        self.0.contains_key(name)
    }

    fn get(&self, name: &str) -> &(Vec<usize>, Vec<f64>) {
        self.0
            .get(name)
            .unwrap_or_else(|| panic!("the reference has no `{name}`"))
    }

    pub fn shape(&self, name: &str) -> &[usize] {
        &self.get(name).0
    }

    pub fn numbers(&self, name: &str) -> &[f64] {
        &self.get(name).1
    }

    pub fn f32s(&self, name: &str) -> Vec<f32> {
        self.numbers(name).iter().map(|x| *x as f32).collect()
    }

    pub fn tensor(&self, name: &str) -> Tensor {
        Tensor::from_vec(self.f32s(name), self.shape(name), &Device::Cpu).unwrap()
    }

    pub fn ids(&self, name: &str) -> Tensor {
        let ids: Vec<u32> = self.numbers(name).iter().map(|x| *x as u32).collect();
        Tensor::from_vec(ids, self.shape(name), &Device::Cpu).unwrap()
    }

    /// Rows of a two-dimensional mask.
    pub fn mask(&self, name: &str) -> Vec<Vec<bool>> {
        self.numbers(name)
            .chunks(self.shape(name)[1])
            .map(|row| row.iter().map(|x| *x != 0.0).collect())
            .collect()
    }

    pub fn flags(&self, name: &str) -> Vec<bool> {
        self.numbers(name).iter().map(|x| *x != 0.0).collect()
    }
}

pub fn numbers(tensor: &Tensor) -> Vec<f64> {
    tensor
        .flatten_all()
        .unwrap()
        .to_vec1::<f32>()
        .unwrap()
        .into_iter()
        .map(f64::from)
        .collect()
}

/// Returns the largest absolute difference.
pub fn distance(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    assert!(!a.is_empty());
    a.iter()
        .zip(b)
        .map(|(x, y)| (x - y).abs())
        .fold(
            0.0,
            |worst, d| if d > worst || d.is_nan() { d } else { worst },
        )
}

/// Returns `|a - b| / |b|` in L2.
pub fn relative_distance(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    let square = |values: &mut dyn Iterator<Item = f64>| values.map(|x| x * x).sum::<f64>().sqrt();
    square(&mut a.iter().zip(b).map(|(x, y)| x - y))
        / square(&mut b.iter().copied()).max(f64::MIN_POSITIVE)
}

/// Asserts and prints the distance of plain numbers from the reference value of that name.
#[track_caller]
pub fn close_numbers(reference: &Values, name: &str, found: &[f32], tolerance: f64) {
    let found: Vec<f64> = found.iter().map(|x| f64::from(*x)).collect();
    check(name, distance(&found, reference.numbers(name)), tolerance);
}

/// Asserts and prints the distance of a tensor from the reference value of that name.
#[track_caller]
pub fn close(reference: &Values, name: &str, tensor: &Tensor, tolerance: f64) {
    assert_eq!(tensor.dims(), reference.shape(name), "{name}");
    check(
        name,
        distance(&numbers(tensor), reference.numbers(name)),
        tolerance,
    );
}

/// Asserts and prints the distance like [`close`], but only at the valid tokens. `mask` has one row of tokens per sample.
#[track_caller]
pub fn close_where(
    reference: &Values,
    name: &str,
    tensor: &Tensor,
    mask: &[Vec<bool>],
    tolerance: f64,
) {
    assert_eq!(tensor.dims(), reference.shape(name), "{name}");
    let width: usize = tensor.dims()[2..].iter().product();
    let keep = |values: &[f64]| -> Vec<f64> {
        let rows = values.chunks(width).zip(mask.iter().flatten());
        rows.filter(|(_, valid)| **valid)
            .flat_map(|(row, _)| row.to_vec())
            .collect()
    };
    check(
        name,
        distance(&keep(&numbers(tensor)), &keep(reference.numbers(name))),
        tolerance,
    );
}

#[track_caller]
pub fn check(name: &str, found: f64, tolerance: f64) {
    println!("{name:<45} {found:9.2e}  (at most {tolerance:.0e})");
    assert!(
        found <= tolerance,
        "{name}: off by {found:e}, {tolerance:e} is allowed"
    );
}
