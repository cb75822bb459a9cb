//! Everything of the verifier that reads strangers' bytes, specifications among them: inputs that fuzzing found, read again.
//! They are in `tests/corpus/verifier`, and `scripts/fuzz verifier eval_spec 600` looks for more of one target.

mod targets;

#[test]
fn what_fuzzing_the_verifier_found_neither_panics_nor_allocates_out_of_proportion() {
    zk0_testkit::fuzzing::read_again("verifier", &targets::TARGETS);
}
