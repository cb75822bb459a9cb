//! What an aggregator reads of strangers, and an auditor of the disk: inputs that fuzzing found, read again.
//! They are in `tests/corpus/aggregator`, and `scripts/fuzz aggregator record 600` looks for more of one target.

#[path = "../../lerobot/tests/allocations/mod.rs"]
mod allocations;
#[path = "../../lerobot/tests/fuzzing/mod.rs"]
mod fuzzing;
mod harness;
#[path = "fuzzing/targets.rs"]
mod targets;

/// The one test of this file: allocations are counted for the whole process.
#[test]
fn what_fuzzing_the_aggregator_found_neither_panics_nor_allocates_out_of_proportion() {
    fuzzing::read_again("aggregator");
}
