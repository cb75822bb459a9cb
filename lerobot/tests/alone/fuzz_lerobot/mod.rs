//! Everything that reads recordings and policy folders: inputs that fuzzing found, read again.
//! They are in `tests/corpus/lerobot`, and `scripts/fuzz lerobot mp4 600` looks for more of one target.

mod hub_target;
mod policy_targets;
mod targets;

#[test]
fn inputs_found_by_fuzzing_neither_panic_nor_allocate_out_of_proportion() {
    zk0_testkit::fuzzing::read_again("lerobot", &targets::TARGETS);
}
