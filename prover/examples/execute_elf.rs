//! Executes an SP1 program without proving and prints what it costs, one JSON line for each folder:
//! `cargo run --release -p zk0-prover --example execute_elf -- PROGRAM.elf FOLDER…`
//!
//! A folder holds the program's input, one file per read, named 0.bin, 1.bin and so on. Cycles and gas are also written
//! to `cost.txt` in it.

use std::error::Error;
use std::path::Path;
use std::{fs, io};
use zk0_prover::program::Executor;

#[tokio::main]
async fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let elf = arguments
        .next()
        .ok_or("usage: execute_elf PROGRAM.elf FOLDER…")?;
    let elf: &'static [u8] = fs::read(elf)?.leak();
    let executor = Executor::new().await?;
    for folder in arguments {
        let run = executor
            .execute(elf, &buffers(Path::new(&folder))?)
            .await
            .map_err(|error| format!("{folder}: {error}"))?;
        let line = serde_json::json!({
            "input": folder, "cycles": run.cycles, "gas": run.gas, "public_values": hex::encode(run.public_values),
        });
        println!("{line}");
        let cost = format!("{} {}\n", run.cycles, run.gas);
        fs::write(Path::new(&folder).join("cost.txt"), cost)?;
    }
    Ok(())
}

/// The files 0.bin, 1.bin and so on, up to the first number that is missing.
fn buffers(folder: &Path) -> io::Result<Vec<Vec<u8>>> {
    (0..)
        .map(|index| folder.join(format!("{index}.bin")))
        .take_while(|path| path.exists())
        .map(fs::read)
        .collect()
}
