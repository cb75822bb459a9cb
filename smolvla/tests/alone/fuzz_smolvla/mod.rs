//! What reads weights, caches and snapshots: inputs that fuzzing found, read again.
//! They are in `tests/corpus/smolvla`, and `scripts/fuzz smolvla policy_file 600` looks for more of one target.

mod cache_and_snapshot_targets;
mod targets;

#[test]
fn inputs_found_by_fuzzing_neither_panic_nor_allocate_out_of_proportion() {
    zk0_testkit::fuzzing::read_again("smolvla", &targets::TARGETS);
}
