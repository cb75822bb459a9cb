//! What mode `succinct` costs beside the proof itself: `cargo run --release --workspace --example bench_succinct MODEL SAMPLES`
//!
//! MODEL is micro or full. It makes a claim from a seed, makes the argument natively, executes the guest program, and does the verifier's share,
//! with both files of weights on disk. The check of the weights is a process of its own, so that its memory is that of the check alone. Each
//! line names a figure and what it is compared with in the same run:
//!
//! | bench | ours | peer |
//! | --- | --- | --- |
//! | `succinct-argument` | seconds of the argument, for a sample under both models | seconds of evaluating it, natively |
//! | `succinct-verify` | seconds of verifying the argument natively | the same, for all samples |
//! | `succinct-weights` | seconds of the verifier's check of both files of weights | seconds of hashing them with SHA-256 |
//! | `succinct-cycles` | guest cycles | the least that mode `direct` takes: four for each multiply-add; nobody runs that |
//! | `succinct-hiding-cycles`, `-input` | guest cycles, bytes of the guest's input; for full 4 alone | those of 88986e74, whose argument did not hide |

use serde_json::json;
use sha2::{Digest as _, Sha256};
use std::env;
use std::error::Error;
use std::fs::{self, File};
use std::path::Path;
use std::process::Command;
use std::time::Instant;
use zk0_circuits::claim::statement::check;
use zk0_circuits::{EvalSpec, Mode};
use zk0_prover::machine::peak_memory;
use zk0_prover::measure::DirectMode;
use zk0_prover::program::{elf, synthetic, Executor, PreparedClaim};
use zk0_verifier::check_weight_claims;
use zk0_weights::Format;

const USAGE: &str = "usage: bench_succinct MODEL SAMPLES";
/// Guest cycles and bytes of the guest's input of `full 4` in 88986e74, the last build whose argument did not hide.
const WITHOUT_HIDING: [f64; 2] = [7_044_259.0, 1_170_034.0];
/// The first argument of the process that checks the weights. The second one is the folder, and the third one is the model.
const CHECK_WEIGHTS: &str = "--check-weights";

/// The result of a step, its seconds, and the most memory that the process had meanwhile, in bytes.
fn measured<T>(step: impl FnOnce() -> T) -> Result<(T, f64, u64), Box<dyn Error>> {
    fs::write("/proc/self/clear_refs", "5")?;
    let begin = Instant::now();
    let result = step();
    Ok((
        result,
        begin.elapsed().as_secs_f64(),
        peak_memory().unwrap_or(0),
    ))
}

fn print(bench: &str, unit: &str, (ours, peer): (f64, f64), more: serde_json::Value) {
    let mut line =
        json!({"bench": bench, "ours": ours, "peer": peer, "ratio": peer / ours, "unit": unit});
    if let (Some(line), serde_json::Value::Object(more)) = (line.as_object_mut(), more) {
        line.extend(more);
    }
    println!("{line}");
}

#[tokio::main]
async fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    if let [mode, folder, model] = &arguments[..] {
        if mode == CHECK_WEIGHTS {
            return check_weights(Path::new(folder), model);
        }
    }
    let [model, samples] = &arguments[..] else {
        return Err(USAGE.into());
    };
    let spec = EvalSpec::new(synthetic::dims(model)?);
    let samples: u32 = samples.parse()?;
    let folder = tempfile::tempdir()?;

    eprintln!("making a claim that holds");
    let direct = synthetic::private_input(&spec, Mode::Direct, samples, 1)?;
    let (evaluated, evaluating, _) = measured(|| check(&direct))?;
    evaluated?;
    drop(direct);
    let private = synthetic::private_input(&spec, Mode::Succinct, samples, 1)?;

    eprintln!("making the argument");
    let (blind, place) = (synthetic::blind(1), Some(folder.path()));
    let made =
        measured(|| PreparedClaim::of(Mode::Succinct, &private, &blind, place, &mut |_| {}))?;
    let (prepared, seconds, memory) = made;
    let prepared = prepared?;
    let of_each = (
        seconds / f64::from(samples),
        evaluating / f64::from(samples),
    );
    let size = json!({"model": model, "samples": samples, "peak_memory_bytes": memory, "input_bytes": prepared.input.bytes()});
    print("succinct-argument", "s", of_each, size);

    let (claim, seconds, memory) = measured(|| prepared.input.claim())?;
    let claim = claim?;
    print(
        "succinct-verify",
        "s",
        (seconds, evaluating),
        json!({"peak_memory_bytes": memory}),
    );

    let format = Format::new(&spec)?;
    for (name, weights) in [("base", &private.base), ("update", &private.update)] {
        fs::write(folder.path().join(name), format.write(weights))?;
    }
    drop(private);
    let named = claim
        .weight_check
        .ok_or("the claim names no weight check")?;
    let check = (named, prepared.weight_check);
    fs::write(folder.path().join("check"), borsh::to_vec(&check)?)?;
    let checked = Command::new(env::current_exe()?)
        .arg(CHECK_WEIGHTS)
        .arg(folder.path())
        .arg(model)
        .status()?;
    if !checked.success() {
        return Err("the check of the weights failed".into());
    }

    let executor = Executor::new().await?;
    let run = executor.execute(elf(Mode::Succinct), &prepared.input.buffers);
    let run = run.await?;
    let weights = format.tensors().iter().map(|tensor| tensor.len() as u64);
    let least = DirectMode {
        weights: weights.sum(),
        samples,
        chunk: u64::from(spec.dims.chunk),
    };
    print(
        "succinct-cycles",
        "cycles",
        (run.cycles as f64, least.cycles() as f64),
        json!({"gas": run.gas}),
    );
    if (&model[..], samples) == ("full", 4) {
        let [cycles, bytes] = WITHOUT_HIDING;
        let (ours, none) = ([run.cycles, prepared.input.bytes()], json!({}));
        print(
            "succinct-hiding-cycles",
            "cycles",
            (ours[0] as f64, cycles),
            none.clone(),
        );
        print(
            "succinct-hiding-input",
            "bytes",
            (ours[1] as f64, bytes),
            none,
        );
    }
    Ok(())
}

/// Checks what the argument leaves of the weights in the files in `folder`, and hashes these files for comparison.
fn check_weights(folder: &Path, model: &str) -> Result<(), Box<dyn Error>> {
    let format = Format::new(&EvalSpec::new(synthetic::dims(model)?))?;
    let check: (_, Vec<u8>) = borsh::from_slice(&fs::read(folder.join("check"))?)?;
    let (named, weight_check) = check;
    let open = |name| File::open(folder.join(name));
    let (base, update) = (open("base")?, open("update")?);
    let (checked, seconds, memory) =
        measured(|| check_weight_claims(&format, &named, &weight_check, base, update))?;
    checked?;
    let hash = || {
        ["base", "update"].map(|name| {
            let mut hasher = Sha256::new();
            std::io::copy(&mut open(name)?, &mut hasher)
        })
    };
    let (hashed, hashing, _) = measured(hash)?;
    for file in hashed {
        file?;
    }
    let more = json!({"peak_memory_bytes": memory, "bytes_beside_the_proof": weight_check.len()});
    print("succinct-weights", "s", (seconds, hashing), more);
    Ok(())
}
