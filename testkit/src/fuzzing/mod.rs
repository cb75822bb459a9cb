//! Tests that readers neither panic nor allocate out of proportion. `corpus` has kept inputs, `guided` libFuzzer's.
//!
//! A crate's program `CRATE_alone`, `tests/alone/main.rs`, declares the [counting allocator](crate::allocations), and has a folder
//! `fuzz_CRATE`. Its `mod.rs` is one test:
//!
//! ```ignore
//! mod targets;
//!
//! #[test]
//! fn inputs_found_by_fuzzing_neither_panic_nor_allocate_out_of_proportion() {
//!     zk0_testkit::fuzzing::read_again("CRATE", &targets::TARGETS);
//! }
//! ```
//!
//! Beside it, `targets.rs` lists the readers:
//!
//! ```ignore
//! use zk0_testkit::fuzzing::{Target, Targets};
//!
//! const NAMES: [&str; 2] = ["base_losses", "training_history"];
//!
//! pub const TARGETS: Targets = Targets {
//!     names: &NAMES,
//!     target,
//!     // What any input may make a reader allocate.
//!     slack: 2 << 20,
//! };
//!
//! fn target(name: &str) -> Target {
//!     match name { … }
//! }
//! ```
//!
//! `scripts/fuzz` builds the same program, and runs `fuzz_CRATE`. Only this crate has bolero and the condition `fuzzing`.

#![allow(unexpected_cfgs)] // `scripts/fuzz` sets `fuzzing`

mod corpus;
#[cfg(fuzzing)]
mod guided;
mod target;

pub use self::corpus::read_again;
pub use self::target::{Target, Targets};
