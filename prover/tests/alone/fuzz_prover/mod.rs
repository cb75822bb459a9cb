//! What the prover reads from others: inputs that fuzzing found, read again.
//! They are in `tests/corpus/prover`, and `scripts/fuzz prover guest_input 600` looks for more of one target.

mod targets;

#[test]
fn what_fuzzing_the_prover_found_neither_panics_nor_allocates_out_of_proportion() {
    zk0_testkit::fuzzing::read_again("prover", &targets::TARGETS);
}
