//! A policy folder of the published size in BF16, read and written back: what memory that takes.
//!
//! The peak is that of the process. The test needs 2 GB of disk for some seconds.

use std::fs::File;
use std::io::{BufReader, BufWriter, Read, Write};
use std::path::Path;

use half::bf16;
use zk0_lerobot::layout::{state_dict_layout, trainable_layout};
use zk0_lerobot::policy_folder::{PolicyFolder, Precision};
use zk0_smolvla::Profile;
use zk0_tensors::TensorSet;
use zk0_testkit::own_process::alone;

use crate::reference::{parameters_of, peak_gib};

/// The policy is 1.5 GiB in F32. A second copy of it, or the file mapped beside it, would not fit.
const MOST_GIB: f64 = 1.8;

/// `config.json` of a policy on the published VLM, which is known by its name.
const CONFIG: &str = r#"{
    "type": "smolvla",
    "input_features": {
        "observation.state": {"type": "STATE", "shape": [6]},
        "observation.images.camera1": {"type": "VISUAL", "shape": [3, 256, 256]},
        "observation.images.camera2": {"type": "VISUAL", "shape": [3, 256, 256]}
    },
    "output_features": {"action": {"type": "ACTION", "shape": [6]}},
    "vlm_model_name": "HuggingFaceTB/SmolVLM2-500M-Video-Instruct"
}"#;

/// Writes the published model's tensors in BF16, with cheap random values below 1.
fn write_model(path: &Path) {
    let layout = state_dict_layout(&Profile::Full.config());
    let mut header = serde_json::Map::new();
    header.insert("__metadata__".into(), serde_json::json!({"format": "pt"}));
    let mut end = 0;
    for (name, shape) in &layout {
        let start = end;
        end += 2 * shape.iter().product::<usize>();
        let info = serde_json::json!({
            "dtype": "BF16", "shape": shape, "data_offsets": [start, end]
        });
        header.insert(name.clone(), info);
    }
    let header = serde_json::to_vec(&header).unwrap();
    let mut out = BufWriter::with_capacity(1 << 20, File::create(path).unwrap());
    out.write_all(&(header.len() as u64).to_le_bytes()).unwrap();
    out.write_all(&header).unwrap();
    let mut state = 1u64;
    let mut block = vec![0u8; 1 << 20];
    let mut left = end;
    while left > 0 {
        for pair in block.chunks_exact_mut(2) {
            state = state
                .wrapping_mul(6364136223846793005)
                .wrapping_add(1442695040888963407);
            // Any exponent below that of 1 gives a finite number.
            let bits = ((state >> 48) as u16) & 0xbf7f;
            pair.copy_from_slice(&bits.to_le_bytes());
        }
        let now = left.min(block.len());
        out.write_all(&block[..now]).unwrap();
        left -= now;
    }
    out.flush().unwrap();
}

fn same_bytes(a: &Path, b: &Path) -> bool {
    let open = |path: &Path| BufReader::with_capacity(1 << 20, File::open(path).unwrap());
    let (mut a, mut b) = (open(a), open(b));
    let (mut left, mut right) = (vec![0; 1 << 20], vec![0; 1 << 20]);
    loop {
        let n = a.read(&mut left).unwrap();
        if n == 0 {
            return b.read(&mut right).unwrap() == 0;
        }
        if b.read_exact(&mut right[..n]).is_err() || left[..n] != right[..n] {
            return false;
        }
    }
}

#[test]
fn a_published_policy_folder_is_read_and_written_in_bounded_memory() {
    let test =
        "published_policy_folder::a_published_policy_folder_is_read_and_written_in_bounded_memory";
    if !alone(test, &[]) {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let (source, copy) = (folder.path().join("source"), folder.path().join("copy"));
    std::fs::create_dir(&source).unwrap();
    std::fs::write(source.join("config.json"), CONFIG).unwrap();
    write_model(&source.join("model.safetensors"));

    let opened = PolicyFolder::open(&source).unwrap();
    let dims = &opened.config().dims;
    assert_eq!((dims.text.layers, dims.cameras), (16, 2));
    let parameters = parameters_of(&opened);
    let name = "model.action_out_proj.bias";
    let bias: Vec<f32> = parameters.get(name).unwrap().to_vec1().unwrap();
    assert!(bias.iter().all(|x| bf16::from_f32(*x).to_f32() == *x));
    assert!(bias.iter().any(|x| *x != 0.0));
    drop(parameters);

    let expert: TensorSet = trainable_layout(dims, true)
        .into_keys()
        .map(|name| {
            let tensor = opened.tensor(&name).unwrap();
            (name, tensor)
        })
        .collect();
    opened.write(&copy, &expert, Precision::Kept).unwrap();
    assert!(same_bytes(
        &source.join("model.safetensors"),
        &copy.join("model.safetensors")
    ));

    let peak = peak_gib();
    println!("peak memory {peak:.2} GiB (at most {MOST_GIB})");
    assert!(peak <= MOST_GIB, "{peak:.2} GiB");
}
