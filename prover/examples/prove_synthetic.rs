//! Proves a claim made from a seed. It serves to try a machine's prover, and to make the proof that the verifier's tests use:
//! `cargo run --release --workspace --example prove_synthetic -- DEVICE MODEL MODE SAMPLES [FOLDER]`
//!
//! DEVICE is cpu or cuda (`make cuda` builds this example, too), MODEL micro or full, MODE direct, checked or succinct. Writes
//! `proof.bin`, `claim.bin` (the public values) and `input.bin` (borsh) to FOLDER when one is given, and prints what it
//! took. A claim of model full takes a minute and 3 GB to make before it is proven.

use serde_json::json;
use std::error::Error;
use std::path::PathBuf;
use std::time::Instant;
use std::{env, fs};
use zk0_circuits::{EvalSpec, Mode};
use zk0_prover::machine::{peak_memory, Device, DeviceKind, ProverLock};
use zk0_prover::program::{synthetic, Executor};
use zk0_prover::prove::Sp1Prover;

#[tokio::main]
async fn main() -> Result<(), Box<dyn Error>> {
    const USAGE: &str = "usage: prove_synthetic DEVICE MODEL MODE SAMPLES [FOLDER]";
    let mut arguments = env::args().skip(1);
    let kind: DeviceKind = arguments.next().ok_or(USAGE)?.parse()?;
    let model = arguments.next().ok_or(USAGE)?;
    let spec = EvalSpec::new(synthetic::dims(&model)?);
    let mode: Mode = arguments.next().ok_or(USAGE)?.parse()?;
    let samples = arguments.next().ok_or(USAGE)?.parse()?;
    let folder = arguments.next().map(PathBuf::from);
    // This comes first, so that nobody waits a minute for a device that is not there.
    let device = Device::find(kind)?;
    let lock = ProverLock::acquire(&ProverLock::default_path(), Default::default())?;
    let executor = Executor::new().await?;
    let (input, run) = synthetic::execute(&executor, &spec, mode, samples).await?;
    let begin = Instant::now();
    let prover = Sp1Prover::start(device.clone(), lock.into()).await?;
    let start = begin.elapsed();
    eprintln!("started in {start:.0?} on {device:?}");
    let begin = Instant::now();
    let proof = prover.prove_compressed(&input).await?;
    let proving = begin.elapsed();
    if let Some(folder) = folder {
        fs::create_dir_all(&folder)?;
        fs::write(folder.join("proof.bin"), &proof.bytes)?;
        fs::write(folder.join("claim.bin"), &proof.public_values)?;
        fs::write(folder.join("input.bin"), borsh::to_vec(&input.buffers)?)?;
    }
    let report = json!({
        "device": kind.to_string(),
        "model": model,
        "mode": mode.to_string(),
        "samples": samples,
        "cycles": run.cycles,
        "gas": run.gas,
        "start_seconds": start.as_secs_f64(),
        "proving_seconds": proving.as_secs_f64(),
        "cycles_per_second": run.cycles as f64 / proving.as_secs_f64(),
        "proof_bytes": proof.bytes.len(),
        "claim_is_that_of_the_execution": proof.public_values == run.public_values,
        "peak_memory_bytes": peak_memory(),
        "gpu_memory_bytes": device.gpu_memory_used(),
    });
    println!("{report}");
    Ok(())
}
