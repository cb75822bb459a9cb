//! What reads weights, caches and snapshots: inputs that fuzzing found, read again.
//! They are in `tests/corpus/smolvla`, and `scripts/fuzz smolvla policy_file 600` looks for more of one target.

#[path = "../../lerobot/tests/allocations/mod.rs"]
mod allocations;
#[path = "fuzzing/cache_and_snapshot_targets.rs"]
mod cache_and_snapshot_targets;
#[path = "../../lerobot/tests/fuzzing/mod.rs"]
mod fuzzing;
#[path = "fuzzing/targets.rs"]
mod targets;

/// The one test of this file: allocations are counted for the whole process.
#[test]
fn inputs_found_by_fuzzing_neither_panic_nor_allocate_out_of_proportion() {
    fuzzing::read_again("smolvla");
}
