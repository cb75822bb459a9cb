//! An argument that values were computed as a statement states. Its verifier is short enough for the SP1 guest, whatever the computation took;
//! its prover is native.
//!
//! ```
//! use zk0_argument::claim::{check, ClaimInput};
//!
//! // What the guest program reads: neither samples nor weights.
//! let input = std::fs::read("../tests/fixtures/full_size/input.bin")?;
//! let buffers: Vec<Vec<u8>> = borsh::from_slice(&input)?;
//! let (claim, _) = check(&ClaimInput::from_buffers(&buffers)?)?;
//! assert_eq!(claim.terms.eval_samples, 4);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! From the bottom up. Each folder or file uses only those above it in this list.
//!
//! - [`field`]: integers modulo the Goldilocks prime, and the extension that challenges come from.
//! - [`permutation`], [`hash`]: Poseidon2, SP1's precompile. [`tree`]: Merkle trees over rows.
//! - [`transcript`]: what the prover states, and the challenges that follow from it.
//! - [`multilinear`], [`sumcheck`]: polynomials given by their values on {0, 1}^n, and the proof of a sum over them.
//! - [`fractions`]: a sum of fractions that is zero, as look-ups need it.
//! - [`commitment`]: a commitment to many polynomials, opened at one point.
//! - [`relation`]: what an argument is about. [`protocol`]: the argument, as both sides do it, with [`gather`] and [`share`];
//!   [`party`] is what differs, and [`verify`] and `prove` are the two sides.
//! - [`expert`]: the evaluation of both models, as relations. [`claim`]: mode `succinct`, in which an argument becomes a claim.
#![cfg_attr(not(any(feature = "prove", test)), no_std)]
extern crate alloc;

pub mod claim;
pub mod commitment;
pub mod expert;
pub mod field;
pub mod form;
pub mod fractions;
pub mod gather;
pub mod hash;
pub mod layout;
pub mod multilinear;
pub mod opening;
pub mod party;
pub mod permutation;
pub mod protocol;
#[cfg(feature = "prove")]
pub mod prove;
pub mod relation;
pub mod share;
pub mod sumcheck;
pub mod transcript;
pub mod tree;
pub mod verify;
pub mod weights;

pub use zk0_circuits::vm::budget::operation;
