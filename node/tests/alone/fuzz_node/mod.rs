//! What a node reads from a disk that may have damaged it: inputs that fuzzing found, read again.
//! They are in `tests/corpus/node`, and `scripts/fuzz node base_losses 600` looks for more of one target.

mod targets;

#[test]
fn what_fuzzing_the_node_found_neither_panics_nor_allocates_out_of_proportion() {
    zk0_testkit::fuzzing::read_again("node", &targets::TARGETS);
}
