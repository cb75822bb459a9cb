//! Writes the verifying keys of the guest ELFs, and the records of how they were built. Run it after `circuits/build-guest.sh` has
//! replaced the ELFs; `make guest` does both.
//!
//! `cargo run --release -p zk0-prover --example record_guest [CIRCUITS]`; CIRCUITS is this clone's `circuits` unless another one is named

use serde_json::json;
use sha2::{Digest, Sha256};
use std::env;
use std::error::Error;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use zk0_prover::program::Executor;

#[tokio::main]
async fn main() -> Result<(), Box<dyn Error>> {
    let own = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../circuits");
    let circuits = env::args_os().nth(1).map_or_else(own, PathBuf::from);
    let executor = Executor::new().await?;
    for program in ["direct", "succinct"] {
        record(&circuits, program, &executor).await?;
    }
    Ok(())
}

async fn record(circuits: &Path, program: &str, executor: &Executor) -> Result<(), Box<dyn Error>> {
    let file = |extension: &str| circuits.join(format!("elf/{program}.{extension}"));
    let elf = fs::read(file("elf"))?;
    let sha256 = hex::encode(Sha256::digest(&elf));
    let key = executor.verifying_key(elf.leak()).await?;
    let toolchain = Command::new(circuits.join("build-guest.sh"))
        .arg("--toolchain")
        .output()?;
    if !toolchain.status.success() {
        return Err(String::from_utf8(toolchain.stderr)?.into());
    }
    let record = json!({
        "program": program,
        "elf_sha256": sha256,
        "verifying_key_koalabear": hex::encode(&key.koalabear),
        "verifying_key_bytes32": key.bytes32,
        "sp1": sp1_version(&fs::read_to_string(circuits.join("guest/Cargo.lock"))?)?,
        "toolchain": String::from_utf8(toolchain.stdout)?.trim(),
    });
    fs::write(file("vk"), &key.koalabear)?;
    fs::write(file("json"), format!("{record:#}\n"))?;
    println!("{record:#}");
    Ok(())
}

/// The version of sp1-zkvm in the guest's lock file.
fn sp1_version(lock: &str) -> Result<String, String> {
    let (_, package) = lock
        .split_once("name = \"sp1-zkvm\"\nversion = \"")
        .ok_or("no sp1-zkvm in circuits/guest/Cargo.lock")?;
    Ok(package.split('"').next().unwrap_or_default().into())
}
