//! Proves that an SP1 program accepts its input, with a compressed proof, and verifies it with the verifier that auditors use:
//! `cargo run --release --workspace --example prove_elf -- PROGRAM.elf FOLDER`
//!
//! The folder holds the program's input, as `execute_elf` reads it. The proof goes to `proof.bin` there, and the public values to
//! `public.bin`. It serves to measure programs that no mode of zk0 uses yet.

use serde_json::json;
use sp1_sdk::blocking::{CpuProver, ProveRequest, Prover};
use sp1_sdk::{Elf, HashableKey, ProvingKey, SP1Stdin};
use sp1_verifier::compressed::SP1CompressedVerifierRaw;
use std::error::Error;
use std::path::Path;
use std::time::{Duration, Instant};
use std::{env, fs};
use zk0_prover::machine::{peak_memory, Device, DeviceKind, ProverLock};

fn main() -> Result<(), Box<dyn Error>> {
    const USAGE: &str = "usage: prove_elf PROGRAM.elf FOLDER";
    let mut arguments = env::args().skip(1);
    let elf: &'static [u8] = fs::read(arguments.next().ok_or(USAGE)?)?.leak();
    let folder = arguments.next().ok_or(USAGE)?;
    let folder = Path::new(&folder);
    let mut stdin = SP1Stdin::new();
    for number in 0.. {
        let file = folder.join(format!("{number}.bin"));
        if !file.exists() {
            break;
        }
        stdin.write_slice(&fs::read(file)?);
    }
    // Only builds with the feature `cuda` know another device.
    #[allow(irrefutable_let_patterns)]
    let Device::Cpu(options) = Device::find(DeviceKind::Cpu)?
    else {
        return Err("this example proves on a CPU".into());
    };
    let _lock = ProverLock::acquire(&ProverLock::default_path(), Duration::ZERO)?;
    let begin = Instant::now();
    options.export();
    let prover = CpuProver::new_with_opts(Some(options.core()));
    let program = prover.setup(Elf::Static(elf))?;
    let start = begin.elapsed();
    eprintln!("started after {start:.0?}");
    let begin = Instant::now();
    let proven = prover.prove(&program, stdin).compressed().run()?;
    let proving = begin.elapsed();
    let proof = bincode::serialize(&proven.proof)?;
    let public = proven.public_values.to_vec();
    let key = bincode::serialize(&program.verifying_key().hash_koalabear())?;
    let begin = Instant::now();
    SP1CompressedVerifierRaw::verify_with_public_values(&proof, &public, &key)?;
    let verifying = begin.elapsed();
    fs::write(folder.join("proof.bin"), &proof)?;
    fs::write(folder.join("public.bin"), &public)?;
    let report = json!({
        "start_seconds": start.as_secs_f64(),
        "proving_seconds": proving.as_secs_f64(),
        "verifying_seconds": verifying.as_secs_f64(),
        "proof_bytes": proof.len(),
        "peak_memory_bytes": peak_memory(),
    });
    println!("{report}");
    Ok(())
}
