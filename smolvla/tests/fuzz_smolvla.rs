//! Inputs that fuzzing found, read again; and the fuzzing itself, for as long as one likes:
//!
//! ```sh
//! FUZZ_TARGET=policy_file FUZZ_SECONDS=600 cargo test --release -p zk0-smolvla --test fuzz_smolvla -- --ignored --nocapture
//! ```
//!
//! It adds to `tests/fixtures/fuzz/<target>` one small input per outcome that is not there yet. It fails on a panic or an
//! allocation out of proportion, and leaves such inputs there as well. The machinery is that of `lerobot/tests/fuzz_lerobot.rs`.

#[path = "../../lerobot/tests/allocations/mod.rs"]
mod allocations;
#[path = "fuzzing/cache_and_snapshot_targets.rs"]
mod cache_and_snapshot_targets;
#[path = "../../lerobot/tests/fuzzing/mod.rs"]
mod fuzzing;
#[path = "fuzzing/targets.rs"]
mod targets;

use std::path::Path;

fn corpora() -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/fixtures/fuzz")
}

/// The one test of this file that always runs: allocations are counted for the whole process.
#[test]
fn inputs_found_by_fuzzing_neither_panic_nor_allocate_out_of_proportion() {
    fuzzing::read_again(&corpora());
}

#[test]
#[ignore = "runs for FUZZ_SECONDS and writes into tests/fixtures"]
fn fuzzing() {
    fuzzing::fuzz(&corpora());
}
