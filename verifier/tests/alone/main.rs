//! Tests that count what the whole process allocates.

mod fuzz_verifier;

#[global_allocator]
static ALLOCATOR: zk0_testkit::allocations::Watched = zk0_testkit::allocations::Watched;
