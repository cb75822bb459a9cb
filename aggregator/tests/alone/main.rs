//! What counts the allocations of its whole process.

mod fuzz_aggregator;

#[global_allocator]
static ALLOCATOR: zk0_testkit::allocations::Watched = zk0_testkit::allocations::Watched;
