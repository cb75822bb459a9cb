//! Everything in protocol and ledger that reads strangers' bytes. One test reads the inputs that fuzzing has found. Another fuzzes for as
//! long as you like:
//!
//! ```sh
//! FUZZ_TARGET=entry FUZZ_SECONDS=600 cargo test --release --workspace --test fuzz -- --ignored --nocapture fuzzing_the_ledger
//! ```
//!
//! It adds to `ledger/tests/corpus/<target>` one small input per outcome that is not there yet, and fails on a panic or an
//! allocation out of proportion, whose inputs it leaves there as well. The fuzzer is the one of `lerobot/tests/fuzzing`.

#[path = "../../lerobot/tests/allocations/mod.rs"]
mod allocations;
#[path = "../../lerobot/tests/fuzzing/mod.rs"]
mod fuzzing;
mod network;
#[path = "fuzzing/targets.rs"]
mod targets;

use std::path::Path;

fn corpus() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/corpus"))
}

/// The one test of this file that always runs: allocations are counted for the whole process.
#[test]
fn inputs_found_by_fuzzing_neither_panic_nor_allocate_out_of_proportion() {
    fuzzing::read_again(corpus());
}

#[test]
#[ignore = "runs for FUZZ_SECONDS and writes into ledger/tests/corpus"]
fn fuzzing_the_ledger() {
    fuzzing::fuzz(corpus());
}
