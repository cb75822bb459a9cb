//! Inputs of libFuzzer, for `scripts/fuzz`.

use std::env::var;
use std::fs;
use std::panic::AssertUnwindSafe;
use std::path::Path;

use super::Targets;

/// Writes the target's seeds into the folder FUZZ_SEEDS, and fuzzes until a panic.
pub fn fuzz(targets: &Targets, name: &str) {
    // The default cuts inputs at 4096 bytes.
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
