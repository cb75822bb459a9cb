//! Prototype of a succinct proof of the evaluation, whose verifier runs in the SP1 guest. README.md says what it shows.
//!
//! - [`field`], [`poseidon2`], [`transcript`]: KoalaBear, the hash, Fiat–Shamir. [`multilinear`], [`sumcheck`]: basics.
//! - [`matmul`]: a matrix product. [`fractions`], [`lookup`]: look-ups. [`merkle`], [`commitment`]: the commitment.
//! - [`layer`]: all of them for one linear layer of full size. [`program`]: what the guest runs.
//! - [`synthetic`]: values to prove; [`cases`]: what is measured, by [`clock`]; [`expert`]: what follows for the whole.

pub mod cases;
pub mod clock;
pub mod commitment;
pub mod expert;
pub mod field;
pub mod fractions;
pub mod layer;
pub mod lookup;
pub mod matmul;
pub mod merkle;
pub mod multilinear;
pub mod poseidon2;
pub mod program;
pub mod sumcheck;
pub mod synthetic;
pub mod transcript;
