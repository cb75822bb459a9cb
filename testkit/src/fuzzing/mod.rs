//! What a reader may do with an input: neither panic, nor allocate out of proportion. `corpus` gives it the inputs that are kept,
//! `guided` those that libFuzzer makes up.
//!
//! The program `CRATE_alone` of a crate, `tests/alone/main.rs`, declares the [counting allocator](crate::allocations), and has a folder
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
//! Beside it, `targets.rs` says which readers there are:
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
//! `scripts/fuzz` builds the same program, and runs what is in `fuzz_CRATE`. bolero and the condition `fuzzing` are of this crate alone.

#![allow(unexpected_cfgs)] // `scripts/fuzz` sets `fuzzing`

mod corpus;
#[cfg(fuzzing)]
mod guided;
mod target;

pub use self::corpus::read_again;
pub use self::target::{Target, Targets};
