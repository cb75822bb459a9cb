//! Reads a LeRobot policy folder and writes it to a new folder, with every weight taken through `f32`: an untouched copy. With
//! `--scale X` the trainable tensors are multiplied by X, and with `--single` they are written in F32.
//!
//! ```sh
//! cargo run --release -p zk0-lerobot --example copy_policy_folder -- SOURCE TARGET [--scale X] [--single]
//! ```

use std::path::Path;
use std::process::ExitCode;

use zk0_lerobot::layout::{policy_layout, trainable_layout};
use zk0_lerobot::policy_folder::{PolicyFolder, Precision};
use zk0_lerobot::safetensors::TensorSet;
use zk0_lerobot::StoredPolicyError;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let scale = match arguments.iter().position(|a| a == "--scale") {
        Some(at) => arguments.get(at + 1).and_then(|x| x.parse::<f32>().ok()),
        None => Some(1.0),
    };
    let (Some(source), Some(target), Some(scale)) = (arguments.first(), arguments.get(1), scale)
    else {
        eprintln!("usage: copy_policy_folder SOURCE TARGET [--scale X] [--single]");
        return ExitCode::from(2);
    };
    let precision = match arguments.iter().any(|a| a == "--single") {
        true => Precision::Single,
        false => Precision::Kept,
    };
    match copy(Path::new(source), Path::new(target), scale, precision) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}

fn copy(
    source: &Path,
    target: &Path,
    scale: f32,
    precision: Precision,
) -> Result<(), StoredPolicyError> {
    let folder = PolicyFolder::open(source)?;
    let config = folder.config();
    let trainable = trainable_layout(&config.dims, config.training.train_state_proj);
    let names = match precision {
        Precision::Kept => policy_layout(&config.dims),
        Precision::Single => trainable.clone(),
    };
    let mut changed = TensorSet::new();
    for name in names.into_keys() {
        let mut tensor = folder.tensor(&name)?;
        if trainable.contains_key(&name) {
            tensor.data.iter_mut().for_each(|x| *x *= scale);
        }
        changed.insert(name, tensor);
    }
    folder.write(target, &changed, precision)
}
