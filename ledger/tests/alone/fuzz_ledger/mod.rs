//! Everything in protocol and ledger that reads strangers' bytes: inputs that fuzzing found, read again.
//! They are in `tests/corpus/ledger`, and `scripts/fuzz ledger entry 600` looks for more of one target.

mod history;
mod targets;

#[test]
fn inputs_found_by_fuzzing_neither_panic_nor_allocate_out_of_proportion() {
    zk0_testkit::fuzzing::read_again("ledger", &targets::TARGETS);
}
