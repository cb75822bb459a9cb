//! Everything in protocol and ledger that reads strangers' bytes: inputs that fuzzing found, read again.
//! They are in `tests/corpus/ledger`, and `scripts/fuzz ledger entry 600` looks for more of one target.

#[path = "../../lerobot/tests/allocations/mod.rs"]
mod allocations;
#[path = "../../lerobot/tests/fuzzing/mod.rs"]
mod fuzzing;
mod network;
#[path = "fuzzing/targets.rs"]
mod targets;

/// The one test of this file: allocations are counted for the whole process.
#[test]
fn inputs_found_by_fuzzing_neither_panic_nor_allocate_out_of_proportion() {
    fuzzing::read_again("ledger");
}
