//! Everything of the verifier that reads strangers' bytes, specifications among them: inputs that fuzzing found, read again; and
//! the fuzzing itself, for as long as one likes:
//!
//! ```sh
//! FUZZ_TARGET=eval_spec FUZZ_SECONDS=600 \
//!     cargo test --release --workspace --test fuzz_verifier -- --ignored --nocapture fuzzing_the_verifier
//! ```
//!
//! As `ledger/tests/fuzz.rs`, with the corpus in `verifier/tests/corpus`.

#[path = "../../lerobot/tests/allocations/mod.rs"]
mod allocations;
#[path = "../../lerobot/tests/fuzzing/mod.rs"]
mod fuzzing;
#[path = "fuzzing/targets.rs"]
mod targets;

use std::path::Path;

fn corpus() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/corpus"))
}

/// The one test of this file that always runs: allocations are counted for the whole process.
#[test]
fn what_fuzzing_the_verifier_found_neither_panics_nor_allocates_out_of_proportion() {
    fuzzing::read_again(corpus());
}

#[test]
#[ignore = "runs for FUZZ_SECONDS and writes into verifier/tests/corpus"]
fn fuzzing_the_verifier() {
    fuzzing::fuzz(corpus());
}
