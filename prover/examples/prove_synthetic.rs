//! Proves a claim made from a seed. It serves to try a machine's prover, and `make prove-full` runs it:
//! `cargo run --release --workspace --example prove_synthetic -- DEVICE MODEL MODE SAMPLES [FOLDER]`
//!
//! DEVICE is cpu or cuda (`make cuda` builds this example, too), MODEL micro or full, MODE direct or succinct. Verifies the proof as an
//! aggregator does, and prints what it took as a JSON line. Writes to FOLDER: `input.bin` (borsh of what the guest program reads),
//! `weight_check.bin`, `proof.bin` and `claim.bin` (the public values). Each is written when it is complete. Whoever is interrupted runs the
//! same command again, and what is there is not made again. Remove the folder after a change of the sources.
//!
//! Making the input is a process of its own, so that all of its memory is free again before SP1 starts. In mode `succinct` it makes the
//! argument.

use serde_json::json;
use std::error::Error;
use std::path::Path;
use std::process::{Command, ExitCode};
use std::time::Instant;
use std::{env, fs};
use zk0_circuits::claim::program::verifying_key;
use zk0_circuits::{Claim, EvalSpec, Mode};
use zk0_prover::machine::{leftovers, peak_memory, Device, DeviceKind, ProverLock};
use zk0_prover::program::synthetic::MadeAgain;
use zk0_prover::program::{elf, synthetic, Executor, GuestInput, PreparedClaim};
use zk0_prover::prove::Sp1Prover;
use zk0_verifier::{check_proof, ProgramKey};

const USAGE: &str = "usage: prove_synthetic DEVICE MODEL MODE SAMPLES [FOLDER]";
/// Everything follows from it.
const SEED: u64 = 1;
/// The last argument of the process that makes the input.
const PREPARE: &str = "--prepare";

#[tokio::main]
async fn main() -> ExitCode {
    let Err(error) = prove().await else {
        return ExitCode::SUCCESS;
    };
    eprintln!("prove_synthetic: {error}");
    ExitCode::FAILURE
}

async fn prove() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let [kind, model, mode, samples, rest @ ..] = &arguments[..] else {
        return Err(USAGE.into());
    };
    let kind: DeviceKind = kind.parse()?;
    let spec = EvalSpec::new(synthetic::dims(model)?);
    let mode: Mode = mode.parse()?;
    let samples: u32 = samples.parse()?;
    if let [folder, last] = rest {
        if last == PREPARE {
            return prepare(&spec, mode, samples, Path::new(folder));
        }
    }
    let temporary = tempfile::tempdir()?;
    let folder = rest
        .first()
        .map_or(temporary.path(), |folder| Path::new(folder));
    fs::create_dir_all(folder)?;
    // This comes first, so that nobody waits for a device that is not there.
    let lock = ProverLock::acquire(&ProverLock::default_path(), Default::default())?;
    leftovers::remove(Path::new("/dev/shm"));
    let device = Device::find(kind)?;

    let path = |name: &str| folder.join(name);
    if !path("input.bin").exists() {
        eprintln!("making the input");
        let made = Command::new(env::current_exe()?)
            .args(&arguments[..4])
            .arg(folder)
            .arg(PREPARE)
            .status()?;
        if !made.success() {
            return Err("there is no input to prove".into());
        }
    }
    let buffers: Vec<Vec<u8>> = borsh::from_slice(&fs::read(path("input.bin"))?)?;
    let input = GuestInput::new(mode, buffers);
    let claim = input.claim()?;
    let run = Executor::new()
        .await?
        .execute(elf(mode), &input.buffers)
        .await?;
    eprintln!("executed: {} cycles, gas {}", run.cycles, run.gas);
    if run.public_values != borsh::to_vec(&claim)? {
        return Err("the guest program commits to another claim than the input gives here".into());
    }
    let (mut start, mut proving) = (None, None);
    if !path("proof.bin").exists() {
        let begin = Instant::now();
        let prover = Sp1Prover::start(device.clone(), lock.into()).await?;
        start = Some(begin.elapsed().as_secs_f64());
        eprintln!(
            "started in {:.0?} on {device:?}; now it proves",
            begin.elapsed()
        );
        let begin = Instant::now();
        let proof = prover.prove_compressed(&input).await?;
        proving = Some(begin.elapsed().as_secs_f64());
        write(&path("claim.bin"), &proof.public_values)?;
        write(&path("proof.bin"), &proof.bytes)?;
    }
    let (proof, proven) = (fs::read(path("proof.bin"))?, fs::read(path("claim.bin"))?);
    let proven: Claim = borsh::from_slice(&proven)?;
    if proven != claim {
        return Err("the proof is one of another claim than the input gives".into());
    }
    let key = ProgramKey::from_bytes(verifying_key(mode))?;
    let begin = Instant::now();
    check_proof(&proof, &proven, &key)?;
    let verifying = begin.elapsed().as_secs_f64();
    let report = json!({
        "device": kind.to_string(),
        "model": model,
        "mode": mode.to_string(),
        "samples": samples,
        "input_bytes": input.bytes(),
        "cycles": run.cycles,
        "gas": run.gas,
        "start_seconds": start,
        "proving_seconds": proving,
        "cycles_per_second": proving.map(|seconds| run.cycles as f64 / seconds),
        "verifying_seconds": verifying,
        "proof_bytes": proof.len(),
        "peak_memory_bytes": peak_memory(),
        "gpu_memory_bytes": device.gpu_memory_used(),
    });
    println!("{report}");
    Ok(())
}

/// Makes the input and what belongs to it.
fn prepare(spec: &EvalSpec, mode: Mode, samples: u32, folder: &Path) -> Result<(), Box<dyn Error>> {
    let begin = Instant::now();
    let private = MadeAgain::new(spec, mode, samples, SEED)?;
    eprintln!("a claim that holds: {:.0?}", begin.elapsed());
    let begin = Instant::now();
    let mut shown = 0;
    let mut progress = |share: f64| {
        let percent = (100.0 * share) as u32;
        if percent > shown {
            shown = percent;
            let left = begin.elapsed().mul_f64((1.0 - share) / share);
            eprintln!("making the argument: {percent} %, about {left:.0?} left");
        }
    };
    let blind = synthetic::blind(SEED);
    let prepared = PreparedClaim::of(mode, &private, &blind, Some(folder), &mut progress)?;
    let line = json!({
        "what": "private input to guest input", "mode": mode.to_string(), "samples": samples,
        "seconds": begin.elapsed().as_secs_f64(), "peak_memory_bytes": peak_memory(),
    });
    println!("{line}");
    write(&folder.join("weight_check.bin"), &prepared.weight_check)?;
    write(
        &folder.join("input.bin"),
        &borsh::to_vec(&prepared.input.buffers)?,
    )?;
    Ok(())
}

/// Writes a file, which is there when it is complete.
fn write(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    let partial = path.with_extension("partial");
    fs::write(&partial, bytes)?;
    fs::rename(partial, path)
}
