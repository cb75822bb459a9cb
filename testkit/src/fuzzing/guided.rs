//! The inputs of libFuzzer, which changes those that reach new code. `scripts/fuzz` builds and runs this.

use std::env::var;
use std::fs;
use std::panic::AssertUnwindSafe;
use std::path::Path;

use super::Targets;

/// Fuzzes the target of this name, and writes its seeds into the folder FUZZ_SEEDS before. The run stops at a panic.
pub fn fuzz(targets: &Targets, name: &str) {
    // Inputs are cut off at 4096 bytes otherwise.
    let fuzzer = bolero::check!().with_max_len(1 << 20);
    let mut target = AssertUnwindSafe((targets.target)(name));
    let seeds = var("FUZZ_SEEDS").unwrap();
    for (number, seed) in target.seeds.iter().enumerate() {
        fs::write(Path::new(&seeds).join(format!("seed-{number}")), seed).unwrap();
    }
    fuzzer.for_each(move |input: &[u8]| {
        if let Err(finding) = targets.run(&mut target, input) {
            panic!("{finding}");
        }
    })
}
