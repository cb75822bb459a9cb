//! Inputs that fuzzing found, read again; and the fuzzing itself, for as long as one likes:
//!
//! ```sh
//! FUZZ_TARGET=mp4 FUZZ_SECONDS=600 cargo test --release -p zk0-lerobot --test fuzz_lerobot -- --ignored --nocapture
//! ```
//!
//! It adds to `tests/fixtures/fuzz/<target>` one small input per outcome that is not there yet, and fails on a panic or an
//! allocation out of proportion, whose inputs it leaves there as well.

mod allocations;
mod fuzzing;
#[path = "fuzzing/hub_target.rs"]
mod hub_target;
mod mp4_writer;
#[path = "fuzzing/policy_targets.rs"]
mod policy_targets;
mod recordings;
#[path = "fuzzing/targets.rs"]
mod targets;

use recordings::fixtures;

/// The one test of this file that always runs: allocations are counted for the whole process.
#[test]
fn inputs_found_by_fuzzing_neither_panic_nor_allocate_out_of_proportion() {
    fuzzing::read_again(&fixtures().join("fuzz"));
}

#[test]
#[ignore = "runs for FUZZ_SECONDS and writes into tests/fixtures"]
fn fuzzing() {
    fuzzing::fuzz(&fixtures().join("fuzz"));
}
