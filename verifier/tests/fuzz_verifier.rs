//! Everything of the verifier that reads strangers' bytes, specifications among them: inputs that fuzzing found, read again.
//! They are in `tests/corpus/verifier`, and `scripts/fuzz verifier eval_spec 600` looks for more of one target.

#[path = "../../lerobot/tests/allocations/mod.rs"]
mod allocations;
#[path = "../../lerobot/tests/fuzzing/mod.rs"]
mod fuzzing;
mod left;
#[path = "fuzzing/targets.rs"]
mod targets;

/// The one test of this file: allocations are counted for the whole process.
#[test]
fn what_fuzzing_the_verifier_found_neither_panics_nor_allocates_out_of_proportion() {
    fuzzing::read_again("verifier");
}
