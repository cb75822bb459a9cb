//! What a node reads from a disk that may have damaged it: inputs that fuzzing found, read again.
//! They are in `tests/corpus/node`, and `scripts/fuzz node base_losses 600` looks for more of one target.

#[path = "../../lerobot/tests/allocations/mod.rs"]
mod allocations;
#[path = "../../lerobot/tests/fuzzing/mod.rs"]
mod fuzzing;
#[path = "fuzzing/targets.rs"]
mod targets;

/// The one test of this file: allocations are counted for the whole process.
#[test]
fn what_fuzzing_the_node_found_neither_panics_nor_allocates_out_of_proportion() {
    fuzzing::read_again("node");
}
