//! Makes the proofs that are measured, and reports.
//!
//! - `prove cases FOLDER [LARGEST]`: proves every case natively, verifies it, and writes the guest's input and the native
//!   costs to a folder each. LARGEST is the binary logarithm of the largest commitment (default 24).
//! - `prove report FOLDER`: JSON lines of all costs, with those that `execute_elf` left there, and the whole expert's.

use std::{error::Error, fs, path::Path};
use zk0_succinct::{
    cases::{self, Proven},
    clock::Clock,
    expert::{self, Costs},
};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match arguments[..] {
        ["cases", folder] => prove_cases(Path::new(folder), 24),
        ["cases", folder, largest] => prove_cases(Path::new(folder), largest.parse()?),
        ["report", folder] => report(Path::new(folder)),
        _ => Err("usage: prove cases FOLDER [LARGEST] | prove report FOLDER".into()),
    }
}

fn prove_cases(folder: &Path, largest: usize) -> Result<(), Box<dyn Error>> {
    if !(20..=25).contains(&largest) {
        return Err(format!("LARGEST is {largest}, must be within 20 ..= 25").into());
    }
    for (number, (name, statement)) in cases::all(largest).into_iter().enumerate() {
        let folder = folder.join(format!("{number:02}"));
        fs::create_dir_all(&folder)?;
        let Proven { proof, seconds: [commit, prove], .. } = cases::prove(statement);
        let start = Clock::start();
        statement.verify(&proof)?;
        let verify = start.seconds();
        let bytes = |words: &mut dyn Iterator<Item = u32>| words.flat_map(u32::to_le_bytes).collect::<Vec<u8>>();
        fs::write(folder.join("0.bin"), bytes(&mut statement.to_words().into_iter()))?;
        fs::write(folder.join("1.bin"), bytes(&mut proof.iter().map(|value| value.0)))?;
        let native = format!("{commit:.3} {prove:.3} {:.3} {}", verify * 1e3, proof.len() * 4);
        fs::write(folder.join("native.txt"), format!("{name}\n{native}\n"))?;
        eprintln!("{name}: committed in {commit:.2} s, proven in {prove:.2} s, {} bytes", proof.len() * 4);
    }
    Ok(())
}

fn report(folder: &Path) -> Result<(), Box<dyn Error>> {
    let mut folders: Vec<_> = fs::read_dir(folder)?.collect::<Result<Vec<_>, _>>()?;
    folders.sort_by_key(|entry| entry.path());
    let mut costs = Costs::default();
    for folder in folders.iter().map(|entry| entry.path()).filter(|path| path.join("cost.txt").exists()) {
        let native = fs::read_to_string(folder.join("native.txt"))?;
        let (name, native) = native.trim().split_once('\n').ok_or("native.txt has no second line")?;
        let native: Vec<f64> = native.split(' ').map(str::parse).collect::<Result<_, _>>()?;
        let [commit, prove, verify, bytes] = native[..] else { return Err("native.txt is not as written".into()) };
        let cost = fs::read_to_string(folder.join("cost.txt"))?;
        let cost: Vec<u64> = cost.split_whitespace().map(str::parse).collect::<Result<_, _>>()?;
        let [cycles, gas] = cost[..] else { return Err("cost.txt is not as written".into()) };
        costs.add(name, cycles, gas);
        println!(
            "{{\"part\":\"{name}\",\"commit_s\":{commit},\"prove_s\":{prove},\"native_verify_ms\":{verify},\
             \"proof_bytes\":{bytes},\"guest_cycles\":{cycles},\"guest_gas\":{gas}}}"
        );
    }
    for samples in [1, 4, 16] {
        println!("{}", expert::estimate(&costs, samples)?);
    }
    Ok(())
}
