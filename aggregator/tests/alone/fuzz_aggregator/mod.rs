//! What an aggregator reads of strangers, and an auditor of the disk: inputs that fuzzing found, read again.
//! They are in `tests/corpus/aggregator`, and `scripts/fuzz aggregator record 600` looks for more of one target.

mod targets;

#[test]
fn what_fuzzing_the_aggregator_found_neither_panics_nor_allocates_out_of_proportion() {
    zk0_testkit::fuzzing::read_again("aggregator", &targets::TARGETS);
}
