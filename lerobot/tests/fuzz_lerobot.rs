//! Everything that reads recordings and policy folders: inputs that fuzzing found, read again.
//! They are in `tests/corpus/lerobot`, and `scripts/fuzz lerobot mp4 600` looks for more of one target.

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

/// The one test of this file: allocations are counted for the whole process.
#[test]
fn inputs_found_by_fuzzing_neither_panic_nor_allocate_out_of_proportion() {
    fuzzing::read_again("lerobot");
}
