//! Tests that count what the whole process allocates.

mod dataset_damage;
mod fuzz_lerobot;

#[global_allocator]
static ALLOCATOR: zk0_testkit::allocations::Watched = zk0_testkit::allocations::Watched;
