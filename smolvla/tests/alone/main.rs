//! Tests that count what the whole process allocates, or look at its memory.

mod fuzz_smolvla;
mod memory;

#[global_allocator]
static ALLOCATOR: zk0_testkit::allocations::Watched = zk0_testkit::allocations::Watched;
